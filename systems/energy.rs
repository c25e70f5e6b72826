//! The energy ledger at monitor steps, and the watch for numbers that went wrong.
use crate::systems::axial_implicit::AxialChains;
use braid_ecs::prelude::*;

/// Registers the energy ledger and the finite check.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("energy", install);
}

/// Steps between two looks; a run may force a look at the next step.
#[derive(Resource, Clone, Copy, Debug)]
pub struct MonitorEvery(pub u64);

/// True when the energies were taken at the current step.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct LookNow(pub bool);

fn install(cx: &mut Install<'_>) {
    cx.world.init_resource::<EnergyLedger>();
    cx.world.insert_resource(MonitorEvery(u64::from(cx.model.integration.monitor_every.max(1))));
    cx.world.insert_resource(LookNow(true));
    cx.add_system(StepSet::Monitor, take_energies);
}

/// Kinetic energy with velocities brought to the time of the positions, v - (dt/2) f/m; strain
/// energy of all kinds.
pub fn take_energies(world: &mut World) {
    let clock = world.resource::<Clock>().clone();
    let every = world.resource::<MonitorEvery>().0;
    if !world.resource::<LookNow>().0 && !clock.step.is_multiple_of(every) {
        return;
    }
    world.resource_mut::<LookNow>().0 = false;
    if let Some(message) = not_finite(world) {
        let mut failure = world.resource_mut::<Failure>();
        failure.0.get_or_insert(message);
        return;
    }
    let kinetic = kinetic_energy(world, 0.5 * clock.dt_next);
    let mut strain = 0.0;
    if let Some(kinds) = world.remove_resource::<KindReports>() {
        for k in &kinds.0 {
            let energy = (k.strain_energy)(world);
            if k.name == "axial bar" {
                let work = world.resource::<AxialChains>().work();
                world.resource_mut::<EnergyLedger>().axial = work - energy;
            }
            strain += energy;
        }
        world.insert_resource(kinds);
    }
    let mut ledger = world.resource_mut::<EnergyLedger>();
    if clock.step == 0 {
        ledger.initial = kinetic + strain + ledger.contact;
        ledger.axial = 0.0;
    }
    ledger.kinetic = kinetic;
    ledger.strain = strain;
}

fn kinetic_energy(world: &mut World, back: f64) -> f64 {
    let mut sum = 0.0;
    let mut nodes = world.query::<(&Velocity, &Force, &InverseMass, &Mass)>();
    for (v, f, w, m) in nodes.iter(world) {
        sum += 0.5 * m.0 * (v.0 - f.0 * w.0 * back).length_squared();
    }
    let mut nodes = world.query::<(&AngularVelocity, &Moment, &InverseInertia, &RotaryInertia)>();
    for (o, m, w, j) in nodes.iter(world) {
        sum += 0.5 * j.0 * (o.0 - m.0 * w.0 * back).length_squared();
    }
    sum
}

/// The first node whose position or velocity is not a finite number, or that crosses the whole
/// model in a few steps.
fn not_finite(world: &mut World) -> Option<String> {
    let clock = world.resource::<Clock>().clone();
    let mut nodes = world.query::<(&Position, &InitialPosition, &Velocity, &Force)>();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (_, x0, _, _) in nodes.iter(world) {
        low = low.min(x0.0);
        high = high.max(x0.0);
    }
    let size = (high - low).length();
    let mut found = None;
    for (row, (x, _, v, f)) in nodes.iter(world).enumerate() {
        if !(x.0.is_finite() && v.0.is_finite() && f.0.is_finite()) {
            found = Some((row, "is not a finite number"));
            break;
        }
        if size > 0.0 && v.0.length() * clock.dt_next > size {
            found = Some((row, "would cross the whole model in one step"));
            break;
        }
    }
    let (row, what) = found?;
    let id = world.resource::<NodeRows>().id(row);
    let place = world.get_resource::<NodePlaces>().and_then(|p| p.0.get(id.row()).cloned().flatten());
    let place = place.map_or(String::new(), |p| format!(" ({p})"));
    Some(format!(
        "node {}{place} {what}; the time step {:.3e} was limited by {} to {:.3e}. Likely causes: a time step above the stable limit, a contact far stiffer than its nodes are heavy, or a load without support. Try integration: (safety: 0.5)",
        id.0, clock.dt, clock.limited_by, clock.dt_limit
    ))
}

/// Where nodes sit ("tow 3, filament 2, node 17"), for messages.
#[derive(Resource, Clone, Debug, Default)]
pub struct NodePlaces(pub Vec<Option<String>>);
