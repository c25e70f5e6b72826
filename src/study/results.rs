//! What came out of a study: values with 95 % intervals, errors against the reference, and which rows
//! nothing beats in both time and error.
use super::convergence::{Convergence, convergence};
use super::plan::{Plan, Run};
use super::record::{Ended, Record};
use super::schema::{ErrorSpec, Study};
use super::text::seconds;
use super::uncertainty::{Uncertainty, uncertainty};
use crate::measure::Estimate;
use crate::output::summary::{Quality, Summary};
use serde::Serialize;

/// One outcome of one row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Value {
    /// Measure or probe.
    pub outcome: String,
    /// Unit.
    pub unit: String,
    /// Mean over the repetitions; of one run its value. None without a finished run.
    pub value: Option<f64>,
    /// Half width of the 95 % interval of the mean (Student t): over the repetitions where there are
    /// several, else over the places at which the run measures it. None for single values.
    pub ci95: Option<f64>,
    /// Number of values behind mean and interval.
    pub n: usize,
    /// Signed difference to the reference over its size, or over the given size; not in percent.
    pub difference: Option<f64>,
    /// Its magnitude, where the outcome has an error.
    pub error: Option<f64>,
    /// Half width of the 95 % interval of the difference: that of the value, and what is not known of the
    /// reference, taken as independent.
    pub error_ci95: Option<f64>,
    /// True if the value lies in the interval of the reference, or in what is not known of it.
    pub within: Option<bool>,
}

/// One run of a row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunResult {
    /// Its folder in that of the study.
    pub folder: String,
    /// Seed, where the study gives one.
    pub seed: Option<u64>,
    /// Status of the summary (`converged`, `completed`), `failed`, or `missing` if it was not made.
    pub status: String,
    /// How far the result can be trusted.
    pub quality: Option<Quality>,
    /// Relative error of the energy balance.
    pub balance_error: Option<f64>,
    /// Fingerprint of the final state.
    pub state_hash: Option<String>,
    /// What it was made from and how it ended.
    pub record: Option<Record>,
}

/// One row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowResult {
    /// Name of its folder.
    pub name: String,
    /// Its labels, one per axis or one.
    pub labels: Vec<String>,
    /// File name of the scene.
    pub scene: String,
    /// Changes of the scene, without seeds.
    pub sets: Vec<(String, String)>,
    /// Name of the row that errors are relative to.
    pub reference: Option<String>,
    /// True for the reference itself.
    pub is_reference: bool,
    /// Outcomes in the order of the study.
    pub outcomes: Vec<Value>,
    /// Sum of the errors, if all are there; not in percent.
    pub cumulated: Option<f64>,
    /// Wall time of a run, mean over the repetitions (s).
    pub wall_s: Option<f64>,
    /// Processor time of a run, mean over the repetitions (s).
    pub cpu_s: Option<f64>,
    /// Steps of a run, mean over the repetitions.
    pub steps: Option<f64>,
    /// Elements.
    pub elements: Option<usize>,
    /// Threads of a run.
    pub threads: Option<usize>,
    /// True if no other row is at least as good in time and cumulated error, and better in one.
    pub front: bool,
    /// The runs.
    pub runs: Vec<RunResult>,
}

impl RowResult {
    /// The labels as one text.
    pub fn label(&self) -> String {
        self.labels.join(", ")
    }

    /// Wall time in words, with its threads if there was more than one.
    pub fn time(&self) -> String {
        match (self.wall_s.map(seconds), self.threads) {
            (None, _) => "–".into(),
            (Some(time), Some(threads @ 2..)) => format!("{time}, {threads} threads"),
            (Some(time), _) => time,
        }
    }

    /// What its runs were made from, of those that have ended.
    pub fn records(&self) -> impl Iterator<Item = &Record> {
        self.runs.iter().filter_map(|r| r.record.as_ref())
    }

    /// One word, or how many of the runs stand behind the numbers.
    pub fn status(&self) -> String {
        let mut words: Vec<&str> = self.runs.iter().map(|r| r.status.as_str()).collect();
        let bad = words.iter().filter(|w| ["failed", "missing"].contains(w)).count();
        if bad > 0 && bad < words.len() {
            return format!("{} of {} runs", words.len() - bad, words.len());
        }
        words.sort_unstable();
        words.dedup();
        words.join(", ")
    }
}

