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

/// Registers the work of prescribed motions; after everything that adds to the forces of a step.
pub fn work_plugin(sim: &mut Simulation) {
    sim.add_installer("work of prescribed motion", install_work);
}

/// Row of a prescribed degree of freedom, its reaction at the last position, and the velocity and acceleration
/// that the motion asks for.
#[derive(Component, Clone, Copy, Debug)]
struct PrescribedRow {
    row: u32,
    reaction: f64,
    /// Velocity over the step just made.
    velocity: f64,
    acceleration: f64,
}

fn install(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    let rest = |row: usize| PrescribedRow { row: row as u32, reaction: 0.0, velocity: 0.0, acceleration: 0.0 };
    let bundles: Vec<_> = cx.model.prescribed.iter().map(|p| (p.clone(), rest(cx.row(p.node)))).collect();
    cx.world.spawn_batch(bundles);
    cx.add_system(StepSet::Dynamics, prescribe_velocities);
    if cx.rotations() {
        cx.add_system(StepSet::Dynamics, prescribe_spins);
    }
}

fn install_work(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    cx.add_system(StepSet::Dynamics, work_of_displacements);
    if cx.rotations() {
        cx.add_system(StepSet::Dynamics, work_of_rotations);
    }
}

/// The velocity that leads from the prescribed value now to that at the end of the coming step.
fn prescribe(p: &PrescribedMotion, at: &mut PrescribedRow, clock: &Clock, amplitudes: &Amplitudes, velocity: &mut f64) {
    let amplitude = &amplitudes.0[p.amplitude];
    let next = p.value * (amplitude.at(clock.time + clock.dt_next) - amplitude.at(clock.time)) / clock.dt_next;
    at.velocity = *velocity;
    at.acceleration = (next - *velocity) / clock.kick();
    *velocity = next;
}

/// The support carries what accelerates the node less what acts on it; its work over the step just made
/// uses the reaction at both ends.
fn work(at: &mut PrescribedRow, inertia: f64, force: f64, clock: &Clock, ledger: &mut EnergyLedger) {
    let reaction = inertia * at.acceleration - force;
    ledger.external_work += 0.5 * (at.reaction + reaction) * at.velocity * clock.dt;
    at.reaction = reaction;
}

fn prescribe_velocities(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<&mut Velocity>,
) {
    let (motions, mut rows) = columns(&mut list);
    let mut v = columns(&mut nodes);
    let v = v.bypass_change_detection();
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()).filter(|(p, _)| !p.dof.is_rotation()) {
        let row = at.row as usize;
        prescribe(p, at, &clock, &amplitudes, &mut v[row].0[p.dof.axis()]);
    }
}

fn prescribe_spins(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<&mut AngularVelocity>,
) {
    let (motions, mut rows) = columns(&mut list);
    let mut w = columns(&mut nodes);
    let w = w.bypass_change_detection();
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()).filter(|(p, _)| p.dof.is_rotation()) {
        let row = at.row as usize;
        prescribe(p, at, &clock, &amplitudes, &mut w[row].0[p.dof.axis()]);
    }
}

fn work_of_displacements(
    clock: Res<Clock>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<(&Force, &Mass)>,
) {
    let (motions, mut rows) = columns(&mut list);
    let (f, m) = columns(&mut nodes);
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()).filter(|(p, _)| !p.dof.is_rotation()) {
        let row = at.row as usize;
        work(at, m[row].0, f[row].0[p.dof.axis()], &clock, &mut ledger);
    }
}

fn work_of_rotations(
    clock: Res<Clock>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>,
    mut nodes: Query<(&Moment, &RotaryInertia)>,
) {
    let (motions, mut rows) = columns(&mut list);
    let (m, j) = columns(&mut nodes);
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()).filter(|(p, _)| p.dof.is_rotation()) {
        let row = at.row as usize;
        work(at, j[row].0, m[row].0[p.dof.axis()], &clock, &mut ledger);
    }
}
