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

/// Bounds of the elements at the last look: a new list of contacts does not change them.
#[derive(Resource, Default, Serialize, Deserialize)]
struct ElementBounds(Vec<(String, Vec<StiffnessBound>)>);

fn follow_limit(world: &mut World) {
    let rule = *world.resource::<StepRule>();
    let step = world.resource::<Clock>().step;
    let changed = std::mem::take(&mut world.resource_mut::<StiffnessChanged>().0);
    if step == 0 || !(changed || step.is_multiple_of(rule.every)) || world.resource::<Failure>().0.is_some() {
        return;
    }
    let known = if step.is_multiple_of(rule.every) { Vec::new() } else { std::mem::take(&mut world.resource_mut::<ElementBounds>().0) };
    let (limit, by, elements) = limit_from(world, known);
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
    let (limit, by, _) = limit_from(world, Vec::new());
    (limit, by)
}

/// The stable limit with the bounds of the elements, taken now if none are given.
fn limit_from(world: &mut World, elements: Vec<(String, Vec<StiffnessBound>)>) -> (f64, String, Vec<(String, Vec<StiffnessBound>)>) {
    let mut masses = world.query::<(&Mass, Option<&RotaryInertia>)>();
    let masses: Vec<(f64, f64)> = masses.iter(world).map(|(m, j)| (m.0, j.map_or(0.0, |j| j.0))).collect();
    let zero = vec![StiffnessBound::default(); masses.len()];
    let mut parts = elements;
    if parts.is_empty()
        && let Some(kinds) = world.remove_resource::<KindReports>()
    {
        for k in &kinds.0 {
            let mut part = zero.clone();
            (k.stiffness)(world, &mut part);
            parts.push((k.name.to_string(), part));
        }
        world.insert_resource(kinds);
    }
    let kinds = parts.len();
    if let Some(sources) = world.remove_resource::<StiffnessSources>() {
        for (name, source) in &sources.0 {
            let mut part = zero.clone();
            source(world, &mut part);
            parts.push(((*name).to_string(), part));
        }
        world.insert_resource(sources);
    }
    let mut worst = (0.0f64, 0usize, false);
    for (row, (m, j)) in masses.iter().enumerate() {
        let (mut translation, mut rotation) = (0.0, 0.0);
        for (_, p) in &parts {
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
        parts.truncate(kinds);
        return (longest, "the implicit axial scheme".into(), parts);
    }
    if omega2 == 0.0 {
        parts.truncate(kinds);
        return (f64::INFINITY, "nothing".into(), parts);
    }
    let share = |p: &StiffnessBound| if rotates { p.rotation } else { p.translation };
    let name = parts.iter().max_by(|a, b| share(&a.1[row]).total_cmp(&share(&b.1[row]))).map_or("nothing", |p| p.0.as_str()).to_owned();
    let id = world.resource::<NodeRows>().id(row);
    let how = if rotates { " (rotation)" } else { "" };
    parts.truncate(kinds);
    (2.0 / omega2.sqrt(), format!("{name}{how} at node {}", id.0), parts)
}