/// A whole study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Results {
    /// Rows in the order of the study.
    pub rows: Vec<RowResult>,
    /// Convergence along the axis that the study names.
    pub convergence: Vec<Convergence>,
    /// Uncertainty of the row that the study names, by outcome.
    pub uncertainty: Vec<Uncertainty>,
}

/// Compares the runs of a plan; `ended` in its order.
pub fn results(plan: &Plan, ended: &[Option<Ended>]) -> Results {
    let mut rows: Vec<RowResult> = (0..plan.rows.len())
        .map(|i| {
            let of_row = |(run, _): &(&Run, &Option<Ended>)| run.row == i;
            row(plan, i, &plan.runs.iter().zip(ended).filter(of_row).collect::<Vec<_>>())
        })
        .collect();
    for i in 0..rows.len() {
        if let Some(r) = plan.rows[i].reference.filter(|r| *r != i) {
            let reference = rows[r].clone();
            compare(plan, &mut rows[i], &reference);
        }
    }
    let points: Vec<Option<(f64, f64)>> = rows.iter().map(|r| r.wall_s.zip(r.cumulated)).collect();
    for (row, front) in rows.iter_mut().zip(pareto_front(&points)) {
        row.front = front;
    }
    let convergence = convergence(&plan.file.study, &rows[..plan.product]);
    let uncertainty = uncertainty(&plan.file.study, &rows);
    Results { rows, convergence, uncertainty }
}

fn row(plan: &Plan, index: usize, runs: &[(&Run, &Option<Ended>)]) -> RowResult {
    let row = &plan.rows[index];
    let summaries: Vec<&Summary> = runs.iter().filter_map(|(_, e)| e.as_ref()?.summary.as_ref()).collect();
    let mean = |of: &dyn Fn(&Summary) -> Option<f64>| {
        let values: Vec<f64> = summaries.iter().filter_map(|s| of(s)).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let outcomes = plan.file.study.outcomes.iter().map(|o| {
        let values: Vec<Estimate> = summaries.iter().filter_map(|s| estimate(s, &o.name)).collect();
        let unit = plan.units.get(&o.name).cloned().unwrap_or_default();
        let e = over_repetitions(&values, runs.len());
        Value {
            outcome: o.name.clone(),
            unit,
            value: e.map(|e| e.mean),
            ci95: e.and_then(|e| e.ci95),
            n: e.map_or(0, |e| e.n),
            difference: None,
            error: None,
            error_ci95: None,
            within: None,
        }
    });
    RowResult {
        name: row.name.clone(),
        labels: row.labels.clone(),
        scene: row.scene.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned()),
        sets: row.sets.clone(),
        reference: row.reference.map(|r| plan.rows[r].name.clone()),
        is_reference: plan.rows.iter().any(|r| r.reference == Some(index)),
        outcomes: outcomes.collect(),
        cumulated: None,
        wall_s: mean(&|s| Some(s.wall_s)),
        cpu_s: mean(&|s| s.cpu_s),
        steps: mean(&|s| Some(s.steps as f64)),
        elements: summaries.first().map(|s| s.elements),
        threads: summaries.first().map(|s| s.threads),
        front: false,
        runs: runs.iter().map(|(run, e)| run_result(run, e)).collect(),
    }
}

fn run_result(run: &Run, ended: &Option<Ended>) -> RunResult {
    let summary = ended.as_ref().and_then(|e| e.summary.as_ref());
    RunResult {
        folder: run.folder.clone(),
        seed: run.seed,
        status: match (ended, summary) {
            (None, _) => "missing".into(),
            (_, None) => "failed".into(),
            (_, Some(s)) => s.status.clone(),
        },
        quality: summary.map(|s| s.quality),
        balance_error: summary.and_then(|s| s.energy.balance_error),
        state_hash: summary.map(|s| s.state_hash.clone()),
        record: ended.as_ref().map(|e| e.record.clone()),
    }
}

/// The outcome of one run: a measure with its interval, or a probe.
fn estimate(summary: &Summary, name: &str) -> Option<Estimate> {
    match summary.measures.get(name) {
        Some(m) => Some(Estimate { mean: m.mean?, ci95: m.ci95, n: m.n }),
        None => Some(Estimate { mean: summary.probes.get(name).copied().flatten()?, ci95: None, n: 1 }),
    }
}

