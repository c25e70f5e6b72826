//! Stepping through a run at a prompt: `braid-ecs step SCENE`, in builds with debug assertions.
//!
//! | file | what |
//! |---|---|
//! | `session.rs` | a simulation between or within its steps; runs, stops, goes back |
//! | `drive.rs` | the step system by system, through bevy's `Stepping` |
//! | `past.rs` | saved states, from which any earlier step is made again with the same bits |
//! | `stops.rs` | breaks and watches |
//! | `expression.rs`, `reading.rs` | conditions, and the numbers that they are made of |
//! | `inspect.rs`, `units.rs` | components and resources by name, with units |
//! | `address.rs` | which node, element, contact is meant |
//! | `commands.rs` | the table of commands; `print.rs`, `survey.rs`, `pictures.rs` what they show |
//! | `prompt.rs`, `text.rs` | terminal, script, pipe; numbers and tables |
//!
//! Nothing here knows any system or element: what is remembered is shown, by the names of its types.
mod address;
mod commands;
mod drive;
mod expression;
pub(crate) mod inspect;
mod past;
mod pictures;
mod print;
mod prompt;
mod reading;
mod session;
mod stops;
mod survey;
mod text;
mod units;

pub use commands::Reply;
pub use prompt::{ScriptError, ask, run_script};
pub use session::Session;
