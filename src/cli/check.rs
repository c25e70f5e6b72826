//! `braid-ecs check SCENE`: reads and builds a scene, and tells what a run would be like.
use super::SceneArgs;
use super::message::{Failure, out};
use super::progress::duration_text;
use super::run::notes;
use crate::memory;
use crate::run::{self, expected_duration};
use crate::scene;
use crate::simulation::{NodeRows, Plugin, Simulation};
use crate::step::Clock;
use clap::Args;
use std::time::{Duration, Instant};

/// Arguments of a check.
#[derive(Args, Debug)]
pub(super) struct CheckArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
}

/// Steps are tried for this long to measure their speed, at most [`TRIED`] of them.
const TRY_FOR: Duration = Duration::from_millis(400);
const TRIED: u64 = 200;

/// Checks a scene and prints what a run would be like. Nothing is written.
pub(super) fn check(args: &CheckArgs, plugins: impl Plugin + Send) -> Result<(), Failure> {
    args.scene.with_threads(|| try_out(args, plugins))?
}

fn try_out(args: &CheckArgs, plugins: impl Plugin) -> Result<(), Failure> {
    let mut sim = Simulation::new(plugins);
    let loaded = scene::load(&args.scene.scene, &args.scene.sets, &sim.registry)?;
    let (model, units) = (&loaded.model, loaded.scene.units);
    sim.build(model).and_then(|()| run::start(&mut sim, model)).map_err(|e| Failure::of_start(&loaded, e))?;
    let row = |name: &str, text: String| out(&format!("  {name:<12} {text}"));
    out(&format!("{}: the scene is sound", args.scene.scene.display()));
    for hint in &loaded.hints {
        out(&hint.line("hint: "));
    }
    let dummies = model.nodes.iter().filter(|n| n.dummy).count();
    let rows = sim.world.resource::<NodeRows>().len();
    row("nodes", format!("{} ({dummies} dummy, {} tied), {rows} rows", model.nodes.len(), model.ties.len()));
    let kinds = sim.registry.elements.iter().map(|k| (k.name, (k.count)(model))).filter(|k| k.1 > 0);
    row("elements", kinds.map(|(name, n)| format!("{n} {name}")).collect::<Vec<_>>().join(", "));
    row("filaments", model.filaments.len().to_string());
    row("constraints", format!("{} periodic pairs, {} equations", model.periodic.len(), model.equations.len()));
    let begin = Instant::now();
    while begin.elapsed() < TRY_FOR && sim.world.resource::<Clock>().step < TRIED {
        run::step(&mut sim)?;
    }
    let clock = sim.world.resource::<Clock>().clone();
    let per_step = begin.elapsed().as_secs_f64() / clock.step.max(1) as f64;
    row("time step", format!("{:.3e} {}, limit {:.3e} by {}", clock.dt_target, units.time(), clock.dt_limit, clock.limited_by));
    match expected_duration(model, clock.dt_target) {
        Some(duration) => {
            let steps = duration / clock.dt_target;
            row("steps", format!("about {steps:.0} to t = {duration:.4e} {}", units.time()));
            let speed = format!("{:.1} us a step with {} threads, from {} steps", 1e6 * per_step, rayon::current_num_threads(), clock.step);
            row("duration", format!("about {} ({speed}; contacts come on top)", duration_text(steps * per_step)));
        }
        None => row("steps", "unknown: the end depends on the steady state alone".into()),
    }
    if let Some(peak) = memory::peak() {
        let machine = memory::of_machine().map_or(String::new(), |m| format!(", of {} that this machine has", memory::text(m)));
        row("memory", format!("{} with the first contacts{machine}", memory::text(peak)));
    }
    notes(&sim);
    Ok(())
}
