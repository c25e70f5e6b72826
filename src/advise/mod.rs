//! Which model of a tow to take: from the errors and times of a study to a scene.
//!
//! A study has run models against a reference, under one load, with one friction. What it found is kept in a file
//! ([`Data`]): for every row what it changed in the scene, its error and its cost. [`choose`] picks a row for a wanted
//! error or time, and [`outside`] says where a scene differs from what the study has covered.
mod data;
mod facts;

pub use data::{Data, DataError, Row};
pub use facts::{Fact, Facts, outside};

/// What is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Largest cumulated error (not in percent).
    pub error: Option<f64>,
    /// Longest run (s).
    pub time: Option<f64>,
}

/// A row that was chosen, and whether it meets what was wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// Its index.
    pub row: usize,
    /// True if it meets the error and the time.
    pub meets: bool,
}

/// Picks a row; `times` are the expected times of all rows (s).
///
/// With an error alone it is the cheapest row that meets it, with a time the one of least error that meets both. If none does, the row that misses
/// by the least factor.
pub fn choose(rows: &[Row], times: &[f64], wanted: Wanted) -> Option<Choice> {
    let within = |value: f64, limit: Option<f64>| limit.is_none_or(|l| value <= l);
    let meets = |i: &usize| within(rows[*i].error, wanted.error) && within(times[*i], wanted.time);
    let by = |key: &dyn Fn(usize) -> f64, all: &mut dyn Iterator<Item = usize>| all.min_by(|a, b| key(*a).total_cmp(&key(*b)));
    let rank = |i: usize| if wanted.time.is_some() { rows[i].error } else { times[i] };
    if let Some(row) = by(&rank, &mut (0..rows.len()).filter(meets)) {
        return Some(Choice { row, meets: true });
    }
    let over = |value: f64, limit: Option<f64>| limit.map_or(1.0, |l| (value / l).max(1.0));
    let missed = |i: usize| over(rows[i].error, wanted.error).max(over(times[i], wanted.time));
    by(&missed, &mut (0..rows.len())).map(|row| Choice { row, meets: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Row> {
        let row = |label: &str, error: f64| Row { label: label.into(), error, ..Row::default() };
        vec![row("trusses", 0.67), row("embedded", 0.14), row("embedded 19", 0.06)]
    }

    #[test]
    fn the_cheapest_that_meets_the_error_or_the_best_within_the_time() {
        let times = [10.0, 12.0, 100.0];
        let of = |error: Option<f64>, time: Option<f64>| choose(&rows(), &times, Wanted { error, time }).map(|c| (c.row, c.meets));
        assert_eq!(of(Some(0.2), None), Some((1, true)), "cheaper than the one of less error");
        assert_eq!(of(Some(0.1), None), Some((2, true)));
        assert_eq!(of(None, Some(50.0)), Some((1, true)));
        assert_eq!(of(Some(0.2), Some(200.0)), Some((2, true)), "less error, since the time allows it");
        assert_eq!(of(Some(0.1), Some(50.0)), Some((1, false)), "1.4 times the error; the other one takes twice the time");
        assert_eq!(of(Some(0.001), None), Some((2, false)));
        assert_eq!(choose(&[], &[], Wanted::default()), None);
    }
}
