//! `study.json`: everything; `study.csv`: a line per row.
//!
//! | key of `study.json` | meaning |
//! |---|---|
//! | `title`, `study`, `text` | title, name, and the study file as it stands |
//! | `state` | see [`State`] |
//! | `machine` | see [`Machine`] |
//! | `scene`, `sets`, `axes`, `reference`, `seeds` | what is common to the rows, and what they differ in |
//! | `outcomes`, `published` | what is compared and how; numbers of others |
//! | `results` | `rows` (see [`RowResult`]), `convergence`, `uncertainty` |
use super::StudyError;
use super::plan::Plan;
use super::results::{Results, RowResult};
use super::schema::{ErrorSpec, PublishedValue};
use super::text::{number, percent, signed_percent, with_interval};
use super::uncertainty::Uncertainty;
use crate::output::file::{json, write_atomic};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// How far a study has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It is under way, or was ended without a chance to say so.
    Running,
    /// Stopped from outside; `--resume` goes on.
    Interrupted,
    /// All runs have been made.
    Ended,
}

/// What the rows were run on and by.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Version of the program.
    pub version: String,
    /// Start of the BLAKE3 of the executable.
    pub build: String,
    /// Architecture and system.
    pub target: String,
    /// Processors that the program may use.
    pub processors: usize,
    /// Rows run at a time; wall times are those of rows that share the machine.
    pub jobs: usize,
    /// Threads of each run; none if they were given out by need.
    pub threads: Option<usize>,
}

impl Machine {
    /// This one.
    pub fn here(jobs: usize, threads: Option<usize>, build: &str) -> Self {
        Machine {
            version: env!("CARGO_PKG_VERSION").into(),
            build: build.into(),
            target: format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            jobs,
            threads,
        }
    }
}

/// How an outcome is compared.
#[derive(Serialize)]
struct Compared<'a> {
    name: &'a str,
    unit: &'a str,
    error: ErrorSpec,
    tolerance: f64,
    /// Half width of what is not known of the reference, over its value.
    reference_uncertainty: Option<f64>,
}

/// Numbers of others.
#[derive(Serialize)]
struct Published<'a> {
    row: &'a [String],
    source: &'a str,
    values: &'a BTreeMap<String, PublishedValue>,
    errors: BTreeMap<&'a str, f64>,
    cumulated: Option<f64>,
    wall_s: Option<f64>,
    note: &'a str,
}

/// The whole `study.json`.
#[derive(Serialize)]
struct Document<'a> {
    title: &'a str,
    study: String,
    state: State,
    machine: &'a Machine,
    scene: &'a Option<String>,
    sets: &'a [(String, String)],
    axes: Vec<(&'a str, Vec<&'a str>)>,
    reference: &'a Option<Vec<String>>,
    seeds: &'a [u64],
    outcomes: Vec<Compared<'a>>,
    published: Vec<Published<'a>>,
    results: &'a Results,
    /// The study file as it stands.
    text: &'a str,
}

/// Writes both tables.
pub(super) fn write(plan: &Plan, results: &Results, machine: &Machine, state: State, folder: &Path) -> Result<(), StudyError> {
    let study = &plan.file.study;
    let document = Document {
        title: &study.title,
        study: plan.file.name(),
        state,
        machine,
        scene: &study.scene,
        sets: &study.set.0,
        axes: study.axes.iter().map(|a| (a.name.as_str(), a.points.iter().map(|p| p.label.as_str()).collect())).collect(),
        reference: &study.reference,
        seeds: study.replicates.as_ref().map_or(&[], |r| &r.seeds),
        outcomes: study
            .outcomes
            .iter()
            .map(|o| Compared {
                name: &o.name,
                unit: &plan.units[&o.name],
                error: o.error,
                tolerance: o.tolerance.0,
                reference_uncertainty: study.reference_uncertainty.get(&o.name).map(|r| r.0),
            })
            .collect(),
        published: study
            .published
            .iter()
            .map(|p| Published {
                row: &p.row,
                source: &p.source,
                values: &p.values,
                errors: p.errors.iter().map(|(n, e)| (n.as_str(), e.0)).collect(),
                cumulated: p.cumulated.map(|c| c.0),
                wall_s: p.wall.map(|w| w.0),
                note: &p.note,
            })
            .collect(),
        results,
        text: &plan.file.text,
    };
    write_atomic(&folder.join("study.json"), &json(&document))?;
    Ok(write_atomic(&folder.join("study.csv"), &csv(plan, results))?)
}

