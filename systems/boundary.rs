//! Prescribed motions: the velocity that carries a degree of freedom to its next prescribed value.
//!
//! Held degrees of freedom need no system: their inverse mass is zero. A prescribed one has zero
//! inverse mass too, and a velocity (u(t + dt) - u(t)) / dt, so that the displacement is met exactly at
//! every step.
use crate::systems::constraint::Constraints;
use crate::systems::integration::MassDamping;
use crate::systems::load::Amplitudes;
use braid_ecs::prelude::*;

/// Registers prescribed motions.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("prescribed motion", install);
}

/// Registers what a prescribed motion does to the masses that hang on it; before the constraints
/// hand the forces on.
pub fn inertia_plugin(sim: &mut Simulation) {
    sim.add_installer("inertia of prescribed motion", install_inertia);
}

/// Registers the work of prescribed motions; after everything that adds to the forces of a step.
pub fn work_plugin(sim: &mut Simulation) {
    sim.add_installer("work of prescribed motion", install_work);
}

/// A prescribed degree of freedom, its reaction at the last position, and the velocities before and after it.
#[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
pub struct PrescribedRow {
    /// Row of the node.
    pub row: u32,
    /// Degree of freedom, as in [`Dof`].
    pub dof: usize,
    reaction: f64,
    /// Velocity over the step just made.
    velocity: f64,
    /// Velocity over the coming step.
    next: f64,
}

impl PrescribedRow {
    /// Change of velocity in this step (length / time or 1 / time).
    pub fn jump(&self) -> f64 {
        self.next - self.velocity
    }

    /// Number of the degree of freedom, as the constraints count them.
    fn index(&self) -> u32 {
        self.row * 6 + self.dof as u32
    }

    /// What an inertia that follows the motion feels: acceleration and mass damping.
    fn drag(&self, clock: &Clock, damping: MassDamping) -> f64 {
        self.jump() / clock.kick() + damping.0 * 0.5 * (self.next + self.velocity)
    }
}

fn install(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    cx.add_system(StepSet::Dynamics, prescribe_velocities);
    if cx.rotations() {
        cx.add_system(StepSet::Dynamics, prescribe_spins);
    }
}

fn install_inertia(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    let row =
        |p: &PrescribedMotion| PrescribedRow { row: cx.row(p.node) as u32, dof: p.dof as usize, reaction: 0.0, velocity: 0.0, next: 0.0 };
    let bundles: Vec<_> = cx.model.prescribed.iter().map(|p| (p.clone(), row(p))).collect();
    cx.world.spawn_batch(bundles);
    cx.world.init_resource::<Dragged>();
    cx.remember::<PrescribedRow>();
    cx.add_system(StepSet::Condensation, look_ahead);
    if !(cx.model.periodic.is_empty() && cx.model.equations.is_empty()) {
        cx.add_system(StepSet::Condensation, drag_dependents);
    }
}

/// Part of the inertia force of dependents that comes from prescribed motions, by their order in the constraints.
#[derive(Resource, Clone, Debug, Default)]
struct Dragged(Vec<f64>);

fn install_work(cx: &mut Install<'_>) {
    if cx.model.prescribed.is_empty() {
        return;
    }
    cx.add_system(StepSet::Dynamics, work_of_displacements);
    if cx.rotations() {
        cx.add_system(StepSet::Dynamics, work_of_rotations);
    }
}

/// The velocities that lead from the prescribed values now to those at the end of the coming step.
fn look_ahead(clock: Res<Clock>, amplitudes: Res<Amplitudes>, mut list: Query<(&PrescribedMotion, &mut PrescribedRow)>) {
    let (motions, mut rows) = columns(&mut list);
    for (p, at) in motions.iter().zip(rows.bypass_change_detection()) {
        let amplitude = &amplitudes.0[p.amplitude];
        at.velocity = at.next;
        at.next = p.value * (amplitude.at(clock.time + clock.dt_next) - amplitude.at(clock.time)) / clock.dt_next;
        if clock.dt == 0.0 {
            // What is prescribed to move from the start on moves already: its kinetic energy is there, not put in.
            at.velocity = at.next;
        }
    }
}

