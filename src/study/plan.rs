//! From a study to its rows and runs: scenes, changes, folders, references, expected cost.
use super::draft::{Draft, drafts, names};
use super::facts::facts;
use super::read::{StudyFile, at, unknown};
use crate::generate::BraidLayout;
use crate::model::Model;
use crate::output::measured::unit;
use crate::run::expected_duration;
use crate::scene::error::{Problem, SceneErrors};
use crate::scene::spans::Path;
use crate::scene::{LoadedScene, load, text_of};
use crate::simulation::{Plugin, Simulation};
use crate::systems::time_step::stable_limit;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// Most rows of a study.
pub const MAX_ROWS: usize = 4096;

/// One variant of the scene.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name of its folder, unique in the study.
    pub name: String,
    /// One label per axis, or the label of a row by itself.
    pub labels: Vec<String>,
    /// The scene file.
    pub scene: PathBuf,
    /// BLAKE3 of the text of the scene, hexadecimal.
    pub scene_hash: String,
    /// Changes of the scene, in the order in which they are made.
    pub sets: Vec<(String, String)>,
    /// Index of the row that errors are relative to.
    pub reference: Option<usize>,
    /// Expected element-steps, where they can be told.
    pub cost: Option<f64>,
    /// What a reader asks first about its scene: name and value.
    pub facts: Vec<(&'static str, String)>,
}

impl Row {
    /// The labels as one text.
    pub fn label(&self) -> String {
        self.labels.join(", ")
    }
}

/// One run of a row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// Index of the row.
    pub row: usize,
    /// Seed, where the study gives one.
    pub seed: Option<u64>,
    /// Its folder in that of the study, with `/`.
    pub folder: String,
}

/// What is to be run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The study.
    pub file: StudyFile,
    /// All rows: those of the axes, the last axis fastest, then those by themselves.
    pub rows: Vec<Row>,
    /// Number of the rows of the axes.
    pub product: usize,
    /// All runs, row by row.
    pub runs: Vec<Run>,
    /// Unit of every outcome.
    pub units: BTreeMap<String, String>,
}

impl Plan {
    /// Reads and builds the scene of every row, without running any.
    ///
    /// # Errors
    /// Rows without a scene or with one that is not sound, changes that lead nowhere, unknown outcomes,
    /// each with its place in the study file.
    pub fn new(file: StudyFile, plugins: &impl Plugin) -> Result<Plan, SceneErrors> {
        let drafts = drafts(&file)?;
        let names = names(&drafts);
        let (mut rows, mut problems) = (Vec::new(), Vec::new());
        let mut units: BTreeMap<String, (String, usize)> = BTreeMap::new();
        for (draft, name) in drafts.iter().zip(names) {
            match row(&file, draft, name, plugins) {
                Ok((row, found)) => {
                    problems.extend(outcome_units(&file, &rows, &row, found, &mut units));
                    rows.push(row);
                }
                Err(found) => problems.extend(found),
            }
        }
        // A change that all rows share is wrong in all of them.
        let mut seen = BTreeSet::new();
        problems.retain(|p| seen.insert(p.path.to_string()));
        if !problems.is_empty() {
            return Err(file.errors(problems));
        }
        let references: Vec<Option<usize>> = rows.iter().map(|r| reference(&file, &rows, r)).collect();
        for (row, reference) in rows.iter_mut().zip(references) {
            row.reference = reference;
        }
        let runs = rows.iter().enumerate().flat_map(|(i, row)| runs(&file, i, row)).collect();
        let units = units.into_iter().map(|(name, (unit, _))| (name, unit)).collect();
        let product = rows.len() - file.study.rows.len();
        Ok(Plan { file, rows, product, runs, units })
    }

    /// Indices of the runs, the longest first; those of unknown length come before all.
    pub fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.runs.len()).collect();
        let cost = |i: usize| self.rows[self.runs[i].row].cost.unwrap_or(f64::INFINITY);
        order.sort_by(|a, b| cost(*b).total_cmp(&cost(*a)));
        order
    }

    /// The changes of a run, its seed included.
    pub fn sets(&self, run: &Run) -> Vec<(String, String)> {
        let mut sets = self.rows[run.row].sets.clone();
        sets.extend(run.seed.map(|s| ("seed".to_owned(), s.to_string())));
        sets
    }
}

/// A row with the units of the outcomes that its scene knows.
fn row(file: &StudyFile, draft: &Draft, name: String, plugins: &impl Plugin) -> Result<(Row, BTreeMap<String, String>), Vec<Problem>> {
    let label = draft.labels.join(", ");
    let Some((place, scene)) = &draft.scene else {
        let problem = Problem::new(draft.place.clone(), format!("row `{label}` has no scene"));
        return Err(vec![problem.help("give the study a `scene`, or the row one of its own")]);
    };
    let path = file.scene_path(scene);
    if !file.may_read(&path) {
        let problem =
            Problem::new(place.clone(), format!("the scene `{scene}` lies outside the folder of the study and the working folder"));
        return Err(vec![problem.help("allow it with --outside, or run the study from a folder above both")]);
    }
    let sets: Vec<(String, String)> = draft.sets.iter().map(|s| s.1.clone()).collect();
    let sim = Simulation::new(|sim: &mut Simulation| plugins.build(sim));
    let text = text_of(&path, "scene").map_err(|e| vec![Problem::new(place.clone(), e.to_string())])?;
    let loaded = load(&path, &sets, &sim.registry).map_err(|e| row_problems(draft, &label, place, e))?;
    let row = Row {
        name,
        labels: draft.labels.clone(),
        scene: path,
        scene_hash: blake3::hash(text.as_bytes()).to_hex().to_string(),
        sets,
        reference: None,
        cost: cost(&loaded.model, sim),
        facts: facts(&loaded),
    };
    Ok((row, units(&loaded)))
}

