//! The command line: arguments, progress, messages, exit codes. One file per command.
//!
//! | code | meaning |
//! |---|---|
//! | 0 | done |
//! | 2 | usage: unknown option, malformed or unknown `--set` |
//! | 3 | the scene is invalid |
//! | 4 | a file cannot be read or written |
//! | 5 | numerical failure during the run, or a failed row of a study; what was computed is kept |
//! | 6 | a scene with known answers misses one, or no model meets what was asked of `advise` |
//! | 75 | stopped (Ctrl-C, SIGTERM, `--time-limit`, `ctl DIR stop`): what was computed is kept, and `resume DIR` goes on |
//! | 130 | given up with a second Ctrl-C; `resume DIR` goes on from the last checkpoint |
mod advise;
mod bench;
mod check;
#[cfg(test)]
mod faults;
mod message;
mod plugins;
mod processor;
mod progress;
mod report;
mod resume;
mod run;
mod signals;
mod status;
mod step;
mod study;
mod verify;

pub use message::Failure;

use crate::simulation::Plugin;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Simulates dry-fibre braids and filament bundles.
#[derive(Parser, Debug)]
#[command(name = "braid-ecs", version, args_conflicts_with_subcommands = true, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 done, 2 usage, 3 scene invalid, 4 file error, 5 numerical failure, 6 a known answer was missed, 75 stopped and can be resumed, 130 given up with a second Ctrl-C."
)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    scene: Option<SceneArgs>,
    #[command(flatten)]
    run: run::RunArgs,
}

/// Everything but a run.
#[derive(Subcommand, Debug)]
enum Command {
    /// Read and build a scene without running it: sizes, time step, expected duration.
    Check(check::CheckArgs),
    /// Time the steps in the middle of a run, by set.
    Bench(bench::BenchArgs),
    /// Run scenes with known answers and print how near the program comes to them.
    Verify(verify::VerifyArgs),
    /// Run a scene in many variants and compare what comes out.
    Study(study::StudyArgs),
    /// Propose a model of the tows for a wanted error or time, and write the scene.
    Advise(advise::AdviseArgs),
    /// Go on with a run that was stopped, from its last checkpoint.
    Resume(resume::ResumeArgs),
    /// Step through a run at a prompt, system by system and back (debug builds).
    Step(step::StepArgs),
    /// List what scenes of this program may name: elements, settings, probes, measures, amplitudes.
    Plugins(plugins::PluginsArgs),
    /// Tell how far a run has come.
    Status(status::StatusArgs),
    /// Stop a run, or have it write a checkpoint or a frame.
    Ctl(status::ControlArgs),
}

/// The scene and changes to it.
#[derive(Args, Debug, Clone)]
pub(crate) struct SceneArgs {
    /// The scene file (.ron).
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Change one value of the scene: `--set tow.filaments=19`. May be given several times.
    #[arg(long = "set", value_name = "PATH=VALUE", value_parser = parse_set)]
    sets: Vec<(String, String)>,
    /// Threads to use (default: all processors).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

fn parse_set(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((path, value)) if !path.trim().is_empty() && !value.trim().is_empty() => Ok((path.trim().into(), value.trim().into())),
        _ => Err("expected PATH=VALUE, for example contact.friction=0.3".into()),
    }
}

impl SceneArgs {
    /// Runs `work` in a pool with the wanted number of threads.
    fn with_threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
        with_threads(self.threads, work)
    }
}

fn with_threads<T: Send>(threads: Option<u16>, work: impl FnOnce() -> T + Send) -> Result<T, Failure> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.map_or(0, usize::from)).build();
    Ok(pool.map_err(|e| Failure::Usage(format!("cannot start {} threads: {e}", threads.unwrap_or(0))))?.install(work))
}

/// The program: reads the arguments, does what they say, returns the exit code. A binary with
/// plugins of its own calls it with `(systems::default_plugins, my::plugin)`.
pub fn main(plugins: impl Plugin + Send + Sync) -> ExitCode {
    if let Some(features) = processor::lacking() {
        message::line(&format!(
            "error: this program was built for processors with {features} (x86-64-v3), and this one lacks them\n  \
             help: build it for all processors: RUSTFLAGS=\"\" cargo build --release"
        ));
        return ExitCode::from(2);
    }
    // clap prints its own messages and leaves with 0 (help, version) or 2.
    let cli = Cli::parse();
    let done = match (cli.command, cli.scene) {
        (Some(Command::Check(args)), _) => check::check(&args, plugins),
        (Some(Command::Bench(args)), _) => bench::bench(&args, plugins),
        (Some(Command::Verify(args)), _) => verify::run(&args, plugins),
        (Some(Command::Study(args)), _) => study::run(&args, plugins),
        (Some(Command::Advise(args)), _) => advise::advise(&args, plugins),
        (Some(Command::Resume(args)), _) => resume::resume(&args, plugins),
        (Some(Command::Step(args)), _) => step::step(&args, plugins),
        (Some(Command::Plugins(args)), _) => plugins::list(&args, plugins),
        (Some(Command::Status(args)), _) => status::status(&args),
        (Some(Command::Ctl(args)), _) => status::control(&args),
        (None, Some(scene)) => run::run(&scene, &cli.run, plugins),
        (None, None) => Err(Failure::Usage("no scene was given".into())),
    };
    match done {
        Ok(()) if message::lost() => {
            message::line("error: standard output was closed before all was written there; files are complete");
            ExitCode::from(4)
        }
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            message::print(&failure);
            ExitCode::from(failure.exit_code())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_scene_runs_and_check_checks() {
        let cli = Cli::try_parse_from(["braid-ecs", "a.ron", "--set", "tow.filaments=19", "--set", "x = a=b", "--threads", "2"]).unwrap();
        assert!(cli.command.is_none());
        let scene = cli.scene.unwrap();
        assert_eq!(scene.scene, PathBuf::from("a.ron"));
        assert_eq!(scene.sets, [("tow.filaments".into(), "19".into()), ("x".into(), "a=b".into())]);
        assert_eq!(scene.threads, Some(2));
        let cli = Cli::try_parse_from(["braid-ecs", "check", "a.ron", "--set", "seed=2"]).unwrap();
        assert!(matches!(cli.command, Some(Command::Check(c)) if c.scene.sets.len() == 1));
        let cli = Cli::try_parse_from(["braid-ecs", "resume", "results/a", "--until", "30 ms", "--time-limit", "2 h", "-q"]).unwrap();
        assert!(matches!(cli.command, Some(Command::Resume(r)) if r.dir.ends_with("results/a")));
        assert!(matches!(Cli::try_parse_from(["braid-ecs", "ctl", "a", "stop"]).unwrap().command, Some(Command::Ctl(_))));
        assert!(matches!(Cli::try_parse_from(["braid-ecs", "status", "a", "-w"]).unwrap().command, Some(Command::Status(_))));
        for bad in [
            &["braid-ecs", "ctl", "a", "jump"][..],
            &["braid-ecs", "a.ron", "--time-limit", "-1 s"],
            &["braid-ecs", "a.ron", "--set", "seed"],
            &["braid-ecs", "a.ron", "--threads", "0"],
            &["braid-ecs", "a.ron", "--no"],
        ] {
            assert_eq!(Cli::try_parse_from(bad).unwrap_err().exit_code(), 2, "{bad:?}");
        }
    }
}
