//! The solve: up to four chains of one length side by side, one in each lane.
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

/// Largest turn of a bar in a step (radian): the tension acts in the direction that the bar has before it. Only chains that fall
/// slack and whip about come near. A cable dropped from where it is slack makes 100 % of energy at turns of 0.3, 7 % at
/// 0.1, and keeps its balance to half a percent at 0.05.
const TURN: f64 = 0.05;

/// Chains of a pack.
pub const LANES: usize = L::WIDTH;
type L = f64x4;

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
    /// True if dummy nodes move the first or the second end of any of the bars.
    hangs: [bool; 2],
    /// True if all of the bars start from the node in which those before them end.
    joined: bool,
}

impl Ends {
    /// Marks what all lanes have in common, `before` being the bars before these.
    fn mark(&mut self, before: Option<&Ends>) {
        self.hangs = [0, 1].map(|side| self.hang.iter().any(|h| h[side] != PLAIN));
        let same = |b: &Ends| (0..LANES).all(|l| self.rows[l][0] == b.rows[l][1] && self.carriers[l][0] == b.carriers[l][1]);
        self.joined = !self.hangs[0] && before.is_some_and(|b| !b.hangs[1] && same(b));
    }
}

/// Place, velocity, what the kick has added to it, and inverse mass at one end of the bars.
#[derive(Clone, Copy)]
struct End {
    x: V3<L>,
    v: V3<L>,
    added: V3<L>,
    w: V3<L>,
}

