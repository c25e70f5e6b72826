//! `braid-ecs resume DIR`: goes on with a run from its last checkpoint.
use super::message::{self, Failure, out};
use super::run::{self, Start, WatchArgs, simulation};
use super::with_threads;
use crate::checkpoint::{CheckpointError, Found, Header, Orders, Store};
use crate::model::{Model, Stop};
use crate::output::failure::FailureReport;
use crate::output::provenance::REVISION;
use crate::output::summary::{Retry, Summary};
use crate::output::{Outcome, Recorder};
use crate::run::{Status, start};
use crate::scene::load_text;
use crate::scene::schema::OutputSpec;
use crate::scene::units::{Time, UnitSystem};
use crate::simulation::{Plugin, Simulation};
use crate::step::Clock;
use crate::systems::time_step::scale_safety;
use clap::Args;
use std::path::{Path, PathBuf};

/// Arguments of `resume`.
#[derive(Args, Debug)]
pub(super) struct ResumeArgs {
    /// Output folder of the run.
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
    /// Run until this time instead of the end that the scene gives: `--until "30 ms"`.
    #[arg(long, value_name = "TIME")]
    until: Option<String>,
    /// Go on from this checkpoint instead of the newest one.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Threads to use (default: all processors).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(flatten)]
    watch: WatchArgs,
}

/// Goes on with a run, prints the outcome. A run that is over stays as it is.
pub(super) fn resume(args: &ResumeArgs, plugins: impl Plugin + Send + Sync) -> Result<(), Failure> {
    if args.until.is_none()
        && args.from.is_none()
        && let Ok(s) = Summary::read(&args.dir)
        && [Status::Completed, Status::Converged].iter().any(|status| status.word() == s.status)
    {
        tell_over(args, &s.status, s.time.unwrap_or(f64::NAN), s.steps);
        return Ok(());
    }
    match with_threads(args.threads, || simulate(args, &plugins))?? {
        Some(outcome) => run::conclude(&outcome, &args.watch),
        None => Ok(()),
    }
}

fn tell_over(args: &ResumeArgs, status: &str, time: f64, step: u64) {
    if !args.watch.quiet {
        out(&format!("the run in {} is over: {status} at t = {time:.4e}, step {step}", args.dir.display()));
        out("  to let it run on: --until TIME");
    }
}

/// The outcome, or none if the run is over.
fn simulate(args: &ResumeArgs, plugins: &impl Plugin) -> Result<Option<Outcome>, Failure> {
    let mut store = Store::open(&args.dir)?;
    let found = store.find(args.from.as_deref())?;
    let mut header = found.checkpoint.header.clone();
    if let Some(text) = &args.until {
        let units = load_text(&header.scene, found.scene.clone(), &[], &simulation(plugins).registry)?.scene.units;
        header.until = Some(until(text, units, &header)?);
    } else if let Some(status) = header.ended {
        tell_over(args, status.word(), header.time, header.step);
        return Ok(None);
    }
    let (watch, quiet) = (&args.watch, args.watch.quiet);
    go_on(store, found, header, &args.dir, &|output| watch.orders(output), quiet, plugins).map(Some)
}

/// Goes on with a run from a checkpoint. `header` is that of the checkpoint, or says what has changed since: another end, one
/// more retry.
pub(super) fn go_on(
    store: Store,
    found: Found,
    mut header: Header,
    dir: &Path,
    orders: &dyn Fn(&OutputSpec) -> Orders,
    quiet: bool,
    plugins: &impl Plugin,
) -> Result<Outcome, Failure> {
    let mut sim = simulation(plugins);
    let mut loaded = load_text(&header.scene, found.scene.clone(), &[], &sim.registry)?;
    if let Some(time) = header.until {
        loaded.model.stop = Stop { time: Some(time), steps: None, steady: None };
        header.duration = Some(time);
    }
    let model: &Model = &loaded.model;
    run::time_sets(&mut sim, model);
    sim.build(model).and_then(|()| start(&mut sim, model)).map_err(|e| Failure::of_start(&loaded, e))?;
    // Nothing on the disk changes before everything has been found good.
    let mut recorder = Recorder::resumed(&loaded, &mut sim, dir, found.checkpoint.recorder.clone())?;
    sim.restore_state(&found.checkpoint.state).map_err(CheckpointError::State)?;
    shorten_steps(&mut sim, header.retries.len(), found.checkpoint.header.retries.len());
    store.clear_after(&found)?;
    recorder.rewind()?;
    if !quiet {
        for (path, fault) in &found.passed_over {
            message::line(&format!("note: `{}` {fault}; an older checkpoint is used", path.display()));
        }
        let (name, unit) = (loaded.name(), loaded.scene.units.time());
        message::line(&format!("{name}: goes on at t = {:.4e} {unit}, step {}, from {}", header.time, header.step, found.path.display()));
        run::notes(&sim);
        if header.revision != REVISION {
            message::line(&format!(
                "note: the checkpoint was written by revision {}, and this is {REVISION}: it may go on with other numbers",
                header.revision
            ));
        }
    }
    header.revision = REVISION.into();
    let orders = orders(&loaded.scene.output);
    let start = Start { sim, loaded: &loaded, recorder, store, header, resumed: Some(found.checkpoint) };
    run::carry_on(start, orders, quiet, plugins)
}

/// The time step of a run that has been tried again so many times, from a state in which it had been `before` times.
fn shorten_steps(sim: &mut Simulation, retries: usize, before: usize) {
    let half = |times: usize| 0.5f64.powi(times as i32);
    scale_safety(&mut sim.world, half(retries));
    sim.world.resource_mut::<Clock>().dt_target *= half(retries - before);
}

/// The header of a run that goes back to a state after a failure; `before` are the failures from which it has come back already,
/// of which the state may not know yet.
pub(super) fn with_retry(good: &Header, before: Vec<Retry>, failure: &FailureReport, safety: f64) -> Header {
    let mut retries = before;
    let safety = safety * 0.5f64.powi(retries.len() as i32 + 1);
    let FailureReport { time, step, message, .. } = failure;
    retries.push(Retry { time: *time, step: *step, message: message.clone(), from_step: good.step, safety });
    Header { retries, ..good.clone() }
}

/// The wanted end time.
fn until(text: &str, units: UnitSystem, header: &Header) -> Result<f64, Failure> {
    let wrong = |why: String| Failure::Usage(format!("--until {text}: {why}"));
    let time = units.while_reading(|| Time::parse(text)).map_err(wrong)?.0;
    if time <= header.time {
        return Err(wrong(format!("the checkpoint is at t = {:.4e} {} already", header.time, units.time())));
    }
    Ok(time)
}
