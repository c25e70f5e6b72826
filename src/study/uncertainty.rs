//! How uncertain the value of a row is: what other rows say about its mesh, its penalties, its rate of loading, its random numbers.
//!
//! Contributions are taken as independent: the combined half width is the root of the sum of their squares (JCGM 100:2008, 5.1.2).
//! A contribution whose rows have not all ended is not known, and the combined one is then a lower bound.
use super::results::RowResult;
use super::schema::{PartBy, Study};
use crate::measure::Estimate;
use serde::Serialize;

/// How uncertain one outcome is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Uncertainty {
    /// The outcome.
    pub outcome: String,
    /// Unit of value and half widths.
    pub unit: String,
    /// Value of the base.
    pub value: Option<f64>,
    /// Contributions, in the order of the study.
    pub parts: Vec<Part>,
    /// Root of the sum of the squares of the half widths that are known.
    pub combined: Option<f64>,
    /// True if all of them are.
    pub complete: bool,
}

impl Uncertainty {
    /// A half width over the value; none without a value, or for zero.
    pub fn relative(&self, half_width: f64) -> Option<f64> {
        self.value.filter(|v| *v != 0.0).map(|v| half_width / v.abs())
    }
}

/// One contribution.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// Name.
    pub name: String,
    /// How it is found.
    pub by: PartBy,
    /// Half width; none while it is not known.
    pub half_width: Option<f64>,
}

/// The uncertainty that a study asks for, of every outcome.
pub fn uncertainty(study: &Study, rows: &[RowResult]) -> Vec<Uncertainty> {
    let Some(spec) = &study.uncertainty else { return Vec::new() };
    let row = |labels: &[String]| rows.iter().find(|r| r.labels == labels);
    let Some(base) = row(&spec.base) else { return Vec::new() };
    let of = |k: usize| {
        let own = &base.outcomes[k];
        let parts: Vec<Part> = spec
            .parts
            .iter()
            .map(|p| {
                let values: Option<Vec<f64>> = p.rows.iter().map(|labels| row(labels)?.outcomes[k].value).collect();
                let half_width = own.value.zip(values).and_then(|(value, values)| half_width(p.by, value, own.ci95, &values));
                Part { name: p.name.clone(), by: p.by, half_width }
            })
            .collect();
        let known = || parts.iter().filter_map(|p| p.half_width);
        Uncertainty {
            outcome: own.outcome.clone(),
            unit: own.unit.clone(),
            value: own.value,
            combined: (own.value.is_some() && known().next().is_some()).then(|| known().map(|h| h * h).sum::<f64>().sqrt()),
            complete: parts.iter().all(|p| p.half_width.is_some()),
            parts,
        }
    };
    (0..study.outcomes.len()).map(of).collect()
}

fn half_width(by: PartBy, base: f64, ci95: Option<f64>, rows: &[f64]) -> Option<f64> {
    match by {
        PartBy::Difference => rows.iter().map(|v| (v - base).abs()).reduce(f64::max),
        PartBy::Scatter => Estimate::of(&std::iter::once(base).chain(rows.iter().copied()).collect::<Vec<_>>()).ci95,
        // A quantity that is measured at one place, like a length, has no scatter over places.
        PartBy::Places => Some(ci95.unwrap_or(0.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contributions_are_differences_scatter_and_intervals() {
        assert_eq!(half_width(PartBy::Difference, 2.0, Some(9.0), &[2.5, 1.0]), Some(1.0));
        assert_eq!(half_width(PartBy::Difference, 2.0, None, &[]), None);
        assert_eq!(half_width(PartBy::Places, 2.0, Some(0.3), &[]), Some(0.3));
        // s of 1, 2, 3 is 1, Student's quantile for two degrees of freedom 4.302652730.
        let scatter = half_width(PartBy::Scatter, 1.0, None, &[2.0, 3.0]).unwrap();
        assert!((scatter - 4.302652730 / 3.0f64.sqrt()).abs() < 1e-8);
    }
}
