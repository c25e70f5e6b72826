//! Checks of the kernel on one element.
use super::{Finding, Specimen};
use crate::element::{Element, NodeForce, NodeState, StiffnessBound};
use glam::{DQuat, DVec3};

/// Rounding of a few hundred operations, with the digits lost by moving far away.
const ROUNDING: f64 = 1e-10;
/// Step of central differences over the size of the element: the error of the difference, of the order of
/// the square of it, and the rounding, 1e-16 over it, are both far below 1e-5.
const STEP: f64 = 1e-5;
/// Numbers of the deformed shapes that are looked at.
const SHAPES: std::ops::Range<u32> = 1..4;

/// Scattered numbers between -1 and 1, the same in every run: the finaliser of SplitMix64 (Steele et al.
/// 2014). Numbers in even steps would leave nodes in a row in a row.
fn scatter(shape: u32, k: usize) -> f64 {
    let mut z = (u64::from(shape) << 32 | k as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    2.0 * ((z >> 11) as f64 / (1u64 << 53) as f64) - 1.0
}

fn scattered(shape: u32, k: usize) -> DVec3 {
    DVec3::new(scatter(shape, 3 * k), scatter(shape, 3 * k + 1), scatter(shape, 3 * k + 2))
}

/// Force and moment on every node.
type Ends<const N: usize> = [(DVec3, DVec3); N];

/// What is needed of all checks: the element from its initial state, whatever it remembers.
struct Bench<'a, E: Element<N>, const N: usize>(&'a Specimen<E, N>);

impl<E: Element<N>, const N: usize> Bench<'_, E, N> {
    fn force(&self, state: [NodeState; N]) -> Ends<N> {
        self.0.element.clone().internal_force(state).map(|f| (f.force(), f.moment()))
    }

    /// Strain energy of the element after it has felt this state.
    fn energy(&self, state: [NodeState; N]) -> f64 {
        let mut element = self.0.element.clone();
        element.internal_force(state);
        element.strain_energy(state)
    }

    fn deformed(&self, shape: u32) -> [NodeState; N] {
        let mut state = self.0.rest();
        for (k, s) in state.iter_mut().enumerate() {
            s.x += scattered(shape, k) * (self.0.deformation * self.0.size());
            if E::Force::ROTATIONS {
                s.q = DQuat::from_scaled_axis(scattered(shape, k + N) * self.0.deformation);
            }
        }
        state
    }

    /// One degree of freedom moved: a displacement, or a rotation in global axes.
    fn nudged(&self, mut state: [NodeState; N], freedom: usize, by: f64) -> [NodeState; N] {
        let (node, k) = (freedom / Specimen::<E, N>::FREEDOMS, freedom % Specimen::<E, N>::FREEDOMS);
        if k < 3 {
            state[node].x[k] += by;
        } else {
            let mut turn = DVec3::ZERO;
            turn[k - 3] = by;
            state[node].q = DQuat::from_scaled_axis(turn) * state[node].q;
        }
        state
    }

    fn freedoms(&self) -> usize {
        N * Specimen::<E, N>::FREEDOMS
    }

    /// Step of a difference in one degree of freedom.
    fn step(&self, freedom: usize) -> f64 {
        if freedom % Specimen::<E, N>::FREEDOMS < 3 { STEP * self.0.size() } else { STEP }
    }

    /// The tangent stiffness by central differences of the internal force, row by row.
    fn tangent(&self, state: [NodeState; N]) -> Vec<Vec<f64>> {
        let n = self.freedoms();
        let mut k = vec![vec![0.0; n]; n];
        for j in 0..n {
            let h = self.step(j);
            let (plus, minus) = (flat::<E, N>(self.force(self.nudged(state, j, h))), flat::<E, N>(self.force(self.nudged(state, j, -h))));
            for i in 0..n {
                k[i][j] = (plus[i] - minus[i]) / (2.0 * h);
            }
        }
        k
    }

    /// Largest eigenvalue of M^-1/2 K M^-1/2 with the symmetric part of K (under load the rotations
    /// of a tangent do not commute); degrees of freedom without inertia are left out.
    fn largest_eigenvalue(&self, k: &[Vec<f64>]) -> f64 {
        let n = self.freedoms();
        let root: Vec<f64> = (0..n)
            .map(|i| {
                let m = self.0.masses[i / Specimen::<E, N>::FREEDOMS];
                let inertia = if i % Specimen::<E, N>::FREEDOMS < 3 { m.mass } else { m.inertia };
                if inertia > 0.0 { inertia.sqrt().recip() } else { 0.0 }
            })
            .collect();
        let a: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| 0.5 * (k[i][j] + k[j][i]) * root[i] * root[j]).collect()).collect();
        // The norm bounds all eigenvalues; shifted by it none is negative, and the largest is the one found.
        let shift = a.iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max);
        let mut v: Vec<f64> = (0..n).map(|i| scatter(7, i)).collect();
        let mut lambda = 0.0;
        for _ in 0..2000 {
            let mut w: Vec<f64> = (0..n).map(|i| shift * v[i] + a[i].iter().zip(&v).map(|(a, v)| a * v).sum::<f64>()).collect();
            let norm = w.iter().map(|x| x * x).sum::<f64>().sqrt();
            if norm == 0.0 {
                return 0.0;
            }
            w.iter_mut().for_each(|x| *x /= norm);
            (v, lambda) = (w, norm);
        }
        lambda - shift
    }

    /// Largest omega^2 that the bounds of the element give.
    fn bound(&self, state: [NodeState; N]) -> f64 {
        let bounds: [StiffnessBound; N] = self.0.element.stiffness_bound(state, self.0.masses);
        let one = |(b, m): (&StiffnessBound, &crate::element::NodeMass)| {
            let turn = if E::Force::ROTATIONS && m.inertia > 0.0 { b.rotation / m.inertia } else { 0.0 };
            (b.translation / m.mass).max(turn)
        };
        bounds.iter().zip(&self.0.masses).map(one).fold(0.0, f64::max)
    }
}

