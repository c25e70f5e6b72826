//! Element kernels against finite differences and rigid motions.
use braid_ecs::prelude::*;
use braid_ecs::systems::{beam::Beam, bending::Bending, truss::Truss};
use std::collections::BTreeMap;

fn section() -> Section {
    Section { ea: 40.0, ei: [3.0, 5.0], gj: 2.0, ga: 70.0, mass: 0.3, inertia: 0.01 }
}

/// Elements of kind `E` along the given points, with their nodes.
fn chain<E: Element<N>, const N: usize>(points: &[DVec3], natural: NaturalShape) -> Vec<(E, [NodeId; N])> {
    let mut model = Model::new("kernel");
    let nodes: Vec<NodeId> = points.iter().map(|p| model.add_node(*p)).collect();
    let mut section = section();
    if E::NAME == "bending" {
        section.ei = [3.0, 3.0];
    }
    let chain = Chain { nodes, section, natural, orientation: Some(DVec3::new(0.1, 0.2, 1.0)), closed: false };
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    E::along(&chain, &mut Build { model: &mut model, materials: &materials, sections: &sections }).expect("a valid chain");
    model.elements::<E, N>().to_vec()
}

/// Element of kind `E` along the given points.
fn along<E: Element<N>, const N: usize>(points: &[DVec3], natural: NaturalShape) -> E {
    chain::<E, N>(points, natural)[0].0.clone()
}

/// The vector kernel, four elements at a time, against the kernel of one.
fn same_bits<E: Element<N>, const N: usize>() {
    let points: Vec<DVec3> = (0..9).map(|i| DVec3::new(i as f64, 0.1 * i as f64, 0.0)).collect();
    let state = moved(&points, 0.05);
    let (mut elements, rows): (Vec<E>, Vec<Connectivity<N>>) =
        chain::<E, N>(&points, NaturalShape::AsBuilt).into_iter().map(|(e, n)| (e, Connectivity(n.map(|n| n.0)))).unzip();
    assert!(elements.len() >= 7, "one group of four and some alone");
    let mut together = vec![EndForces::default(); elements.len()];
    E::internal_forces(&mut elements, &rows, &state[..], &mut together);
    for ((e, c), forces) in elements.iter_mut().zip(&rows).zip(&together) {
        let alone = e.internal_force(c.0.map(|r| state[r as usize]));
        for (a, b) in alone.iter().zip(&forces.0) {
            let bits = |f: &E::Force| [f.force(), f.moment()].map(|v| v.to_array().map(f64::to_bits));
            assert_eq!(bits(a), bits(b), "{}", E::NAME);
        }
    }
}

#[test]
fn four_at_once_have_the_bits_of_each_alone() {
    same_bits::<Truss, 2>();
    same_bits::<Beam, 2>();
    same_bits::<Bending, 3>();
}

fn rotated(q: DQuat, axis: usize, by: f64) -> DQuat {
    let mut v = DVec3::ZERO;
    v[axis] = by;
    DQuat::from_scaled_axis(v) * q
}

/// Largest difference between the force and the finite difference of the energy, relative to the largest force.
fn gradient_error<E: Element<N>, const N: usize>(e: &mut E, state: [NodeState; N]) -> f64 {
    let force = e.internal_force(state);
    let (mut worst, mut scale) = (0.0f64, 0.0f64);
    let h = 1e-5;
    for node in 0..N {
        for axis in 0..3 {
            let (mut plus, mut minus) = (state, state);
            plus[node].x[axis] += h;
            minus[node].x[axis] -= h;
            let fd = (e.strain_energy(plus) - e.strain_energy(minus)) / (2.0 * h);
            worst = worst.max((fd - force[node].force()[axis]).abs());
            scale = scale.max(fd.abs());
            let (mut plus, mut minus) = (state, state);
            plus[node].q = rotated(state[node].q, axis, h);
            minus[node].q = rotated(state[node].q, axis, -h);
            let fd = (e.strain_energy(plus) - e.strain_energy(minus)) / (2.0 * h);
            worst = worst.max((fd - force[node].moment()[axis]).abs());
            scale = scale.max(fd.abs());
        }
    }
    worst / scale
}

fn moved(points: &[DVec3], k: f64) -> Vec<NodeState> {
    points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let s = i as f64 + 1.0;
            let mut n = NodeState::at(*p + DVec3::new(0.1 * s * k, -0.07 * s * s * k, 0.05 * (s * 1.7).sin() * k));
            n.q = DQuat::from_scaled_axis(DVec3::new(0.3 * s, -0.4 + 0.1 * s, 0.2 * s * s) * k);
            n
        })
        .collect()
}

