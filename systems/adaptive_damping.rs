//! Mass damping that follows the motion once it has calmed down: dynamic relaxation with the least delay.
//!
//! On the way to its resting place a structure moves with the damping of the scene, because friction remembers the way.
//! When its kinetic energy has fallen to a small share of its largest value, what is left is the swing about the resting
//! place. It dies soonest just below the critical damping of its slowest mode, alpha = 2 omega, and omega follows from
//! Rayleigh's quotient of the motion between two looks, omega^2 = -sum m da.dx / sum m dx.dx (P. Underwood, in
//! *Computational Methods for Transient Analysis* (1983), chapter 5). The rate is never below that of the scene.
//!
//! Where nothing tells the time of the problem beforehand, [`NaturalTime`] finds it in the same way from the first step on.
//! It corrects itself: with a rate too high the slow motion creeps, and what creeps has the quotient of its own slow mode; with
//! a rate too low it swings, and a swing has that of its frequency.
use crate::systems::integration::MassDamping;
use braid_ecs::prelude::*;
use std::collections::VecDeque;

/// Share of the largest kinetic energy below which the motion counts as calm.
const CALM: f64 = 0.02;
/// Looks per 1 / rate: far less than a swing, far more than the vibrations of single nodes.
const LOOKS: f64 = 8.0;
/// Largest rate over that of the scene.
const MOST: f64 = 30.0;
/// Rate over the omega seen: a little less than critical, since vibrations of single nodes raise what is seen.
const DAMPED: f64 = 1.4;
/// What is kept of the sums at a look.
const KEPT: f64 = 0.75;

/// Registers the damping, for models that ask for it.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("adaptive damping", install);
}

/// What the damping has seen.
#[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
pub struct Settling {
    /// Rate of the scene (1 / time).
    rate: f64,
    /// Rate now (1 / time).
    pub now: f64,
    /// Time of the next look.
    next: f64,
    /// Largest kinetic energy so far.
    peak: f64,
    /// Sums of -m da.dx and m dx.dx, once the motion has calmed down.
    seen: Option<[f64; 2]>,
    /// Positions and accelerations at the last look, by row.
    last: Vec<[DVec3; 2]>,
}

fn install(cx: &mut Install<'_>) {
    let rate = match cx.model.integration.damping {
        Damping::Adaptive(Some(rate)) => rate,
        Damping::Adaptive(None) => return install_search(cx),
        _ => return,
    };
    cx.world.insert_resource(Settling { rate, now: rate, ..Settling::default() });
    cx.remember_resource::<Settling>();
    cx.after_restore(|world| {
        let now = world.resource::<Settling>().now;
        world.insert_resource(MassDamping(now));
    });
    cx.add_system(StepSet::Monitor, follow);
}

fn follow(
    clock: Res<Clock>,
    mut settling: ResMut<Settling>,
    mut damping: ResMut<MassDamping>,
    mut nodes: Query<(&Position, &Velocity, &Force, &InverseMass)>,
) {
    if clock.time < settling.next {
        return;
    }
    let s = &mut *settling;
    s.next = clock.time + 1.0 / (LOOKS * s.rate);
    let (x, v, f, w) = columns(&mut nodes);
    // Nodes that do not move by themselves have no inverse mass.
    let masses = || w.iter().map(|w| w.0.map(|w| if w > 0.0 { 1.0 / w } else { 0.0 }));
    let kinetic: f64 = masses().zip(v).map(|(m, v)| (m * v.0).dot(v.0)).sum();
    s.peak = s.peak.max(kinetic);
    if s.seen.is_none() && (kinetic > CALM * s.peak || s.peak == 0.0) {
        return;
    }
    let now = || x.iter().zip(f.iter().zip(w)).map(|(x, (f, w))| [x.0, f.0 * w.0]);
    if s.last.len() == x.len() {
        let (mut stiff, mut heavy) = (0.0, 0.0);
        for ((m, [x, a]), [x0, a0]) in masses().zip(now()).zip(&s.last) {
            stiff -= (m * (a - *a0)).dot(x - *x0);
            heavy += (m * (x - *x0)).dot(x - *x0);
        }
        if heavy > 0.0 {
            // Sums of both, not means of the quotient: at the turn of a swing only vibrations move.
            let [old_stiff, old_heavy] = s.seen.map_or([0.0; 2], |old| old.map(|o| KEPT * o));
            let seen = [old_stiff + stiff, old_heavy + heavy];
            s.seen = Some(seen);
            s.now = (DAMPED * (seen[0] / seen[1]).max(0.0).sqrt()).clamp(s.rate, MOST * s.rate);
            damping.0 = s.now;
        }
    }
    s.last.clear();
    s.last.extend(now());
}

/// Looks that count: at half a radian each, a little more than half a swing, so that its turn is never alone.
const COUNT: usize = 8;
/// Natural times between two looks.
const SPACING: f64 = 0.5;
/// Steps between two looks at least, and over which the first ones are taken.
const FEWEST: f64 = 8.0;

/// The time of the slowest motion, found from the motion itself.
#[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
pub struct NaturalTime {
    /// 1 / omega of the motion seen last (time); none while nothing has swung or crept back.
    pub found: Option<f64>,
    /// Mass damping wanted from the next kick on (1 / time).
    pub rate: f64,
    /// Mass damping of the last kick (1 / time).
    applied: f64,
    next: f64,
    /// -m da.dx and m dx.dx between the last looks.
    looks: VecDeque<[f64; 2]>,
    /// Positions and accelerations at the last look, by row.
    last: Vec<[DVec3; 2]>,
    /// The same of rotations.
    last_turns: Vec<(DQuat, DVec3)>,
}

