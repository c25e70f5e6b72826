//! `report.html`: the whole study on one page that needs nothing else, on a screen or on paper.
use super::StudyError;
use super::plan::Plan;
use super::plots::{Drawn, published};
use super::results::{Results, RowResult, Value};
use super::schema::{ErrorSpec, PublishedSpec};
use super::tables::{Machine, State};
use super::text;
use super::text::{escape, number, seconds, signed_percent, with_interval};
use crate::output::file::write_atomic;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

const STYLE: &str = "
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 2rem auto; max-width: 66rem; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2rem; border-bottom: 1px solid #ccc; }
p.about { color: #666; margin-top: 0.2rem; }
div.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.87rem; }
th, td { padding: 0.25rem 0.6rem; text-align: right; border-bottom: 1px solid #ddd; white-space: nowrap; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td.text { white-space: normal; }
tr.reference td { background: #e8f5ef; } tr.others td { color: #777; font-style: italic; border-bottom-style: dotted; }
small { color: #666; } td.front { color: #b34700; font-weight: 600; } td.failed { color: #b00020; }
figure { margin: 0.8rem 0; break-inside: avoid; } svg { max-width: 100%; height: auto; }
pre { background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 0.8rem; white-space: pre-wrap; }
@page { margin: 14mm; }
@media print { html { font-size: 11px; } body { margin: 0; padding: 0; max-width: none; font-size: 11px; } div.wide { overflow: visible; } th, td { white-space: normal; padding: 0.15rem 0.3rem; } tr { break-inside: avoid; } h2 { break-after: avoid; } }
";

/// Writes the page.
pub(super) fn write(
    plan: &Plan,
    results: &Results,
    machine: &Machine,
    state: State,
    plots: &[Drawn],
    folder: &Path,
) -> Result<(), StudyError> {
    Ok(write_atomic(&folder.join("report.html"), page(plan, results, machine, state, plots).as_bytes())?)
}

fn page(plan: &Plan, results: &Results, machine: &Machine, state: State, plots: &[Drawn]) -> String {
    let study = &plan.file.study;
    let title = if study.title.is_empty() { plan.file.name() } else { study.title.clone() };
    let mut h = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{t}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>{t}</h1>\n",
        t = escape(&title)
    );
    let runs: usize = results.rows.iter().map(|r| r.runs.len()).sum();
    let word = match state {
        State::Ended => "",
        State::Running => ", under way",
        State::Interrupted => ", stopped before its end",
    };
    let _ = writeln!(h, "<p class=\"about\">{} rows, {runs} runs{word}. braid-ecs {}.</p>", results.rows.len(), escape(&machine.version));
    h += "<h2>Results</h2>\n";
    h += &table(plan, results);
    h += &failures(results);
    h += "<h2>Plots</h2>\n";
    for plot in plots {
        let _ = writeln!(h, "<figure>{}</figure>", inline(&plot.svg));
    }
    if !results.convergence.is_empty() {
        h += &convergence(results);
    }
    h += &trust(results);
    h += &assumptions(plan);
    h += &machine_facts(results, machine);
    let _ = writeln!(h, "<h2>Study file</h2>\n<pre>{}</pre>\n</body>\n</html>", escape(&plan.file.text));
    h
}

/// Inside a page SVG needs no name space, and with it no address.
fn inline(svg: &str) -> String {
    svg.replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1)
}

fn percent(fraction: f64) -> String {
    escape(&text::percent(fraction))
}

fn table(plan: &Plan, results: &Results) -> String {
    let study = &plan.file.study;
    let compared = results.rows.iter().any(|r| r.reference.is_some());
    let mut h = String::from("<div class=\"wide\"><table>\n<tr><th>row</th>");
    for o in &study.outcomes {
        let _ = write!(h, "<th>{} [{}]</th>", escape(&o.name), escape(&plan.units[&o.name]));
    }
    if compared {
        h += "<th>cumulated error</th>";
    }
    h += "<th>wall time</th><th>steps</th><th>elements</th><th class=\"text\">status</th></tr>\n";
    for row in &results.rows {
        let class = if row.is_reference { " class=\"reference\"" } else { "" };
        let _ = write!(h, "<tr{class}><td>{}</td>", escape(&row.label()));
        for v in &row.outcomes {
            let _ = write!(h, "<td>{}{}</td>", with_interval(v.value, v.ci95), difference(v));
        }
        if compared {
            let class = if row.front { " class=\"front\"" } else { "" };
            let _ = write!(h, "<td{class}>{}</td>", row.cumulated.map_or("–".into(), percent));
        }
        let class = if row.status().contains("failed") { "text failed" } else { "text" };
        let _ = writeln!(
            h,
            "<td>{}</td><td>{}</td><td>{}</td><td class=\"{class}\">{}</td></tr>",
            row.wall_s.map_or("–".into(), seconds),
            row.steps.map_or("–".into(), |s| format!("{s:.0}")),
            row.elements.map_or("–".into(), |e| e.to_string()),
            row.status()
        );
        for (_, p) in published(plan, row) {
            h += &others(plan, p, compared);
        }
    }
    h += "</table></div>\n<p>Values are means ± half the width of their 95 % interval (Student's t)";
    h += if study.replicates.is_some() { ", over the repetitions." } else { ", over the places at which a run measures them." };
    if compared {
        h += " Below them differences, relative to the reference (green rows); values in its interval are marked with •. \
              Nothing is better in both time and error than the rows with an orange error.";
    }
    let notes: Vec<String> = study.published.iter().filter(|p| !p.note.is_empty()).map(|p| escape(&p.note)).collect();
    let notes = if notes.is_empty() { String::new() } else { format!(" Numbers of others: {}.", notes.join("; ")) };
    h + &notes + "</p>\n"
}

fn difference(v: &Value) -> String {
    let mark = if v.within == Some(true) { " •" } else { "" };
    v.difference.map_or(String::new(), |d| format!("<br><small>{}{mark}</small>", escape(&signed_percent(d))))
}

/// A line with the numbers of others for a row.
fn others(plan: &Plan, p: &PublishedSpec, compared: bool) -> String {
    let mut h = format!("<tr class=\"others\"><td>{}</td>", escape(&p.source));
    for o in &plan.file.study.outcomes {
        let value = p.values.get(&o.name).map(|v| with_interval(Some(v.value), v.ci95));
        // Of an error the sign is not known.
        let error = p.errors.get(&o.name).map(|e| format!("<small>±{}</small>", percent(e.0)));
        let _ = write!(h, "<td>{}</td>", value.into_iter().chain(error).collect::<Vec<_>>().join("<br>"));
    }
    if compared {
        let _ = write!(h, "<td>{}</td>", p.cumulated.map_or(String::new(), |c| percent(c.0)));
    }
    let _ = writeln!(h, "<td>{}</td><td></td><td></td><td></td></tr>", p.wall.map_or(String::new(), |w| seconds(w.0)));
    h
}

fn failures(results: &Results) -> String {
    let mut h = String::new();
    for row in &results.rows {
        for run in row.runs.iter().filter(|r| r.status == "failed") {
            let seed = run.seed.map_or(String::new(), |s| format!(", seed {s}"));
            let message = run.record.as_ref().map_or("", |r| r.message.as_str());
            let _ = writeln!(h, "<p>Row <b>{}</b>{seed} failed:</p><pre>{}</pre>", escape(&row.label()), escape(message));
        }
    }
    h
}

fn convergence(results: &Results) -> String {
    let mut h = String::from("<h2>Convergence</h2>\n<div class=\"wide\"><table>\n<tr><th>rows</th><th class=\"text\">outcome</th>");
    h += "<th class=\"text\">change from the point before</th><th>counts as none below</th><th class=\"text\">converged at</th></tr>\n";
    for c in &results.convergence {
        let change = |(p, v): (&String, &Option<f64>)| v.map(|v| format!("{}: {}", escape(p), percent(v)));
        let changes: Vec<String> = c.points.iter().zip(&c.changes).filter_map(change).collect();
        let _ = writeln!(
            h,
            "<tr><td>{}</td><td class=\"text\">{}</td><td class=\"text\">{}</td><td>{}</td><td class=\"text\">{}</td></tr>",
            escape(&c.labels.join(", ")),
            escape(&c.outcome),
            changes.join(", "),
            c.limit.map_or("–".into(), percent),
            c.converged_at.as_deref().map_or("not".into(), escape)
        );
    }
    h + "</table></div>\n<p>The limit is 2 s / √n over the value at the last point, with the standard deviation s averaged over the points; \
         a given tolerance for outcomes without an interval.</p>\n"
}

fn trust(results: &Results) -> String {
    let mut h = String::from(
        "<h2>How far the runs can be trusted</h2>\n<div class=\"wide\"><table>\n<tr><th>run</th><th class=\"text\">status</th>",
    );
    h += "<th>energy balance error</th><th>force residual</th><th>kinetic energy / work</th><th>largest penetration / radius</th></tr>\n";
    for run in results.rows.iter().flat_map(|r| &r.runs) {
        let q = run.quality.unwrap_or_default();
        let cell = |v: Option<f64>| format!("<td>{}</td>", v.map_or("–".into(), percent));
        let name = run.folder.trim_start_matches("rows/");
        let _ = writeln!(
            h,
            "<tr><td>{}</td><td class=\"text\">{}</td>{}{}{}{}</tr>",
            escape(name),
            escape(&run.status),
            cell(run.balance_error),
            cell(q.force_residual),
            cell(q.kinetic_to_work),
            cell(q.max_penetration_to_radius)
        );
    }
    h + "</table></div>\n"
}

fn assumptions(plan: &Plan) -> String {
    let study = &plan.file.study;
    let sets = |sets: &[(String, String)]| {
        let all: Vec<String> = sets.iter().map(|(p, v)| format!("<code>{} = {}</code>", escape(p), escape(v))).collect();
        if all.is_empty() { "as in the scene".to_owned() } else { all.join(", ") }
    };
    let mut h = String::from("<h2>Assumptions</h2>\n<ul>\n");
    if let Some(scene) = &study.scene {
        let _ = writeln!(h, "<li>Scene of all rows that name no other: <code>{}</code>.</li>", escape(scene));
    }
    if !study.set.0.is_empty() {
        let _ = writeln!(h, "<li>Changed in every row: {}.</li>", sets(&study.set.0));
    }
    if let Some(reference) = &study.reference {
        let _ = writeln!(
            h,
            "<li>Reference: {}{}.</li>",
            escape(&reference.join(", ")),
            if reference.contains(&"*".into()) { ", * for the label of the row itself" } else { "" }
        );
    }
    for o in &study.outcomes {
        let error = match o.error {
            ErrorSpec::Relative => "|a − a_ref| / |a_ref|".to_owned(),
            ErrorSpec::Scaled(s) => format!("|a − a_ref| / {} {}", number(s), escape(&plan.units[&o.name])),
            ErrorSpec::None => "not counted".to_owned(),
        };
        let _ = writeln!(h, "<li>Error of {}: {error}.</li>", escape(&o.name));
    }
    h += "<li>The cumulated error is the sum of these errors.</li>\n";
    if let Some(r) = &study.replicates {
        let seeds: Vec<String> = r.seeds.iter().map(u64::to_string).collect();
        let _ = writeln!(h, "<li>Every row was run with the seeds {}.</li>", seeds.join(", "));
    }
    h += "</ul>\n<div class=\"wide\"><table>\n<tr><th>row</th><th class=\"text\">scene</th><th class=\"text\">changes</th></tr>\n";
    for (row, plan) in plan.rows.iter().map(|r| (r.label(), r)) {
        let scene = plan.scene.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned());
        let _ = writeln!(
            h,
            "<tr><td>{}</td><td class=\"text\">{} <small>({})</small></td><td class=\"text\">{}</td></tr>",
            escape(&row),
            escape(&scene),
            &plan.scene_hash[..8],
            sets(&plan.sets)
        );
    }
    h + "</table></div>\n<p>The word in brackets is the start of the BLAKE3 fingerprint of the scene file.</p>\n"
}

