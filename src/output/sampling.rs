//! When something is written.
use crate::scene::schema::Sampling;
use serde::{Deserialize, Serialize};

/// Tells when the next sample is due. Samples at the start and at the end are not its business:
/// the recorder takes those unless the sampling is `Never`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sampler {
    rule: Rule,
    next_time: f64,
    next_step: u64,
}

/// Doublings of the number of steps over which `Count` is spread where the duration is unknown.
const DOUBLINGS: u32 = 10;

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
enum Rule {
    Never,
    Ends,
    Every(f64),
    Steps(u64),
    /// The first after n steps, the next ones after a share of 1/n of the steps so far: for runs of unknown duration.
    Growing(u64),
}

impl Default for Sampler {
    fn default() -> Self {
        Sampler::new(Sampling::Never, None)
    }
}

impl Sampler {
    /// A sampler for a run that is expected to last `duration` (time), if that is known.
    pub fn new(sampling: Sampling, duration: Option<f64>) -> Self {
        let rule = match sampling {
            Sampling::Never => Rule::Never,
            Sampling::Ends | Sampling::Count(0) => Rule::Ends,
            Sampling::Count(n) => match duration.filter(|d| d.is_finite() && *d > 0.0) {
                Some(d) => Rule::Every(d / f64::from(n)),
                None => Rule::Growing(u64::from(n.div_ceil(DOUBLINGS))),
            },
            Sampling::Every(interval) if interval.0 > 0.0 => Rule::Every(interval.0),
            Sampling::Every(_) => Rule::Ends,
            Sampling::Steps(n) => Rule::Steps(n.max(1)),
        };
        let (next_time, next_step) = match rule {
            Rule::Every(interval) => (interval, u64::MAX),
            Rule::Steps(n) | Rule::Growing(n) => (f64::INFINITY, n),
            Rule::Never | Rule::Ends => (f64::INFINITY, u64::MAX),
        };
        Sampler { rule, next_time, next_step }
    }

    /// False if nothing is written at all, not even at the start and the end.
    pub fn wanted(&self) -> bool {
        !matches!(self.rule, Rule::Never)
    }

    /// How often to ask (time), for the loop that calls back; `dt` is the expected time step.
    pub fn interval(&self, dt: f64) -> f64 {
        match self.rule {
            Rule::Every(interval) => interval,
            Rule::Steps(n) => 0.5 * n as f64 * dt,
            Rule::Growing(_) => 64.0 * dt,
            Rule::Never | Rule::Ends => f64::INFINITY,
        }
    }

    /// True if a sample is due at this time and step; the next one is then due an interval later.
    pub fn due(&mut self, time: f64, step: u64) -> bool {
        // Half a millionth of an interval forgives the rounding of a time that is a sum of steps.
        match self.rule {
            Rule::Every(interval) if time >= self.next_time - 5e-7 * interval => {
                self.next_time = (((time + 5e-7 * interval) / interval).floor() + 1.0) * interval;
                true
            }
            Rule::Steps(n) if step >= self.next_step => {
                self.next_step = (step / n + 1) * n;
                true
            }
            Rule::Growing(n) if step >= self.next_step => {
                self.next_step = step + (step / n).max(1);
                true
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::units::Time;

    fn times(sampling: Sampling, duration: Option<f64>, dt: f64) -> Vec<u64> {
        let mut s = Sampler::new(sampling, duration);
        (1..=100).filter(|i| s.due(*i as f64 * dt, *i)).collect()
    }

    #[test]
    fn samples_come_at_even_intervals() {
        assert_eq!(times(Sampling::Count(4), Some(1.0), 0.01), [25, 50, 75, 100]);
        assert_eq!(times(Sampling::Every(Time(0.3)), None, 0.01), [30, 60, 90]);
        assert_eq!(times(Sampling::Steps(40), None, 0.01), [40, 80]);
        assert!(times(Sampling::Ends, Some(1.0), 0.01).is_empty() && times(Sampling::Count(0), None, 0.01).is_empty());
        // Of a run of unknown duration: a share of the steps so far.
        assert_eq!(times(Sampling::Count(20), None, 0.01), [2, 3, 4, 6, 9, 13, 19, 28, 42, 63, 94]);
        // Steps longer than the interval: one sample per step, none twice.
        assert_eq!(times(Sampling::Every(Time(0.3)), None, 1.0).len(), 100);
        assert!(!Sampler::new(Sampling::Never, None).wanted() && Sampler::new(Sampling::Ends, None).wanted());
    }
}
