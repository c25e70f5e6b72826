//! Cost of a whole time step per element, from a state in the middle of a run.
//!
//! Every benchmark builds its model, runs it some way in, and then times a fixed number of steps from
//! there. Criterion's throughput is element-steps per second; compare ratios within one run.
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use std::path::Path;

/// Steps before the clock starts, and steps timed.
const WARM: usize = 400;
const STEPS: usize = 20;

/// A scene some way into its run.
fn warm(name: &str, sets: &[(&str, &str)]) -> (Simulation, u64) {
    let sets: Vec<(String, String)> = sets.iter().map(|(p, v)| (p.to_string(), v.to_string())).collect();
    let mut sim = Simulation::new(default_plugins);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}.ron"));
    let loaded = scene::load(&file, &sets, &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    sim.build(&loaded.model).unwrap_or_else(|e| panic!("{name}: {e}"));
    run::start(&mut sim, &loaded.model).unwrap_or_else(|e| panic!("{name}: {e}"));
    for _ in 0..WARM {
        sim.step();
    }
    let elements = sim.world.resource::<KindReports>().0.iter().map(|k| k.count as u64).sum();
    (sim, elements)
}

fn steps(c: &mut Criterion) {
    let cases: [(&str, &str, &[(&str, &str)]); 4] = [
        ("truss", "truss7", &[]),
        ("beam", "beam7", &[]),
        ("embedded", "embedded7", &[]),
        ("embedded, summed bending", "embedded7_sum", &[]),
    ];
    let mut group = c.benchmark_group("step");
    group.sample_size(10);
    for (label, scene, sets) in cases {
        let (mut sim, elements) = warm(scene, sets);
        group.throughput(Throughput::Elements(elements * STEPS as u64));
        group.bench_function(label, |b| {
            b.iter_batched(|| (), |()| (0..STEPS).for_each(|_| sim.step()), BatchSize::PerIteration);
        });
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
