//! Progress of a run: a bar on a terminal, plain lines every few seconds elsewhere.
use super::message;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::output::Recorder;
use crate::run::Observer;
use crate::simulation::{Simulation, SimulationError};
use crate::step::Clock;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::VecDeque;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Seconds between plain lines.
const LINES_EVERY: Duration = Duration::from_secs(5);
/// Seconds over which the speed is taken: a run slows down when contacts come.
const WINDOW: Duration = Duration::from_secs(20);

/// Shows how far a run has come.
pub(super) struct Progress {
    duration: Option<f64>,
    unit: &'static str,
    show: Show,
    past: VecDeque<(Instant, f64)>,
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
        Progress { duration, unit, show, past: VecDeque::new() }
    }

    /// Takes the state of a run and shows it when it is time.
    pub fn update(&mut self, sim: &Simulation) {
        if matches!(self.show, Show::Nothing) {
            return;
        }
        let now = Instant::now();
        let clock = sim.world.resource::<Clock>();
        self.past.push_back((now, clock.time));
        while self.past.len() > 2 && now - self.past[0].0 > WINDOW {
            self.past.pop_front();
        }
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
        let (Some(first), Some(last)) = (self.past.front(), self.past.back()) else { return String::new() };
        let (wall, done) = ((last.0 - first.0).as_secs_f64(), last.1 - first.1);
        if wall < 0.2 || done <= 0.0 {
            return String::new();
        }
        format!("about {} left  ", duration_text((duration - time) / done * wall))
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

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// True once the user has pressed Ctrl-C.
pub(super) fn interrupted() -> bool {
    INTERRUPTED.load(Ordering::Relaxed)
}

/// The first Ctrl-C lets the run stop in order, with all its files, and is answered with `notice`; the second
/// one ends the program.
pub(super) fn catch_interrupts(notice: &'static str) {
    // Where no handler can be set, Ctrl-C ends the program as ever.
    let _ = ctrlc::set_handler(move || {
        if INTERRUPTED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
        message::line(notice);
    });
}

/// Hands samples to the recorder and shows the progress.
pub(super) struct Watcher<'a, 'b> {
    /// The recorder.
    pub recorder: &'b mut Recorder<'a>,
    /// The progress.
    pub progress: Progress,
}

impl Observer for Watcher<'_, '_> {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError> {
        // Writing first: the pictures of the start must not count as slow steps.
        self.recorder.sample(sim)?;
        self.progress.update(sim);
        Ok(())
    }
    fn stop_requested(&self) -> bool {
        self.recorder.stop_requested() || interrupted()
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

    #[test]
    fn the_remaining_time_follows_the_latest_speed() {
        let mut p = Progress::new(Some(10.0), "s", true);
        let start = Instant::now();
        // Two units of time in ten seconds: 8 more take 40 s.
        p.past = [(start, 0.0), (start + Duration::from_secs(10), 2.0)].into();
        assert_eq!(p.remaining(2.0), "about 40 s left  ");
        assert_eq!(p.remaining(10.5), "waiting for the steady state  ");
    }
}
