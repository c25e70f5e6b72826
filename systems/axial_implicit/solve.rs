//! The solve: chains of one length side by side, one in each lane.
use super::chains::Chain;
use crate::systems::constraint::Constraints;
use braid_ecs::prelude::*;

/// Numbers that all bars share in one step.
#[derive(Clone, Copy)]
pub struct Step {
    pub dt: f64,
    /// Kick with what the mass damping leaves of it.
    pub kick: f64,
    pub whole_kick: f64,
    /// What the mass damping leaves of the velocity before.
    pub keep: f64,
}

/// Columns of the nodes.
pub type NodeSlices<'a> = (&'a [Position], &'a [Velocity], &'a [Force], &'a [InverseMass]);

/// Marks the end of a bar that is carried by nothing but its own row.
const PLAIN: u32 = u32::MAX;

/// What never changes about one bar of each chain, by lane.
#[derive(Clone, Debug, Default)]
struct Ends {
    rows: [[u32; 2]; 4],
    carriers: [[u32; 2]; 4],
    /// Entry of [`Pack::dummies`] of each end, or [`PLAIN`].
    hang: [[u32; 2]; 4],
}

/// Working numbers of one bar of each chain.
#[derive(Clone, Copy, Debug)]
struct Work<L> {
    rest_length: L,
    ea: L,
    t: V3<L>,
    length: L,
    /// Rate of the length before the kick.
    rate_before: L,
    /// Lengthening by transverse motion.
    turning: L,
    upper: L,
    pivot: L,
    y: L,
    /// Solution for the unit load of the last bar of a closed chain.
    z: L,
}

/// How a chain stretches with the border.
#[derive(Clone, Copy, Debug)]
struct Coupling {
    bar: usize,
    lane: usize,
    member: usize,
    axis: usize,
    coefficient: f64,
    /// Coefficient times direction now.
    gamma: f64,
}

/// `L::WIDTH` chains with the same number of bars.
#[derive(Clone, Debug)]
pub struct Pack<L> {
    closed: bool,
    ends: Vec<Ends>,
    work: Vec<Work<L>>,
    dummies: Vec<Vec<usize>>,
    couplings: Vec<Coupling>,
    /// A^-1 gamma of the members of the border that the chains feel.
    solved: Vec<(usize, Vec<L>)>,
    /// Work of the motion on the bars in the last kick, by lane (force x length).
    pub done: f64,
}

impl<L: Lane> Pack<L> {
    /// From as many chains as there are lanes.
    pub fn new(chains: &[Chain], constraints: Option<&Constraints>) -> Self {
        assert_eq!(chains.len(), L::WIDTH, "one chain a lane");
        let count = chains[0].bars.len();
        let zero = L::splat(0.0);
        let mut dummies = Vec::new();
        let mut ends = vec![Ends::default(); count];
        for (lane, chain) in chains.iter().enumerate() {
            for (e, b) in ends.iter_mut().zip(&chain.bars) {
                (e.rows[lane], e.carriers[lane], e.hang[lane]) = (b.rows, b.carriers, [PLAIN; 2]);
                for side in 0..2 {
                    if b.rows[side] != b.carriers[side]
                        && let Some(carried) = constraints.and_then(|c| c.carried(b.rows[side] as usize))
                    {
                        e.hang[lane][side] = dummies.len() as u32;
                        dummies.push(carried.dummies);
                    }
                }
            }
        }
        let work = (0..count).map(|i| Work {
            rest_length: L::from_fn(|l| chains[l].bars[i].rest_length),
            ea: L::from_fn(|l| chains[l].bars[i].ea),
            t: V3::zero(),
            length: zero,
            rate_before: zero,
            turning: zero,
            upper: zero,
            pivot: zero,
            y: zero,
            z: zero,
        });
        let of = |(lane, chain): (usize, &Chain)| -> Vec<Coupling> {
            let coupling = |&(bar, member, axis, coefficient): &(usize, usize, usize, f64)| Coupling {
                bar,
                lane,
                member,
                axis,
                coefficient,
                gamma: 0.0,
            };
            chain.couplings.iter().map(coupling).collect()
        };
        let couplings: Vec<Coupling> = chains.iter().enumerate().flat_map(of).collect();
        let members: std::collections::BTreeSet<usize> = couplings.iter().map(|c| c.member).collect();
        let solved = members.into_iter().map(|j| (j, vec![zero; count])).collect();
        Pack { closed: chains[0].closed, ends, work: work.collect(), dummies, couplings, solved, done: 0.0 }
    }

    /// Number of bars in all lanes.
    pub fn count(&self) -> usize {
        self.ends.len() * L::WIDTH
    }

