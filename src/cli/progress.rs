//! Progress of a run: a bar on a terminal, plain lines every few seconds elsewhere.
use super::message;
use crate::checkpoint::Keeper;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::output::pace::Pace;
use crate::run::{Observer, Status};
use crate::simulation::{Simulation, SimulationError};
use crate::step::Clock;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// Seconds between plain lines.
const LINES_EVERY: Duration = Duration::from_secs(5);

/// Shows how far a run has come.
pub(super) struct Progress {
    duration: Option<f64>,
    unit: &'static str,
    show: Show,
    pace: Pace,
}

enum Show {
    Nothing,
    Bar(ProgressBar),
    Lines(Instant),
}

/// Steps of the bar.
const LENGTH: u64 = 1000;

impl Progress {
    /// Progress towards an expected duration (time), in the given unit.
    pub fn new(duration: Option<f64>, unit: &'static str, quiet: bool) -> Self {
        let show = if quiet {
            Show::Nothing
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(Some(LENGTH), ProgressDrawTarget::stderr());
            bar.set_style(ProgressStyle::with_template("{bar:20.cyan/238} {percent:>3} %  {wide_msg}").expect("a fixed template"));
            Show::Bar(bar)
        } else {
            Show::Lines(Instant::now())
        };
        Progress { duration, unit, show, pace: Pace::default() }
    }

    /// Takes the state of a run and shows it when it is time.
    pub fn update(&mut self, sim: &Simulation) {
        if matches!(self.show, Show::Nothing) {
            return;
        }
        let now = Instant::now();
        let clock = sim.world.resource::<Clock>();
        self.pace.note(now, clock.time);
        let fraction = self.duration.map_or(0.0, |d| clock.time / d).clamp(0.0, 1.0);
        let text = self.text(sim, clock);
        match &mut self.show {
            Show::Nothing => {}
            Show::Bar(bar) => {
                bar.set_position((fraction * LENGTH as f64) as u64);
                bar.set_message(text);
            }
            Show::Lines(last) => {
                if now - *last >= LINES_EVERY {
                    *last = now;
                    message::line(&format!("{:3.0} %  {text}", 100.0 * fraction));
                }
            }
        }
    }

    fn text(&self, sim: &Simulation, clock: &Clock) -> String {
        // The remaining time comes first: narrow terminals cut the end off.
        let mut text = self.remaining(clock.time);
        text += &format!("t {:.3e} {u}  dt {:.1e} {u}  step {}", clock.time, clock.dt_next, clock.step, u = self.unit);
        if let Some(e) = sim.world.get_resource::<EnergyLedger>()
            && e.strain > 0.0
        {
            text += &format!("  kinetic/strain {:.1e}", e.kinetic / e.strain);
        }
        if let Some(c) = sim.world.get_resource::<ContactSummary>()
            && c.records > 0
        {
            text += &format!("  contacts {}", c.active);
        }
        text
    }

    fn remaining(&self, time: f64) -> String {
        let Some(duration) = self.duration else { return String::new() };
        if time >= duration {
            return "waiting for the steady state  ".into();
        }
        self.pace.seconds_to(duration).map_or(String::new(), |s| format!("about {} left  ", duration_text(s)))
    }

    /// Says something beside the bar.
    fn say(&self, text: &str) {
        match &self.show {
            Show::Nothing => {}
            Show::Bar(bar) => bar.println(text),
            Show::Lines(_) => message::line(text),
        }
    }

    /// Takes the bar off the terminal.
    pub fn clear(&self) {
        if let Show::Bar(bar) = &self.show {
            bar.finish_and_clear();
        }
    }
}

/// Seconds in words: `12 s`, `3 min 20 s`, `2 h 05 min`.
pub(super) fn duration_text(seconds: f64) -> String {
    let s = seconds.round();
    if !s.is_finite() || s > 1e9 {
        "very long".into()
    } else if seconds < 10.0 {
        format!("{seconds:.1} s")
    } else if s < 100.0 {
        format!("{s:.0} s")
    } else if s < 3600.0 {
        format!("{:.0} min {:02.0} s", (s / 60.0).floor(), s % 60.0)
    } else {
        format!("{:.0} h {:02.0} min", (s / 3600.0).floor(), ((s % 3600.0) / 60.0).floor())
    }
}

/// Hands the run to the keeper and shows the progress.
pub(super) struct Watcher<'a, 'b> {
    /// The keeper.
    pub keeper: &'b mut Keeper<'a>,
    /// The progress.
    pub progress: Progress,
}

impl Observer for Watcher<'_, '_> {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError> {
        // Writing first: the pictures of the start must not count as slow steps.
        self.keeper.sample(sim)?;
        self.progress.update(sim);
        Ok(())
    }
    fn step_done(&mut self, sim: &mut Simulation, ended: Option<Status>) -> Result<(), SimulationError> {
        self.keeper.step_done(sim, ended)?;
        self.keeper.notes().iter().for_each(|note| self.progress.say(note));
        Ok(())
    }
    fn stop_requested(&self) -> bool {
        self.keeper.stop_requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_read_well() {
        let all = [0.04, 12.3, 99.4, 200.0, 3599.0, 7500.0, f64::INFINITY].map(duration_text);
        assert_eq!(all, ["0.0 s", "12 s", "99 s", "3 min 20 s", "59 min 59 s", "2 h 05 min", "very long"]);
    }
}
