//! Central differences: x(n+1) = x(n) + dt v(n+1/2), v(n+1/2) = v(n-1/2) + dt a(n), second order and
//! symplectic without damping (E. Hairer, C. Lubich, G. Wanner, *Acta Numerica* 12 (2003) 399-450).
//!
//! Mass damping f = -alpha m v is taken at the middle of the kick,
//! v+ = [(1 - alpha dt/2) v- + dt f/m] / (1 + alpha dt/2), which is stable for any alpha. Rotations move by
//! q+ = exp(dt w) q with the spatial angular velocity w. The rotary inertia is isotropic (a
//! sphere), so that the equation of rotation is J w' = m without gyroscopic terms: true for torsion and
//! for any equilibrium, and scaled on purpose (see `RotaryInertiaRule`).
use braid_ecs::prelude::*;

/// Registers the integration of nodes.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("integration", install);
}

/// Mass damping in force (1 / time).
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct MassDamping(pub f64);

impl MassDamping {
    /// What a kick of length `dt` leaves of the velocity before, and what it gains per acceleration (time).
    #[inline]
    pub fn kick(self, dt: f64) -> (f64, f64) {
        let h = 0.5 * self.0 * dt;
        ((1.0 - h) / (1.0 + h), dt / (1.0 + h))
    }
}

/// Watches the kinetic energy for the peaks of kinetic damping.
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct KineticPeak {
    last: f64,
}

fn install(cx: &mut Install<'_>) {
    let rotations = cx.rotations();
    cx.add_system(StepSet::Kinematics, advance_clock);
    cx.add_system(StepSet::Kinematics, advance_positions);
    if rotations {
        cx.add_system(StepSet::Kinematics, advance_orientations);
    }
    let alpha = match cx.model.integration.damping {
        Damping::Mass(alpha) | Damping::Adaptive(Some(alpha)) => alpha,
        _ => 0.0,
    };
    cx.world.insert_resource(MassDamping(alpha));
    if alpha > 0.0 || cx.model.integration.damping == Damping::Adaptive(None) {
        cx.add_system(StepSet::Constraints, dissipate);
        if rotations {
            cx.add_system(StepSet::Constraints, dissipate_rotations);
        }
    }
    cx.add_system(StepSet::Dynamics, kick_velocities);
    if rotations {
        cx.add_system(StepSet::Dynamics, kick_spins);
    }
    if cx.model.integration.damping == Damping::Kinetic {
        cx.world.insert_resource(KineticPeak::default());
        cx.remember_resource::<KineticPeak>();
        if rotations {
            cx.add_system(StepSet::Kinematics, reset_at_peak_with_rotations);
        } else {
            cx.add_system(StepSet::Kinematics, reset_at_peak);
        }
    }
}

const CHUNK: usize = 1024;

fn advance_clock(mut clock: ResMut<Clock>) {
    clock.dt = clock.dt_next;
    clock.dt_next = clock.dt_target;
    clock.time += clock.dt;
    clock.at_rest = false;
    if clock.dt > 0.0 {
        clock.step += 1;
    }
}

fn advance_positions(clock: Res<Clock>, mut nodes: Query<(&mut Position, &Velocity)>) {
    let (mut x, v) = columns(&mut nodes);
    let dt = clock.dt;
    parallel::zip2(x.bypass_change_detection(), v, CHUNK, |x, v| x.0 += v.0 * dt);
}

fn advance_orientations(clock: Res<Clock>, mut nodes: Query<(&mut Orientation, &AngularVelocity)>) {
    let (mut q, w) = columns(&mut nodes);
    let half = 0.5 * clock.dt;
    parallel::chunks2_mut(q.bypass_change_detection(), w, CHUNK, |q, w| {
        for group in lane::groups(q.len()) {
            let (q, w) = (&mut q[group.clone()], &w[group]);
            if q.len() == f64x4::WIDTH { turn::<f64x4>(q, w, half) } else { turn::<f64>(q, w, half) }
        }
    });
}

/// q+ = exp(h) q with h = w x half of the step, for `L::WIDTH` nodes.
#[inline(always)]
fn turn<L: Lane>(q: &mut [Orientation], w: &[AngularVelocity], half: f64) {
    let one = L::splat(1.0);
    let h = V3::<L>::gather(|l| w[l].0) * L::splat(half);
    let [x, y, z, s] = L::rows(|l| q[l].0.to_array());
    let v = V3::new(x, y, z);
    // cos|h| and sin|h|/|h| to 4e-11 for a tenth of a radian per step.
    let h2 = h.dot(h);
    let series = |a: f64, b: f64, c: f64| one - h2 * (L::splat(a) - h2 * (L::splat(b) - h2 * L::splat(c)));
    let (cos, sinc) = (series(0.5, 1.0 / 24.0, 1.0 / 720.0), series(1.0 / 6.0, 1.0 / 120.0, 1.0 / 5040.0));
    let p = h * sinc;
    let (v, s) = (v * cos + p * s + p.cross(v), cos * s - p.dot(v));
    let scale = one / (v.dot(v) + s * s).sqrt();
    L::each_row([v.x * scale, v.y * scale, v.z * scale, s * scale], |l, row| q[l].0 = DQuat::from_array(row));
}

