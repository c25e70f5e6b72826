//! The file that advice comes from, and how a study becomes one.
use super::facts::{self, Facts};
use crate::output::OutputError;
use crate::scene::LoadedScene;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Version of the format.
const FORMAT: u32 = 1;

/// What a study has found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    /// Version of the format.
    pub format: u32,
    /// Title of the study.
    pub study: String,
    /// Program and machine that ran it.
    pub made_by: String,
    /// Name of the row that errors are relative to.
    pub reference: String,
    /// What all rows share.
    pub covered: Facts,
    /// The rows, without the reference.
    pub rows: Vec<Row>,
}

/// A model and what it came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Its name in the study.
    pub label: String,
    /// Changes that make a scene such a model: path and value.
    pub sets: Vec<(String, String)>,
    /// Sum of the relative errors (not in percent).
    pub error: f64,
    /// Half width of its 95 % interval.
    pub error_ci95: Option<f64>,
    /// Steps of the run.
    pub steps: f64,
    /// Elements.
    pub elements: usize,
    /// Processor time with one thread (s).
    pub run_s: f64,
    /// Time of one of the first steps on the machine of the study (s).
    pub first_step_s: f64,
}

/// Why there are no data.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A file cannot be read.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// It is not what it should be.
    #[error("`{}` {message}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
}

/// Paths of a scene that make a model, and the unit of their numbers by powers of force and length.
const MODEL: [(&str, [i32; 2]); 8] = [
    ("tow.model", [0, 0]),
    ("tow.bending", [0, 0]),
    ("tow.filaments", [0, 0]),
    ("tow.elements", [0, 0]),
    ("tow.spread", [0, 0]),
    ("contact.initial_overlap", [0, 0]),
    ("contact.stiffness", [1, -1]),
    ("contact.hardening", [0, 0]),
];

impl Data {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// A text of another kind, or of another version.
    pub fn parse(path: &Path, text: &str) -> Result<Data, DataError> {
        let content = |message: String| DataError::Content { path: path.to_owned(), message };
        let value: serde_json::Value = serde_json::from_str(text).map_err(|e| content(format!("is no JSON: {e}")))?;
        if value.get("results").is_some() {
            return Err(content(format!("is a study; make advice of it: braid-ecs advise --collect {} --out FILE", path.display())));
        }
        match value.get("format").and_then(serde_json::Value::as_u64) {
            Some(f) if f == u64::from(FORMAT) => {}
            Some(f) => return Err(content(format!("has format version {f}, and this program reads version {FORMAT}"))),
            None => return Err(content("holds no advice: write it with braid-ecs advise --collect STUDY.json --out FILE".into())),
        }
        serde_json::from_value(value).map_err(|e| content(format!("cannot be understood: {e}")))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read; as [`Data::parse`].
    pub fn read(path: &Path) -> Result<Data, DataError> {
        let text = std::fs::read_to_string(path).map_err(|e| OutputError::io("read", path, e))?;
        Data::parse(path, &text)
    }

    /// The data that come with the program.
    ///
    /// # Panics
    /// Never: a test reads them.
    pub fn shipped() -> Data {
        let text = include_str!("../../scenes/studies/advice.json");
        Data::parse(Path::new("scenes/studies/advice.json"), text).expect("the data of the program are sound")
    }

    /// Makes data of a finished `study.json`. `load` reads the scene of a row; `first_step` times its first steps (s).
    ///
    /// # Errors
    /// A file that is no study, without a reference or without rows that have an error; scenes that cannot be read.
    pub fn collect<E: From<DataError>>(
        path: &Path,
        load: impl Fn(&Path) -> Result<LoadedScene, E>,
        first_step: impl Fn(&LoadedScene) -> Result<f64, E>,
    ) -> Result<Data, E> {
        let content = |message: &str| E::from(DataError::Content { path: path.to_owned(), message: message.to_owned() });
        let text = std::fs::read_to_string(path).map_err(|e| DataError::Output(OutputError::io("read", path, e)))?;
        let study: Study = serde_json::from_str(&text).map_err(|e| content(&format!("is no study: {e}")))?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let scene = |row: &StudyRow| {
            let run = row.runs.first().ok_or_else(|| content(&format!("has no run of row `{}`", row.labels.join(", "))))?;
            load(&folder.join(&run.folder).join("scene.resolved.ron"))
        };
        let reference = study.results.rows.iter().find(|r| r.is_reference).ok_or_else(|| content("has no reference"))?;
        let mut rows = Vec::new();
        for row in study.results.rows.iter().filter(|r| !r.is_reference) {
            let (Some(error), Some(steps), Some(elements), Some(run_s)) = (row.cumulated, row.steps, row.elements, row.cpu_s) else {
                continue;
            };
            if let Some(threads @ 2..) = row.threads {
                let row = row.labels.join(", ");
                return Err(content(&format!(
                    "ran row `{row}` with {threads} threads; times to expect are those of one: run the study with --threads 1"
                )));
            }
            let loaded = scene(row)?;
            let intervals: Option<f64> = row.outcomes.iter().filter_map(|o| o.error_ci95).map(|c| c * c).reduce(|a, b| a + b);
            rows.push(Row {
                label: row.labels.join(", "),
                sets: model_of(&loaded),
                error,
                error_ci95: intervals.map(f64::sqrt),
                steps,
                elements,
                run_s,
                first_step_s: first_step(&loaded)?,
            });
        }
        if rows.is_empty() {
            return Err(content("has no finished row with an error"));
        }
        let made_by = format!("braid-ecs {}, {}", study.machine.version, study.machine.target);
        let covered = facts::of(&scene(reference)?);
        Ok(Data { format: FORMAT, study: study.title, made_by, reference: reference.labels.join(", "), covered, rows })
    }
}

/// The changes that make any scene a model like that of `scene`.
fn model_of(scene: &LoadedScene) -> Vec<(String, String)> {
    let units = scene.scene.units;
    let words = (scene.words(), units);
    let of = |(path, [force, length]): &(&str, [i32; 2])| {
        // Words and plain numbers as they are, others with their unit.
        let value = facts::value(&words, path, [0; 3]).filter(|v| v != "None" && v != "0")?;
        let unit = if *force == 0 && *length == 0 { String::new() } else { format!(" {}/{}", units.force(), units.length()) };
        Some(((*path).to_owned(), if unit.is_empty() { value } else { format!("\"{value}{unit}\"") }))
    };
    MODEL.iter().filter_map(of).collect()
}

#[derive(Deserialize)]
struct Study {
    title: String,
    machine: Machine,
    results: Results,
}

#[derive(Deserialize)]
struct Machine {
    version: String,
    target: String,
}

#[derive(Deserialize)]
struct Results {
    rows: Vec<StudyRow>,
}

#[derive(Deserialize)]
struct StudyRow {
    labels: Vec<String>,
    is_reference: bool,
    outcomes: Vec<Outcome>,
    cumulated: Option<f64>,
    cpu_s: Option<f64>,
    steps: Option<f64>,
    elements: Option<usize>,
    threads: Option<usize>,
    runs: Vec<Run>,
}

#[derive(Deserialize)]
struct Outcome {
    error_ci95: Option<f64>,
}

#[derive(Deserialize)]
struct Run {
    folder: String,
}
