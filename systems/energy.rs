//! The energy ledger at monitor steps, and the watch for numbers that went wrong.
use crate::systems::axial_implicit::AxialChains;
use crate::systems::watch::{self, NodePlaces};
use braid_ecs::prelude::*;

/// Registers the energy ledger and the finite check.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("energy", install);
}

/// Steps between two looks; a run may force a look at the next step.
#[derive(Resource, Clone, Copy, Debug)]
pub struct MonitorEvery(pub u64);

/// True when the energies were taken at the current step.
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct LookNow(pub bool);

fn install(cx: &mut Install<'_>) {
    cx.world.init_resource::<EnergyLedger>();
    cx.world.insert_resource(MonitorEvery(u64::from(cx.model.integration.monitor_every.max(1))));
    cx.world.insert_resource(LookNow(true));
    cx.world.init_resource::<Supply>();
    cx.remember_resource::<EnergyLedger>();
    cx.remember_resource::<LookNow>();
    cx.remember_resource::<Supply>();
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
    let (stored, supply) = (kinetic + strain + ledger.contact, ledger.initial + ledger.external_work);
    let mut peak = world.resource_mut::<Supply>();
    peak.0 = peak.0.max(supply);
    let supply = peak.0;
    if clock.step >= SETTLED && supply > 0.0 && stored > RUNAWAY.max(2.0 * swing(&clock)) * supply && stored > rounding(world) {
        let fastest = fastest_node(world);
        let what = format!("has run away: the model holds {stored:.3e} of energy, and only {supply:.3e} was put in");
        let message = blame(world, fastest, &what);
        world.resource_mut::<Failure>().0.get_or_insert(message);
    }
    watch::look(world);
}

/// Largest energy that was ever put in (force x length).
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Supply(f64);

/// Energy over what was put in from which a run counts as runaway, and the steps until it is looked at:
/// in the first ones the work of the loads lags half a step behind.
const RUNAWAY: f64 = 10.0;
const SETTLED: u64 = 100;

/// How much more energy than at its ends a sound vibration may show in the middle of a swing: central differences keep
/// kinetic + strain - (dt^2 / 8) sum m a.a, so that at s times the limit the sum goes up to 1 / (1 - s^2) of what was put in.
pub(super) fn swing(clock: &Clock) -> f64 {
    let s = clock.dt.max(clock.dt_next) / clock.dt_limit;
    1.0 / (1.0 - s * s).max(1e-3)
}

/// Energy of a model that moves by the rounding of its coordinates in every step, also in the short ones at its start.
pub(super) fn rounding(world: &mut World) -> f64 {
    let first = world.get_resource::<AxialChains>().map_or(f64::INFINITY, |c| c.explicit_step);
    let dt = world.resource::<Clock>().dt_next.min(first);
    let mut nodes = world.query::<(&Position, &Mass)>();
    nodes.iter(world).map(|(x, m)| m.0 * (f64::EPSILON * x.0.length() / dt).powi(2)).sum()
}

/// Row of the node with the largest kinetic energy.
pub(super) fn fastest_node(world: &mut World) -> usize {
    let mut nodes = world.query::<(&Velocity, &Mass)>();
    let energy = nodes.iter(world).map(|(v, m)| m.0 * v.0.length_squared()).enumerate();
    energy.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(row, _)| row)
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

/// The first node whose position or velocity is not a finite number, or the fastest of those that would cross the
/// whole model in one step.
fn not_finite(world: &mut World) -> Option<String> {
    let clock = world.resource::<Clock>().clone();
    let mut nodes = world.query::<(&Position, &InitialPosition, &Velocity, &Force)>();
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (_, x0, _, _) in nodes.iter(world) {
        low = low.min(x0.0);
        high = high.max(x0.0);
    }
    let size = (high - low).length();
    let (mut found, mut fastest) = (None, size);
    for (row, (x, _, v, f)) in nodes.iter(world).enumerate() {
        if !(x.0.is_finite() && v.0.is_finite() && f.0.is_finite()) {
            found = Some((row, "is not a finite number"));
            break;
        }
        let way = v.0.length() * clock.dt_next;
        if size > 0.0 && way > fastest {
            fastest = way;
            found = Some((row, "would cross the whole model in one step"));
        }
    }
    let (row, what) = found?;
    Some(blame(world, row, what))
}

/// What is wrong with a node, where it sits, and the likely causes.
fn blame(world: &World, row: usize, what: &str) -> String {
    let clock = world.resource::<Clock>();
    let id = world.resource::<NodeRows>().id(row);
    let place = world.get_resource::<NodePlaces>().and_then(|p| p.text(id));
    let place = place.map_or(String::new(), |p| format!(" ({p})"));
    format!(
        "node {}{place} {what}; the time step {:.3e} was limited by {} to {:.3e}. Likely causes: a time step above the stable limit, a contact far stiffer than its nodes are heavy, or a load without support. Try integration: (safety: 0.5)",
        id.0, clock.dt, clock.limited_by, clock.dt_limit
    )
}
