//! The diagrams of a study.
use super::StudyError;
use super::chart::{Mark, RowChart};
use super::convergence::along_axis;
use super::plan::Plan;
use super::results::{Results, RowResult, Value, reference_floor, reference_half_width};
use super::scatter::{Point, Scatter};
use super::schema::{ErrorSpec, PublishedSpec};
use crate::output::OutputError;
use crate::output::file::write_atomic;
use crate::output::plot::{Axis, Plot, Series, line_plot, panels};
use std::path::Path;

/// Width of the diagrams in pixels.
const WIDTH: u32 = 820;

/// A diagram with the name of its file, without ending.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    pub name: String,
    pub svg: String,
}

/// Draws everything and writes it to the folder `plots`.
pub(super) fn write(plan: &Plan, results: &Results, folder: &Path) -> Result<Vec<Drawn>, StudyError> {
    let all = draw(plan, results);
    let folder = folder.join("plots");
    std::fs::create_dir_all(&folder).map_err(|e| OutputError::io("create the folder", &folder, e))?;
    for plot in &all {
        write_atomic(&folder.join(format!("{}.svg", plot.name)), plot.svg.as_bytes())?;
    }
    Ok(all)
}

/// The numbers of others for a row, with the index of their source.
pub(super) fn published<'a>(plan: &'a Plan, row: &RowResult) -> Vec<(usize, &'a PublishedSpec)> {
    let sources = sources(plan);
    let of = plan.file.study.published.iter().filter(|p| p.row == row.labels);
    of.map(|p| (sources.iter().position(|s| *s == p.source).unwrap_or(0), p)).collect()
}

/// The sources of numbers of others, in the order of the study.
pub(super) fn sources(plan: &Plan) -> Vec<String> {
    let mut sources: Vec<String> = Vec::new();
    for p in &plan.file.study.published {
        if !sources.contains(&p.source) {
            sources.push(p.source.clone());
        }
    }
    sources
}

type Other = (f64, Option<f64>);

struct Charts<'a> {
    plan: &'a Plan,
    results: &'a Results,
    sources: Vec<String>,
}

impl Charts<'_> {
    /// A chart of one number per row.
    fn chart(
        &self,
        title: &str,
        x: Axis,
        bars: bool,
        mark: impl Fn(&RowResult) -> Mark,
        other: impl Fn(&PublishedSpec) -> Option<Other>,
    ) -> String {
        let row = |r: &RowResult| {
            let others = published(self.plan, r).into_iter().filter_map(|(s, p)| other(p).map(|(v, c)| (s, v, c)));
            Mark { label: r.label(), is_reference: r.is_reference, others: others.collect(), ..mark(r) }
        };
        let rows: Vec<Mark> = self.results.rows.iter().map(row).collect();
        let sources = if rows.iter().all(|r| r.others.is_empty()) { Vec::new() } else { self.sources.clone() };
        RowChart { title: title.into(), x, rows, bars, sources }.svg(WIDTH)
    }

    /// Value and interval of the reference of a row.
    fn band(&self, row: &RowResult, k: usize) -> Option<(f64, f64)> {
        let name = if row.is_reference { &row.name } else { row.reference.as_ref()? };
        let v: &Value = &self.results.rows.iter().find(|r| r.name == *name)?.outcomes[k];
        let half = reference_half_width(&self.plan.file.study, v).unwrap_or(0.0);
        v.value.map(|v| (v - half, v + half))
    }
}

fn draw(plan: &Plan, results: &Results) -> Vec<Drawn> {
    let c = Charts { plan, results, sources: sources(plan) };
    let mut all = Vec::new();
    let mut add = |name: String, svg: String| all.push(Drawn { name, svg });
    let compared = results.rows.iter().any(|r| r.reference.is_some());
    for (k, o) in plan.file.study.outcomes.iter().enumerate() {
        let unit = &plan.units[&o.name];
        let value =
            |r: &RowResult| Mark { value: r.outcomes[k].value, half_width: r.outcomes[k].ci95, band: c.band(r, k), ..Mark::default() };
        let other = |p: &PublishedSpec| p.values.get(&o.name).map(|v| (v.value, v.ci95));
        let file = file_name(&o.name);
        add(format!("value_{file}"), c.chart(&o.name, Axis::linear(format!("{} [{unit}]", o.name)), false, value, other));
        if compared && o.error != ErrorSpec::None {
            let mark = |r: &RowResult| Mark {
                value: r.outcomes[k].error.map(|e| 100.0 * e),
                half_width: r.outcomes[k].error_ci95.filter(|_| r.outcomes[k].error.is_some()).map(|e| 100.0 * e),
                band: plan.file.study.reference_uncertainty.get(&o.name).map(|u| (0.0, 100.0 * u.0)),
                ..Mark::default()
            };
            let other = |p: &PublishedSpec| p.errors.get(&o.name).map(|e| (100.0 * e.0, None));
            let title = format!("Error of {}", o.name);
            add(format!("error_{file}"), c.chart(&title, Axis::linear("error [%]"), true, mark, other));
        }
    }
    if compared {
        let band = reference_floor(&plan.file.study).map(|f| (0.0, 100.0 * f));
        let mark = |r: &RowResult| Mark { value: r.cumulated.map(|e| 100.0 * e), band, ..Mark::default() };
        let other = |p: &PublishedSpec| p.cumulated.map(|e| (100.0 * e.0, None));
        add("cumulated_error".into(), c.chart("Cumulated error", Axis::linear("sum of the errors [%]"), true, mark, other));
    }
    let mark = |r: &RowResult| Mark { value: r.wall_s, ..Mark::default() };
    let other = |p: &PublishedSpec| p.wall.map(|w| (w.0, None));
    add("wall_time".into(), c.chart("Calculation time", Axis::log("wall time [s]"), true, mark, other));
    if compared {
        add("error_over_time".into(), error_over_time(plan, results));
        if let Some((axis, svg)) = error_over_axis(plan, results) {
            add(format!("error_over_{}", file_name(&axis)), svg);
        }
    }
    if !results.convergence.is_empty() {
        add("convergence".into(), convergence(plan, results));
    }
    all
}

