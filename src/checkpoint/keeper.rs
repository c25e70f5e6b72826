//! Looks after a run between its steps: checkpoints by the clock, `status.json`, commands, the time limit.
use super::format::{Checkpoint, Header};
use super::store::{Kind, Store};
use crate::output::control::Command;
use crate::output::failure::{FailureReport, LastGood};
use crate::output::pace::Pace;
use crate::output::provenance;
use crate::output::status::{RunStatus, RunningState};
use crate::output::{Outcome, OutputError, Recorder};
use crate::run::{Observer, Status};
use crate::simulation::{Simulation, SimulationError};
use crate::step::Clock;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What a run is told from outside.
#[derive(Clone, Debug, Default)]
pub struct Orders {
    /// Wall-clock time between checkpoints; `None` writes one only at a stop.
    pub checkpoint: Option<Duration>,
    /// Wall-clock time after which the run is stopped.
    pub time_limit: Option<Duration>,
    /// Set from anywhere to stop the run.
    pub stop: Arc<AtomicBool>,
}

/// How often `status.json` is replaced and a command looked for.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Steps between two states that are kept in memory, to go back to when the run fails. Saving one takes as long as ten to
/// twenty steps. Counting steps and not seconds makes runs that are tried again come out the same every time.
const GOOD_EVERY: u64 = 4096;

/// A recorder and what else watches over the run: an [`Observer`] that can stop it and lets it be resumed.
pub struct Keeper<'a> {
    recorder: Recorder<'a>,
    store: Store,
    header: Header,
    orders: Orders,
    status: RunStatus,
    pace: Pace,
    beat: Beat,
    begin: Instant,
    /// Last checkpoint by the clock, if one was written in this part of the run.
    last: Option<Instant>,
    looked: Option<Instant>,
    stopped: bool,
    /// States that were good, the older one first; see [`GOOD_EVERY`].
    good: VecDeque<Checkpoint>,
    /// The checkpoint of the last step; it is written after the outputs, which could not be made from it.
    end: Option<Checkpoint>,
    notes: Vec<String>,
    error: Option<OutputError>,
}

impl<'a> Keeper<'a> {
    /// A keeper for a run that begins or goes on from the checkpoint `resumed`. `header` says what the run is; `unit`
    /// is that of the time.
    pub fn new(mut recorder: Recorder<'a>, store: Store, header: Header, resumed: Option<Checkpoint>, orders: Orders, unit: &str) -> Self {
        let begin = Instant::now();
        let name = std::path::Path::new(&header.scene).file_stem().map_or(String::new(), |s| s.to_string_lossy().into_owned());
        recorder.tell_retries(&header.retries);
        // A command to an earlier run is not meant for this one.
        let _ = Command::take(recorder.folder());
        Keeper {
            status: RunStatus {
                scene: name,
                unit: unit.into(),
                provenance: provenance::map(recorder.provenance()),
                threads: rayon::current_num_threads(),
                ..Default::default()
            },
            recorder,
            store,
            header,
            orders,
            pace: Pace::default(),
            beat: Beat::default(),
            begin,
            last: resumed.is_some().then_some(begin),
            looked: None,
            stopped: false,
            good: resumed.into_iter().collect(),
            end: None,
            notes: Vec::new(),
            error: None,
        }
    }

    /// The first error of a file, if there was one; the run stops on it.
    pub fn error(&mut self) -> Option<OutputError> {
        self.error.take().or_else(|| self.recorder.error())
    }

    /// What happened since the last call that the user should know.
    pub fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Writes what belongs to the end, `status.json` last; see [`Recorder::finish`].
    ///
    /// # Errors
    /// What the operating system says.
    pub fn finish(&mut self, sim: &mut Simulation, word: &str) -> Result<Outcome, OutputError> {
        self.take_status(sim);
        let folder = self.recorder.folder().to_owned();
        let outcome = self.recorder.finish(sim, word).and_then(|outcome| match &self.end {
            Some(end) => self.recorder.sync().and_then(|()| self.store.put(Kind::End, end)).map(|_| outcome),
            None => Ok(outcome),
        });
        if let (Some(end), Ok(_)) = (&self.end, &outcome) {
            self.status.checkpoint = Some(end.header.step);
        }
        self.status.eta_s = None;
        self.status.state = match word {
            "stopped" if outcome.is_ok() => RunningState::Stopped,
            _ if word == Status::FAILED || outcome.is_err() => RunningState::Failed,
            _ => RunningState::Finished,
        };
        let _ = self.status.write(&folder);
        outcome
    }