fn install_search(cx: &mut Install<'_>) {
    cx.world.init_resource::<NaturalTime>();
    cx.remember_resource::<NaturalTime>();
    cx.after_restore(|world| {
        let applied = world.resource::<NaturalTime>().applied;
        world.insert_resource(MassDamping(applied));
    });
    cx.add_system(StepSet::Constraints, book_change);
    if cx.rotations() {
        cx.add_system(StepSet::Constraints, book_change_of_rotations);
        cx.add_system(StepSet::Monitor, search_with_rotations);
    } else {
        cx.add_system(StepSet::Monitor, search);
    }
    cx.add_system(StepSet::Constraints, take_over);
}

/// The step just made lies between a kick with the old rate and one with the new: each has a half of what it dissipates, and with the old
/// rate all of it has been booked.
fn book_change(
    clock: Res<Clock>,
    time: Res<NaturalTime>,
    damping: Res<MassDamping>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&Velocity, &Mass)>,
) {
    if time.rate != damping.0 {
        let (v, m) = columns(&mut nodes);
        let swing: f64 = v.iter().zip(m).map(|(v, m)| m.0 * v.0.length_squared()).sum();
        ledger.damping += 0.5 * (time.rate - damping.0) * clock.dt * swing;
    }
}

fn book_change_of_rotations(
    clock: Res<Clock>,
    time: Res<NaturalTime>,
    damping: Res<MassDamping>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&AngularVelocity, &RotaryInertia)>,
) {
    if time.rate != damping.0 {
        let (w, j) = columns(&mut nodes);
        let swing: f64 = w.iter().zip(j).map(|(w, j)| j.0 * w.0.length_squared()).sum();
        ledger.damping += 0.5 * (time.rate - damping.0) * clock.dt * swing;
    }
}

fn take_over(mut time: ResMut<NaturalTime>, mut damping: ResMut<MassDamping>) {
    damping.0 = time.rate;
    time.applied = time.rate;
}

/// Translations: position, force, inverse mass. Rotations: orientation, moment, inverse inertia.
type Moving = (&'static Position, &'static Force, &'static InverseMass);
type Turning = (&'static Orientation, &'static Moment, &'static InverseInertia);

fn search(clock: Res<Clock>, mut time: ResMut<NaturalTime>, mut nodes: Query<Moving>) {
    if clock.time >= time.next {
        let (x, f, w) = columns(&mut nodes);
        let sums = time.moved(x, f, w);
        time.look(&clock, sums);
    }
}

fn search_with_rotations(clock: Res<Clock>, mut time: ResMut<NaturalTime>, mut nodes: Query<Moving>, mut spins: Query<Turning>) {
    if clock.time >= time.next {
        let (x, f, w) = columns(&mut nodes);
        let (q, m, j) = columns(&mut spins);
        let (a, b) = (time.moved(x, f, w), time.turned(q, m, j));
        time.look(&clock, [a[0] + b[0], a[1] + b[1]]);
    }
}

/// Mass of every direction; zero where a node does not move by itself.
fn masses(inverse: DVec3) -> DVec3 {
    inverse.map(|w| if w > 0.0 { 1.0 / w } else { 0.0 })
}

impl NaturalTime {
    /// -m da.dx and m dx.dx since the last look.
    fn moved(&mut self, x: &[Position], f: &[Force], w: &[InverseMass]) -> [f64; 2] {
        let mut sums = [0.0; 2];
        let now = || x.iter().zip(f).zip(w).map(|((x, f), w)| [x.0, f.0 * w.0]);
        for (([x, a], [x0, a0]), w) in now().zip(&self.last).zip(w) {
            let (m, dx) = (masses(w.0), x - *x0);
            sums[0] -= (m * (a - *a0)).dot(dx);
            sums[1] += (m * dx).dot(dx);
        }
        self.last.clear();
        self.last.extend(now());
        sums
    }

    /// The same of rotations.
    fn turned(&mut self, q: &[Orientation], m: &[Moment], j: &[InverseInertia]) -> [f64; 2] {
        let mut sums = [0.0; 2];
        let now = || q.iter().zip(m).zip(j).map(|((q, m), j)| (q.0, m.0 * j.0));
        for (((q, a), (q0, a0)), j) in now().zip(&self.last_turns).zip(j) {
            let (inertia, turn) = (masses(j.0), (q * q0.conjugate()).to_scaled_axis());
            sums[0] -= (inertia * (a - *a0)).dot(turn);
            sums[1] += (inertia * turn).dot(turn);
        }
        self.last_turns.clear();
        self.last_turns.extend(now());
        sums
    }

    /// The rate of damping from the last looks, and the time of the next one.
    fn look(&mut self, clock: &Clock, sums: [f64; 2]) {
        if self.looks.len() == COUNT {
            self.looks.pop_front();
        }
        self.looks.push_back(sums);
        let [stiff, heavy] = self.looks.iter().fold([0.0; 2], |s, l| [s[0] + l[0], s[1] + l[1]]);
        let omega = if heavy > 0.0 { (stiff / heavy).max(0.0).sqrt() } else { 0.0 };
        let shortest = FEWEST * clock.dt_next;
        let longest = (0.125 * clock.time).max(2.0 * shortest);
        let wait = if omega > 0.0 { (SPACING / omega).clamp(shortest, longest) } else { longest };
        if omega > 0.0 {
            self.found = Some(1.0 / omega);
        }
        self.rate = DAMPED * omega;
        self.next = clock.time + wait;
    }
}