/// Working numbers of one bar of each chain.
#[derive(Clone, Copy, Debug)]
struct Work {
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

/// Up to [`LANES`] chains with the same number of bars; lanes without a chain of their own repeat the last one.
#[derive(Clone, Debug)]
pub struct Pack {
    /// Number of chains.
    lanes: usize,
    closed: bool,
    ends: Vec<Ends>,
    work: Vec<Work>,
    dummies: Vec<Vec<usize>>,
    /// The ends that dummy nodes move, as for [`Pack::pull`], with their entry of `dummies`.
    hanging: Vec<(u32, u32)>,
    couplings: Vec<Coupling>,
    /// A^-1 gamma of the members of the border that the chains feel.
    solved: Vec<(usize, Vec<L>)>,
    /// Pulls of the bars on their first ends, four of each bar.
    pulls: Vec<DVec3>,
    /// Work of the motion on the bars in the last kick (force x length).
    pub done: f64,
    /// Step h in which no bar turns by more than [`TURN`]: (v + a h) h = TURN l, with the speed v at which its ends pass each other, and, if
    /// it is slack, the acceleration a of that by all other forces (time).
    pub turning_step: f64,
}

impl Pack {
    /// From chains with the same number of bars, one to [`LANES`] of them.
    pub fn new(chains: &[Chain], constraints: Option<&Constraints>) -> Self {
        let lanes = chains.len();
        let chain = |lane: usize| &chains[lane.min(lanes - 1)];
        let count = chains[0].bars.len();
        let zero = L::splat(0.0);
        let mut dummies = Vec::new();
        let mut ends = vec![Ends::default(); count];
        for lane in 0..LANES {
            for (e, b) in ends.iter_mut().zip(&chain(lane).bars) {
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
        for i in 0..count {
            let (before, rest) = ends.split_at_mut(i);
            rest[0].mark(before.last());
        }
        let work = (0..count).map(|i| Work {
            rest_length: L::from_fn(|l| chain(l).bars[i].rest_length),
            ea: L::from_fn(|l| chain(l).bars[i].ea),
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
        let sides = |i: usize| (0..2 * lanes).map(move |k| (i, k / 2, k % 2));
        let hanging = (0..count).flat_map(sides).map(|(i, l, side)| ((2 * (i * LANES + l) + side) as u32, ends[i].hang[l][side]));
        let hanging = hanging.filter(|(_, entry)| *entry != PLAIN).collect();
        let pulls = vec![DVec3::ZERO; count * LANES];
        Pack {
            lanes,
            closed: chains[0].closed,
            ends,
            work: work.collect(),
            dummies,
            hanging,
            couplings,
            solved,
            pulls,
            done: 0.0,
            turning_step: f64::INFINITY,
        }
    }

    /// Number of bars.
    pub fn count(&self) -> usize {
        self.ends.len() * self.lanes
    }

    /// Rows, rest length and EA of the bars, chain beside chain.
    pub fn bars(&self) -> impl Iterator<Item = AxialBar> + '_ {
        self.ends
            .iter()
            .zip(&self.work)
            .flat_map(|(e, w)| (0..self.lanes).map(|l| AxialBar { rows: e.rows[l], rest_length: w.rest_length.lane(l), ea: w.ea.lane(l) }))
    }

    /// Largest 4 EA / (L m) of a bar, with the given inverse masses by row.
    pub fn frequency2(&self, light: &[f64]) -> f64 {
        let of = |e: &Ends, w: &Work, l: usize| {
            let [a, b] = e.carriers[l].map(|c| light[c as usize]);
            4.0 * w.ea.lane(l) / w.rest_length.lane(l) * a.max(b)
        };
        self.ends.iter().zip(&self.work).flat_map(|(e, w)| (0..LANES).map(move |l| of(e, w, l))).fold(0.0, f64::max)
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
                column[c.bar] += L::from_fn(|l| if l == c.lane { c.gamma } else { 0.0 });
            }
        }
        self.factorise();
    }

    fn assemble(&mut self, step: Step, nodes: NodeSlices<'_>, jumps: &[DVec3]) {
        let Pack { ends, work, dummies, closed, .. } = self;
        let h2 = L::splat(step.dt * step.kick);
        let (half, dt, keep) = (L::splat(0.5), L::splat(step.dt), L::splat(1.0 / step.keep));
        let mut before: Option<End> = None;
        let mut first = None;
        let mut turning = L::splat(0.0);
        let (most, four, per_kick) = (L::splat(TURN), L::splat(4.0), L::splat(1.0 / step.kick));
        let last = ends.len() - 1;
        for (i, e) in ends.iter().enumerate() {
            let a = before.filter(|_| e.joined).unwrap_or_else(|| e.end(0, step.kick, nodes, jumps, dummies));
            let z = e.end(1, step.kick, nodes, jumps, dummies);
            let (d, dv, dk) = (z.x - a.x, z.v - a.v, z.added - a.added);
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
            b.rate_before = along * keep;
            b.turning = half * dt * dt * across.dot(across) / l;
            b.y = l - b.rest_length + dt * t.dot(dv) + b.turning;
            // No tension holds a slack bar back: what the other forces make of it turns it, too.
            let push = (dk - t * t.dot(dk)) * per_kick;
            let push = L::pick(b.rest_length.less(l), L::splat(0.0), push.dot(push).sqrt());
            let speed = across.dot(across).sqrt();
            let way = l * most;
            turning = turning.upper((speed + (speed * speed + four * push * way).sqrt()) / way);
            b.pivot = b.rest_length / b.ea + h2 * t.dot(times(a.w + z.w, t));
            b.z = L::splat(0.0);
            // The neighbour before shares the first end of this bar.
            if let Some(shared) = before {
                work[i - 1].upper = -(h2 * work[i - 1].t.dot(times(shared.w, t)));
            }
            first = first.or(Some(t));
            before = Some(z);
        }
        // Whatever is not finite is for others to say.
        let turning = (0..LANES).map(|l| turning.lane(l)).filter(|t| t.is_finite()).fold(0.0, f64::max);
        self.turning_step = 2.0 / turning;
        if *closed && let (Some(shared), Some(t_first)) = (before, first) {
            work[last].upper = -(h2 * work[last].t.dot(times(shared.w, t_first)));
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
            work[0].z += ring.upper;
            work[m - 1].z += wrap;
        }
        let one = L::splat(1.0);
        // From here on the pivot holds its inverse.
        work[0].pivot = one / work[0].pivot;
        for i in 1..m {
            let before = work[i - 1];
            let factor = before.upper * before.pivot;
            let b = &mut work[i];
            b.pivot = one / (b.pivot - factor * before.upper);
            b.y -= factor * before.y;
            if *closed {
                b.z -= factor * before.z;
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
                b.y -= b.z * y;
            }
            for (_, column) in solved.iter_mut() {
                let c = (column[n - 1] - wrap * column[0] - before * column[m - 1]) / pivot;
                column[n - 1] = c;
                for (b, value) in work[..m].iter().zip(column.iter_mut()) {
                    *value -= b.z * c;
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

    /// Tensions with the border's motion, in the order of [`Pack::bars`], and the work of the motion on the bars: the kick
    /// takes just this out of the kinetic energy.
    pub fn finish(&mut self, step: Step, border: &[f64], tensions: &mut [Tension]) {
        for (j, column) in &self.solved {
            let push = L::splat(step.dt * border[*j]);
            for (b, z) in self.work.iter_mut().zip(column) {
                b.y += push * *z;
            }
        }
        let (one, half, kick, dt) = (L::splat(1.0), L::splat(0.5), L::splat(step.whole_kick), L::splat(step.dt));
        let mut done = L::splat(0.0);
        let ends = self.pulls.chunks_exact_mut(LANES).zip(tensions.chunks_exact_mut(self.lanes));
        for (b, (pulls, tensions)) in self.work.iter().zip(ends) {
            (b.t * b.y).each(|l, pull| pulls[l] = pull);
            tensions.iter_mut().zip(b.y.to_array()).for_each(|(out, tension)| out.0 = tension);
            let after = b.rest_length * (one + b.y / b.ea);
            let rate_after = (after - b.length - b.turning) / dt;
            done += half * b.y * (b.rate_before + rate_after) * kick;
        }
        self.done = (0..self.lanes).map(|l| done.lane(l)).sum();
    }

    /// The carriers of all ends of bars, each with what asks [`Pack::pull`] for the pull on it.
    pub fn carriers(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        let of = move |i: usize, l: usize| [0, 1].map(|side| (self.ends[i].carriers[l][side], (2 * (i * LANES + l) + side) as u32));
        (0..self.ends.len()).flat_map(move |i| (0..self.lanes).flat_map(move |l| of(i, l)))
    }

    /// Pull of a bar on one of its ends.
    #[inline]
    pub fn pull(&self, end: u32) -> DVec3 {
        let pull = self.pulls[end as usize / 2];
        if end & 1 == 0 { pull } else { -pull }
    }

    /// Pulls on the ends that dummy nodes move, with these.
    pub fn hanging(&self) -> impl Iterator<Item = (DVec3, &[usize])> + '_ {
        self.hanging.iter().map(|(end, entry)| (self.pull(*end), &self.dummies[*entry as usize][..]))
    }
}

/// Component by component.
#[inline(always)]
fn times(a: V3<L>, b: V3<L>) -> V3<L> {
    V3::new(a.x * b.x, a.y * b.y, a.z * b.z)
}

impl Ends {
    /// How the bars' first (0) or second (1) ends move.
    #[inline(always)]
    fn end(&self, side: usize, kick: f64, (x, v, f, w): NodeSlices<'_>, jumps: &[DVec3], dummies: &[Vec<usize>]) -> End {
        let carrier = |l: usize| self.carriers[l][side] as usize;
        let inverse = V3::gather(|l| w[carrier(l)].0);
        let mut end = End {
            x: V3::gather(|l| x[self.rows[l][side] as usize].0),
            v: V3::gather(|l| v[carrier(l)].0),
            added: times(inverse, V3::gather(|l| f[carrier(l)].0)) * L::splat(kick),
            w: inverse,
        };
        if !jumps.is_empty() {
            end.added = end.added + V3::gather(|l| jumps[carrier(l)]);
        }
        if self.hangs[side] {
            let behind = |l: usize| match self.hang[l][side] {
                PLAIN => &[][..],
                k => &dummies[k as usize][..],
            };
            let jump = |d: usize| jumps.get(d).copied().unwrap_or(DVec3::ZERO);
            end.v = end.v + V3::gather(|l| behind(l).iter().map(|d| v[*d].0).sum());
            end.added = end.added + V3::gather(|l| behind(l).iter().map(|d| w[*d].0 * f[*d].0 * kick + jump(*d)).sum());
        }
        end
    }
}
