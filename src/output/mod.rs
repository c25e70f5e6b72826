//! What a run leaves behind: ParaView frames, pictures, histories, plots, a summary.
pub mod file;
pub mod frame;
pub mod history;
pub mod lines;
pub mod plot;
pub mod render;
pub mod sampling;
pub mod summary;
pub mod timing;
pub mod vtp;