    /// Rows, rest length and EA of the bars, in the order of [`Pack::tensions`].
    pub fn bars(&self) -> impl Iterator<Item = AxialBar> + '_ {
        self.ends
            .iter()
            .zip(&self.work)
            .flat_map(|(e, w)| (0..L::WIDTH).map(|l| AxialBar { rows: e.rows[l], rest_length: w.rest_length.lane(l), ea: w.ea.lane(l) }))
    }

    /// Largest 4 EA / (L m) of a bar, with the given inverse masses by row.
    pub fn frequency2(&self, light: &[f64]) -> f64 {
        let of = |e: &Ends, w: &Work<L>, l: usize| {
            let [a, b] = e.carriers[l].map(|c| light[c as usize]);
            4.0 * w.ea.lane(l) / w.rest_length.lane(l) * a.max(b)
        };
        self.ends.iter().zip(&self.work).flat_map(|(e, w)| (0..L::WIDTH).map(move |l| of(e, w, l))).fold(0.0, f64::max)
    }

    /// Assembles the matrix, factorises it, and solves for y = A^-1 r and A^-1 gamma.
    pub fn solve(&mut self, step: Step, nodes: NodeSlices<'_>, jumps: &[DVec3]) {
        self.assemble(step, nodes, jumps);
        for c in &mut self.couplings {
            let t = self.work[c.bar].t;
            c.gamma = c.coefficient * [t.x, t.y, t.z][c.axis].lane(c.lane);
        }
        for (j, column) in &mut self.solved {
            column.fill(L::splat(0.0));
            for c in self.couplings.iter().filter(|c| c.member == *j) {
                column[c.bar] = column[c.bar] + L::from_fn(|l| if l == c.lane { c.gamma } else { 0.0 });
            }
        }
        self.factorise();
    }

    fn assemble(&mut self, step: Step, (x, v, f, w): NodeSlices<'_>, jumps: &[DVec3]) {
        let Pack { ends, work, dummies, closed, .. } = self;
        let (kick, h2) = (step.kick, L::splat(step.dt * step.kick));
        let (half, dt) = (L::splat(0.5), L::splat(step.dt));
        let pad = |v: DVec3| [v.x, v.y, v.z, 0.0];
        // What the kick has added to the velocity of an end, and the velocity with it.
        let kicked = |row: usize| w[row].0 * f[row].0 * kick + jumps.get(row).copied().unwrap_or(DVec3::ZERO);
        let end = |e: &Ends, l: usize, side: usize| -> (DVec3, DVec3) {
            let c = e.carriers[l][side] as usize;
            let (mut velocity, mut added) = (v[c].0, kicked(c));
            if e.hang[l][side] != PLAIN {
                for d in &dummies[e.hang[l][side] as usize] {
                    velocity += v[*d].0;
                    added += kicked(*d);
                }
            }
            (velocity, added)
        };
        let mut before: Option<(V3<L>, V3<L>)> = None;
        let mut first: Option<(V3<L>, V3<L>)> = None;
        let last = ends.len() - 1;
        for (i, e) in ends.iter().enumerate() {
            let [dx, dy, dz, _] = L::rows(|l| pad(x[e.rows[l][1] as usize].0 - x[e.rows[l][0] as usize].0));
            let ([vx, vy, vz, _], [kx, ky, kz, _]);
            {
                let (mut dv, mut dk) = ([[0.0; 4]; 4], [[0.0; 4]; 4]);
                for l in 0..L::WIDTH {
                    let ((va, ka), (vb, kb)) = (end(e, l, 0), end(e, l, 1));
                    (dv[l], dk[l]) = (pad(vb - va), pad(kb - ka));
                }
                [vx, vy, vz, _] = L::rows(|l| dv[l]);
                [kx, ky, kz, _] = L::rows(|l| dk[l]);
            }
            let (d, dv, dk) = (V3::new(dx, dy, dz), V3::new(vx, vy, vz), V3::new(kx, ky, kz));
            let [ax, ay, az, _] = L::rows(|l| pad(w[e.carriers[l][0] as usize].0));
            let [bx, by, bz, _] = L::rows(|l| pad(w[e.carriers[l][1] as usize].0));
            let (wa, wb) = (V3::new(ax, ay, az), V3::new(bx, by, bz));
            let b = &mut work[i];
            let l = d.dot(d).sqrt();
            let t = d * (L::splat(1.0) / l);
            // The turning of the bar from the velocity before the kick: the kick alone holds forces
            // that the tension balances, and would lengthen a bar at rest.
            let calm = dv - dk;
            let along = t.dot(calm);
            let across = calm - t * along;
            b.t = t;
            b.length = l;
            b.rate_before = along / L::splat(step.keep);
            b.turning = half * dt * dt * across.dot(across) / l;
            b.y = l - b.rest_length + dt * t.dot(dv) + b.turning;
            let times = |a: V3<L>, b: V3<L>| V3::new(a.x * b.x, a.y * b.y, a.z * b.z);
            b.pivot = b.rest_length / b.ea + h2 * t.dot(times(wa + wb, t));
            b.z = L::splat(0.0);
            // The neighbour before shares the first end of this bar.
            if let Some((t_before, w_shared)) = before {
                work[i - 1].upper = -(h2 * t_before.dot(times(w_shared, t)));
            }
            first = first.or(Some((t, wa)));
            before = Some((t, wb));
        }
        if *closed && let (Some((t, w)), Some((t_first, _))) = (before, first) {
            work[last].upper = -(h2 * t.dot(V3::new(w.x * t_first.x, w.y * t_first.y, w.z * t_first.z)));
        }
    }

    /// Thomas algorithm on the open part; a ring leaves its last bar out and puts it back in the end.
    fn factorise(&mut self) {
        let Pack { closed, work, solved, .. } = self;
        let n = work.len();
        let m = if *closed { n - 1 } else { n };
        let ring = work[n - 1];
        if *closed {
            let wrap = work[n - 2].upper;
            work[0].z = work[0].z + ring.upper;
            work[m - 1].z = work[m - 1].z + wrap;
        }
        let one = L::splat(1.0);
        // From here on the pivot holds its inverse.
        work[0].pivot = one / work[0].pivot;
        for i in 1..m {
            let before = work[i - 1];
            let factor = before.upper * before.pivot;
            let b = &mut work[i];
            b.pivot = one / (b.pivot - factor * before.upper);
            b.y = b.y - factor * before.y;
            if *closed {
                b.z = b.z - factor * before.z;
            }
            for (_, column) in solved.iter_mut() {
                column[i] = column[i] - factor * column[i - 1];
            }
        }
        let (mut y, mut z) = (L::splat(0.0), L::splat(0.0));
        for i in (0..m).rev() {
            let b = &mut work[i];
            let upper = if i + 1 < m { b.upper } else { L::splat(0.0) };
            b.y = (b.y - upper * y) * b.pivot;
            y = b.y;
            if *closed {
                b.z = (b.z - upper * z) * b.pivot;
                z = b.z;
            }
            for (_, column) in solved.iter_mut() {
                let next = if i + 1 < m { column[i + 1] } else { L::splat(0.0) };
                column[i] = (column[i] - upper * next) * b.pivot;
            }
        }
        if *closed {
            let (wrap, before) = (ring.upper, work[n - 2].upper);
            let pivot = ring.pivot - wrap * work[0].z - before * work[m - 1].z;
            let y = (ring.y - wrap * work[0].y - before * work[m - 1].y) / pivot;
            work[n - 1].y = y;
            for b in &mut work[..m] {
                b.y = b.y - b.z * y;
            }
            for (_, column) in solved.iter_mut() {
                let c = (column[n - 1] - wrap * column[0] - before * column[m - 1]) / pivot;
                column[n - 1] = c;
                for (b, value) in work[..m].iter().zip(column.iter_mut()) {
                    *value = *value - b.z * c;
                }
            }
        }
    }

    /// Adds -gamma^t A^-1 r and gamma^t A^-1 gamma of all lanes; `n` members.
    pub fn load_border(&self, load: &mut [f64], stiffness: &mut [f64]) {
        let n = load.len();
        for c in &self.couplings {
            load[c.member] -= c.gamma * self.work[c.bar].y.lane(c.lane);
            for (k, column) in &self.solved {
                stiffness[c.member * n + k] += c.gamma * column[c.bar].lane(c.lane);
            }
        }
    }

    /// Tensions with the border's motion, and the work of the motion on the bars: the kick takes just
    /// this out of the kinetic energy.
    pub fn finish(&mut self, step: Step, border: &[f64]) {
        for (j, column) in &self.solved {
            let push = L::splat(step.dt * border[*j]);
            for (b, z) in self.work.iter_mut().zip(column) {
                b.y = b.y + push * *z;
            }
        }
        let (one, half, kick, dt) = (L::splat(1.0), L::splat(0.5), L::splat(step.whole_kick), L::splat(step.dt));
        let mut done = L::splat(0.0);
        for b in &self.work {
            let after = b.rest_length * (one + b.y / b.ea);
            let rate_after = (after - b.length - b.turning) / dt;
            done = done + half * b.y * (b.rate_before + rate_after) * kick;
        }
        self.done = (0..L::WIDTH).map(|l| done.lane(l)).sum();
    }

    /// Calls `pull` with tension, pull on the first end, carriers, and the dummies behind both ends of each bar.
    pub fn tensions(&self, mut pull: impl FnMut(f64, DVec3, [u32; 2], [&[usize]; 2])) {
        let behind = |hang: u32| if hang == PLAIN { &[][..] } else { &self.dummies[hang as usize][..] };
        for (e, b) in self.ends.iter().zip(&self.work) {
            let p = b.t * b.y;
            for l in 0..L::WIDTH {
                pull(b.y.lane(l), p.lane(l), e.carriers[l], e.hang[l].map(behind));
            }
        }
    }
}
