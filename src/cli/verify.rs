//! `braid-ecs verify`: scenes with known answers, and how near the program comes to them.
use super::message::{Failure, line, out};
use crate::scene;
use crate::simulation::{Plugin, Simulation};
use crate::verify::{Verified, verify};
use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Where the cases of the project are.
const MANUAL: &str = "scenes/verification";

/// Arguments of a verification.
#[derive(Args, Debug)]
pub(super) struct VerifyArgs {
    /// Scenes, folders of scenes, or parts of the names of scenes in scenes/verification [default: all of these].
    #[arg(value_name = "PATTERN|FILE|DIR")]
    what: Vec<String>,
    /// Scenes to run at a time (default: one per processor).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// One line of the result.
#[derive(Debug, Serialize)]
struct Row {
    scene: String,
    quantity: String,
    reference: f64,
    computed: Option<f64>,
    allowed: f64,
    holds: bool,
    steps: u64,
    seconds: f64,
}

/// Runs scenes with expectations, several at a time, and prints every quantity against its reference.
pub(super) fn run(args: &VerifyArgs, plugins: impl Plugin + Send + Sync) -> Result<(), Failure> {
    let files = scenes(&args.what)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads.map_or(0, usize::from)).build();
    let pool = pool.map_err(|e| Failure::Usage(format!("cannot start threads: {e}")))?;
    let outcomes: Vec<(PathBuf, Result<Verified, Failure>)> = pool.install(|| {
        let one = |file: &PathBuf| {
            let outcome = case(file, &plugins);
            if let (Ok(v), false) = (&outcome, args.json) {
                line(&format!("{}: {} in {:.1} s", v.scene, if v.holds() { "as expected" } else { "NOT as expected" }, v.seconds));
            }
            (file.clone(), outcome)
        };
        files.par_iter().map(one).collect()
    });
    let mut rows = Vec::new();
    let (mut short, mut broken) = (0, None);
    for (file, outcome) in outcomes {
        match outcome {
            Ok(v) => {
                short += v.rows.iter().filter(|r| !r.holds()).count();
                rows.extend(v.rows.iter().map(|r| Row {
                    scene: v.scene.clone(),
                    quantity: r.name.clone(),
                    reference: r.expected,
                    computed: r.found,
                    allowed: r.allowed,
                    holds: r.holds(),
                    steps: v.steps,
                    seconds: v.seconds,
                }));
            }
            Err(failure) => {
                line(&format!("{}: could not be run", file.display()));
                broken.get_or_insert(failure);
            }
        }
    }
    if args.json {
        out(&serde_json::to_string_pretty(&rows).expect("numbers and texts only"));
    } else {
        print(&rows);
    }
    match broken {
        Some(failure) => Err(failure),
        None if short > 0 => Err(Failure::Short(short)),
        None => Ok(()),
    }
}

fn case(file: &Path, plugins: &(impl Plugin + Sync)) -> Result<Verified, Failure> {
    let sim = Simulation::new(|sim: &mut Simulation| plugins.build(sim));
    let loaded = scene::load(file, &[], &sim.registry)?;
    if loaded.scene.expect.is_empty() {
        return Err(Failure::Usage(format!("`{}` expects nothing: it has no `expect`", file.display())));
    }
    // Every scene on one thread of its own: they run side by side.
    let alone =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| Failure::Usage(format!("cannot start a thread: {e}")))?;
    alone.install(|| verify(&loaded, sim)).map_err(|e| Failure::of_start(&loaded, e))
}

/// The files that the arguments mean, sorted.
fn scenes(what: &[String]) -> Result<Vec<PathBuf>, Failure> {
    let folder = |path: &Path| -> Result<Vec<PathBuf>, Failure> {
        let list = std::fs::read_dir(path).map_err(|e| crate::output::OutputError::io("read the folder", path, e))?;
        let mut files: Vec<PathBuf> =
            list.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.extension().is_some_and(|e| e == "ron")).collect();
        files.sort();
        Ok(files)
    };
    if what.is_empty() {
        return folder(Path::new(MANUAL));
    }
    let mut files = Vec::new();
    for w in what {
        let path = Path::new(w);
        let found = if path.is_dir() {
            folder(path)?
        } else if path.exists() {
            vec![path.to_owned()]
        } else {
            let named = |p: &PathBuf| p.file_stem().is_some_and(|s| s.to_string_lossy().to_lowercase().contains(&w.to_lowercase()));
            folder(Path::new(MANUAL))?.into_iter().filter(named).collect()
        };
        if found.is_empty() {
            return Err(Failure::Usage(format!("no scene is meant by `{w}`: no such file or folder, and no name in {MANUAL} contains it")));
        }
        files.extend(found);
    }
    files.sort();
    files.dedup();
    Ok(files)
}

fn print(rows: &[Row]) {
    let width = |of: fn(&Row) -> &str, least: usize| rows.iter().map(|r| of(r).chars().count()).max().unwrap_or(0).max(least);
    let (scene, quantity) = (width(|r| &r.scene, 5), width(|r| &r.quantity, 8));
    out(&format!(
        "{:<scene$}  {:<quantity$}  {:>13}  {:>13}  {:>9}  {:>9}  {:>9}  {:>7}",
        "scene", "quantity", "reference", "computed", "error", "allowed", "steps", "seconds"
    ));
    for r in rows {
        let computed = r.computed.map_or("-".into(), |v| format!("{v:.6e}"));
        // Relative where the reference is a size, else the difference itself.
        let scale = if r.reference == 0.0 { 1.0 } else { r.reference.abs() };
        let error = r.computed.map_or("-".into(), |v| format!("{:+.1e}", (v - r.reference) / scale));
        out(&format!(
            "{:<scene$}  {:<quantity$}  {:>13.6e}  {computed:>13}  {error:>9}  {:>9.1e}  {:>9}  {:>7.1}{}",
            r.scene,
            r.quantity,
            r.reference,
            r.allowed / scale,
            r.steps,
            r.seconds,
            if r.holds { "" } else { "  SHORT" }
        ));
    }
    let held = rows.iter().filter(|r| r.holds).count();
    out(&format!("{held} of {} quantities as expected", rows.len()));
}
