//! `braid-ecs SCENE`: runs a scene.
use super::message::{self, Failure};
use super::progress::{Progress, Watcher};
use super::{SceneArgs, report, resume, signals};
use crate::checkpoint::{Checkpoint, CheckpointError, Found, Header, Keeper, Orders, SceneHash, Store, store};
use crate::model::Model;
use crate::output::failure::FailureReport;
use crate::output::provenance::REVISION;
use crate::output::{Outcome, Recorder, file, timing};
use crate::parallel;
use crate::run::{self, Status, expected_duration};
use crate::scene::schema::{OnFailure, OutputSpec};
use crate::scene::units::WallTime;
use crate::scene::{LoadedScene, load};
use crate::simulation::{NodeRows, Notes, Plugin, Simulation, SimulationError};
use crate::step::Clock;
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of a run besides the scene.
#[derive(Args, Debug)]
pub(super) struct RunArgs {
    /// Output folder [default: results/<scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Move results of an earlier run aside (to <folder>.1, .2, ...) instead of refusing.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    watch: WatchArgs,
}

/// How a run is watched.
#[derive(Args, Debug)]
pub(super) struct WatchArgs {
    /// Stop after this wall-clock time, in order: `--time-limit "10 min"`. `resume` goes on.
    #[arg(long, value_name = "DURATION", value_parser = WallTime::parse)]
    time_limit: Option<WallTime>,
    /// Print nothing but errors.
    #[arg(long, short)]
    pub quiet: bool,
}

impl WatchArgs {
    /// What the run is told from outside; signals are caught from now on.
    pub fn orders(&self, output: &OutputSpec) -> Orders {
        let wall = |w: Option<WallTime>| w.map(|w| w.0);
        let orders = Orders { checkpoint: wall(output.checkpoint), time_limit: wall(self.time_limit), ..Default::default() };
        signals::catch(&orders.stop);
        orders
    }
}

/// Elements from which steps are timed by set: the markers cost 0.46 us a step (measured), and a
/// step of so many elements takes more than 100 us.
const TIMED_FROM: usize = 2000;

/// Times the steps by set where that costs little; call it before the model is built.
pub(super) fn time_sets(sim: &mut Simulation, model: &Model) {
    if elements(sim, model) >= TIMED_FROM {
        timing::install(sim);
    }
}

/// Runs a scene, prints the outcome.
pub(super) fn run(scene: &SceneArgs, args: &RunArgs, plugins: impl Plugin + Send + Sync) -> Result<(), Failure> {
    let outcome = scene.with_threads(|| simulate(scene, args, &plugins))??;
    conclude(&outcome, &args.watch)
}

/// Prints the outcome; a run that was stopped has an exit code of its own.
pub(super) fn conclude(outcome: &Outcome, watch: &WatchArgs) -> Result<(), Failure> {
    if !watch.quiet {
        report::print(outcome);
    }
    if outcome.summary.status == Status::Stopped.word() { Err(Failure::Stopped(outcome.folder.clone())) } else { Ok(()) }
}

fn simulate(scene: &SceneArgs, args: &RunArgs, plugins: &impl Plugin) -> Result<Outcome, Failure> {
    let quiet = args.watch.quiet;
    let mut sim = simulation(plugins);
    let loaded = load(&scene.scene, &scene.sets, &sim.registry)?;
    let model = &loaded.model;
    time_sets(&mut sim, model);
    // A model that cannot start leaves no folder behind.
    sim.build(model).and_then(|()| run::start(&mut sim, model)).map_err(|e| Failure::of_start(&loaded, e))?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("results").join(loaded.name()));
    if store::in_use(&folder) == Some(true) {
        return Err(CheckpointError::InUse(folder).into());
    }
    if let Some(aside) = file::claim_folder(&folder, args.force)?
        && !quiet
    {
        message::line(&format!("earlier results moved to {}", aside.display()));
    }
    if !quiet {
        let (name, nodes) = (loaded.name(), model.nodes.len());
        message::line(&format!("{name}: {nodes} nodes, {} elements; results go to {}", elements(&sim, model), folder.display()));
        notes(&sim);
        if !loaded.hints.is_empty() {
            let (n, file) = (loaded.hints.len(), loaded.path.display());
            message::line(&format!("{n} hint{}: braid-ecs check {file}", if n == 1 { "" } else { "s" }));
        }
    }
    let dt = sim.world.resource::<Clock>().dt_target;
    let duration = expected_duration(model, dt);
    let store = Store::create(&folder, &loaded.text)?;
    let recorder = Recorder::new(&loaded, &mut sim, &folder, duration)?;
    let header = Header {
        program: env!("CARGO_PKG_VERSION").into(),
        revision: REVISION.into(),
        scene: loaded.path.display().to_string(),
        scene_hash: SceneHash::of(&loaded.text),
        step: 0,
        time: 0.0,
        // Often enough for the progress to move, and for the recorder.
        sample_interval: recorder.interval(dt).min(duration.unwrap_or(f64::INFINITY) / 400.0),
        duration,
        until: None,
        ended: None,
        retries: Vec::new(),
    };
    let orders = args.watch.orders(&loaded.scene.output);
    carry_on(Start { sim, loaded: &loaded, recorder, store, header, resumed: None }, orders, quiet, plugins)
}

