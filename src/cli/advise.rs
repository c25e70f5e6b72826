//! `braid-ecs advise SCENE --error 5%`: which model of a tow to take, from what a study has found.
use super::message::{Failure, line, out};
use super::progress::duration_text;
use super::with_threads;
use crate::advise::{Choice, Data, DataError, Row, Wanted, choose, outside};
use crate::output::file::{json, write_atomic};
use crate::run;
use crate::scene::units::{Ratio, WallTime};
use crate::scene::{self, LoadedScene};
use crate::simulation::{Plugin, Simulation};
use crate::step::Clock;
use crate::study::text::percent;
use clap::Args;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Arguments of the adviser.
#[derive(Args, Debug)]
pub(super) struct AdviseArgs {
    /// A scene with a braid.
    #[arg(value_name = "SCENE", required_unless_present = "collect")]
    scene: Option<PathBuf>,
    /// Largest sum of the relative errors of length, angle and thickness: `5%` or `0.05`.
    #[arg(long, value_name = "SHARE", value_parser = share)]
    error: Option<f64>,
    /// Longest run with one thread: `60s`, `"10 min"`.
    #[arg(long, value_name = "TIME", value_parser = |text: &str| WallTime::parse(text))]
    time: Option<WallTime>,
    /// Advice of a study of your own, written with --collect [default: that of the program].
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Make advice of a finished study: `results/filaments/study.json`.
    #[arg(long, value_name = "STUDY", conflicts_with_all = ["scene", "error", "time", "from"], requires = "out")]
    collect: Option<PathBuf>,
    /// File to write [default: SCENE.advised.ron in the working folder].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write over the file if it is there.
    #[arg(long)]
    force: bool,
}

fn share(text: &str) -> Result<f64, String> {
    let value = Ratio::parse(text.trim())?.0;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("an error must be above zero: 5% or 0.05".into()) }
}

/// Steps are timed for this long.
const TRY_FOR: Duration = Duration::from_millis(700);

/// Proposes a model, tells what to expect of it, and writes the scene.
pub(super) fn advise(args: &AdviseArgs, plugins: impl Plugin + Send + Sync) -> Result<(), Failure> {
    with_threads(Some(1), || match (&args.collect, &args.scene) {
        (Some(study), _) => collect(study, args, &plugins),
        (None, Some(scene)) => propose(scene, args, &plugins),
        (None, None) => Err(Failure::Usage("no scene was given".into())),
    })?
}

fn collect(study: &Path, args: &AdviseArgs, plugins: &impl Plugin) -> Result<(), Failure> {
    let file = args.out.as_ref().expect("clap asks for it");
    free(file, args.force)?;
    let data = Data::collect(study, |path| load(path, &[], plugins), |loaded| first_step(loaded, plugins))?;
    write_atomic(file, &json(&data))?;
    line(&format!("{} rows of `{}` are in {}", data.rows.len(), data.study, file.display()));
    Ok(())
}

fn propose(path: &Path, args: &AdviseArgs, plugins: &impl Plugin) -> Result<(), Failure> {
    let wanted = Wanted { error: args.error, time: args.time.map(|t| t.0.as_secs_f64()) };
    if wanted == Wanted::default() {
        return Err(Failure::Usage("say what is wanted: --error 5%, --time 60s, or both".into()));
    }
    let loaded = load(path, &[], plugins)?;
    if loaded.scene.braid.is_none() {
        return Err(Failure::Usage(format!("`{}` has no braid: the study knows models of the tows of a braid only", path.display())));
    }
    let file = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("{}.advised.ron", loaded.name())));
    free(&file, args.force)?;
    let data = args.from.as_deref().map_or_else(|| Ok(Data::shipped()), Data::read)?;
    // Machines differ by one factor for all rows, as far as one scene can tell.
    let guess: Vec<f64> = data.rows.iter().map(|r| r.run_s).collect();
    let first = choose(&data.rows, &guess, wanted).ok_or_else(|| Failure::Usage("there are no rows to choose from".into()))?;
    let factor = first_step(&with_row(path, &data.rows[first.row], plugins)?, plugins)? / data.rows[first.row].first_step_s;
    let times: Vec<f64> = guess.iter().map(|t| t * factor).collect();
    let choice = choose(&data.rows, &times, wanted).expect("there are rows");
    let proposed = with_row(path, &data.rows[choice.row], plugins)?;
    print(&data, &times, choice);
    let strange = outside(&data.covered, &loaded);
    for (name, study, scene) in &strange {
        out(&format!("  outside what the study covered: {name} {scene} (study: {study})"));
    }
    if !strange.is_empty() {
        out("  errors and times are extrapolated; numbers in SI units");
    }
    write_atomic(&file, with_note(&data, &data.rows[choice.row], !strange.is_empty(), &proposed.text).as_bytes())?;
    out(&format!("  scene        {}", file.display()));
    out(&format!("to run it: braid-ecs {}", file.display()));
    if choice.meets { Ok(()) } else { Err(Failure::Short(1)) }
}

