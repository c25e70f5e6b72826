//! The RON scene: from the text of a file to a [`Model`](crate::model::Model).
pub mod error;
pub mod schema;
pub mod spans;
pub mod units;

/// The RON dialect of scenes: `Some` and newtype names may be left out.
pub fn ron_options() -> ron::Options {
    ron::Options::default()
        .with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
        .with_default_extension(ron::extensions::Extensions::UNWRAP_NEWTYPES)
}