fn machine_facts(results: &Results, machine: &Machine) -> String {
    let records = || results.rows.iter().flat_map(RowResult::records);
    let builds: BTreeSet<&str> = records().map(|r| r.build.as_str()).collect();
    let jobs: BTreeSet<usize> = records().map(|r| r.jobs).collect();
    let jobs = jobs.iter().map(usize::to_string).collect::<Vec<_>>().join(" or ");
    let mut h = format!(
        "<h2>Machine</h2>\n<p>braid-ecs {}, {}, {} processors, {} runs at a time with {} thread{} each: wall times are of runs that share the machine.",
        escape(&machine.version),
        escape(&machine.target),
        machine.processors,
        if jobs.is_empty() { machine.jobs.to_string() } else { jobs },
        machine.threads,
        if machine.threads == 1 { "" } else { "s" }
    );
    match builds.len() {
        0 => {}
        1 => {
            let _ = write!(h, " Fingerprint of the program: {}.", builds.iter().map(|b| escape(b)).collect::<String>());
        }
        n => {
            let _ = write!(h, " <b>The runs were made by {n} builds of this version.</b>");
        }
    }
    h + "</p>\n"
}

#[cfg(test)]
mod tests {
    use super::inline;
    use crate::study::chart::{Mark, RowChart};

    #[test]
    fn pictures_inside_the_page_have_no_address() {
        let x = crate::output::plot::Axis::linear("x");
        let chart = RowChart { title: "a".into(), x, rows: vec![Mark::default()], bars: false, sources: Vec::new() };
        let svg = chart.svg(300);
        assert!(svg.contains("http"), "a file of its own needs the name space");
        assert!(!inline(&svg).contains("http"));
    }
}
