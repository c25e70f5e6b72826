//! `braid-ecs bench SCENE`: the cost of a step in the middle of a run, by set.
//!
//! The scene runs for a while, its state is saved, and a fixed number of steps is timed from the
//! restored state, several times. The fastest pass counts: everything else on the machine only adds.
use super::SceneArgs;
use super::message::{Failure, out};
use super::run::elements;
use crate::ledger::ContactSummary;
use crate::output::timing;
use crate::parallel;
use crate::run;
use crate::scene;
use crate::simulation::{NodeRows, Plugin, Simulation, SimulationError};
use crate::step::StepSet;
use clap::Args;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// Arguments of a bench.
#[derive(Args, Debug)]
pub(super) struct BenchArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Steps before the state that is timed.
    #[arg(long, value_name = "STEPS", default_value_t = 5000)]
    warm: u64,
    /// Steps in a timed pass.
    #[arg(long, value_name = "STEPS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Timed passes; the fastest counts.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    passes: u32,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// The result.
#[derive(Debug, Serialize)]
struct Report {
    scene: String,
    version: &'static str,
    threads: usize,
    elements: usize,
    contacts: usize,
    /// Contact records of the neighbour list, and how many of them are near.
    records: usize,
    near_records: usize,
    /// Steps that a neighbour list and a look at all its records last; zero if there was none.
    steps_per_list: f64,
    steps_per_look: f64,
    warm_steps: u64,
    steps: u64,
    steps_per_s: f64,
    element_steps_per_s: f64,
    ns_per_element_step: f64,
    /// ns per element and step of each set.
    sets: BTreeMap<String, f64>,
    /// Share of the two sets of contact.
    contact_share: f64,
    /// Slowest over fastest pass.
    spread: f64,
}

/// Times a scene and prints what its steps cost. Nothing is written.
pub(super) fn bench(args: &BenchArgs, plugins: impl Plugin + Send) -> Result<(), Failure> {
    let report = args.scene.with_threads(|| measure(args, plugins))??;
    if args.json {
        out(&serde_json::to_string_pretty(&report).expect("numbers and texts only"));
        return Ok(());
    }
    let r = &report;
    out(&format!(
        "{}: {} elements, {} contacts, {} threads, {} steps from step {}",
        r.scene, r.elements, r.contacts, r.threads, r.steps, r.warm_steps
    ));
    if r.records > 0 {
        let last = |steps: f64| if steps > 0.0 { format!("{steps:.1} steps") } else { "the whole pass".into() };
        let (list, look) = (last(r.steps_per_list), last(r.steps_per_look));
        out(&format!("  {} records, {} of them near; a list lasts {list}, a look {look}", r.records, r.near_records));
    }
    out("  set              ns per element-step");
    for set in StepSet::ORDER {
        let name = format!("{set:?}");
        out(&format!("  {name:<16} {:8.2}  {:5.1} %", r.sets[&name], 100.0 * r.sets[&name] / r.ns_per_element_step));
    }
    out(&format!("  {:<16} {:8.2}", "all", r.ns_per_element_step));
    out(&format!(
        "  {:.0} steps/s, {:.2} million element-steps/s, contact {:.1} %, slowest pass {:.2} times the fastest",
        r.steps_per_s,
        1e-6 * r.element_steps_per_s,
        100.0 * r.contact_share,
        r.spread
    ));
    Ok(())
}

fn measure(args: &BenchArgs, plugins: impl Plugin) -> Result<Report, Failure> {
    let mut sim = Simulation::new(plugins);
    let loaded = scene::load(&args.scene.scene, &args.scene.sets, &sim.registry)?;
    timing::install(&mut sim);
    sim.build(&loaded.model).and_then(|()| run::start(&mut sim, &loaded.model)).map_err(|e| Failure::of_start(&loaded, e))?;
    steps(&mut sim, args.warm)?;
    let saved = sim.save_state().map_err(SimulationError::Model)?;
    let mut passes = Vec::new();
    let seen = |sim: &Simulation| sim.world.get_resource::<ContactSummary>().copied().unwrap_or_default();
    let before = seen(&sim);
    for _ in 0..args.passes {
        sim.restore_state(&saved).map_err(SimulationError::Model)?;
        timing::reset(&mut sim.world);
        let begin = Instant::now();
        steps(&mut sim, args.steps)?;
        passes.push((begin.elapsed().as_secs_f64(), timing::share(&sim.world)));
    }
    let slowest = passes.iter().map(|p| p.0).fold(0.0, f64::max);
    let (seconds, share) = passes.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).expect("one pass at least");
    let elements = elements(&sim, &loaded.model).max(1);
    let now = seen(&sim);
    let every = |from: u64, to: u64| if to > from { args.steps as f64 / (to - from) as f64 } else { 0.0 };
    let whole = seconds / args.steps as f64;
    let per_element = 1e9 * whole / elements as f64;
    let of = |set: StepSet| share.get(&format!("{set:?}")).copied().unwrap_or(0.0);
    Ok(Report {
        scene: loaded.name(),
        version: env!("CARGO_PKG_VERSION"),
        threads: rayon::current_num_threads(),
        elements,
        contacts: now.active,
        records: now.records,
        near_records: now.near,
        steps_per_list: every(before.rebuilds, now.rebuilds),
        steps_per_look: every(before.looks, now.looks),
        warm_steps: args.warm,
        steps: args.steps,
        steps_per_s: 1.0 / whole,
        element_steps_per_s: elements as f64 / whole,
        ns_per_element_step: per_element,
        sets: StepSet::ORDER.iter().map(|set| (format!("{set:?}"), per_element * of(*set))).collect(),
        contact_share: of(StepSet::ContactSearch) + of(StepSet::ContactForces),
        spread: slowest / seconds,
    })
}

fn steps(sim: &mut Simulation, count: u64) -> Result<(), SimulationError> {
    let rows = sim.world.resource::<NodeRows>().len();
    parallel::awake(rows, || (0..count).try_for_each(|_| run::step(sim)))
}
