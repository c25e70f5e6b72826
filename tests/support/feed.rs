//! What the fuzzers feed, and the edits that make odd inputs of good ones; shared by `tests/fuzz.rs` and `fuzz/`.
#![allow(dead_code)]
use braid_ecs::checkpoint::{Checkpoint, Header, SceneHash};
use braid_ecs::output::recorder::RecorderState;
use braid_ecs::prelude::*;
use braid_ecs::systems::default_plugins;
use braid_ecs::{run, scene, study};
use std::cell::RefCell;

/// Structures beyond this are refused, so that a million inputs stay quick (bytes; about 9000 elements).
const MEMORY: u64 = 64 << 20;

/// A scene: it is read, or every fault has a message and a place. True if it is sound.
pub fn scene(bytes: &[u8]) -> bool {
    thread_local!(static PROGRAM: Simulation = Simulation::new(default_plugins));
    let text = String::from_utf8_lossy(bytes).into_owned();
    PROGRAM.with(|sim| match scene::load_text_within(Some(MEMORY), "fuzz.ron", text, &[], &sim.registry) {
        Ok(_) => true,
        Err(errors) => {
            placed(&errors);
            false
        }
    })
}

/// A study file: as [`scene`].
pub fn study(bytes: &[u8]) -> bool {
    match study::load_text("fuzz.ron", String::from_utf8_lossy(bytes).into_owned()) {
        Ok(_) => true,
        Err(errors) => {
            placed(&errors);
            false
        }
    }
}

fn placed(errors: &scene::error::SceneErrors) {
    assert!(!errors.errors.is_empty());
    for e in &errors.errors {
        let (line, column) = e.place();
        assert!(!e.message.is_empty() && line >= 1 && column >= 1);
        let _ = e.word();
    }
    let _ = errors.to_string();
}

const SCENE: &str = r#"(
    units: Consistent,
    sections: { "s": Stiffness(ea: 100, ei: 1, gj: 1, mass: 1) },
    nodes: [[0, 0, 0], [1, 0, 0], [0.5, -0.5, 0.19], [0.5, 0.5, 0.19]],
    elements: { "beam": [(nodes: [0, 1], section: "s"), (nodes: [2, 3], section: "s")] },
    filaments: [(nodes: [0, 1], radius: 0.1), (nodes: [2, 3], radius: 0.1)],
    contact: (initial_overlap: Offset, stiffness: 100),
    fixed: [(nodes: [0, 2], dofs: [U, R])],
    stop: (steps: 10),
)"#;

/// A simulation with beams in contact, and a checkpoint of it.
struct Running {
    sim: Simulation,
    state: Vec<u8>,
    checkpoint: Vec<u8>,
}

fn running() -> Running {
    let mut sim = Simulation::new(default_plugins);
    let loaded = scene::load_text("fuzz.ron", SCENE.into(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    sim.build(&loaded.model).and_then(|()| run::start(&mut sim, &loaded.model)).expect("a sound model");
    (0..5).for_each(|_| run::step(&mut sim).expect("stable"));
    let state = sim.save_state().expect("plain data");
    let header = Header {
        program: env!("CARGO_PKG_VERSION").into(),
        revision: "fuzz".into(),
        scene: "fuzz.ron".into(),
        scene_hash: SceneHash::of(SCENE),
        step: 5,
        time: 1.0,
        sample_interval: 1.0,
        duration: None,
        until: None,
        ended: None,
        retries: Vec::new(),
    };
    let checkpoint = Checkpoint { header, recorder: RecorderState::default(), state: state.clone() };
    Running { sim, state, checkpoint: checkpoint.encode().expect("plain data") }
}

thread_local!(static RUNNING: RefCell<Running> = RefCell::new(running()));

/// The bytes of a good checkpoint.
pub fn good_checkpoint() -> Vec<u8> {
    RUNNING.with_borrow(|r| r.checkpoint.clone())
}

/// A checkpoint, as it is and with a checksum that fits: it is refused, or a simulation goes back to it, or says why it cannot.
/// True if it is taken.
pub fn checkpoint(bytes: &[u8]) -> bool {
    let scene = SceneHash::of(SCENE);
    let mut signed = bytes[..bytes.len().saturating_sub(32)].to_vec();
    signed.extend(blake3::hash(&signed).as_bytes());
    let intact = good_checkpoint() == bytes;
    assert_eq!(Checkpoint::decode(bytes, scene).is_ok(), intact || signed == bytes && Checkpoint::decode(&signed, scene).is_ok());
    let Ok(checkpoint) = Checkpoint::decode(&signed, scene) else { return false };
    RUNNING.with_borrow_mut(|r| {
        let taken = r.sim.restore_state(&checkpoint.state).is_ok();
        let Running { sim, state, .. } = r;
        if sim.restore_state(state).is_err() {
            // A state that did not fit leaves a world of no use.
            *r = running();
        }
        taken
    })
}

/// Words that mean something, or nearly.
const WORDS: [&str; 32] = [
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ",",
    ":",
    "\"",
    "//",
    "/*",
    "*/",
    "-1",
    "0",
    "NaN",
    "inf",
    "1e999",
    "1e-320",
    "4294967296",
    "99999999999999999999",
    "\u{20ac}",
    "Some",
    "None",
    "r#\"",
    "\0",
    "\"2.5 um\"",
    "\"1 parsec\"",
    "Never",
    "Count(4000000000)",
    "[[[[[[[[",
    "all",
    "0.5",
];

/// One edit of an input: kind, place, size.
pub type Edit = (u8, u32, u32);

/// A good input after some edits; `others` are inputs to take parts from.
pub fn edited(good: &[u8], others: &[&[u8]], edits: &[Edit]) -> Vec<u8> {
    let mut out = good.to_vec();
    for (kind, place, size) in edits {
        let at = *place as usize % (out.len() + 1);
        let end = (at + *size as usize % 40).min(out.len());
        match kind % 8 {
            0 if at < out.len() => out[at] ^= 1 << (size % 8),
            1 if at < out.len() => out[at] = *size as u8,
            2 => drop(out.drain(at..end)),
            3 => {
                let part = out[at..end].to_vec();
                out.splice(at..at, part);
            }
            4 => drop(out.splice(at..end.min(at + 8), WORDS[*size as usize % WORDS.len()].bytes())),
            5 => drop(out.splice(at..at, WORDS[*size as usize % WORDS.len()].bytes())),
            6 if !others.is_empty() => {
                let other = others[*size as usize % others.len()];
                let from = (*place as usize / 7) % (other.len() + 1);
                out.splice(at..end, other[from..(from + 60).min(other.len())].iter().copied());
            }
            7 => out.truncate(at.max(out.len() / 2)),
            _ => {}
        }
    }
    out
}
