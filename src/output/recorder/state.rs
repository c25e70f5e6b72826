//! What a recorder remembers, so that its files go on as if the run had never stopped.
use super::{LAST_GOOD, Recorder};
use crate::output::file::{OutputError, remove};
use crate::output::history::{History, HistoryState};
use crate::output::sampling::Sampler;
use crate::output::{failure, timing, vtp};
use crate::scene::LoadedScene;
use crate::simulation::Simulation;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// State of a [`Recorder`]: where its files end and what it has gathered.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct RecorderState {
    history: Option<HistoryState>,
    history_sampler: Sampler,
    frame_sampler: Sampler,
    frames: Vec<(f64, String)>,
    contact_frames: Vec<(f64, String)>,
    probes: Vec<Option<f64>>,
    started: bool,
    last: (Option<u64>, Option<u64>),
    /// Seconds: wall, processor, writing.
    seconds: [f64; 3],
    timing: Vec<u64>,
}

/// What is written at the end of a run, and would be wrong while it goes on.
const OF_THE_END: [&str; 5] = ["summary.json", "final.png", "history.svg", failure::FILE, LAST_GOOD];

impl<'a> Recorder<'a> {
    /// The state now.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn state(&self, sim: &Simulation) -> Result<RecorderState, OutputError> {
        Ok(RecorderState {
            history: self.history.as_ref().map(History::state).transpose()?,
            history_sampler: self.history_sampler.clone(),
            frame_sampler: self.frame_sampler.clone(),
            frames: self.frames.clone(),
            contact_frames: self.contact_frames.clone(),
            probes: self.probes.state(),
            started: self.started,
            last: self.last,
            seconds: [self.wall(), self.cpu().unwrap_or(0.0), self.writing],
            timing: timing::so_far(&sim.world),
        })
    }

    /// Waits until the history is on the disk.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn sync(&self) -> Result<(), OutputError> {
        self.history.as_ref().map_or(Ok(()), History::sync)
    }

    /// A recorder that goes on from a state, in the folder of the run. `sim` stands at the start: what
    /// pictures and frames need of the undeformed model is taken from it. No file is changed before
    /// [`Recorder::rewind`].
    ///
    /// # Errors
    /// A history that is shorter than it was.
    pub fn resumed(loaded: &'a LoadedScene, sim: &mut Simulation, folder: &Path, state: RecorderState) -> Result<Self, OutputError> {
        let mut recorder = Recorder::without_files(loaded, sim, folder, None);
        recorder.history_sampler = state.history_sampler;
        recorder.frame_sampler = state.frame_sampler;
        recorder.frames = state.frames;
        recorder.contact_frames = state.contact_frames;
        recorder.probes.put_back(state.probes);
        recorder.started = state.started;
        recorder.last = state.last;
        recorder.before = [state.seconds[0], state.seconds[1]];
        recorder.writing = state.seconds[2];
        timing::go_on(&mut sim.world, &state.timing);
        if let Some(history) = state.history {
            recorder.history = Some(History::reopen(&folder.join("history.csv"), recorder.columns(), history)?);
        }
        Ok(recorder)
    }

    /// Cuts the files back to the state: what was written after it goes.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn rewind(&mut self) -> Result<(), OutputError> {
        if let Some(history) = &mut self.history {
            history.rewind()?;
        }
        for name in OF_THE_END {
            remove(&self.folder.join(name))?;
        }
        for i in self.frames.len().. {
            // Frames are numbered without gaps.
            let [path, contacts] = [format!("frames/{i:04}.vtp"), format!("frames/contacts_{i:04}.vtp")].map(|n| self.folder.join(n));
            if !path.exists() && !contacts.exists() {
                break;
            }
            remove(&path)?;
            remove(&contacts)?;
        }
        for (name, frames) in [("results.pvd", &self.frames), ("contacts.pvd", &self.contact_frames)] {
            let path = self.folder.join(name);
            if frames.is_empty() { remove(&path)? } else { vtp::write_series(&path, frames, &self.provenance)? }
        }
        Ok(())
    }
}
