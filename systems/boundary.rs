//! Prescribed motions: the velocity that carries a degree of freedom to its next prescribed value.
//!
//! Held degrees of freedom need no system: their inverse mass is zero. A prescribed one has zero
//! inverse mass too, and a velocity (u(t + dt) - u(t)) / dt, so that the displacement is met exactly at
//! every step.
use crate::systems::load::Amplitudes;
use braid_ecs::prelude::*;

/// Registers prescribed motions.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("prescribed motion", install);
}

/// Row and last reaction of a prescribed degree of freedom.
#[derive(Component, Clone, Copy, Debug)]
struct PrescribedRow {
    row: u32,
    reaction: f64,
}

fn install(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    let bundles: Vec<_> =
        cx.model.prescribed.iter().map(|p| (p.clone(), PrescribedRow { row: cx.row(p.node) as u32, reaction: 0.0 })).collect();
    cx.world.spawn_batch(bundles);
    cx.add_system(StepSet::Dynamics, prescribe_velocities);
    if cx.rotations() {
        cx.add_system(StepSet::Dynamics, prescribe_spins);
    }
}

/// The work uses the reaction at both ends of the step that has just been made.
fn prescribe_velocities(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<(&mut Velocity, &Force)>,
) {
    let (motions, mut rows) = columns(&mut list);
    let (mut v, f) = columns(&mut nodes);
    let v = v.bypass_change_detection();
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()) {
        if p.dof.is_rotation() {
            continue;
        }
        let (row, k) = (at.row as usize, p.dof.axis());
        let amplitude = &amplitudes.0[p.amplitude];
        let reaction = -f[row].0[k];
        ledger.external_work += 0.5 * (at.reaction + reaction) * v[row].0[k] * clock.dt;
        at.reaction = reaction;
        v[row].0[k] = p.value * (amplitude.at(clock.time + clock.dt_next) - amplitude.at(clock.time)) / clock.dt_next;
    }
}

fn prescribe_spins(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<(&mut AngularVelocity, &Moment)>,
) {
    let (motions, mut rows) = columns(&mut list);
    let (mut w, m) = columns(&mut nodes);
    let w = w.bypass_change_detection();
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()) {
        if !p.dof.is_rotation() {
            continue;
        }
        let (row, k) = (at.row as usize, p.dof.axis());
        let amplitude = &amplitudes.0[p.amplitude];
        let reaction = -m[row].0[k];
        ledger.external_work += 0.5 * (at.reaction + reaction) * w[row].0[k] * clock.dt;
        at.reaction = reaction;
        w[row].0[k] = p.value * (amplitude.at(clock.time + clock.dt_next) - amplitude.at(clock.time)) / clock.dt_next;
    }
}
