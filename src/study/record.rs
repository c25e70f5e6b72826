//! `row.json`: what a run of a study was made from and how it ended. It is written when the run begins,
//! and again when it has ended: one that says `running` is of a run that did not end, and can be gone on with.
use super::StudyError;
use super::plan::{Plan, Run};
use crate::output::file::{json, write_atomic};
use crate::output::summary::Summary;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Not at all: it is under way, or was stopped.
    Running,
    /// With a summary.
    Finished,
    /// With a message.
    Failed,
}

/// The content of `row.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Label of the row.
    pub row: String,
    /// Seed of a repetition.
    pub seed: Option<u64>,
    /// How it ended.
    pub status: Status,
    /// Why it failed; else empty.
    pub message: String,
    /// Exit code of the run; none if it was ended from outside.
    pub exit_code: Option<i32>,
    /// File name of the scene.
    pub scene: String,
    /// BLAKE3 of its text, hexadecimal.
    pub scene_hash: String,
    /// Changes of the scene, the seed included.
    pub sets: Vec<(String, String)>,
    /// Version of the program.
    pub version: String,
    /// Start of the BLAKE3 of the executable: two builds of one version differ in it.
    pub build: String,
    /// Runs at a time in the study that made it; its wall time is of a machine shared by so many.
    pub jobs: usize,
    /// Wall time from the start of the process to its end (s).
    pub process_s: f64,
}

impl Record {
    /// The record of a run that begins, by the program with the fingerprint `build`.
    pub fn of(plan: &Plan, run: &Run, build: &str) -> Self {
        let row = &plan.rows[run.row];
        Record {
            row: row.label(),
            seed: run.seed,
            status: Status::Running,
            message: String::new(),
            exit_code: None,
            scene: row.scene.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned()),
            scene_hash: row.scene_hash.clone(),
            sets: plan.sets(run),
            version: env!("CARGO_PKG_VERSION").into(),
            build: build.into(),
            jobs: 1,
            process_s: 0.0,
        }
    }

    /// What the run would now be made from that it was not made from.
    pub fn changes(&self, now: &Record) -> Vec<String> {
        let mut changes = Vec::new();
        if self.version != now.version {
            changes.push(format!("it was run by version {}, this is version {}", self.version, now.version));
        }
        if self.scene != now.scene {
            changes.push(format!("its scene was `{}`, and is now `{}`", self.scene, now.scene));
        } else if self.scene_hash != now.scene_hash {
            changes.push(format!("its scene `{}` has changed", self.scene));
        }
        let of = |sets: &[(String, String)], path: &str| sets.iter().rfind(|s| s.0 == path).map(|s| s.1.clone());
        let mut paths: Vec<&String> = self.sets.iter().chain(&now.sets).map(|s| &s.0).collect();
        paths.sort();
        paths.dedup();
        let before = changes.len();
        for path in paths {
            let (old, new) = (of(&self.sets, path), of(&now.sets, path));
            let word = |v: &Option<String>| v.as_ref().map_or("not set".to_owned(), |v| format!("`{v}`"));
            if old != new {
                changes.push(format!("`{path}` was {}, and is now {}", word(&old), word(&new)));
            }
        }
        if changes.len() == before && self.sets != now.sets {
            changes.push("its changes of the scene come in another order".into());
        }
        changes
    }

    /// Writes the record into the folder of its run.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write(&self, folder: &Path) -> Result<(), StudyError> {
        Ok(write_atomic(&folder.join("row.json"), &json(self))?)
    }
}

/// The end of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Ended {
    /// What it was made from and how it ended.
    pub record: Record,
    /// What came out; none of a failed run.
    pub summary: Option<Summary>,
}

/// What an earlier run has left in `folder`: none if there was none, or if it did not end.
///
/// # Errors
/// A record that cannot be read.
pub fn read(folder: &Path) -> Result<Option<Ended>, StudyError> {
    let Some(record) = read_record(folder)?.filter(|r| r.status != Status::Running) else { return Ok(None) };
    let summary = if record.status == Status::Finished { Summary::read(folder).ok() } else { None };
    Ok(Some(Ended { record, summary }))
}

/// True if `folder` holds a run that was begun as `now` would begin it, by the same build, and has a checkpoint.
///
/// # Errors
/// A record that cannot be read.
pub fn unfinished(folder: &Path, now: &Record) -> Result<bool, StudyError> {
    // Without an exit code it was ended from outside.
    let open = |r: &Record| r.status == Status::Running || r.status == Status::Failed && r.exit_code.is_none();
    let same = |r: &Record| open(r) && r.build == now.build && r.changes(now).is_empty();
    let checkpoints = || std::fs::read_dir(folder.join("checkpoints")).is_ok_and(|mut files| files.next().is_some());
    Ok(read_record(folder)?.is_some_and(|r| same(&r)) && checkpoints())
}

fn read_record(folder: &Path) -> Result<Option<Record>, StudyError> {
    let path = folder.join("row.json");
    if !path.exists() {
        return Ok(None);
    }
    let broken = |message: String| StudyError::Record { path: path.clone(), message };
    let text = std::fs::read_to_string(&path).map_err(|e| broken(e.to_string()))?;
    serde_json::from_str(&text).map(Some).map_err(|e| broken(e.to_string()))
}
