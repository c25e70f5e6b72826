//! The bytes of a checkpoint: edits of a good one, nine bytes each, or any bytes after a 255.
#![no_main]
#[path = "../../tests/support/feed.rs"]
mod feed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Some(raw) = bytes.strip_prefix(&[255]) {
        feed::checkpoint(raw);
        return;
    }
    let number = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let edits: Vec<feed::Edit> = bytes.chunks_exact(9).map(|c| (c[0], number(&c[1..5]), number(&c[5..9]))).collect();
    feed::checkpoint(&feed::edited(&feed::good_checkpoint(), &[], &edits));
});