const LINE: [DVec3; 3] = [DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 0.1, 0.0), DVec3::new(2.0, 0.2, 0.0)];

#[test]
fn forces_are_the_gradient_of_the_energy() {
    for k in [0.01, 0.3, 1.0] {
        let s = moved(&LINE, k);
        let mut truss: Truss = along(&LINE[..2], NaturalShape::AsBuilt);
        assert!(gradient_error(&mut truss, [s[0], s[1]]) < 1e-8, "truss {k}");
        for natural in [NaturalShape::AsBuilt, NaturalShape::Straight { twist: 0.4 }] {
            let mut beam: Beam = along(&LINE[..2], natural);
            assert!(gradient_error(&mut beam, [s[0], s[1]]) < 1e-7, "beam {k}");
        }
        let mut bending: Bending = along(&LINE, NaturalShape::Straight { twist: 0.0 });
        assert!(gradient_error(&mut bending, [s[0], s[1], s[2]]) < 1e-7, "bending {k}");
    }
}

#[test]
fn rigid_motion_gives_no_force() {
    let q = DQuat::from_scaled_axis(DVec3::new(1.2, -2.0, 0.7));
    let shift = DVec3::new(3.0, -5.0, 11.0);
    let state: Vec<NodeState> = LINE.iter().map(|p| NodeState { q, ..NodeState::at(q * *p + shift) }).collect();
    let mut truss: Truss = along(&LINE[..2], NaturalShape::AsBuilt);
    let mut beam: Beam = along(&LINE[..2], NaturalShape::AsBuilt);
    let mut bending: Bending = along(&LINE, NaturalShape::AsBuilt);
    for f in truss.internal_force([state[0], state[1]]) {
        assert!(f.length() < 1e-12 * 40.0);
    }
    for f in beam.internal_force([state[0], state[1]]) {
        assert!(f.force.length() < 1e-12 * 40.0 && f.moment.length() < 1e-12 * 40.0);
    }
    for f in bending.internal_force([state[0], state[1], state[2]]) {
        assert!(f.length() < 1e-12 * 40.0);
    }
}

#[test]
fn internal_forces_balance_in_force_and_moment() {
    let s = moved(&LINE, 0.7);
    let mut beam: Beam = along(&LINE[..2], NaturalShape::AsBuilt);
    let [a, b] = beam.internal_force([s[0], s[1]]);
    assert!((a.force + b.force).length() < 1e-12 * a.force.length());
    let moment = a.moment + b.moment + s[0].x.cross(a.force) + s[1].x.cross(b.force);
    assert!(moment.length() < 1e-12 * (a.moment.length() + b.moment.length()));
}

#[test]
fn stiffness_bounds_hold_for_a_free_beam() {
    // lambda <= kappa / M for the exact 12 x 12 eigenproblem, by power iteration on finite differences.
    let mut beam: Beam = along(&[DVec3::ZERO, DVec3::X], NaturalShape::AsBuilt);
    let rest = [NodeState::at(DVec3::ZERO), NodeState::at(DVec3::X)];
    let mass = NodeMass { mass: 0.15, inertia: 0.02 };
    let bound = beam.stiffness_bound(rest, [mass; 2])[0];
    let limit = (bound.translation / mass.mass).max(bound.rotation / mass.inertia);
    let mut v: Vec<f64> = (0..12).map(|i| ((i * 7 + 3) % 11) as f64 - 4.9).collect();
    let mut lambda = 0.0;
    for _ in 0..400 {
        let h = 1e-6;
        let mut state = rest;
        for n in 0..2 {
            state[n].x += DVec3::from_slice(&v[6 * n..]) * h;
            state[n].q = DQuat::from_scaled_axis(DVec3::from_slice(&v[6 * n + 3..]) * h);
        }
        let f = beam.internal_force(state);
        for n in 0..2 {
            for k in 0..3 {
                v[6 * n + k] = f[n].force[k] / h / mass.mass;
                v[6 * n + 3 + k] = f[n].moment[k] / h / mass.inertia;
            }
        }
        lambda = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.iter_mut().for_each(|x| *x /= lambda);
    }
    assert!(lambda <= limit * (1.0 + 1e-6), "{lambda} {limit}");
    assert!(lambda > 0.6 * limit, "the bound is not wasteful: {lambda} {limit}");
}