fn error_over_time(plan: &Plan, results: &Results) -> String {
    let point = |r: &RowResult| Some(Point { label: r.label(), at: (r.wall_s?, 100.0 * r.cumulated?), front: r.front });
    let lines = results.rows.iter().filter(|r| r.is_reference && r.cumulated.is_none()).filter_map(|r| Some((r.label(), r.wall_s?)));
    let scatter = Scatter {
        title: "Error against time".into(),
        x: Axis::log("wall time [s]"),
        y: Axis::log("cumulated error [%]"),
        points: results.rows.iter().filter_map(point).collect(),
        lines: lines.collect(),
        floor: reference_floor(&plan.file.study).map(|f| 100.0 * f),
    };
    scatter.svg((WIDTH, 480))
}

/// Cumulated error along the axis of convergence, with the name of the axis; none unless its labels are numbers.
fn error_over_axis(plan: &Plan, results: &Results) -> Option<(String, String)> {
    let study = &plan.file.study;
    let (axis, groups) = along_axis(study, &results.rows[..plan.product])?;
    let mut series: Vec<Series> = Vec::new();
    for (labels, rows) in groups {
        let mut points = Vec::new();
        for row in rows {
            let at = row.labels[axis].trim().parse::<f64>().ok().filter(|v| *v > 0.0)?;
            points.extend(row.cumulated.map(|error| (at, 100.0 * error)));
        }
        if !points.is_empty() {
            series.push(Series::dots(labels.join(", "), points));
        }
    }
    let ends = series.iter().flat_map(|s| &s.points).fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p.0), b.max(p.0)));
    if ends.0 >= ends.1 {
        return None;
    }
    if let Some(floor) = reference_floor(study) {
        series.push(Series::line("not known of the reference", vec![(ends.0, 100.0 * floor), (ends.1, 100.0 * floor)]));
    }
    let name = study.axes[axis].name.clone();
    let plot = Plot { title: format!("Error against {name}"), x: Axis::log(name.clone()), y: Axis::log("cumulated error [%]"), series };
    Some((name, line_plot(&plot, (WIDTH, 420))))
}

/// Changes along the axis, a diagram per outcome, with the limit of each (dashed).
fn convergence(plan: &Plan, results: &Results) -> String {
    let study = &plan.file.study;
    let plot = |name: &String| {
        let of_outcome = || results.convergence.iter().filter(|c| c.outcome == *name);
        let changes = of_outcome().map(|c| {
            let points = c.changes.iter().enumerate().filter_map(|(i, v)| Some((place(&c.points[i], i), 100.0 * (*v)?)));
            Series::dots(c.labels.join(", "), points.collect())
        });
        let mut series: Vec<Series> = changes.collect();
        for (k, c) in of_outcome().enumerate() {
            series.extend(c.limit.map(|limit| Series::limit_of(k, series[k].points.iter().map(|p| (p.0, 100.0 * limit)).collect())));
        }
        Plot {
            title: format!("Change of {name} from the point before"),
            x: Axis::linear(study.convergence.clone().unwrap_or_default()),
            y: Axis::log("change [%]"),
            series,
        }
    };
    let plots: Vec<Plot> = study.outcomes.iter().map(|o| plot(&o.name)).collect();
    panels(&plots, (WIDTH, 300 * plots.len() as u32))
}

/// A label that is a number is its own place, any other its number in the order of the axis.
fn place(label: &str, index: usize) -> f64 {
    label.trim().parse::<f64>().ok().filter(|v| v.is_finite()).unwrap_or(index as f64)
}

/// A name that all file systems like.
fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect()
}
