//! The text of a study file.
#![no_main]
#[path = "../../tests/support/feed.rs"]
mod feed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    feed::study(bytes);
});
