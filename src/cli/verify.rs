//! `braid-ecs verify`: scenes with known answers, and how near the program comes to them.
use super::message::{Failure, line, out};
use crate::scene;
use crate::simulation::{Plugin, Simulation};
use crate::verify::{Broken, Outcome, Row, Verified, rows, verify};
use clap::Args;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Where the cases of the project are.
const MANUAL: &str = "scenes/verification";

/// Where the outcome goes.
const FOLDER: &str = "results/verification";

/// Arguments of a verification.
#[derive(Args, Debug)]
pub(super) struct VerifyArgs {
    /// Scenes, folders of scenes, or parts of the names of scenes in scenes/verification [default: all of these].
    #[arg(value_name = "PATTERN|FILE|DIR")]
    what: Vec<String>,
    /// Scenes to run at a time (default: one per processor).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Run each scene that says how its mesh is refined (`refine`) on meshes that are finer by these factors
    /// (coarser below 1), and estimate the order of convergence: --mesh 0.5 1 2.
    #[arg(long, value_name = "FACTOR", num_args = 1.., value_parser = parse_factor)]
    mesh: Vec<f64>,
    /// Folder for verification.json and verification.html [default: results/verification].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

fn parse_factor(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(f) if (1e-6..=1e6).contains(&f) => Ok(f),
        _ => Err("expected a factor above zero, for example 0.5 or 2; names of scenes stand before --mesh".into()),
    }
}

/// Runs scenes with expectations, several at a time, and prints every quantity against its reference.
pub(super) fn run(args: &VerifyArgs, plugins: impl Plugin + Send + Sync) -> Result<(), Failure> {
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(FOLDER));
    let cases = cases(args, &plugins)?;
    Outcome::check_folder(&folder)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads.map_or(0, usize::from)).build();
    let pool = pool.map_err(|e| Failure::Usage(format!("cannot start threads: {e}")))?;
    let outcomes: Vec<(&Case, Result<Verified, Failure>)> = pool.install(|| {
        let one = |case: &'_ Case| {
            let outcome = verified(case, &plugins);
            if let (Ok(v), false) = (&outcome, args.json) {
                let mesh = if args.mesh.is_empty() { String::new() } else { format!(", mesh x {}", v.mesh) };
                let word = match (v.holds(), v.mesh < 1.0) {
                    (true, _) => "as expected",
                    (false, true) => "less near than on its own mesh",
                    (false, false) => "NOT as expected",
                };
                line(&format!("{}{mesh}: {word} in {:.1} s", v.scene, v.seconds));
            }
            outcome
        };
        cases.par_iter().map(|c| (c, one(c))).collect()
    });
    let (mut all, mut broken, mut first) = (Vec::new(), Vec::new(), None);
    for (case, outcome) in outcomes {
        match outcome {
            Ok(v) => all.push(v),
            Err(failure) => {
                let scene = case.file.display().to_string();
                line(&format!("{scene}: could not be run"));
                broken.push(Broken { scene, mesh: case.mesh.unwrap_or(1.0), message: failure.to_string() });
                first.get_or_insert(failure);
            }
        }
    }
    let outcome = Outcome::new(rows(&all), broken);
    outcome.write(&folder)?;
    if args.json {
        out(&serde_json::to_string_pretty(&outcome.rows).expect("numbers and texts only"));
    } else {
        print(&outcome.rows, !args.mesh.is_empty());
        out(&format!("table and plots: {}", folder.join("verification.html").display()));
    }
    let missed = outcome.rows.iter().filter(|r| r.missed()).count();
    match first {
        Some(failure) => Err(failure),
        None if missed > 0 => Err(Failure::Short(missed)),
        None => Ok(()),
    }
}

/// A scene on one mesh.
struct Case {
    file: PathBuf,
    /// Factor on the mesh of the scene; none runs it as it is.
    mesh: Option<f64>,
}

