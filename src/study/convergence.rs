//! Convergence along an axis, as the paper judges it: the change from one point to the next,
//! R = |a(i-1) - a(i)| / |a(i)|, against what the scatter of the values can tell, 2 s / (|a| sqrt(n))
//! with the standard deviation s averaged over the points; against a given tolerance where an outcome
//! has no interval.
use super::results::RowResult;
use super::schema::Study;
use crate::measure::quantile;
use serde::Serialize;

/// One outcome along the axis, all other labels held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Convergence {
    /// The other labels; empty if there is one axis.
    pub labels: Vec<String>,
    /// The outcome.
    pub outcome: String,
    /// Labels of the points.
    pub points: Vec<String>,
    /// Relative change from the point before; none at the first, and where a row has no value.
    pub changes: Vec<Option<f64>>,
    /// Change that counts as none.
    pub limit: Option<f64>,
    /// The first point from which on all changes are below the limit.
    pub converged_at: Option<String>,
}

/// The convergence of all outcomes along the axis that the study names; `rows` are those of the axes.
pub fn convergence(study: &Study, rows: &[RowResult]) -> Vec<Convergence> {
    let Some((axis, groups)) = along_axis(study, rows) else { return Vec::new() };
    let mut all = Vec::new();
    for (labels, rows) in &groups {
        for (k, outcome) in study.outcomes.iter().enumerate() {
            let values: Vec<(Option<f64>, Option<f64>)> =
                rows.iter().map(|r| (r.outcomes[k].value, r.outcomes[k].ci95.and_then(|c| two_sigma(c, r.outcomes[k].n)))).collect();
            let points: Vec<String> = rows.iter().map(|r| r.labels[axis].clone()).collect();
            let (changes, limit) = judge(&values, outcome.tolerance.0);
            let converged_at = first_below(&changes, limit).map(|i| points[i].clone());
            all.push(Convergence { labels: labels.clone(), outcome: outcome.name.clone(), points, changes, limit, converged_at });
        }
    }
    all
}

/// Rows that differ along the axis of convergence only, with the labels that they share.
pub(super) type Group<'a> = (Vec<String>, Vec<&'a RowResult>);

/// The axis of convergence, and `rows` (those of the axes) in groups along it.
pub(super) fn along_axis<'a>(study: &Study, rows: &'a [RowResult]) -> Option<(usize, Vec<Group<'a>>)> {
    let axis = study.axes.iter().position(|a| Some(&a.name) == study.convergence.as_ref())?;
    let mut groups: Vec<Group<'_>> = Vec::new();
    for row in rows {
        let mut labels = row.labels.clone();
        labels.remove(axis);
        match groups.iter_mut().find(|g| g.0 == labels) {
            Some(g) => g.1.push(row),
            None => groups.push((labels, vec![row])),
        }
    }
    Some((axis, groups))
}

/// 2 s / sqrt(n) from the half width t s / sqrt(n) of n values.
fn two_sigma(ci95: f64, n: usize) -> Option<f64> {
    (n > 1).then(|| 2.0 * ci95 / quantile(n))
}

/// Changes between neighbours and their limit, from values and their 2 s / sqrt(n).
fn judge(values: &[(Option<f64>, Option<f64>)], tolerance: f64) -> (Vec<Option<f64>>, Option<f64>) {
    let change = |i: usize| {
        let (before, now) = (values[i.checked_sub(1)?].0?, values[i].0?);
        (now != 0.0).then(|| (before - now).abs() / now.abs())
    };
    let widths: Vec<f64> = values.iter().filter_map(|v| v.1).collect();
    let last = values.last().and_then(|v| v.0).filter(|a| *a != 0.0);
    let limit = if widths.is_empty() { Some(tolerance) } else { last.map(|a| widths.iter().sum::<f64>() / widths.len() as f64 / a.abs()) };
    ((0..values.len()).map(change).collect(), limit)
}

/// The first of the last changes that are all below the limit.
fn first_below(changes: &[Option<f64>], limit: Option<f64>) -> Option<usize> {
    let limit = limit?;
    let quiet = changes.iter().rev().take_while(|c| c.is_some_and(|c| c < limit)).count();
    (quiet > 0).then(|| changes.len() - quiet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_are_judged_by_scatter_or_tolerance() {
        // Twelve values with s = 0.6: half width 2.200985160 x 0.6 / sqrt(12).
        let width = two_sigma(2.200985160 * 0.6 / 12f64.sqrt(), 12).unwrap();
        assert!((width - 2.0 * 0.6 / 12f64.sqrt()).abs() < 1e-8);
        assert_eq!(two_sigma(0.1, 0), None);
        let (changes, limit) = judge(&[(Some(40.0), Some(0.2)), (Some(36.0), Some(0.4)), (Some(36.1), None)], 0.005);
        assert_eq!(changes[0], None);
        assert!((changes[1].unwrap() - 4.0 / 36.0).abs() < 1e-15 && (changes[2].unwrap() - 0.1 / 36.1).abs() < 1e-15);
        assert!((limit.unwrap() - 0.3 / 36.1).abs() < 1e-15);
        assert_eq!(first_below(&changes, limit), Some(2));
        // Without intervals the tolerance counts; a late jump undoes earlier quiet.
        let (changes, limit) = judge(&[(Some(3.65), None), (Some(3.651), None), (Some(3.7), None)], 0.005);
        assert_eq!((first_below(&changes, limit), limit), (None, Some(0.005)));
        assert_eq!(first_below(&[None, None], Some(1.0)), None);
    }
}