fn load(path: &Path, sets: &[(String, String)], plugins: &impl Plugin) -> Result<LoadedScene, Failure> {
    let sim = Simulation::new(|sim: &mut Simulation| plugins.build(sim));
    Ok(scene::load(path, sets, &sim.registry)?)
}

fn with_row(path: &Path, row: &Row, plugins: &impl Plugin) -> Result<LoadedScene, Failure> {
    load(path, &row.sets, plugins)
}

/// Mean time of the first steps of a scene (s).
fn first_step(loaded: &LoadedScene, plugins: &impl Plugin) -> Result<f64, Failure> {
    let mut sim = Simulation::new(|sim: &mut Simulation| plugins.build(sim));
    sim.build(&loaded.model).and_then(|()| run::start(&mut sim, &loaded.model)).map_err(|e| Failure::of_start(loaded, e))?;
    let begin = Instant::now();
    while begin.elapsed() < TRY_FOR {
        run::step(&mut sim)?;
    }
    Ok(begin.elapsed().as_secs_f64() / sim.world.resource::<Clock>().step.max(1) as f64)
}

/// Nothing that is there is written over without being asked.
fn free(file: &Path, force: bool) -> Result<(), Failure> {
    if file.exists() && !force {
        return Err(Failure::Usage(format!(
            "`{}` is there already: choose another file with --out, or write over it with --force",
            file.display()
        )));
    }
    Ok(())
}

fn print(data: &Data, times: &[f64], choice: Choice) {
    out(&format!("errors against {}, times with one thread of this machine, from `{}`", data.reference, data.study));
    let mut order: Vec<usize> = (0..data.rows.len()).collect();
    order.sort_by(|a, b| times[*a].total_cmp(&times[*b]));
    for i in order {
        let r = &data.rows[i];
        let interval = r.error_ci95.map_or(String::new(), |c| format!(" +- {}", percent(c)));
        let mark = if i == choice.row { "->" } else { "  " };
        out(&format!(
            "{mark} {:<36} error {:>8}{interval:<12} {:>7} elements, about {}",
            r.label,
            percent(r.error),
            r.elements,
            duration_text(times[i])
        ));
    }
    if !choice.meets {
        out("  no row meets what was asked for; the marked one comes nearest");
    }
}

/// The scene with a word about where it comes from.
fn with_note(data: &Data, row: &Row, extrapolated: bool, text: &str) -> String {
    let interval = row.error_ci95.map_or(String::new(), |c| format!(" +- {}", percent(c)));
    let care = if extrapolated { ", extrapolated" } else { "" };
    format!(
        "// Model `{}` of the study `{}`: error {}{interval} against {}{care}.\n{text}",
        row.label,
        data.study,
        percent(row.error),
        data.reference
    )
}

impl From<DataError> for Failure {
    fn from(e: DataError) -> Self {
        match e {
            DataError::Output(e) => Failure::Output(e),
            e => Failure::Usage(e.to_string()),
        }
    }
}
