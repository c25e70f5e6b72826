//! The text of a scene file.
#![no_main]
#[path = "../../tests/support/feed.rs"]
mod feed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    feed::scene(bytes);
});
