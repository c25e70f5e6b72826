//! Random edits of good scenes, studies and checkpoints: no panic, no hang, little memory. `fuzz/` feeds the same functions from
//! libFuzzer. `BRAID_FUZZ` tells how many inputs each test makes.
#[path = "support/feed.rs"]
mod feed;
use braid_ecs::memory;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::path::Path;
use std::time::{Duration, Instant};

/// Largest memory that the program may have taken (bytes).
const MOST_MEMORY: u64 = 1 << 30;

fn inputs() -> u32 {
    std::env::var("BRAID_FUZZ").map_or(2000, |n| n.parse().expect("a number of inputs"))
}

/// The files of folders, the small ones: they are read most often.
fn files(folders: &[&str]) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths: Vec<_> =
        folders.iter().flat_map(|f| std::fs::read_dir(root.join(f)).expect("a folder")).map(|e| e.expect("an entry").path()).collect();
    paths.sort();
    paths.retain(|p| p.extension().is_some_and(|e| e == "ron"));
    paths.iter().map(|p| std::fs::read(p).expect("a file")).filter(|b| b.len() < 6000).collect()
}

/// Feeds edited inputs; `feed` tells whether one was sound.
fn fuzz(name: &str, seeds: &[Vec<u8>], feed: fn(&[u8]) -> bool) {
    let others: Vec<&[u8]> = seeds.iter().map(Vec::as_slice).collect();
    let config = ProptestConfig { cases: inputs(), failure_persistence: None, ..ProptestConfig::default() };
    let (mut sound, mut slowest, begin) = (0u32, Duration::ZERO, Instant::now());
    let counts = std::cell::RefCell::new((&mut sound, &mut slowest));
    let edits = (0..seeds.len(), vec((any::<u8>(), any::<u32>(), any::<u32>()), 0..6));
    TestRunner::new(config)
        .run(&edits, |(seed, edits)| {
            let input = feed::edited(&seeds[seed], &others, &edits);
            let one = Instant::now();
            let good = feed(&input);
            let (sound, slowest) = &mut *counts.borrow_mut();
            **sound += u32::from(good);
            **slowest = one.elapsed().max(**slowest);
            Ok(())
        })
        .unwrap_or_else(|e| panic!("{name}: {e}"));
    let peak = memory::peak();
    let inputs = inputs();
    println!(
        "{name}: {inputs} inputs in {:.0} s, {sound} sound, the slowest took {slowest:.2?}, memory {}",
        begin.elapsed().as_secs_f64(),
        peak.map_or("-".into(), memory::text)
    );
    assert!(sound > 0 && sound < inputs, "{name}: {sound} of {inputs} sound: the edits are too wild or too tame");
    assert!(peak.is_none_or(|p| p < MOST_MEMORY), "{name}: {peak:?}");
}

#[test]
fn scenes() {
    fuzz("scenes", &files(&["scenes/verification", "scenes/bad", "scenes/bench", "examples/scenes"]), feed::scene);
}

#[test]
fn studies() {
    fuzz("studies", &files(&["scenes/studies"]), feed::study);
}

#[test]
fn checkpoints() {
    fuzz("checkpoints", &[feed::good_checkpoint()], feed::checkpoint);
}