/// A node that follows a prescribed one has to be accelerated with it: its inertia is a force on
/// whatever else carries it.
fn drag_dependents(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    constraints: Option<Res<Constraints>>,
    mut dragged: ResMut<Dragged>,
    list: Query<&PrescribedRow>,
    mut nodes: Query<(&mut Force, &Mass)>,
) {
    let Some(constraints) = constraints else { return };
    let (mut f, m) = columns(&mut nodes);
    let f = f.bypass_change_detection();
    dragged.0.clear();
    for (row, axis, terms) in constraints.dependent_displacements() {
        let drag = |(t, c): &(u32, f64)| {
            let held = list.iter().find(|p| p.index() == *t);
            held.map_or(0.0, |p| c * p.drag(&clock, *damping))
        };
        let force = m[row].0 * terms.iter().map(drag).sum::<f64>();
        f[row].0[axis] -= force;
        dragged.0.push(force);
    }
}

/// The support carries what accelerates the node less what acts on it; its work over the step just made
/// uses the reaction at both ends.
fn work(at: &mut PrescribedRow, reaction: f64, clock: &Clock, ledger: &mut EnergyLedger) {
    ledger.external_work += 0.5 * (at.reaction + reaction) * at.velocity * clock.dt;
    at.reaction = reaction;
}

fn prescribe_velocities(list: Query<&PrescribedRow>, mut nodes: Query<&mut Velocity>) {
    let mut v = columns(&mut nodes);
    let v = v.bypass_change_detection();
    for at in list.iter().filter(|p| p.dof < 3) {
        v[at.row as usize].0[at.dof] = at.next;
    }
}

fn prescribe_spins(list: Query<&PrescribedRow>, mut nodes: Query<&mut AngularVelocity>) {
    let mut w = columns(&mut nodes);
    let w = w.bypass_change_detection();
    for at in list.iter().filter(|p| p.dof >= 3) {
        w[at.row as usize].0[at.dof - 3] = at.next;
    }
}

fn work_of_displacements(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    constraints: Option<Res<Constraints>>,
    dragged: Res<Dragged>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<&mut PrescribedRow>,
    mut nodes: Query<(&Force, &Mass, &Velocity)>,
) {
    let (f, m, v) = columns(&mut nodes);
    let (keep, _) = damping.kick(clock.kick());
    // Inertia of the dependents that hang on prescribed rows; what these add themselves is in the force.
    let mut inertia = std::collections::BTreeMap::<u32, f64>::new();
    if let Some(constraints) = constraints {
        for ((row, axis, terms), dragged) in constraints.dependent_displacements().zip(&dragged.0) {
            let held = |t: u32| list.iter().any(|p| p.index() == t);
            if *dragged == 0.0 && !terms.iter().any(|t| held(t.0)) {
                continue;
            }
            // A dependent still has the velocity of the step before, damped like all the others.
            let before = v[row].0[axis] / keep;
            let after: f64 = terms.iter().filter(|t| t.0 % 6 < 3).map(|(t, c)| c * v[*t as usize / 6].0[*t as usize % 6]).sum();
            let total = m[row].0 * ((after - before) / clock.kick() + damping.0 * 0.5 * (after + before));
            for (t, c) in terms.iter().filter(|t| held(t.0)) {
                *inertia.entry(*t).or_default() += c * (total - dragged);
            }
        }
    }
    let mut rows = columns(&mut list);
    for at in rows.bypass_change_detection().iter_mut().filter(|p| p.dof < 3) {
        let row = at.row as usize;
        let hanging = inertia.get(&at.index()).copied().unwrap_or(0.0);
        let reaction = m[row].0 * at.drag(&clock, *damping) + hanging - f[row].0[at.dof];
        work(at, reaction, &clock, &mut ledger);
    }
}

fn work_of_rotations(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    mut ledger: ResMut<EnergyLedger>,
    mut list: Query<&mut PrescribedRow>,
    mut nodes: Query<(&Moment, &RotaryInertia)>,
) {
    let mut rows = columns(&mut list);
    let (m, j) = columns(&mut nodes);
    for at in rows.bypass_change_detection().iter_mut().filter(|p| p.dof >= 3) {
        let row = at.row as usize;
        let reaction = j[row].0 * at.drag(&clock, *damping) - m[row].0[at.dof - 3];
        work(at, reaction, &clock, &mut ledger);
    }
}
