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

/// Steps between two chances of the time step to grow, to the least limit among them: it falls at once.
const GROW: u64 = 16;

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
    cx.world.init_resource::<Seen>();
    cx.remember_resource::<StiffnessChanged>();
    cx.remember_resource::<Seen>();
    cx.add_system(StepSet::Monitor, follow_limit);
}

/// What is known of the limit between two looks at everything.
#[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
struct Seen {
    /// Bound of the squared frequency of translations of each row at the last look, without [`ActingStiffness`] (1 / time^2).
    omega2: Vec<f64>,
    /// The limit from that, and what sets it.
    limit: f64,
    by: String,
    /// Least limit since the step could grow last, with what set it.
    least: Option<(f64, String)>,
}

fn follow_limit(world: &mut World) {
    let rule = *world.resource::<StepRule>();
    let step = world.resource::<Clock>().step;
    if step == 0 || world.resource::<Failure>().0.is_some() {
        return;
    }
    let changed = std::mem::take(&mut world.resource_mut::<StiffnessChanged>().0);
    // Often at first: what begins without tension may soon be stiff.
    let early = step.is_power_of_two() && step < rule.every;
    let mut seen = world.remove_resource::<Seen>().expect("inserted by the installer");
    if changed || early || step.is_multiple_of(rule.every) || seen.omega2.is_empty() {
        let acting = world.get_resource::<ActingStiffness>().map_or("", |a| a.name);
        let bounds = bounds(world, |source| source != acting);
        let omega2 = omega2(world, &bounds);
        (seen.limit, seen.by) = limit_of(world, &bounds, &omega2);
        seen.omega2 = omega2.iter().map(|o| o[0]).collect();
    }
    let (mut limit, mut by) = with_acting(world, &seen);
    let turning = world.get_resource::<AxialChains>().map_or(f64::INFINITY, |c| c.turning_step);
    if turning < limit {
        (limit, by) = (turning, "turning bars, integrated implicitly".into());
    }
    if seen.least.as_ref().is_none_or(|(least, _)| limit < *least) {
        seen.least = Some((limit, by));
    }
    let (least, by) = seen.least.as_ref().expect("just set");
    let mut clock = world.resource_mut::<Clock>();
    let wanted = rule.safety * least;
    // Not in the first steps: what will touch has not begun to move.
    let may_grow = step.is_multiple_of(GROW);
    if wanted < clock.dt_target || may_grow {
        (clock.dt_limit, clock.limited_by) = (*least, by.clone());
        if !rule.fixed && wanted.is_finite() && (wanted < clock.dt_target || wanted > 1.05 * clock.dt_target) {
            clock.dt_target = wanted;
        }
    }
    if may_grow {
        seen.least = None;
    }
    world.insert_resource(seen);
}

/// The limit with what acts in this step, and what sets it.
fn with_acting(world: &World, seen: &Seen) -> (f64, String) {
    let acting = world.get_resource::<ActingStiffness>();
    let at = |(row, omega2): &(u32, f64)| (seen.omega2[*row as usize] + omega2, *row);
    let worst = acting.and_then(|a| a.rows.iter().map(at).max_by(|a, b| a.0.total_cmp(&b.0)));
    match (acting, worst) {
        (Some(acting), Some((omega2, row))) if 2.0 < seen.limit * omega2.sqrt() => {
            let id = world.resource::<NodeRows>().id(row as usize);
            (2.0 / omega2.sqrt(), format!("{} at node {}", acting.name, id.0))
        }
        _ => (seen.limit, seen.by.clone()),
    }
}

/// Bounds by row of each kind of elements, contacts or surfaces, with its name.
type Bounds = Vec<(String, Vec<StiffnessBound>)>;

/// The stable limit now (time) and the name of what sets it.
pub fn stable_limit(world: &mut World) -> (f64, String) {
    let bounds = bounds(world, |_| true);
    let omega2 = omega2(world, &bounds);
    limit_of(world, &bounds, &omega2)
}

/// Bounds of all elements, and of those sources that are `asked`.
fn bounds(world: &mut World, asked: impl Fn(&str) -> bool) -> Bounds {
    let zero = vec![StiffnessBound::default(); world.query::<&Mass>().iter(world).len()];
    let mut bounds = Bounds::new();
    if let Some(kinds) = world.remove_resource::<KindReports>() {
        for k in &kinds.0 {
            let mut part = zero.clone();
            (k.stiffness)(world, &mut part);
            bounds.push((k.name.to_string(), part));
        }
        world.insert_resource(kinds);
    }
    if let Some(sources) = world.remove_resource::<StiffnessSources>() {
        for (name, source) in sources.0.iter().filter(|(name, _)| asked(name)) {
            let mut part = zero.clone();
            source(world, &mut part);
            bounds.push(((*name).to_string(), part));
        }
        world.insert_resource(sources);
    }
    bounds
}

/// Sums of the bounds over the masses, by row: of translation and of rotation (1 / time^2).
fn omega2(world: &mut World, bounds: &Bounds) -> Vec<[f64; 2]> {
    let mut masses = world.query::<(&Mass, Option<&RotaryInertia>)>();
    let over = |sum: f64, mass: f64| if mass > 0.0 { sum / mass } else { 0.0 };
    let of = |(row, (m, j)): (usize, (&Mass, Option<&RotaryInertia>))| {
        let sum = |part: fn(&StiffnessBound) -> f64| bounds.iter().map(|(_, b)| part(&b[row])).sum();
        [over(sum(|b| b.translation), m.0), over(sum(|b| b.rotation), j.map_or(0.0, |j| j.0))]
    };
    masses.iter(world).enumerate().map(of).collect()
}

/// The stable limit with the given bounds.
fn limit_of(world: &World, bounds: &Bounds, omega2: &[[f64; 2]]) -> (f64, String) {
    let mut worst = (0.0f64, 0usize, false);
    for (row, &[translation, rotation]) in omega2.iter().enumerate() {
        if translation > worst.0 {
            worst = (translation, row, false);
        }
        if rotation > worst.0 {
            worst = (rotation, row, true);
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
    let name = bounds.iter().max_by(|a, b| share(&a.1[row]).total_cmp(&share(&b.1[row]))).map_or("nothing", |p| p.0.as_str());
    let id = world.resource::<NodeRows>().id(row);
    let how = if rotates { " (rotation)" } else { "" };
    (2.0 / omega2.sqrt(), format!("{name}{how} at node {}", id.0))
}