/// The end forces as one list in the order of the degrees of freedom.
fn flat<E: Element<N>, const N: usize>(ends: Ends<N>) -> Vec<f64> {
    let one = |(f, m): (DVec3, DVec3)| f.to_array().into_iter().chain(m.to_array()).take(Specimen::<E, N>::FREEDOMS).collect::<Vec<_>>();
    ends.into_iter().flat_map(one).collect()
}

/// The worst of several values, with what was looked at when it came up.
struct Worst(f64, String);

impl Worst {
    fn none() -> Self {
        Worst(0.0, String::new())
    }

    fn see(&mut self, value: f64, at: impl FnOnce() -> String) {
        // NaN is worse than anything and stays.
        if !self.0.is_nan() && (value.is_nan() || value > self.0) {
            *self = Worst(value, at());
        }
    }

    fn finding(self, name: &'static str, most: f64, meaning: &str) -> Finding {
        Finding { name, value: self.0, least: 0.0, most, meaning: format!("{meaning} ({})", self.1) }
    }
}

const NAMES: [&str; 6] = ["force x", "force y", "force z", "moment x", "moment y", "moment z"];

/// All findings but the one about threads.
pub(super) fn findings<E: Element<N>, const N: usize>(s: &Specimen<E, N>) -> Vec<Finding> {
    let bench = Bench(s);
    let (rest, size) = (s.rest(), s.size());
    let tangent = bench.tangent(rest);
    // Forces are compared with those that a deformation of 1 would give, moments with them times the size.
    let stiffness = |state: [NodeState; N]| {
        let b = s.element.stiffness_bound(state, s.masses);
        b.iter().map(|b| b.translation).fold(0.0, f64::max)
    };
    let lever = |i: usize| if i % Specimen::<E, N>::FREEDOMS < 3 { 1.0 } else { size };
    let entries = tangent.iter().enumerate().flat_map(|(i, row)| row.iter().enumerate().map(move |(j, k)| (i, j, k.abs())));
    let steep = entries.map(|(i, j, k)| k / (lever(i) * lever(j))).fold(stiffness(rest), f64::max);
    let (force_scale, energy_scale) = (steep * size, steep * size * size);

    let (mut rigid_force, mut rigid_energy, mut objective) = (Worst::none(), Worst::none(), Worst::none());
    for shape in SHAPES {
        // Rotations of several radians: far beyond any linearisation.
        let turn = DQuat::from_scaled_axis(scattered(shape, 20) * 2.5);
        let shift = scattered(shape, 21) * (10.0 * size);
        let moved = |state: [NodeState; N]| state.map(|n| NodeState { x: turn * n.x + shift, q: turn * n.q, ..n });
        let what = || format!("translation by {shift:.3}, rotation by {:.3} rad", turn.to_scaled_axis().length());
        for (f, m) in bench.force(moved(rest)) {
            rigid_force.see((f.length() + m.length() / size) / force_scale, what);
        }
        rigid_energy.see(bench.energy(moved(rest)).abs() / energy_scale, what);
        let deformed = bench.deformed(shape);
        for (before, after) in bench.force(deformed).into_iter().zip(bench.force(moved(deformed))) {
            let difference = (turn * before.0 - after.0).length() + (turn * before.1 - after.1).length() / size;
            objective.see(difference / force_scale, what);
        }
    }

    let (mut gradient, mut force_sum, mut moment_sum) = (Worst::none(), Worst::none(), Worst::none());
    for shape in SHAPES {
        let state = bench.deformed(shape);
        let ends = bench.force(state);
        let list = flat::<E, N>(ends);
        let largest = ends.iter().map(|(f, m)| f.length() + m.length() / size).fold(0.0, f64::max);
        for (i, force) in list.iter().enumerate() {
            let (node, k) = (i / Specimen::<E, N>::FREEDOMS, i % Specimen::<E, N>::FREEDOMS);
            let h = bench.step(i);
            let slope = (bench.energy(bench.nudged(state, i, h)) - bench.energy(bench.nudged(state, i, -h))) / (2.0 * h);
            gradient.see((slope - force).abs() / (lever(i) * largest), || {
                format!("{} on node {node} of shape {shape}: the force is {force:.6e}, dE/dx is {slope:.6e}", NAMES[k])
            });
        }
        let sum: DVec3 = ends.iter().map(|e| e.0).sum();
        let moment: DVec3 = ends.iter().zip(&state).map(|((f, m), n)| *m + n.x.cross(*f)).sum();
        let reach = state.iter().map(|n| n.x.length()).fold(size, f64::max);
        force_sum.see(sum.length() / largest, || format!("a sum of {:.6e} in shape {shape}", sum.length()));
        moment_sum.see(moment.length() / (reach * largest), || format!("a sum of {:.6e} in shape {shape}", moment.length()));
    }
    let step = |name, state, least, k: &[Vec<f64>]| {
        let (omega2, bound) = (bench.largest_eigenvalue(k), bench.bound(state));
        // Frequencies over those of the bound are the steps of the bound over the exact ones.
        let ratio = (omega2.max(0.0) / bound).sqrt();
        let meaning = format!(
            "`stiffness_bound` allows steps of {:.6e}, the element {:.6e}: {}",
            2.0 / bound.sqrt(),
            2.0 / omega2.sqrt(),
            if ratio > 1.0 {
                "the bound is below the tangent stiffness and runs blow up"
            } else {
                "the bound is far above the tangent stiffness"
            }
        );
        Finding { name, value: ratio, least, most: 1.0 + 1e-6, meaning }
    };
    let far = bench.deformed(1);
    vec![
        rigid_force.finding("rigid motion force", ROUNDING, "a rigid motion makes a force, or the initial shape is not free of stress"),
        rigid_energy.finding("rigid motion energy", ROUNDING, "a rigid motion stores energy, or the initial shape is not free of stress"),
        objective.finding("objectivity", ROUNDING, "the forces do not turn with the element"),
        gradient.finding("force is gradient", 1e-5, "the internal force is not the derivative of the strain energy"),
        force_sum.finding("force balance", ROUNDING, "the end forces do not balance: momentum is made"),
        moment_sum.finding("moment balance", ROUNDING, "the end forces and moments turn the element: angular momentum is made"),
        step("time step", rest, 0.5, &tangent),
        step("time step deformed", far, 0.0, &bench.tangent(far)),
    ]
}
