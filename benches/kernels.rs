//! Cost of one element kernel, without columns, sums or contact.
use braid_ecs::prelude::*;
use braid_ecs::systems::{beam::Beam, bending::Bending, truss::Truss};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::collections::BTreeMap;
use std::hint::black_box;

/// Elements per pass: enough to hide the loop, few enough for the first cache.
const COUNT: usize = 256;

fn elements<E: Element<N>, const N: usize>() -> Vec<E> {
    let mut model = Model::new("kernel");
    let nodes: Vec<NodeId> = (0..COUNT + N).map(|i| model.add_node(DVec3::X * i as f64)).collect();
    let section = Section { ea: 40.0, ei: [3.0, 3.0], gj: 2.0, ga: f64::INFINITY, mass: 0.3, inertia: 0.01 };
    let chain = Chain { nodes, section, natural: NaturalShape::Straight { twist: 0.0 }, orientation: None, closed: false };
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    E::along(&chain, &mut Build { model: &mut model, materials: &materials, sections: &sections }).expect("a valid chain");
    model.elements::<E, N>().iter().take(COUNT).map(|e| e.0.clone()).collect()
}

fn kernel<E: Element<N>, const N: usize>(c: &mut Criterion) {
    let mut list = elements::<E, N>();
    let states: Vec<NodeState> = (0..COUNT + N)
        .map(|i| {
            let s = i as f64;
            let mut n = NodeState::at(DVec3::new(1.01 * s, 0.1 * s.sin(), 0.1 * s.cos()));
            n.q = DQuat::from_scaled_axis(DVec3::new(0.01, 0.02, -0.01) * (s * 0.3).sin());
            n
        })
        .collect();
    let mut group = c.benchmark_group("kernel");
    group.throughput(Throughput::Elements(COUNT as u64));
    group.bench_function(E::NAME, |b| {
        b.iter(|| {
            for (i, e) in list.iter_mut().enumerate() {
                black_box(e.internal_force(std::array::from_fn(|k| states[i + k])));
            }
        });
    });
    group.finish();
}

criterion_group!(benches, kernel::<Truss, 2>, kernel::<Beam, 2>, kernel::<Bending, 3>);
criterion_main!(benches);
