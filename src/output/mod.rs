//! What a run leaves behind: ParaView frames, pictures, histories, plots, a summary.
//!
//! | file | content |
//! |---|---|
//! | `recorder.rs`, `recorder/` | watches a run and fills its folder; what it remembers for a resumed run |
//! | `sampling.rs` | when something is written |
//! | `history.rs`, `summary.rs` | `history.csv`, `summary.json` and the hash of the state |
//! | `lines.rs`, `frame.rs`, `vtp.rs` | the lines of a model as ParaView polylines |
//! | `picture.rs`, `render/` | shaded tubes as PNG |
//! | `plot.rs`, `page.rs` | diagrams as SVG; the look of pages with them |
//! | `measured.rs`, `expected.rs`, `quality.rs` | what a scene asks to be measured and expects; how good the state is |
//! | `timing.rs` | wall time of a step by set |
//! | `failure.rs` | why and where a run has failed |
//! | `status.rs`, `pace.rs`, `control.rs` | how far a run has come and how fast it goes, for others to see; what it is told |
//! | `provenance.rs` | what made a file |
//! | `disk.rs` | what files are written with; tests let it fail |
//! | `file.rs` | whole files or none, folders that are never overwritten silently |
pub mod control;
pub mod disk;
pub mod expected;
pub mod failure;
pub mod file;
pub mod frame;
pub mod history;
pub mod lines;
pub mod measured;
pub mod pace;
pub(crate) mod page;
pub mod picture;
pub mod plot;
pub mod provenance;
pub mod quality;
pub mod recorder;
pub mod render;
pub mod sampling;
pub mod status;
pub mod summary;
pub mod timing;
pub mod vtp;

pub use file::OutputError;
pub use recorder::{Outcome, Recorder};
