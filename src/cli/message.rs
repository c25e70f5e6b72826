//! What can go wrong, how it is said, and the exit code it gives.
use crate::checkpoint::CheckpointError;
use crate::output::OutputError;
use crate::output::failure::FailureReport;
use crate::scene::LoadedScene;
use crate::scene::error::SceneErrors;
use crate::simulation::SimulationError;
use crate::study::StudyError;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a command did not finish.
#[derive(Debug)]
pub enum Failure {
    /// Arguments that make no sense.
    Usage(String),
    /// The scene is invalid or cannot be read.
    Scene(Box<SceneErrors>),
    /// The model cannot be built or the run has failed.
    Simulation(SimulationError),
    /// A run has failed; what is known about where and how.
    Run(SimulationError, Box<FailureReport>),
    /// A result cannot be written.
    Output(OutputError),
    /// A study cannot be run.
    Study(StudyError),
    /// So many runs of a study have failed.
    Rows(usize),
    /// So many known answers were missed.
    Short(usize),
    /// No checkpoint can be used.
    Checkpoint(CheckpointError),
    /// The run in this folder was stopped and can be resumed.
    Stopped(PathBuf),
    /// A study was stopped before its end; rows that have finished are kept.
    StudyStopped,
}

impl Failure {
    /// A model that cannot be spawned or started, with the place in its scene.
    pub fn of_start(loaded: &LoadedScene, error: SimulationError) -> Self {
        match error {
            SimulationError::Numerical { .. } => Failure::Simulation(error),
            _ => Failure::Scene(Box::new(loaded.explain(&error))),
        }
    }

    /// The exit code; see the table of [`crate::cli`].
    pub fn exit_code(&self) -> u8 {
        match self {
            Failure::Usage(_) => 2,
            Failure::Scene(e) => e.category.exit_code(),
            Failure::Simulation(SimulationError::Numerical { .. }) | Failure::Run(..) => 5,
            Failure::Simulation(_) => 3,
            Failure::Output(_) | Failure::Study(_) => 4,
            Failure::Rows(_) => 5,
            Failure::Short(_) => 6,
            Failure::Checkpoint(_) => 4,
            Failure::Stopped(_) | Failure::StudyStopped => 75,
        }
    }

    fn text(&self) -> String {
        match self {
            Failure::Usage(e) => format!("error: {e}"),
            Failure::Scene(e) => format!("error: {e}"),
            Failure::Simulation(e) => format!("error: {e}"),
            Failure::Run(e, report) => format!("error: {e}\n{report}"),
            Failure::Output(e @ OutputError::Occupied { path }) => {
                let go_on = if path.join("study.json").exists() { "with --resume" } else { "if it is unfinished: braid-ecs resume DIR" };
                format!(
                    "error: {e}\n  help: choose another folder with --out DIR, add --force to move the old results aside, or go on {go_on}"
                )
            }
            Failure::Study(e @ StudyError::Changed(_)) => {
                format!("error: {e}\n  help: choose another folder with --out DIR, or add --force instead of --resume to run all rows anew")
            }
            Failure::Study(e) => format!("error: {e}"),
            Failure::Rows(n) => format!("{n} run{} failed; what came out of the others is kept", if *n == 1 { "" } else { "s" }),
            Failure::Output(e @ OutputError::Foreign { .. }) => format!("error: {e}\n  help: choose another folder with --out DIR"),
            Failure::Output(e) => format!("error: {e}"),
            Failure::Short(n) => format!("{n} quantities are not as expected"),
            Failure::Checkpoint(e) => format!("error: {e}"),
            Failure::StudyStopped => {
                "stopped before its end; rows that have finished are kept, and --resume goes on with the others".into()
            }
            Failure::Stopped(folder) => format!("stopped before its end; to go on: braid-ecs resume {}", folder.display()),
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text())
    }
}

impl From<SceneErrors> for Failure {
    fn from(e: SceneErrors) -> Self {
        Failure::Scene(Box::new(e))
    }
}

impl From<SimulationError> for Failure {
    fn from(e: SimulationError) -> Self {
        Failure::Simulation(e)
    }
}

impl From<CheckpointError> for Failure {
    fn from(e: CheckpointError) -> Self {
        Failure::Checkpoint(e)
    }
}

impl From<OutputError> for Failure {
    fn from(e: OutputError) -> Self {
        Failure::Output(e)
    }
}

/// Prints a failure on standard error: with the source text on a terminal, one plain line per
/// problem (`file:line:column: message`) elsewhere.
pub(super) fn print(failure: &Failure) {
    if let Failure::Scene(errors) = failure
        && std::io::stderr().is_terminal()
    {
        let handler = miette::GraphicalReportHandler::new();
        let mut all = String::new();
        for e in &errors.errors {
            if handler.render_report(&mut all, e).is_err() {
                return line(&failure.text());
            }
        }
        return line(&all);
    }
    line(&failure.text());
}

/// A line on standard error; a closed pipe is no reason to fail.
pub(super) fn line(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// True once a line on standard output was lost: its reader has gone, or its disk is full.
static LOST: AtomicBool = AtomicBool::new(false);

/// A line on standard output. What is under way goes on if it cannot be written; [`lost`] tells in the end.
pub(super) fn out(text: &str) {
    if writeln!(std::io::stdout(), "{text}").is_err() {
        LOST.store(true, Ordering::Relaxed);
    }
}

/// True if a line on standard output was lost.
pub(super) fn lost() -> bool {
    LOST.load(Ordering::Relaxed)
}
