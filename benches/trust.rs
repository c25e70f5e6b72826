//! What it costs to be able to trust a run: the watch, the good states that are kept in memory, the checkpoints on the disk; each as a
//! share of the run.
//!
//! Each is timed by itself in the middle of a run and set against the steps between two of them: the difference of two whole
//! runs would drown in noise. The fastest of several passes counts.
use braid_ecs::checkpoint::{Checkpoint, Header, SceneHash};
use braid_ecs::output::file::write_atomic;
use braid_ecs::output::recorder::RecorderState;
use braid_ecs::prelude::*;
use braid_ecs::scene::LoadedScene;
use braid_ecs::systems::{default_plugins, watch};
use braid_ecs::{run, scene};
use std::path::Path;
use std::time::Instant;

/// Steps before the clock starts, steps timed, passes.
const WARM: usize = 600;
const STEPS: u32 = 300;
const PASSES: u32 = 7;

/// Steps between two good states (`checkpoint/keeper.rs`), and seconds between two checkpoints by default.
const GOOD_EVERY: f64 = 4096.0;
const CHECKPOINT_EVERY: f64 = 600.0;

fn warm(name: &str) -> (Simulation, LoadedScene) {
    let mut sim = Simulation::new(default_plugins);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.ron"));
    let loaded = scene::load(&file, &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    sim.build(&loaded.model).and_then(|()| run::start(&mut sim, &loaded.model)).unwrap_or_else(|e| panic!("{name}: {e}"));
    (0..WARM).for_each(|_| sim.step());
    (sim, loaded)
}

/// Seconds of one call, the fastest of several passes of `n` calls.
fn fastest(n: u32, mut f: impl FnMut()) -> f64 {
    let pass = |f: &mut dyn FnMut()| {
        let begin = Instant::now();
        (0..n).for_each(|_| f());
        begin.elapsed().as_secs_f64() / f64::from(n)
    };
    (0..PASSES).map(|_| pass(&mut f)).fold(f64::INFINITY, f64::min)
}

fn checkpoint(sim: &mut Simulation) -> Checkpoint {
    let header = Header {
        program: env!("CARGO_PKG_VERSION").into(),
        revision: String::new(),
        scene: "a.ron".into(),
        scene_hash: SceneHash::of("a"),
        step: 0,
        time: 0.0,
        sample_interval: 1.0,
        duration: None,
        until: None,
        ended: None,
        retries: Vec::new(),
    };
    Checkpoint { header, recorder: RecorderState::default(), state: sim.save_state().expect("plain data") }
}

fn main() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("a.ckpt");
    println!("share of the run: of the watch, of the good states, of the checkpoints");
    for name in ["two_filaments", "truss7", "embedded7", "reference100"] {
        let (mut sim, loaded) = warm(name);
        let step = fastest(STEPS, || sim.step());
        let every = f64::from(loaded.model.integration.monitor_every);
        let look = fastest(100, || watch::look(&mut sim.world));
        let keep = fastest(5, || drop(std::hint::black_box(checkpoint(&mut sim))));
        let write = fastest(3, || write_atomic(&file, &checkpoint(&mut sim).encode().expect("plain data")).expect("room"));
        let bytes = std::fs::metadata(&file).expect("a file").len();
        println!(
            "{name:<14} watch {:.3} % ({:.1} us), good states {:.3} % ({:.1} ms), checkpoints {:.4} % ({:.1} ms, {:.1} MB); a step takes {:.1} us",
            100.0 * look / (every * step),
            1e6 * look,
            100.0 * keep / (GOOD_EVERY * step),
            1e3 * keep,
            100.0 * write / CHECKPOINT_EVERY,
            1e3 * write,
            bytes as f64 / 1e6,
            1e6 * step
        );
    }
}