    /// Marks the run as failed where nothing else can be written any more.
    pub fn give_up(&mut self, sim: &Simulation) {
        self.write_status(sim, RunningState::Failed);
    }

    /// The newest state that is `before` steps older than the failure in the present step, or else the oldest that is known.
    fn last_good(&mut self, sim: &Simulation, before: u64) -> Option<Checkpoint> {
        let step = sim.world.resource::<Clock>().step;
        let old = self.good.iter().rposition(|c| c.header.step + before <= step).unwrap_or(0);
        self.good.remove(old)
    }

    /// True if a good state is known: from the first step on.
    pub fn can_go_back(&self) -> bool {
        !self.good.is_empty()
    }

    /// Puts the last good state, from `before` steps ago, into the folder, so that the run can go back to it; gives the
    /// folder and the state back.
    ///
    /// # Errors
    /// What the operating system says.
    ///
    /// # Panics
    /// Where [`Keeper::can_go_back`] says no.
    pub fn go_back(mut self, sim: &Simulation, before: u64) -> Result<(Store, PathBuf, Checkpoint), OutputError> {
        let good = self.last_good(sim, before).expect("a good state is known");
        self.recorder.sync()?;
        let path = self.store.put(Kind::Good, &good)?;
        Ok((self.store, path, good))
    }

    /// Writes what a failed run leaves: all outputs, checkpoint and frame of the last good state, the report.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn fail(&mut self, sim: &mut Simulation, report: &mut FailureReport, before: u64) -> Result<(), OutputError> {
        let good = self.last_good(sim, before);
        self.finish(sim, Status::FAILED)?;
        if let Some(good) = good {
            self.recorder.sync()?;
            let path = self.store.put(Kind::Good, &good)?;
            let checkpoint = path.strip_prefix(self.recorder.folder()).unwrap_or(&path).display().to_string();
            let Header { step, time, .. } = good.header;
            // The world of the failure has been written down.
            let frame = match sim.restore_state(&good.state) {
                Ok(()) => self.recorder.frame_of_last_good(sim)?,
                Err(_) => None,
            };
            report.last_good = Some(LastGood { step, time, checkpoint, frame });
        }
        report.provenance = provenance::map(self.recorder.provenance());
        report.write(self.recorder.folder())
    }

    fn take_status(&mut self, sim: &Simulation) {
        self.status.wall_s = self.recorder.wall();
        self.status.look(sim);
        self.status.set_progress(self.header.duration, self.status.eta_s);
    }

    fn write_status(&mut self, sim: &Simulation, state: RunningState) {
        self.take_status(sim);
        self.status.state = state;
        // A disk that is full shows at the next file that matters.
        let _ = self.status.write(self.recorder.folder());
    }

    fn checkpoint(&self, sim: &mut Simulation, ended: Option<Status>) -> Result<Checkpoint, OutputError> {
        let clock = sim.world.resource::<Clock>();
        let header = Header { step: clock.step, time: clock.time, ended, ..self.header.clone() };
        let fail = |e| OutputError::io("write a checkpoint in", self.recorder.folder(), std::io::Error::other(e));
        Ok(Checkpoint { header, recorder: self.recorder.state(sim)?, state: sim.save_state().map_err(fail)? })
    }

    fn save(&mut self, sim: &mut Simulation, kind: Kind) -> Result<(), OutputError> {
        let checkpoint = self.checkpoint(sim, None)?;
        self.recorder.sync()?;
        let path = self.store.put(kind, &checkpoint)?;
        self.last = Some(Instant::now());
        let Header { step, time, .. } = checkpoint.header;
        self.status.checkpoint = Some(step);
        if kind == Kind::Stopped {
            self.notes.push(format!("stopped at t = {time:.4e}, step {step}; the checkpoint is {}", path.display()));
        }
        Ok(())
    }

    fn look(&mut self, sim: &mut Simulation, now: Instant) -> Result<(), OutputError> {
        self.looked = Some(now);
        let (time, step) = (sim.world.resource::<Clock>().time, sim.world.resource::<Clock>().step);
        self.pace.note(now, time);
        self.status.eta_s = self.header.duration.filter(|d| time < *d).and_then(|d| self.pace.seconds_to(d));
        self.write_status(sim, RunningState::Running);
        match Command::take(self.recorder.folder()) {
            None => {}
            Some(Ok(Command::Stop)) => self.orders.stop.store(true, Ordering::Relaxed),
            Some(Ok(Command::Checkpoint)) => {
                self.save(sim, Kind::Ring)?;
                self.notes.push(format!("checkpoint at t = {time:.4e}, step {step}"));
            }
            Some(Ok(Command::Frame)) => {
                self.recorder.write_frame(sim)?;
                self.notes.push(format!("frame at t = {time:.4e}, step {step}"));
            }
            Some(Err(word)) => self.notes.push(format!("`{word}` in the file `control` is no command: stop, checkpoint and frame are")),
        }
        Ok(())
    }

    fn between_steps(&mut self, sim: &mut Simulation) -> Result<(), OutputError> {
        if self.good.is_empty() || sim.world.resource::<Clock>().step.is_multiple_of(GOOD_EVERY) {
            let checkpoint = self.checkpoint(sim, None)?;
            if self.good.len() == 2 {
                self.good.pop_front();
            }
            self.good.push_back(checkpoint);
        }
        if let Some(now) = self.beat.tick() {
            if self.looked.is_none_or(|t| now - t >= LOOK_EVERY) {
                self.look(sim, now)?;
            }
            if self.orders.time_limit.is_some_and(|limit| now - self.begin >= limit) {
                self.orders.stop.store(true, Ordering::Relaxed);
            }
            // A run that has just begun can be resumed from its start.
            if self.orders.checkpoint.is_some_and(|every| self.last.is_none_or(|t| now - t >= every)) {
                self.save(sim, Kind::Ring)?;
            }
        }
        if !self.stopped && self.orders.stop.load(Ordering::Relaxed) {
            self.stopped = true;
            self.save(sim, Kind::Stopped)?;
        }
        Ok(())
    }
}