/// Of several runs the mean of their values with Student's interval; of a run that has no repetitions what
/// it says itself. `planned` is the number of runs that there should be: what is left of several has no interval.
pub fn over_repetitions(runs: &[Estimate], planned: usize) -> Option<Estimate> {
    match runs {
        [] => None,
        [one] if planned > 1 => Some(Estimate { mean: one.mean, ci95: None, n: 1 }),
        [one] => Some(*one),
        several => Some(Estimate::of(&several.iter().map(|e| e.mean).collect::<Vec<_>>())),
    }
}

/// Fills in the differences of a row to its reference.
fn compare(plan: &Plan, row: &mut RowResult, reference: &RowResult) {
    let mut sum = Some(0.0);
    for ((v, r), o) in row.outcomes.iter_mut().zip(&reference.outcomes).zip(&plan.file.study.outcomes) {
        let size = match o.error {
            ErrorSpec::Scaled(size) => Some(size),
            ErrorSpec::Relative | ErrorSpec::None => r.value.map(f64::abs).filter(|s| *s > 0.0),
        };
        let (value, size, at, half) = (v.value, size, r.value, reference_half_width(&plan.file.study, r));
        v.difference = value.zip(at).zip(size).map(|((a, b), s)| (a - b) / s);
        if o.error != ErrorSpec::None {
            v.error = v.difference.map(f64::abs);
            sum = sum.zip(v.error).map(|(s, e)| s + e);
        }
        if v.ci95.is_some() || half.is_some() {
            let width = v.ci95.unwrap_or(0.0).hypot(half.unwrap_or(0.0));
            v.error_ci95 = v.difference.and(size).map(|s| width / s);
        }
        v.within = value.zip(at).zip(half).map(|((a, b), c)| (a - b).abs() <= c);
    }
    let counted = plan.file.study.outcomes.iter().any(|o| o.error != ErrorSpec::None);
    row.cumulated = sum.filter(|_| counted);
}

/// Half width of what is not known of a value of the reference: given by the study, or the interval of its run.
pub fn reference_half_width(study: &Study, v: &Value) -> Option<f64> {
    match study.reference_uncertainty.get(&v.outcome) {
        Some(ratio) => v.value.map(|value| ratio.0 * value.abs()),
        None => v.ci95,
    }
}

/// Error below which a row cannot be told from the reference: the sum of the given relative uncertainties of what is
/// counted; none if one is not given.
pub fn reference_floor(study: &Study) -> Option<f64> {
    let counted = study.outcomes.iter().filter(|o| o.error == ErrorSpec::Relative);
    let sum: Option<f64> = counted.map(|o| study.reference_uncertainty.get(&o.name).map(|r| r.0)).sum();
    sum.filter(|s| *s > 0.0)
}

/// Which points no other one beats: none is at least as small in both numbers and smaller in one.
/// Points that are not there are beaten.
pub fn pareto_front(points: &[Option<(f64, f64)>]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let front = |p: &Option<(f64, f64)>| p.is_some_and(|p| !points.iter().flatten().any(|q| beats(*q, p)));
    points.iter().map(front).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let p = |t, e| Some((t, e));
        let front = pareto_front(&[p(10.0, 0.6), p(20.0, 0.7), p(20.0, 0.3), None, p(60.0, 0.3), p(60.0, 0.05), p(10.0, 0.6), p(5.0, 2.0)]);
        assert_eq!(front, [true, false, true, false, false, true, true, true]);
        assert!(pareto_front(&[]).is_empty());
        assert_eq!(pareto_front(&[p(1.0, 0.0), p(1.0, 0.0)]), [true, true], "equals do not beat each other");
    }

    #[test]
    fn repetitions_replace_the_interval_of_a_run() {
        let run = |mean| Estimate { mean, ci95: Some(0.5), n: 12 };
        assert_eq!(over_repetitions(&[], 1), None);
        assert_eq!(over_repetitions(&[run(36.0)], 1), Some(run(36.0)));
        // Student's quantile for two degrees of freedom is 4.302652730; s of 1, 2, 3 is 1.
        assert_eq!(over_repetitions(&[run(36.0)], 3), Some(Estimate { mean: 36.0, ci95: None, n: 1 }));
        let e = over_repetitions(&[run(1.0), run(2.0), run(3.0)], 3).unwrap();
        assert_eq!((e.mean, e.n), (2.0, 3));
        assert!((e.ci95.unwrap() - 4.302652730 / 3.0f64.sqrt()).abs() < 1e-8);
    }
}
