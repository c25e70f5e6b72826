//! `braid-ecs status DIR`: how far a run has come. `braid-ecs ctl DIR`: what it is told.
use super::message::{Failure, out};
use super::progress::duration_text;
use crate::checkpoint::{CheckpointError, store};
use crate::output::control::Command;
use crate::output::status::{RunStatus, RunningState};
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of `status`.
#[derive(Args, Debug)]
pub(super) struct StatusArgs {
    /// Output folder of the run.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Print it every second until the run ends.
    #[arg(long, short)]
    watch: bool,
}

/// Prints how far a run has come.
pub(super) fn status(args: &StatusArgs) -> Result<(), Failure> {
    loop {
        let status = RunStatus::read(&args.dir)?;
        let runs = runs(&args.dir, &status);
        out(&text(&args.dir, &status, runs));
        if !args.watch || !runs {
            return Ok(());
        }
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// Seconds without a sign of life after which a run counts as dead, where the file system has no locks.
const SILENT: f64 = 60.0;

/// True while the program that writes the status is alive.
fn runs(dir: &Path, status: &RunStatus) -> bool {
    status.state == RunningState::Running && store::in_use(dir).unwrap_or(status.age() < SILENT)
}

fn text(dir: &Path, s: &RunStatus, runs: bool) -> String {
    let mut line = match s.state {
        RunningState::Running if !runs => {
            format!("{}: ended without notice; braid-ecs resume {} goes on from its last checkpoint.", s.scene, dir.display())
        }
        state => format!("{}: {}", s.scene, state.word()),
    };
    if let Some(p) = s.progress.filter(|_| runs) {
        line += &format!(", {:.0} %", 100.0 * p);
    }
    if let Some(eta) = s.eta_s.filter(|_| runs) {
        line += &format!(", about {} left", duration_text(eta));
    }
    line += &format!("  t {:.4e} {}  step {}  dt {:.1e} {}", s.time, s.unit, s.step, s.dt, s.unit);
    let energies = [("work", s.energy.external_work), ("kinetic", s.energy.kinetic), ("strain", s.energy.strain)];
    for (name, value) in energies {
        line += &value.map_or(String::new(), |v| format!("  {name} {v:.3e}"));
    }
    line += &format!("  contacts {}  {} of wall time", s.contacts, duration_text(s.wall_s));
    if let Some(step) = s.checkpoint {
        line += &format!("  checkpoint at step {step}");
    }
    line
}

/// Arguments of `ctl`.
#[derive(Args, Debug)]
pub(super) struct ControlArgs {
    /// Output folder of the run.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// What the run is told.
    #[arg(value_name = "WHAT")]
    what: What,
}

/// What a run can be told.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum What {
    /// Finish the step, write a checkpoint and all outputs, and end: `resume` goes on.
    Stop,
    /// Write a checkpoint now.
    Checkpoint,
    /// Write a frame now.
    Frame,
}

/// How long a command waits for the run to take it.
const PATIENCE: Duration = Duration::from_secs(20);

/// Tells a run something and waits until it has taken it.
pub(super) fn control(args: &ControlArgs) -> Result<(), Failure> {
    let alive = || RunStatus::read(&args.dir).is_ok_and(|s| runs(&args.dir, &s));
    let idle = || Failure::Checkpoint(CheckpointError::Idle(args.dir.clone()));
    if !alive() {
        return Err(idle());
    }
    let command = match args.what {
        What::Stop => Command::Stop,
        What::Checkpoint => Command::Checkpoint,
        What::Frame => Command::Frame,
    };
    command.send(&args.dir)?;
    let begin = Instant::now();
    while Command::waits(&args.dir) {
        if !alive() {
            let _ = Command::take(&args.dir);
            return Err(idle());
        }
        if begin.elapsed() > PATIENCE {
            out("the run has not taken the command yet; it will when its step is done");
            return Ok(());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    out("the run has taken the command");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_tells_what_matters() {
        let mut s = RunStatus { scene: "braid".into(), unit: "s".into(), time: 0.0125, step: 40_000, contacts: 12, ..Default::default() };
        s.set_progress(Some(0.025), Some(90.0));
        let line = text(Path::new("results/braid"), &s, true);
        for part in ["braid: running, 50 %, about 90 s left", "t 1.2500e-2 s", "step 40000", "contacts 12"] {
            assert!(line.contains(part), "{part} is missing in {line}");
        }
        assert!(text(Path::new("results/braid"), &s, false).contains("braid-ecs resume results/braid"));
        s.state = RunningState::Stopped;
        assert!(text(Path::new("r"), &s, false).starts_with("braid: stopped  t"));
    }
}
