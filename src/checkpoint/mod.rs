//! Checkpoints: everything a run has to remember, in one file, so that it goes on as if it had never stopped.
//!
//! | file | content |
//! |---|---|
//! | `format.rs` | the bytes of a checkpoint, and what can be wrong with them |
//! | `store.rs` | the folder `checkpoints/` of a run: a ring of two, a named one at a stop and one at the end |
//! | `keeper.rs` | looks after a run between its steps: checkpoints, status, commands, time limit |
//!
//! A checkpoint holds the state of the world ([`crate::state`]) and that of the recorder
//! ([`RecorderState`](crate::output::recorder::RecorderState)). Output files are cut back to where they
//! were at the checkpoint, and what came after it is written once more, with the same bytes.
pub mod format;
pub mod keeper;
pub mod store;

pub use format::{Checkpoint, Fault, Header, SceneHash};
pub use keeper::{Keeper, Orders};
pub use store::{CheckpointError, Found, Kind, Store};
