//! Mass damping that follows the motion once it has calmed down: dynamic relaxation with the least delay.
//!
//! On the way to its resting place a structure moves with the damping of the scene, because friction remembers the way.
//! When its kinetic energy has fallen to a small share of its largest value, what is left is the swing about the resting
//! place. It dies soonest just below the critical damping of its slowest mode, alpha = 2 omega, and omega follows from
//! Rayleigh's quotient of the motion between two looks, omega^2 = -sum m da.dx / sum m dx.dx (P. Underwood, in
//! *Computational Methods for Transient Analysis* (1983), chapter 5). The rate is never below that of the scene.
use crate::systems::integration::MassDamping;
use braid_ecs::prelude::*;

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
    let Damping::Adaptive(rate) = cx.model.integration.damping else { return };
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