impl Observer for Keeper<'_> {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError> {
        self.recorder.sample(sim)
    }

    fn step_done(&mut self, sim: &mut Simulation, ended: Option<Status>) -> Result<(), SimulationError> {
        if self.stop_requested() {
            return Ok(());
        }
        let done = match ended {
            None => self.between_steps(sim),
            Some(_) if self.orders.checkpoint.is_some() => self.checkpoint(sim, ended).map(|c| self.end = Some(c)),
            Some(_) => Ok(()),
        };
        self.error = done.err();
        Ok(())
    }

    fn stop_requested(&self) -> bool {
        self.stopped || self.error.is_some() || self.recorder.stop_requested()
    }
}

/// Tells every few milliseconds of wall time, whatever a step takes: reading the clock in each of them
/// would cost small models one per cent.
#[derive(Debug)]
struct Beat {
    every: u32,
    left: u32,
    last: Instant,
}

impl Default for Beat {
    fn default() -> Self {
        Beat { every: 1, left: 1, last: Instant::now() }
    }
}

impl Beat {
    fn tick(&mut self) -> Option<Instant> {
        self.left -= 1;
        if self.left > 0 {
            return None;
        }
        let now = Instant::now();
        let passed = now - self.last;
        if passed < Duration::from_millis(2) {
            self.every = (self.every * 2).min(1 << 16);
        } else if passed > Duration::from_millis(8) {
            self.every = (self.every / 2).max(1);
        }
        (self.last, self.left) = (now, self.every);
        Some(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beat_adapts_to_the_length_of_a_step() {
        let mut beat = Beat::default();
        assert!(beat.tick().is_some(), "the first step counts");
        let begin = Instant::now();
        let mut looks = 0;
        while begin.elapsed() < Duration::from_millis(100) {
            looks += usize::from(beat.tick().is_some());
        }
        assert!((3..100).contains(&looks), "{looks}");
    }
}
