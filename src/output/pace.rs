//! How fast a run goes, over the last seconds of wall time.
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Seconds over which the speed is taken: a run slows down when contacts come.
const WINDOW: Duration = Duration::from_secs(20);

/// The progress of the last seconds.
#[derive(Clone, Debug, Default)]
pub struct Pace {
    past: VecDeque<(Instant, f64)>,
}

impl Pace {
    /// Notes that the run has reached `time` now.
    pub fn note(&mut self, now: Instant, time: f64) {
        self.past.push_back((now, time));
        while self.past.len() > 2 && now - self.past[0].0 > WINDOW {
            self.past.pop_front();
        }
    }

    /// Seconds of wall time until `end` at the speed of the window, once there is one.
    pub fn seconds_to(&self, end: f64) -> Option<f64> {
        let (first, last) = (self.past.front()?, self.past.back()?);
        let (wall, done) = ((last.0 - first.0).as_secs_f64(), last.1 - first.1);
        (wall >= 0.2 && done > 0.0).then(|| (end - last.1).max(0.0) / done * wall)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_remaining_time_follows_the_latest_speed() {
        let mut p = Pace::default();
        let start = Instant::now();
        assert_eq!(p.seconds_to(10.0), None);
        // Fast at first; then two units of time in twenty seconds: 8 more take 80 s.
        for (wall, time) in [(0, 0.0), (1, 100.0), (2, 0.0), (12, 1.0), (22, 2.0)] {
            p.note(start + Duration::from_secs(wall), time);
        }
        assert_eq!(p.seconds_to(10.0), Some(80.0));
        assert_eq!(p.seconds_to(1.0), Some(0.0));
    }
}
