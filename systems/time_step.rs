//! The stable time step of central differences: dt < 2 / omega_max.
//!
//! Every element, contact and surface gives a bound on its tangent stiffness, K_e <= diag(kappa_e). With the
//! sum kappa and lumped masses M the largest frequency satisfies omega^2 <= max_i kappa_i / M_i (Gershgorin
//! discs of M^-1 K; T. Belytschko, W. K. Liu, B. Moran, *Nonlinear Finite Elements for Continua and
//! Structures* (2000), section 6.2), also after constraints are eliminated. A uniform chain of
//! bars meets the bound exactly: dt = l / c.
use crate::systems::axial_implicit::AxialChains;
use braid_ecs::prelude::*;

/// Registers the time-step monitor.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("time step", install);
}

/// How the time step follows its limit.
#[derive(Resource, Clone, Copy, Debug)]
struct StepRule {
    safety: f64,
    fixed: bool,
    every: u64,
}

/// Multiplies the safety factor: a run that is tried again takes smaller steps, from the next one on.
pub fn scale_safety(world: &mut World, factor: f64) {
    world.resource_mut::<StepRule>().safety *= factor;
}

fn install(cx: &mut Install<'_>) {
    let i = &cx.model.integration;
    // Linear bulk viscosity b lowers the limit to sqrt(1 + b^2) - b.
    let viscosity = (1.0 + i.bulk_viscosity * i.bulk_viscosity).sqrt() - i.bulk_viscosity;
    cx.world.insert_resource(StepRule { safety: i.safety * viscosity, fixed: i.dt.is_some(), every: u64::from(i.monitor_every.max(1)) });
    cx.world.init_resource::<StiffnessChanged>();
    cx.world.init_resource::<ElementBounds>();
    cx.remember_resource::<StiffnessChanged>();
    cx.remember_resource::<ElementBounds>();
    cx.add_system(StepSet::Monitor, follow_limit);
}

/// Bounds by row of each kind of elements, contacts or surfaces, with its name.
type Bounds = Vec<(String, Vec<StiffnessBound>)>;

/// Bounds of the elements at the last look: a new list of contacts does not change them.
#[derive(Resource, Default, Serialize, Deserialize)]
struct ElementBounds(Bounds);

fn follow_limit(world: &mut World) {
    let rule = *world.resource::<StepRule>();
    let step = world.resource::<Clock>().step;
    let changed = std::mem::take(&mut world.resource_mut::<StiffnessChanged>().0);
    // Often at first: what begins without tension may soon be stiff.
    let look = step.is_multiple_of(rule.every) || step.is_power_of_two() && step < rule.every;
    if step == 0 || !(changed || look) || world.resource::<Failure>().0.is_some() {
        return;
    }
    let known = std::mem::take(&mut world.resource_mut::<ElementBounds>().0);
    let elements = if known.is_empty() || look { element_bounds(world) } else { known };
    let (limit, by) = limit_with(world, &elements);
    world.resource_mut::<ElementBounds>().0 = elements;
    let mut clock = world.resource_mut::<Clock>();
    clock.dt_limit = limit;
    clock.limited_by = by;
    let wanted = rule.safety * limit;
    if !rule.fixed && wanted.is_finite() && (wanted < clock.dt_target || wanted > 1.05 * clock.dt_target) {
        clock.dt_target = wanted;
    }
}

/// The stable limit now (time) and the name of what sets it.
pub fn stable_limit(world: &mut World) -> (f64, String) {
    let elements = element_bounds(world);
    limit_with(world, &elements)
}

fn no_bound(world: &mut World) -> Vec<StiffnessBound> {
    vec![StiffnessBound::default(); world.query::<&Mass>().iter(world).len()]
}

fn element_bounds(world: &mut World) -> Bounds {
    let zero = no_bound(world);
    let mut bounds = Bounds::new();
    if let Some(kinds) = world.remove_resource::<KindReports>() {
        for k in &kinds.0 {
            let mut part = zero.clone();
            (k.stiffness)(world, &mut part);
            bounds.push((k.name.to_string(), part));
        }
        world.insert_resource(kinds);
    }
    bounds
}

/// Bounds of contacts and surfaces.
fn contact_bounds(world: &mut World) -> Bounds {
    let zero = no_bound(world);
    let mut bounds = Bounds::new();
    if let Some(sources) = world.remove_resource::<StiffnessSources>() {
        for (name, source) in &sources.0 {
            let mut part = zero.clone();
            source(world, &mut part);
            bounds.push(((*name).to_string(), part));
        }
        world.insert_resource(sources);
    }
    bounds
}

/// The stable limit with the given bounds of the elements.
fn limit_with(world: &mut World, elements: &Bounds) -> (f64, String) {
    let contacts = contact_bounds(world);
    let parts = || elements.iter().chain(&contacts);
    let mut masses = world.query::<(&Mass, Option<&RotaryInertia>)>();
    let masses: Vec<(f64, f64)> = masses.iter(world).map(|(m, j)| (m.0, j.map_or(0.0, |j| j.0))).collect();
    let mut worst = (0.0f64, 0usize, false);
    for (row, (m, j)) in masses.iter().enumerate() {
        let (mut translation, mut rotation) = (0.0, 0.0);
        for (_, p) in parts() {
            translation += p[row].translation;
            rotation += p[row].rotation;
        }
        if *m > 0.0 && translation / m > worst.0 {
            worst = (translation / m, row, false);
        }
        if *j > 0.0 && rotation / j > worst.0 {
            worst = (rotation / j, row, true);
        }
    }
    let longest = world.get_resource::<AxialChains>().map_or(f64::INFINITY, |c| c.longest_step);
    let (omega2, row, rotates) = worst;
    if omega2 * longest * longest < 4.0 {
        return (longest, "the implicit axial scheme".into());
    }
    if omega2 == 0.0 {
        return (f64::INFINITY, "nothing".into());
    }
    let share = |p: &StiffnessBound| if rotates { p.rotation } else { p.translation };
    let name = parts().max_by(|a, b| share(&a.1[row]).total_cmp(&share(&b.1[row]))).map_or("nothing", |p| p.0.as_str());
    let id = world.resource::<NodeRows>().id(row);
    let how = if rotates { " (rotation)" } else { "" };
    (2.0 / omega2.sqrt(), format!("{name}{how} at node {}", id.0))
}
