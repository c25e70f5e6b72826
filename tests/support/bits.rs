//! Runs on any number of threads and in any order of systems, and their bits.
// Every test file takes what it needs.
#![allow(dead_code)]
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::systems::default_plugins;

/// Does something on a pool of its own.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads").install(work)
}

/// A simulation after some steps, with its schedule shuffled by the seed.
pub fn stepped(model: &Model, threads: usize, seed: Option<u64>, steps: usize) -> Simulation {
    let mut sim = Simulation::new(default_plugins);
    if let Some(seed) = seed {
        sim.shuffle_schedule(seed);
    }
    on_threads(threads, || {
        sim.build(model).expect("a sound model");
        run::start(&mut sim, model).expect("a stable start");
        for _ in 0..steps {
            sim.step();
        }
        sim.refresh_energies();
    });
    sim
}

/// The bits of all positions.
pub fn bits(sim: &mut Simulation) -> Vec<[u64; 3]> {
    node_states(&mut sim.world).iter().map(|s| s.x.to_array().map(f64::to_bits)).collect()
}
