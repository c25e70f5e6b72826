//! `braid-ecs SCENE`: runs a scene.
use super::message::{self, Failure};
use super::progress::{Progress, Watcher, catch_interrupts, interrupted};
use super::{SceneArgs, report};
use crate::model::Model;
use crate::output::{Outcome, Recorder, file, timing};
use crate::run::{self, Status, expected_duration};
use crate::scene::load;
use crate::simulation::{Notes, Plugin, Simulation, SimulationError};
use crate::step::Clock;
use clap::Args;
use std::path::PathBuf;

/// Arguments of a run besides the scene.
#[derive(Args, Debug)]
pub(super) struct RunArgs {
    /// Output folder [default: results/<scene>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Move results of an earlier run aside (to <folder>.1, .2, ...) instead of refusing.
    #[arg(long)]
    force: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// Elements from which steps are timed by set: the markers cost 0.46 us a step (measured), and a
/// step of so many elements takes more than 100 us.
const TIMED_FROM: usize = 2000;

/// Runs a scene, prints the outcome.
pub(super) fn run(scene: &SceneArgs, args: &RunArgs, plugins: impl Plugin + Send) -> Result<(), Failure> {
    let outcome = scene.with_threads(|| simulate(scene, args, plugins))??;
    if !args.quiet {
        report::print(&outcome);
    }
    if interrupted() { Err(Failure::Interrupted) } else { Ok(()) }
}

fn simulate(scene: &SceneArgs, args: &RunArgs, plugins: impl Plugin) -> Result<Outcome, Failure> {
    let mut sim = Simulation::new(plugins);
    let loaded = load(&scene.scene, &scene.sets, &sim.registry)?;
    let model = &loaded.model;
    if elements(&sim, model) >= TIMED_FROM {
        timing::install(&mut sim);
    }
    // A model that cannot start leaves no folder behind.
    sim.build(model).and_then(|()| run::start(&mut sim, model)).map_err(|e| Failure::of_start(&loaded, e))?;
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from("results").join(loaded.name()));
    if let Some(aside) = file::claim_folder(&folder, args.force)?
        && !args.quiet
    {
        message::line(&format!("earlier results moved to {}", aside.display()));
    }
    if !args.quiet {
        let (name, nodes) = (loaded.name(), model.nodes.len());
        message::line(&format!("{name}: {nodes} nodes, {} elements; results go to {}", elements(&sim, model), folder.display()));
        notes(&sim);
    }
    let dt = sim.world.resource::<Clock>().dt_target;
    let duration = expected_duration(model, dt);
    let mut recorder = Recorder::new(&loaded, &mut sim, &folder, duration)?;
    // Often enough for the progress to move, and for the recorder.
    let interval = recorder.interval(dt).min(duration.unwrap_or(f64::INFINITY) / 400.0);
    let progress = Progress::new(duration, loaded.scene.units.time(), args.quiet);
    catch_interrupts("stopping after this step; press Ctrl-C again to give up the results");
    let mut watcher = Watcher { recorder: &mut recorder, progress };
    let ended = run::continue_run(&mut sim, model, interval, &mut watcher);
    watcher.progress.clear();
    if let Some(error) = recorder.error() {
        return Err(error.into());
    }
    match ended {
        Ok(status) => {
            let word = match status {
                Status::Converged => "converged",
                Status::Completed => "completed",
                Status::Stopped => "stopped",
            };
            Ok(recorder.finish(&mut sim, word)?)
        }
        Err(error @ SimulationError::Numerical { .. }) => {
            // What was computed is kept; the numerical failure is the error to report.
            if let Err(second) = recorder.finish(&mut sim, "failed") {
                message::line(&format!("also: {second}"));
            }
            message::line(&format!("what was computed is in {}", folder.display()));
            Err(error.into())
        }
        Err(error) => Err(error.into()),
    }
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
