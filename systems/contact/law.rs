//! The contact law of one point: quadratic toe, linear penalty, damping, Coulomb friction with a
//! tangential spring.
//!
//! - Normal spring per unit stiffness: f(g) = g^2 / (2 g0) up to the toe g0, then g - g0 / 2, for
//!   the penetration g > 0: continuous with its derivative, so touching is no stiffness jump.
//! - Hardening for deep contacts: h g (g / D)^2 on top, with the sum of the radii D. It leaves shallow contacts as soft as the time step
//!   wants them, and holds a filament at a hot spot.
//! - Normal damping c = 2 xi sqrt(k m), faded in over the toe; the sum never pulls.
//! - Friction after Cundall and Strack (1979): the elastic slip follows the relative motion in the
//!   tangent plane and is cut back (return mapping) so that k_t |slip| <= mu F_n.
use braid_ecs::prelude::*;

/// Numbers of the law that all records share.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Law {
    /// Friction coefficient.
    pub friction: f64,
    /// Tangential over normal stiffness.
    pub tangential: f64,
    /// Damping ratio of the normal spring.
    pub damping: f64,
    /// Length of the quadratic toe over the sum of the radii.
    pub toe: f64,
    /// Share of the linear force that a penetration of the sum of the radii adds.
    pub hardening: f64,
    /// Time over which the relative motion is integrated into the slip.
    pub dt: f64,
}

impl Law {
    /// Stiffness that limits the time step like the damped spring, over that of the spring alone: lagged
    /// damping of ratio xi narrows the limit by sqrt(1 + xi^2) - xi.
    pub fn damped_stiffness(&self) -> f64 {
        let xi = self.damping;
        ((1.0 + xi * xi).sqrt() - xi).powi(-2)
    }

    /// Slope of the normal force over that of the linear penalty.
    #[inline(always)]
    pub fn slope<L: Lane>(&self, penetration: L, reach: L) -> L {
        let depth = penetration.upper(L::splat(0.0)) / reach;
        L::splat(1.0) + L::splat(3.0 * self.hardening) * depth * depth
    }
}

/// Where and how two bodies touch.
#[derive(Clone, Copy, Debug)]
pub struct Touch<L> {
    /// Stiffness with all weights (force / length).
    pub stiffness: L,
    /// Penetration (length).
    pub penetration: L,
    /// Sum of the radii (length).
    pub reach: L,
    /// Unit normal towards the first body.
    pub normal: V3<L>,
    /// Velocity of the first body relative to the second.
    pub velocity: V3<L>,
    /// Mass that moves on the spring.
    pub mass: L,
}

/// What a contact remembers of the step before.
#[derive(Clone, Copy, Debug)]
pub struct Memory<L> {
    /// Elastic slip of the friction spring (length).
    pub slip: V3<L>,
    /// Force of the damper against approach (force).
    pub damper: L,
}

impl<L: Lane> Memory<L> {
    /// Of bodies that did not touch.
    #[inline(always)]
    pub fn none() -> Self {
        Memory { slip: V3::zero(), damper: L::splat(0.0) }
    }
}

/// Stiffness that is kept of a contact that does not touch.
pub const APART: f64 = -1.0;

/// What the next step has to know of the stiffness.
#[inline(always)]
pub fn kept_stiffness<L: Lane>(stiffness: L, overlap: L) -> L {
    L::pick(L::splat(0.0).less(overlap), stiffness, L::splat(APART))
}

/// What is kept of the stiffness when all stiffnesses grow by `factor`.
pub fn raised(kept: f64, factor: f64) -> f64 {
    if kept > 0.0 { kept * factor } else { kept }
}

/// Change of overlap that the motion need not explain, in sums of radii.
const HOP: f64 = 0.005;

/// Where the spring of a contact had its zero in the step before.
///
/// A penalty force is the derivative of an energy only while weight and closest point change with
/// the motion. A contact that gains stiffness while it touches, or whose closest point hops to another
/// one, would make energy out of nothing; it moves its zero instead, so that the energy stays, and
/// moves it back when the change is undone.
#[derive(Clone, Copy, Debug)]
pub struct Zero<L> {
    /// Penetration that is left free of force (length).
    pub offset: L,
    /// Stiffness, zero if the contact was just found, [`APART`] if it did not touch (force / length).
    pub stiffness: L,
    /// Overlap, not a number if it is not known (length).
    pub overlap: L,
}

impl<L: Lane> Zero<L> {
    /// Offset now, with the slip cut for what the stiffness has gained; `parted` is how far the bodies have moved apart.
    #[inline(always)]
    pub fn follow(&self, stiffness: L, overlap: L, parted: L, reach: L, memory: &mut Memory<L>) -> L {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let hop = overlap - (self.overlap - parted);
        let hopped = (L::splat(HOP) * reach).less(hop.magnitude());
        let offset = L::pick(hopped, self.offset + hop, self.offset).within(zero, overlap.upper(zero));
        let factor = (self.stiffness.upper(zero) / stiffness.upper(L::splat(f64::MIN_POSITIVE))).sqrt();
        let factor = L::pick(self.stiffness.less(zero), one, L::pick(zero.less(stiffness), factor, one));
        memory.slip = memory.slip * factor.lower(one);
        (overlap - (overlap - offset) * factor).within(zero, overlap.upper(zero))
    }
}

