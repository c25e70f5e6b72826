//! `status.json`: how far a run has come, replaced about once a second while it goes on.
//!
//! | key | meaning |
//! |---|---|
//! | `scene`, `state` | name; `running`, `finished`, `stopped` (can be resumed) or `failed` |
//! | `provenance` | as in `summary.json` |
//! | `threads` | threads of this part of the run |
//! | `pid`, `updated` | the process; when this was written, in seconds since 1970 |
//! | `time`, `unit`, `step`, `dt` | where the run is |
//! | `progress`, `eta_s` | share of the expected duration; seconds left at the speed of the last 20 s |
//! | `wall_s` | seconds of wall time so far, earlier parts included |
//! | `energy`, `contacts` | of the last look at them; contacts are those that carry a force |
//! | `checkpoint` | step of the last checkpoint, of this part of the run |
use super::file::{OutputError, json, replace};
use super::summary::{Energies, finite};
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::simulation::Simulation;
use crate::step::Clock;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

/// State of a run as others see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RunningState {
    /// It goes on.
    #[default]
    Running,
    /// It has come to its end.
    Finished,
    /// It was stopped and can be resumed.
    Stopped,
    /// It ended with an error.
    Failed,
}

impl RunningState {
    /// The word in the file.
    pub fn word(self) -> &'static str {
        match self {
            RunningState::Running => "running",
            RunningState::Finished => "finished",
            RunningState::Stopped => "stopped",
            RunningState::Failed => "failed",
        }
    }
}

/// The content of `status.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct RunStatus {
    pub scene: String,
    pub state: RunningState,
    pub provenance: BTreeMap<String, String>,
    pub threads: usize,
    pub pid: u32,
    pub updated: f64,
    pub time: f64,
    pub unit: String,
    pub step: u64,
    pub dt: f64,
    pub progress: Option<f64>,
    pub eta_s: Option<f64>,
    pub wall_s: f64,
    pub energy: Energies,
    pub contacts: usize,
    pub checkpoint: Option<u64>,
}

/// Name of the file in the output folder.
const FILE: &str = "status.json";

impl RunStatus {
    /// Takes time, energies and contacts from a simulation, and the time of day.
    pub fn look(&mut self, sim: &Simulation) {
        let clock = sim.world.resource::<Clock>();
        (self.time, self.step, self.dt) = (clock.time, clock.step, clock.dt);
        let e = sim.world.get_resource::<EnergyLedger>().copied().unwrap_or_default();
        self.energy = Energies::of(&e);
        self.contacts = sim.world.get_resource::<ContactSummary>().map_or(0, |c| c.active);
        self.pid = std::process::id();
        self.updated = now();
    }

    /// Share of `duration` that is done.
    pub fn set_progress(&mut self, duration: Option<f64>, eta: Option<f64>) {
        self.progress = duration.map(|d| (self.time / d).clamp(0.0, 1.0)).and_then(finite);
        self.eta_s = eta.and_then(finite);
    }

    /// Replaces the file in an output folder.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        replace(&folder.join(FILE), &json(self))
    }

    /// Reads the file of an output folder.
    ///
    /// # Errors
    /// What the operating system says; a file of another program.
    pub fn read(folder: &Path) -> Result<Self, OutputError> {
        let path = folder.join(FILE);
        let fail = |e: std::io::Error| OutputError::io("read", &path, e);
        serde_json::from_slice(&std::fs::read(&path).map_err(fail)?).map_err(|e| fail(e.into()))
    }

    /// Seconds since it was written.
    pub fn age(&self) -> f64 {
        (now() - self.updated).max(0.0)
    }
}

fn now() -> f64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let dir = tempfile::tempdir().unwrap();
        let mut s = RunStatus { scene: "a".into(), time: 0.25, updated: now(), ..Default::default() };
        s.set_progress(Some(1.0), Some(f64::INFINITY));
        s.write(dir.path()).unwrap();
        assert_eq!(RunStatus::read(dir.path()).unwrap(), s);
        assert_eq!((s.progress, s.eta_s), (Some(0.25), None));
        assert!(s.age() < 60.0);
        std::fs::write(dir.path().join(FILE), "{").unwrap();
        assert!(RunStatus::read(dir.path()).unwrap_err().to_string().contains("status.json"));
    }
}
