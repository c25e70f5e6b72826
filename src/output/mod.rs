//! What a run leaves behind: ParaView frames, pictures, histories, plots, a summary.
pub mod file;
pub mod history;
pub mod plot;
pub mod render;
pub mod sampling;
pub mod vtp;