/// What the law returns.
#[derive(Clone, Copy, Debug)]
pub struct Response<L> {
    /// Force on the first body.
    pub force: V3<L>,
    /// The part of it that is friction.
    pub drag: V3<L>,
    /// To remember for the next step.
    pub memory: Memory<L>,
    /// Normal force.
    pub normal_force: L,
    /// Elastic energy of both springs.
    pub energy: L,
    /// Work lost to friction in this step.
    pub friction: L,
    /// Work lost to damping in this step.
    pub damping: L,
}

/// Evaluates the law.
///
/// The works are those of the motion since the step before, done by the mean of the forces then and
/// now: central differences turn just that into kinetic energy, so that the ledger closes for hits
/// that last a few steps, too.
#[inline(always)]
pub fn respond<L: Lane>(law: &Law, touch: &Touch<L>, before: &Memory<L>) -> Response<L> {
    let (zero, half, one) = (L::splat(0.0), L::splat(0.5), L::splat(1.0));
    let tiny = L::splat(f64::MIN_POSITIVE);
    let (k, g) = (touch.stiffness, touch.penetration);
    let n = touch.normal;
    let dt = L::splat(law.dt);

    let toe = L::splat(law.toe) * touch.reach;
    let in_toe = g.less(toe);
    let fraction = L::pick(in_toe, g / toe.upper(tiny), one);
    let depth = g / touch.reach;
    let hard = L::splat(law.hardening) * g * depth * depth;
    let spring = k * (L::pick(in_toe, half * g * fraction, g - half * toe) + hard);
    let quarter = L::splat(0.25);
    let sixth = L::splat(1.0 / 6.0);
    let normal_energy = k * (L::pick(in_toe, g * g * fraction * sixth, half * g * (g - toe) + toe * toe * sixth) + quarter * g * hard);

    let separation = touch.velocity.dot(n);
    let viscosity = L::splat(2.0 * law.damping) * (k * touch.mass).sqrt() * fraction;
    let normal_force = (spring - viscosity * separation).upper(zero);

    let slip = before.slip - n * before.slip.dot(n);
    let trial = slip + (touch.velocity - n * separation) * dt;
    let kt = k * L::splat(law.tangential);
    let length = trial.dot(trial).sqrt();
    let limit = L::splat(law.friction) * normal_force / kt.upper(tiny);
    let cut = L::pick(limit.less(length), limit / length.upper(tiny), one);
    let after = trial * cut;

    let live = zero.less(g) & zero.less(k);
    let mask = |v: L| L::pick(live, v, zero);
    let (spring, normal_force) = (mask(spring), mask(normal_force));
    let after = V3::pick(live, after, V3::zero());
    let drag = V3::pick(live, after * -kt, V3::zero());
    let friction = half * kt * (slip + after).dot(trial - after);
    let damper = normal_force - spring;
    let damping = -half * (before.damper + damper) * separation * dt;
    Response {
        force: n * normal_force + drag,
        drag,
        memory: Memory { slip: after, damper },
        normal_force,
        energy: mask(normal_energy) + half * kt * after.dot(after),
        friction: mask(friction),
        damping,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(g: f64, v: [f64; 3]) -> Touch<f64> {
        Touch { stiffness: 2.0, penetration: g, reach: 1.0, normal: V3::new(0.0, 0.0, 1.0), velocity: V3::new(v[0], v[1], v[2]), mass: 1.0 }
    }
    const LAW: Law = Law { friction: 0.3, tangential: 0.5, damping: 0.0, toe: 1e-3, hardening: 0.0, dt: 1e-3 };

    #[test]
    fn force_is_the_derivative_of_the_energy() {
        for (g, hardening) in [2e-4, 9e-4, 1.1e-3, 0.02, 0.3].into_iter().flat_map(|g| [(g, 0.0), (g, 100.0)]) {
            let law = Law { hardening, ..LAW };
            let of = |g: f64| respond(&law, &touch(g, [0.0; 3]), &Memory::none());
            let h = 1e-7;
            let f = of(g).normal_force;
            assert!((f - (of(g + h).energy - of(g - h).energy) / (2.0 * h)).abs() < 1e-6 * f, "at {g}");
            // Beyond the toe the slope is what the time step is told; k is 2.
            let slope = (of(g + h).normal_force - of(g - h).normal_force) / (2.0 * h);
            assert!(g < 1.05e-3 || (slope - 2.0 * law.slope(g, 1.0)).abs() < 1e-5 * slope, "at {g}");
        }
        let soft = respond(&LAW, &touch(0.1, [0.0; 3]), &Memory::none()).normal_force;
        let hard = respond(&Law { hardening: 100.0, ..LAW }, &touch(0.1, [0.0; 3]), &Memory::none()).normal_force;
        assert!((hard - soft - 2.0 * 0.1).abs() < 1e-14, "at a tenth of the sum of the radii a hundredth of 100 is added");
        let before = Memory { slip: V3::new(1.0, 0.0, 0.0), damper: 0.5 };
        let open = respond(&LAW, &touch(-1e-6, [1.0, 0.0, -5.0]), &before);
        assert_eq!((open.normal_force, open.energy, open.memory.slip.x), (0.0, 0.0, 0.0));
        // The damper of the step before does its last work.
        assert_eq!(open.damping, -0.5 * 0.5 * -5.0 * LAW.dt);
    }

    #[test]
    fn friction_sticks_then_slides_at_the_coulomb_limit() {
        let mut memory = Memory::none();
        let mut lost = 0.0;
        let mut seen_stick = false;
        let n = respond(&LAW, &touch(0.01, [0.0; 3]), &Memory::none()).normal_force;
        for step in 0..200 {
            let r = respond(&LAW, &touch(0.01, [0.1, 0.0, 0.0]), &memory);
            memory = r.memory;
            lost += r.friction;
            let elastic = 1.0 * 1e-4 * (step + 1) as f64;
            if elastic < 0.3 * n {
                assert!((r.force.x + elastic).abs() < 1e-15 && r.friction.abs() < 1e-18);
                seen_stick = true;
            } else {
                assert!((r.force.x + 0.3 * n).abs() < 1e-15);
            }
        }
        assert!(seen_stick);
        let stored = 0.5 * memory.slip.x * memory.slip.x;
        let work = 0.3 * n * (200.0 * 1e-4) - 0.5 * (0.3 * n) * (0.3 * n);
        assert!((lost + stored - work).abs() < 0.02 * work, "{lost} {stored} {work}");
    }

    /// A mass hits a damped spring and bounces; every hundredth of the energy is where the ledger says.
    #[test]
    fn the_ledger_of_a_hit_closes() {
        for (dt, closes) in [(0.1, 2e-2), (0.01, 2e-4)] {
            let law = Law { damping: 0.3, dt, ..LAW };
            // Half a gap at first, so that the first touch falls between two steps.
            let (mut x, mut v, mut memory, mut lost) = (-0.5 * dt - 1e-3 * dt, -1.0, Memory::none(), 0.0);
            let start = 0.5 * v * v;
            x = -x;
            for _ in 0..(10.0 / dt) as usize {
                x += dt * v;
                let r = respond(&law, &touch(-x, [0.0, 0.0, v]), &memory);
                (memory, lost) = (r.memory, lost + r.damping);
                v += dt * r.normal_force;
            }
            let kept = 0.5 * v * v;
            assert!(kept < 0.5 * start && v > 0.1, "it has bounced, {v}");
            assert!((kept + lost - start).abs() < closes * start, "dt {dt}: {kept} + {lost} of {start}");
        }
    }

    #[test]
    fn a_change_of_weight_or_place_makes_no_energy() {
        let energy = |k: f64, g: f64| 0.5 * k * g * g;
        let zero = |offset: f64, stiffness: f64, overlap: f64| Zero { offset, stiffness, overlap };
        let follow = |z: Zero<f64>, k: f64, overlap: f64, parted: f64| z.follow(k, overlap, parted, 1.0, &mut Memory::none());
        // Found while touching: free of force. Not touching before: with all of it.
        assert_eq!(follow(zero(0.0, 0.0, f64::NAN), 2.0, 0.03, 0.0), 0.03);
        assert_eq!(follow(zero(0.0, APART, f64::NAN), 2.0, 0.03, 0.0), 0.0);
        // More and less stiffness, and back again.
        let up = follow(zero(0.0, 1.0, 0.03), 4.0, 0.03, 0.0);
        assert!((energy(4.0, 0.03 - up) - energy(1.0, 0.03)).abs() < 1e-15);
        assert!(follow(zero(up, 4.0, 0.03), 1.0, 0.03, 0.0).abs() < 1e-15);
        // A hop of the closest point, and back; what the motion explains is no hop.
        let hop = follow(zero(0.01, 1.0, 0.03), 1.0, 0.05, 0.0);
        assert!((hop - 0.03).abs() < 1e-15);
        assert!((follow(zero(hop, 1.0, 0.05), 1.0, 0.03, 0.0) - 0.01).abs() < 1e-15);
        assert!((follow(zero(0.01, 1.0, 0.03), 1.0, 0.05, -0.02) - 0.01).abs() < 1e-15);
    }

    #[test]
    fn damping_never_pulls() {
        let law = Law { damping: 0.5, ..LAW };
        assert_eq!(respond(&law, &touch(0.01, [0.0, 0.0, 100.0]), &Memory::none()).normal_force, 0.0);
        assert!(respond(&law, &touch(0.01, [0.0, 0.0, -1.0]), &Memory::none()).normal_force > 0.02);
    }
}