/// Errors of a scene, at the change that makes them where there is one.
fn row_problems(draft: &Draft, label: &str, place: &Path, errors: SceneErrors) -> Vec<Problem> {
    let of = |e: &crate::scene::error::SceneError| {
        let about = |(path, value): &(String, String)| {
            let given = format!("--set {path}={value}");
            e.message.starts_with(&given) || e.help.as_ref().is_some_and(|h| h.ends_with(&given))
        };
        let change = draft.sets.iter().rev().find(|s| about(&s.1)).map(|s| &s.0);
        let mut problem = match change {
            Some(path) => Problem::new(path.clone(), format!("row `{label}`: {}", e.message)),
            None => {
                let (line, column) = e.place();
                let file = e.file();
                Problem::new(place.clone(), format!("row `{label}`: {file}:{line}:{column}: {}", e.message))
            }
        };
        problem.help = e.help.clone();
        problem
    };
    errors.errors.iter().map(of).collect()
}

/// Expected steps of a run to its end or earliest rest, times its nodes: elements of two kinds that share nodes share most of the work.
fn cost(model: &Model, mut sim: Simulation) -> Option<f64> {
    sim.build(model).ok()?;
    let (limit, _) = stable_limit(&mut sim.world);
    let dt = model.integration.dt.unwrap_or(model.integration.safety * limit);
    expected_duration(model, dt).map(|d| d / dt * model.nodes.len() as f64).filter(|c| c.is_finite())
}

/// Measures and probes of a scene with their units.
fn units(loaded: &LoadedScene) -> BTreeMap<String, String> {
    let (model, system) = (&loaded.model, loaded.scene.units);
    let mut units: BTreeMap<String, String> = loaded.probes.iter().map(|(n, p)| (n.clone(), unit(p.quantity(), system))).collect();
    let mut measure = |name: &str, unit: &str| units.insert(name.to_owned(), unit.to_owned());
    if model.get::<BraidLayout>().is_some() || model.nodes.iter().any(|n| n.dummy) {
        measure("length", system.length());
    }
    if model.get::<BraidLayout>().is_some() {
        measure("angle", "deg");
        measure("thickness", system.length());
    }
    units
}

/// Every row must know every outcome, in one unit.
fn outcome_units(
    file: &StudyFile,
    rows: &[Row],
    row: &Row,
    found: BTreeMap<String, String>,
    units: &mut BTreeMap<String, (String, usize)>,
) -> Vec<Problem> {
    let mut problems = Vec::new();
    for (i, o) in file.study.outcomes.iter().enumerate() {
        let path = at("outcomes").index(i).key("name");
        let Some(unit) = found.get(&o.name) else {
            let known: Vec<&str> = found.keys().map(String::as_str).collect();
            let mut problem = unknown(path, "measure or probe", &o.name, &known);
            problem.message = format!("row `{}`: {}", row.label(), problem.message);
            problems.push(problem);
            continue;
        };
        let (first, of) = units.entry(o.name.clone()).or_insert((unit.clone(), rows.len()));
        if first != unit {
            let other = rows.get(*of).map_or(String::new(), Row::label);
            let message = format!("`{}` is in {unit} in row `{}`, and in {first} in row `{other}`", o.name, row.label());
            problems.push(Problem::new(path, message).help("scenes of one study must have the same `units`"));
        }
    }
    problems
}

/// The row that another one is compared with.
fn reference(file: &StudyFile, rows: &[Row], row: &Row) -> Option<usize> {
    let wanted = file.study.reference.as_ref()?;
    // `*` stands for the label of the row itself, which a row of another kind does not have.
    if wanted.iter().any(|l| l == "*") && wanted.len() != row.labels.len() {
        return None;
    }
    let wanted: Vec<&String> = wanted.iter().enumerate().map(|(i, l)| if l == "*" { &row.labels[i] } else { l }).collect();
    rows.iter().position(|r| r.labels.iter().eq(wanted.iter().copied()))
}

fn runs(file: &StudyFile, index: usize, row: &Row) -> Vec<Run> {
    let folder = format!("rows/{}", row.name);
    match &file.study.replicates {
        None => vec![Run { row: index, seed: None, folder }],
        Some(r) => r.seeds.iter().map(|s| Run { row: index, seed: Some(*s), folder: format!("{folder}@seed-{s}") }).collect(),
    }
}
