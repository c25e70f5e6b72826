//! The whole contact stage between filaments, in ns per segment and step: centrelines, displacement
//! budget, records, sums at the nodes, with a list that lasts. Twelve tows of parallel filaments that
//! touch, as in a braid; one core.
#[path = "../tests/support/contact_rig.rs"]
mod contact_rig;
use braid_ecs::generate::Packing;
use braid_ecs::prelude::*;
use contact_rig::*;
use criterion::{Criterion, Throughput, criterion_group, criterion_main};

/// Twelve tows of hexagonally packed filaments of radius `r`, in segments of `length`, overlapping by 1 % of the diameter.
fn tows(filaments: usize, r: f64, length: f64, segments: usize) -> Rig {
    let mut model = Model::new("tows");
    let mut noise = Noise(3);
    for tow in 0..12 {
        for place in Packing::Hexagonal.sites(filaments, 1.98 * r) {
            let from = DVec3::new(place.x, place.y + 60.0 * r * f64::from(tow), noise.next() * length);
            filament(&mut model, &straight(from, DVec3::Z * length, segments + 1), r);
        }
    }
    let mut rig = Rig::new(&model, settings(1.0, length), 1.0);
    rig.settings.law.friction = 0.2;
    rig.settings.law.damping = 0.05;
    // Neighbours rub against each other, slowly enough for the list to last.
    for v in &mut rig.v {
        v.0 = noise.vector() * (0.002 * r);
    }
    rig
}

fn stage(c: &mut Criterion) {
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global().expect("the first pool");
    let mut group = c.benchmark_group("contact");
    group.sample_size(10);
    for (name, filaments, r, segments) in [("7 a tow, 9.4 um", 7, 9.4, 91), ("100 a tow, 2.5 um", 100, 2.5, 91)] {
        let mut rig = tows(filaments, r, 42.0, segments);
        group.throughput(Throughput::Elements((12 * filaments * segments * STEPS) as u64));
        group.bench_function(name, |b| {
            b.iter(|| {
                for k in 0..STEPS {
                    // Back and forth, so that every pass starts where the last one did.
                    if k == STEPS / 2 {
                        rig.v.iter_mut().for_each(|v| v.0 = -v.0);
                    }
                    for (x, v) in rig.x.iter_mut().zip(&rig.v) {
                        x.0 += v.0;
                    }
                    rig.evaluate(1.0);
                }
                rig.v.iter_mut().for_each(|v| v.0 = -v.0);
            });
        });
    }
    group.finish();
}

/// Steps per pass.
const STEPS: usize = 20;

criterion_group!(benches, stage);
criterion_main!(benches);