/// Work of the mass damping over the step just made; the kick is centred on the position, the
/// velocity on the step, so the rectangle rule over the half-step velocities is second order.
fn dissipate(clock: Res<Clock>, damping: Res<MassDamping>, mut ledger: ResMut<EnergyLedger>, mut nodes: Query<(&Velocity, &Mass)>) {
    let (v, m) = columns(&mut nodes);
    let part = |rows: std::ops::Range<usize>| v[rows.clone()].iter().zip(&m[rows]).map(|(v, m)| m.0 * v.0.length_squared()).sum();
    ledger.damping += damping.0 * clock.dt * parallel::sum(v.len(), CHUNK, part);
}

fn dissipate_rotations(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&AngularVelocity, &RotaryInertia)>,
) {
    let (w, j) = columns(&mut nodes);
    let part = |rows: std::ops::Range<usize>| w[rows.clone()].iter().zip(&j[rows]).map(|(w, j)| j.0 * w.0.length_squared()).sum();
    ledger.damping += damping.0 * clock.dt * parallel::sum(w.len(), CHUNK, part);
}

fn kick_velocities(clock: Res<Clock>, damping: Res<MassDamping>, mut nodes: Query<(&mut Velocity, &Force, &InverseMass)>) {
    let (mut v, f, im) = columns(&mut nodes);
    let (keep, gain) = damping.kick(clock.kick());
    parallel::zip3(v.bypass_change_detection(), f, im, CHUNK, |v, f, im| v.0 = v.0 * keep + f.0 * im.0 * gain);
}

fn kick_spins(clock: Res<Clock>, damping: Res<MassDamping>, mut nodes: Query<(&mut AngularVelocity, &Moment, &InverseInertia)>) {
    let (mut w, m, ij) = columns(&mut nodes);
    let (keep, gain) = damping.kick(clock.kick());
    parallel::zip3(w.bypass_change_detection(), m, ij, CHUNK, |w, m, ij| w.0 = w.0 * keep + m.0 * ij.0 * gain);
}

/// Kinetic damping (P. A. Cundall 1976; M. R. Barnes, *Int. J. Space Structures* 14 (1999) 89-104): every
/// peak of the kinetic energy is a pass through an equilibrium; the motion starts again from there, with half a kick: with a
/// whole one a mode would go 1 - (w dt)^2 times its amplitude to the other side, more than it came from.
fn reset_at_peak(
    mut peak: ResMut<KineticPeak>,
    mut clock: ResMut<Clock>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&mut Velocity, &Mass)>,
) {
    let (mut v, m) = columns(&mut nodes);
    let v = v.bypass_change_detection();
    let now = 0.5 * v.iter().zip(m).map(|(v, m)| m.0 * v.0.length_squared()).sum::<f64>();
    if now < peak.last {
        v.fill(Velocity(DVec3::ZERO));
        clock.at_rest = true;
        ledger.damping += now;
        peak.last = 0.0;
    } else {
        peak.last = now;
    }
}

fn reset_at_peak_with_rotations(
    mut peak: ResMut<KineticPeak>,
    mut clock: ResMut<Clock>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&mut Velocity, &Mass, &mut AngularVelocity, &RotaryInertia)>,
) {
    let (mut v, m, mut w, j) = columns(&mut nodes);
    let (v, w) = (v.bypass_change_detection(), w.bypass_change_detection());
    let now = 0.5
        * (v.iter().zip(m).map(|(v, m)| m.0 * v.0.length_squared()).sum::<f64>()
            + w.iter().zip(j).map(|(w, j)| j.0 * w.0.length_squared()).sum::<f64>());
    if now < peak.last {
        v.fill(Velocity(DVec3::ZERO));
        w.fill(AngularVelocity(DVec3::ZERO));
        clock.at_rest = true;
        ledger.damping += now;
        peak.last = 0.0;
    } else {
        peak.last = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_nodes_turn_like_each_of_them() {
        let w: Vec<AngularVelocity> = (0..4).map(|i| AngularVelocity(DVec3::new(0.3 - 0.2 * i as f64, 0.1 * i as f64, 0.05))).collect();
        let start: Vec<Orientation> = (0..4).map(|i| Orientation(DQuat::from_rotation_x(0.7 * i as f64))).collect();
        let (mut together, mut alone) = (start.clone(), start.clone());
        turn::<f64x4>(&mut together, &w, 0.05);
        for i in 0..4 {
            turn::<f64>(&mut alone[i..=i], &w[i..=i], 0.05);
            assert_eq!(together[i].0.to_array().map(f64::to_bits), alone[i].0.to_array().map(f64::to_bits));
            let known = DQuat::from_scaled_axis(w[i].0 * 0.1) * start[i].0;
            assert!((together[i].0 - known).length() < 1e-15, "node {i}");
        }
    }
}