/// A run that can begin or go on.
pub(super) struct Start<'a> {
    pub sim: Simulation,
    pub loaded: &'a LoadedScene,
    pub recorder: Recorder<'a>,
    pub store: Store,
    pub header: Header,
    /// The checkpoint from which it goes on.
    pub resumed: Option<Checkpoint>,
}

/// An empty simulation with the plugins of the program.
pub(super) fn simulation(plugins: &impl Plugin) -> Simulation {
    Simulation::new(|sim: &mut Simulation| plugins.build(sim))
}

/// Runs to the end, or to a stop, and writes what belongs to it. A run that fails is tried again if its scene says so.
pub(super) fn carry_on(start: Start<'_>, orders: Orders, quiet: bool, plugins: &impl Plugin) -> Result<Outcome, Failure> {
    let Start { mut sim, loaded, recorder, store, header, resumed } = start;
    let (interval, unit, before) = (header.sample_interval, loaded.scene.units.time(), header.retries.clone());
    let progress = Progress::new(header.duration, unit, quiet);
    let folder = recorder.folder().to_owned();
    let begin = Instant::now();
    let mut keeper = Keeper::new(recorder, store, header, resumed, orders.clone(), unit);
    let mut watcher = Watcher { keeper: &mut keeper, progress };
    let rows = sim.world.resource::<NodeRows>().len();
    let ended = parallel::awake(rows, || run::continue_run(&mut sim, &loaded.model, interval, &mut watcher));
    watcher.progress.clear();
    if let Some(error) = keeper.error() {
        keeper.give_up(&sim);
        return Err(error.into());
    }
    let error = match ended {
        Ok(status) => return Ok(keeper.finish(&mut sim, status.word())?),
        Err(error @ SimulationError::Numerical { .. }) => error,
        Err(error) => return Err(error.into()),
    };
    let mut report = FailureReport::of(&mut sim, &error);
    // A failure is found up to one look after it began, and grows for a while before.
    let steps = 2 * u64::from(loaded.model.integration.monitor_every);
    if let OnFailure::Retry(most) = loaded.scene.watch.on_failure
        && before.len() < most as usize
        && keeper.can_go_back()
    {
        let (store, path, checkpoint) = keeper.go_back(&sim, steps)?;
        let header = resume::with_retry(&checkpoint.header, before, &report, loaded.model.integration.safety);
        if !quiet {
            let (tried, last) = (header.retries.len(), header.retries.last().expect("one was added"));
            message::line(&format!(
                "{error}\nback to step {} with the safety factor {} (try {tried} of {most})",
                last.from_step, last.safety
            ));
        }
        let found = Found { checkpoint, path, scene: loaded.text.clone(), passed_over: Vec::new() };
        let left = orders.time_limit.map(|limit| limit.saturating_sub(begin.elapsed()));
        let orders = Orders { time_limit: left, ..orders };
        return resume::go_on(store, found, header, &folder, &|_| orders.clone(), quiet, plugins);
    }
    // What was computed is kept; the numerical failure is the error to report.
    if let Err(second) = keeper.fail(&mut sim, &mut report, steps) {
        message::line(&format!("also: {second}"));
    }
    message::line(&format!("what was computed is in {}", folder.display()));
    Err(Failure::Run(error, Box::new(report)))
}

/// Number of elements of all kinds.
pub(super) fn elements(sim: &Simulation, model: &Model) -> usize {
    sim.registry.elements.iter().map(|k| (k.count)(model)).sum()
}

/// Prints what the user should know about the way the model is run.
pub(super) fn notes(sim: &Simulation) {
    for note in sim.world.get_resource::<Notes>().map_or(&[][..], |n| &n.0) {
        message::line(&format!("note: {note}"));
    }
}