/// A line per row; numbers with all their digits, empty where there is none.
fn csv(plan: &Plan, results: &Results) -> Vec<u8> {
    let study = &plan.file.study;
    let axes: Vec<&str> = study.axes.iter().map(|a| a.name.as_str()).collect();
    let mut header: Vec<String> = vec!["row".into()];
    header.extend(axes.iter().map(|a| (*a).to_owned()));
    for o in &study.outcomes {
        let unit = &plan.units[&o.name];
        header.extend([format!("{} [{unit}]", o.name), format!("{} ci95 [{unit}]", o.name), format!("{} n", o.name)]);
        header.extend([format!("{} difference [-]", o.name), format!("{} error [-]", o.name)]);
    }
    let last = ["cumulated error [-]", "wall [s]", "cpu [s]", "steps", "elements", "front", "reference", "status"];
    header.extend(last.map(str::to_owned));
    let number = |v: Option<f64>| v.map_or(String::new(), |v| v.to_string());
    let line = |(i, r): (usize, &RowResult)| {
        let mut line = vec![r.label()];
        // A row by itself has no place on the axes.
        let on_axes = i < plan.product;
        line.extend((0..axes.len()).map(|k| if on_axes { r.labels[k].clone() } else { String::new() }));
        for v in &r.outcomes {
            line.extend([number(v.value), number(v.ci95), v.n.to_string(), number(v.difference), number(v.error)]);
        }
        line.extend([number(r.cumulated), number(r.wall_s), number(r.cpu_s), number(r.steps)]);
        line.extend([r.elements.map_or(String::new(), |e| e.to_string()), u8::from(r.front).to_string()]);
        line.extend([r.reference.clone().unwrap_or_default(), r.status()]);
        line
    };
    let mut writer = csv::Writer::from_writer(Vec::new());
    for record in std::iter::once(header).chain(results.rows.iter().enumerate().map(line)) {
        writer.write_record(&record).expect("writing to memory does not fail");
    }
    writer.into_inner().expect("writing to memory does not fail")
}

/// The uncertainty of the reference as text, for a terminal; empty if the study asks for none.
pub fn uncertainty_table(results: &Results) -> String {
    let line = |u: &Uncertainty| {
        let relative = |half: f64| u.relative(half).map_or_else(|| format!("{} {}", number(half), u.unit), percent);
        let parts: Vec<String> =
            u.parts.iter().map(|p| format!("{} {}", p.name, p.half_width.map_or("not known".into(), relative))).collect();
        let least = if u.complete { "" } else { "at least " };
        let combined = u.combined.map_or("not known".into(), |c| format!("{least}{}", relative(c)));
        format!("uncertainty of {}: {combined} ({})", u.outcome, parts.join(", "))
    };
    results.uncertainty.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// The results as aligned text, for a terminal.
pub fn table(plan: &Plan, results: &Results) -> String {
    let study = &plan.file.study;
    let compared = results.rows.iter().any(|r| r.reference.is_some());
    let mut head = vec!["row".to_owned()];
    for o in &study.outcomes {
        head.push(format!("{} [{}]", o.name, plan.units[&o.name]));
        head.extend(compared.then(|| "difference".to_owned()));
    }
    head.extend(compared.then(|| "error".to_owned()));
    head.extend(["time".to_owned(), "status".to_owned()]);
    let line = |r: &RowResult| {
        let mut line = vec![r.label()];
        for v in &r.outcomes {
            line.push(with_interval(v.value, v.ci95));
            line.extend(compared.then(|| v.difference.map_or("–".into(), signed_percent)));
        }
        line.extend(compared.then(|| r.cumulated.map_or("–".into(), percent)));
        line.extend([r.time(), r.status()]);
        line
    };
    let lines: Vec<Vec<String>> = std::iter::once(head).chain(results.rows.iter().map(line)).collect();
    let width = |k: usize| lines.iter().map(|l| l[k].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..lines[0].len()).map(width).collect();
    let text = lines.iter().map(|l| {
        let cells = l.iter().zip(&widths).enumerate();
        let cells: Vec<String> =
            cells.map(|(k, (c, w))| if k == 0 || k + 1 == l.len() { format!("{c:<w$}") } else { format!("{c:>w$}") }).collect();
        cells.join("  ").trim_end().to_owned()
    });
    text.collect::<Vec<_>>().join("\n")
}