/// The scenes that are meant, each on every mesh; with `--mesh` only those that say how they are refined.
fn cases(args: &VerifyArgs, plugins: &(impl Plugin + Sync)) -> Result<Vec<Case>, Failure> {
    let files = scenes(&args.what)?;
    if args.mesh.is_empty() {
        return Ok(files.into_iter().map(|file| Case { file, mesh: None }).collect());
    }
    let mut meshes = args.mesh.clone();
    meshes.sort_by(f64::total_cmp);
    meshes.dedup();
    let registry = Simulation::new(|sim: &mut Simulation| plugins.build(sim)).registry;
    let count = files.len();
    let mut cases = Vec::new();
    for file in files {
        // What is wrong with a scene is said when it is run.
        if scene::load(&file, &[], &registry).is_ok_and(|l| l.scene.refine.is_empty()) {
            continue;
        }
        cases.extend(meshes.iter().map(|m| Case { file: file.clone(), mesh: Some(*m) }));
    }
    let left_out = count - cases.len() / meshes.len();
    if cases.is_empty() {
        let help = "a scene says how its mesh is refined with `refine: [\"polylines[0].subdivisions\"]`; those of the project: braid-ecs verify --mesh 0.5 1";
        return Err(Failure::Usage(format!("none of the {count} scenes has `refine`\n  help: {help}")));
    }
    if left_out > 0 && !args.json {
        line(&format!("left out: {left_out} of {count} scenes, which do not say how their mesh is refined (`refine`)"));
    }
    Ok(cases)
}

fn verified(case: &Case, plugins: &(impl Plugin + Sync)) -> Result<Verified, Failure> {
    let file = &case.file;
    let sim = Simulation::new(|sim: &mut Simulation| plugins.build(sim));
    let mut loaded = scene::load(file, &[], &sim.registry)?;
    if loaded.scene.expect.is_empty() {
        return Err(Failure::Usage(format!("`{}` expects nothing: it has no `expect`", file.display())));
    }
    if let Some(mesh) = case.mesh {
        loaded = loaded.on_mesh(mesh, &sim.registry)?;
    }
    // Every scene on one thread of its own: they run side by side.
    let alone =
        rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| Failure::Usage(format!("cannot start a thread: {e}")))?;
    let outcome = alone.install(|| verify(&loaded, sim)).map_err(|e| Failure::of_start(&loaded, e))?;
    Ok(Verified { mesh: case.mesh.unwrap_or(1.0), ..outcome })
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

fn print(rows: &[Row], meshes: bool) {
    let width = |of: fn(&Row) -> &str, least: usize| rows.iter().map(|r| of(r).chars().count()).max().unwrap_or(0).max(least);
    let (scene, quantity) = (width(|r| &r.scene, 5), width(|r| &r.quantity, 8));
    let mesh = |text: String| if meshes { format!("  {text:>6}") } else { String::new() };
    out(&format!(
        "{:<scene$}  {:<quantity$}{}  {:>13}  {:>13}  {:>9}  {:>9}  {:>5}  {:>9}  {:>7}",
        "scene",
        "quantity",
        mesh("mesh".into()),
        "reference",
        "computed",
        "error",
        "allowed",
        "order",
        "steps",
        "seconds"
    ));
    for r in rows {
        let computed = r.computed.map_or("-".into(), |v| format!("{v:.6e}"));
        let error = r.error.map_or("-".into(), |e| format!("{e:+.1e}"));
        out(&format!(
            "{:<scene$}  {:<quantity$}{}  {:>13.6e}  {computed:>13}  {error:>9}  {:>9.1e}  {:>5}  {:>9}  {:>7.1}{}",
            r.scene,
            r.quantity,
            mesh(r.mesh.to_string()),
            r.reference,
            r.allowed,
            r.order.map_or("-".into(), |o| format!("{o:.2}")),
            r.steps,
            r.seconds,
            if r.missed() { "  SHORT" } else { "" }
        ));
    }
    let promised = rows.iter().filter(|r| r.mesh >= 1.0).count();
    let missed = rows.iter().filter(|r| r.missed()).count();
    if promised > 0 {
        out(&format!("{} of {promised} quantities as expected", promised - missed));
    } else {
        out("no mesh was as fine as that of its scene: nothing was promised");
    }
}
