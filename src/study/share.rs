//! How many threads a run gets: one, unless it would go on alone when all that wait behind it have ended.

/// Share of a run that one thread does while the others wait, measured on braids of one to forty thousand elements: two threads make
/// 1.2 to 1.6 times the steps of one.
const ALONE: f64 = 0.35;

/// Time of a run with so many threads, over that with one.
fn time(threads: usize) -> f64 {
    ALONE + (1.0 - ALONE) / threads as f64
}

/// Threads, out of `free` ones, for a run of this cost before others that wait, which cost so much together and take one thread
/// each: the fewest with which all of them end soonest, one if a cost is not known.
pub fn threads(cost: f64, waiting: f64, free: usize) -> usize {
    if !(cost + waiting).is_finite() {
        return 1;
    }
    let end = |threads: usize| {
        let own = cost * time(threads);
        own.max((own * threads as f64 + waiting) / free as f64)
    };
    (2..=free).fold(1, |best, threads| if end(threads) < end(best) { threads } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_takes_longest_by_far_gets_what_is_free() {
        assert_eq!(threads(1.0, 11.0, 4), 1, "one of twelve alike");
        assert_eq!(threads(400.0, 70.0, 2), 2, "the reference of a study");
        assert_eq!(threads(400.0, 70.0, 1), 1, "what else is running keeps its thread");
        assert_eq!(threads(400.0, 0.0, 8), 8, "the last one");
        // Eight threads make it 2.3 times as fast; six hardly less, and leave two for the others.
        let some = threads(400.0, 300.0, 8);
        assert!((5..8).contains(&some), "{some}");
        assert_eq!(threads(f64::INFINITY, 70.0, 2), 1, "nobody knows");
        assert_eq!(threads(1.0, f64::NAN, 2), 1);
    }
}
