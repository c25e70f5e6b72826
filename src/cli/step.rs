//! `braid-ecs step SCENE`: steps through a run at a prompt, in builds with debug assertions.
use super::SceneArgs;
use super::message::Failure;
use crate::simulation::Plugin;
use clap::Args;
use std::path::PathBuf;

/// Arguments of a session.
#[derive(Args, Debug)]
pub(super) struct StepArgs {
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Take the commands from this file, one a line, instead of the terminal.
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
}

/// Opens the prompt.
#[cfg(debug_assertions)]
pub(super) fn step(args: &StepArgs, plugins: impl Plugin + Send) -> Result<(), Failure> {
    args.scene.with_threads(|| session(args, plugins))?
}

/// Says how to get the prompt.
#[cfg(not(debug_assertions))]
pub(super) fn step(args: &StepArgs, _: impl Plugin + Send) -> Result<(), Failure> {
    let script = args.script.as_ref().map_or(String::new(), |s| format!(" --script {}", s.display()));
    let scene = args.scene.scene.display();
    Err(Failure::Usage(format!("only debug builds step through a run\n  help: cargo run -- step {scene}{script}")))
}

#[cfg(debug_assertions)]
fn session(args: &StepArgs, plugins: impl Plugin) -> Result<(), Failure> {
    use crate::output::OutputError;
    use crate::stepper::{Session, ask, run_script};
    use std::io::{BufReader, IsTerminal};

    // A script that cannot be read is said before the scene is built.
    let script = match &args.script {
        Some(path) => Some((std::fs::File::open(path).map_err(|e| OutputError::io("read", path, e))?, path.display().to_string())),
        None => None,
    };
    let sim = crate::simulation::Simulation::new(plugins);
    let loaded = crate::scene::load(&args.scene.scene, &args.scene.sets, &sim.registry)?;
    let interrupt = std::sync::Arc::default();
    super::signals::catch_interrupt(&interrupt);
    let mut session = Session::new(sim, loaded, interrupt).map_err(|e| Failure::of_start(&e.0, e.1))?;
    let mut out = std::io::stdout();
    match script {
        Some((file, name)) => run_script(&mut session, &name, BufReader::new(file), &mut out),
        None if std::io::stdin().is_terminal() => {
            return ask(&mut session).map_err(|e| Failure::Usage(format!("the terminal cannot be used: {e}")));
        }
        None => run_script(&mut session, "input", std::io::stdin().lock(), &mut out),
    }
    .map_err(|e| Failure::Usage(e.to_string()))
}
