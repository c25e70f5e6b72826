//! How long the rest of a study will take.
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Compares the expected cost of the runs with the time that they took.
#[derive(Clone, Debug)]
pub struct Eta {
    /// Expected cost of every run, in any unit.
    costs: Vec<f64>,
    jobs: usize,
    /// Cost and seconds of the runs that have ended.
    done: (f64, f64),
    open: Vec<bool>,
    running: BTreeMap<usize, Instant>,
}

impl Eta {
    /// For runs with these costs, so many at a time; a run of unknown cost counts as a mean one.
    pub fn new(costs: &[Option<f64>], jobs: usize) -> Self {
        let known: Vec<f64> = costs.iter().copied().flatten().collect();
        let mean = if known.is_empty() { 1.0 } else { known.iter().sum::<f64>() / known.len() as f64 };
        let costs: Vec<f64> = costs.iter().map(|c| c.unwrap_or(mean).max(f64::MIN_POSITIVE)).collect();
        Eta { open: vec![true; costs.len()], costs, jobs: jobs.max(1), done: (0.0, 0.0), running: BTreeMap::new() }
    }

    /// A run needs not be made.
    pub fn kept(&mut self, run: usize) {
        self.open[run] = false;
    }

    /// A run begins.
    pub fn started(&mut self, run: usize, now: Instant) {
        self.running.insert(run, now);
    }

    /// A run has ended; one that has failed says nothing of the speed.
    pub fn ended(&mut self, run: usize, now: Instant, failed: bool) {
        if let Some(begin) = self.running.remove(&run).filter(|_| !failed) {
            self.done.0 += self.costs[run];
            self.done.1 += (now - begin).as_secs_f64();
        }
        self.open[run] = false;
    }

    /// Expected time to the end; unknown before the first run has ended.
    pub fn remaining(&self, now: Instant) -> Option<Duration> {
        if self.done.1 <= 0.0 {
            return None;
        }
        let seconds = |run: usize| {
            let whole = self.costs[run] * self.done.1 / self.done.0;
            let past = self.running.get(&run).map_or(0.0, |begin| (now - *begin).as_secs_f64());
            (whole - past).max(0.0)
        };
        let open: Vec<f64> = (0..self.costs.len()).filter(|r| self.open[*r]).map(seconds).collect();
        let longest = open.iter().copied().fold(0.0, f64::max);
        let even = open.iter().sum::<f64>() / self.jobs as f64;
        // A time that no clock can hold is not known.
        Duration::try_from_secs_f64(even.max(longest)).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_of_past_runs_tells_the_time_of_the_others() {
        let begin = Instant::now();
        let after = |s: u64| begin + Duration::from_secs(s);
        let mut eta = Eta::new(&[Some(100.0), Some(40.0), None, Some(10.0), Some(30.0)], 2);
        assert_eq!(eta.remaining(begin), None);
        eta.started(0, begin);
        eta.started(1, begin);
        eta.ended(1, after(20), false);
        // Half a second per unit: run 0 has 30 s to go, run 2 (the mean, 45) 22.5 s, 3 and 4 20 s together.
        let r = eta.remaining(after(20)).unwrap().as_secs_f64();
        assert!((r - 0.5 * (30.0 + 22.5 + 20.0)).abs() < 1e-9, "{r}");
        // One long run alone cannot be shared.
        for run in 2..5 {
            eta.kept(run);
        }
        assert!((eta.remaining(after(20)).unwrap().as_secs_f64() - 30.0).abs() < 1e-9);
        eta.ended(0, after(30), true);
        assert_eq!(eta.remaining(after(30)), Some(Duration::ZERO));
    }
}
