//! Loads: the first contribution to the nodal sums, f = loads - internal forces - ...
use braid_ecs::prelude::*;

/// Registers concentrated loads and body forces.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("loads", install);
}

/// The amplitudes of the model.
#[derive(Resource)]
pub struct Amplitudes(pub Vec<Amplitude>);

/// Work of one load, kept by halves: force at t_n times the mean of the velocities around it.
#[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
struct LoadRow {
    row: u32,
    force: DVec3,
    moment: DVec3,
}

#[derive(Resource, Clone, Copy)]
struct Gravity(BodyForce);

fn install(cx: &mut Install<'_>) {
    let rotations = cx.rotations();
    cx.world.insert_resource(Amplitudes(cx.model.amplitudes.clone()));
    cx.world.init_resource::<EnergyLedger>();
    if rotations {
        cx.add_system(StepSet::Assembly, (clear_forces, clear_moments).chain());
    } else {
        cx.add_system(StepSet::Assembly, clear_forces);
    }
    if let Some(b) = cx.model.body_force {
        cx.world.insert_resource(Gravity(b));
        cx.add_system(StepSet::Assembly, apply_body_force);
    }
    if !cx.model.loads.is_empty() {
        let bundles: Vec<_> = cx
            .model
            .loads
            .iter()
            .map(|l| (l.clone(), LoadRow { row: cx.row(l.node) as u32, force: DVec3::ZERO, moment: DVec3::ZERO }))
            .collect();
        cx.world.spawn_batch(bundles);
        cx.remember::<LoadRow>();
        if rotations {
            cx.add_system(StepSet::Assembly, apply_loads_and_moments);
        } else {
            cx.add_system(StepSet::Assembly, apply_loads);
        }
    }
}

/// Nodes per parallel chunk.
const CHUNK: usize = 4096;

fn clear_forces(mut nodes: Query<&mut Force>) {
    parallel::fill(columns(&mut nodes).bypass_change_detection(), Force(DVec3::ZERO), CHUNK);
}

fn clear_moments(mut nodes: Query<&mut Moment>) {
    parallel::fill(columns(&mut nodes).bypass_change_detection(), Moment(DVec3::ZERO), CHUNK);
}

/// f = m a(t). The work is the force times the displacement of the last half step and the next:
/// both halves are counted when the positions have moved, with the velocity that moved them.
fn apply_body_force(
    clock: Res<Clock>,
    gravity: Res<Gravity>,
    amplitudes: Res<Amplitudes>,
    mut ledger: ResMut<EnergyLedger>,
    mut nodes: Query<(&mut Force, &Velocity, &Mass)>,
) {
    let (mut f, v, m) = columns(&mut nodes);
    let b = gravity.0;
    let amplitude = &amplitudes.0[b.amplitude];
    let now = b.acceleration * amplitude.at(clock.time);
    let before = b.acceleration * amplitude.at(clock.time - clock.dt);
    let mut momentum = DVec3::ZERO;
    for ((f, v), m) in f.bypass_change_detection().iter_mut().zip(v).zip(m) {
        f.0 += now * m.0;
        momentum += v.0 * m.0;
    }
    ledger.external_work += (now + before).dot(momentum) * 0.5 * clock.dt;
}

fn apply_loads(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut ledger: ResMut<EnergyLedger>,
    mut loads: Query<(&NodalLoad, &mut LoadRow)>,
    mut nodes: Query<(&mut Force, &Velocity)>,
) {
    let (loads, mut rows) = columns(&mut loads);
    let (mut f, v) = columns(&mut nodes);
    let f = f.bypass_change_detection();
    for (load, at) in loads.iter().zip(rows.bypass_change_detection()) {
        let row = at.row as usize;
        let now = load.force * amplitudes.0[load.amplitude].at(clock.time);
        ledger.external_work += (at.force + now).dot(v[row].0) * 0.5 * clock.dt;
        at.force = now;
        f[row].0 += now;
    }
}

fn apply_loads_and_moments(
    clock: Res<Clock>,
    amplitudes: Res<Amplitudes>,
    mut ledger: ResMut<EnergyLedger>,
    mut loads: Query<(&NodalLoad, &mut LoadRow)>,
    mut nodes: Query<(&mut Force, &mut Moment, &Velocity, &AngularVelocity, &Orientation)>,
) {
    let (loads, mut rows) = columns(&mut loads);
    let (mut f, mut m, v, w, q) = columns(&mut nodes);
    let (f, m) = (f.bypass_change_detection(), m.bypass_change_detection());
    for (load, at) in loads.iter().zip(rows.bypass_change_detection()) {
        let row = at.row as usize;
        let size = amplitudes.0[load.amplitude].at(clock.time);
        let turn = if load.follower { q[row].0 } else { DQuat::IDENTITY };
        let (force, moment) = (turn * load.force * size, turn * load.moment * size);
        ledger.external_work += ((at.force + force).dot(v[row].0) + (at.moment + moment).dot(w[row].0)) * 0.5 * clock.dt;
        (at.force, at.moment) = (force, moment);
        f[row].0 += force;
        m[row].0 += moment;
    }
}
