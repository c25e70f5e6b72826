//! The RON scene: from the text of a file to a [`Model`](crate::model::Model).
//!
//! | step | file |
//! |---|---|
//! | text to tree of byte ranges | `spans.rs` |
//! | `--set path=value` edits the text | `set.rs` |
//! | more than one fault | `faults.rs` |
//! | text to [`Scene`](schema::Scene), quantities converted to scene units | `read.rs`, `schema/`, `units.rs` |
//! | scene to model, physics checked | `build/` |
//! | the same scene on a finer mesh | `refined.rs` |
//! | what is wrong, where, what would be right | `error.rs` |
mod build;
pub mod error;
mod faults;
mod read;
mod refined;
pub mod schema;
mod set;
pub mod spans;
pub mod units;

pub use read::{LoadedScene, MAX_BYTES, Words, load, load_text, load_text_within};
pub(crate) use read::{path_of, text_of};

/// The RON dialect of scenes: `Some` and newtype names may be left out.
pub fn ron_options() -> ron::Options {
    ron::Options::default()
        .with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
        .with_default_extension(ron::extensions::Extensions::UNWRAP_NEWTYPES)
}

/// Settings of something of a plugin that needs none.
pub(crate) fn nothing() -> Box<ron::value::RawValue> {
    ron::value::RawValue::from_ron("()").expect("`()` is RON").to_owned()
}
