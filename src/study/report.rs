//! `report.html`: the whole study on one page that needs nothing else, on a screen or on paper.
use super::StudyError;
use super::facts;
use super::gallery::gallery;
use super::plan::Plan;
use super::plots::{Drawn, published};
use super::results::{Results, RowResult, Value, reference_floor};
use super::schema::{ErrorSpec, PublishedSpec};
use super::tables::{Machine, State};
use super::text;
use super::text::{escape, number, seconds, signed_percent, with_interval};
use crate::output::file::write_atomic;
use crate::output::page::{self, inline};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

/// Writes the page.
pub(super) fn write(
    plan: &Plan,
    results: &Results,
    machine: &Machine,
    state: State,
    plots: &[Drawn],
    folder: &Path,
) -> Result<(), StudyError> {
    Ok(write_atomic(&folder.join("report.html"), page(plan, results, machine, state, plots, folder).as_bytes())?)
}

fn page(plan: &Plan, results: &Results, machine: &Machine, state: State, plots: &[Drawn], folder: &Path) -> String {
    let study = &plan.file.study;
    let title = if study.title.is_empty() { plan.file.name() } else { study.title.clone() };
    let mut h = page::head(&title, "braid-ecs study");
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
    h += &gallery(plan, results, folder);
    h += "<h2>Plots</h2>\n";
    for plot in plots {
        let _ = writeln!(h, "<figure>{}</figure>", inline(&plot.svg));
    }
    if !results.convergence.is_empty() {
        h += &convergence(results);
    }
    h += &uncertain(results);
    h += &trust(results);
    h += &facts::html(&plan.rows);
    h += &assumptions(plan);
    h += &machine_facts(results, machine);
    let _ = write!(h, "<h2>Study file</h2>\n<pre>{}</pre>\n{}", escape(&plan.file.text), page::END);
    h
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
            row.time(),
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
        h += &judged(plan, results);
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
         a given tolerance for outcomes without an interval; the diagrams show it dashed.</p>\n"
}

fn uncertain(results: &Results) -> String {
    let Some(first) = results.uncertainty.first() else { return String::new() };
    let mut h = String::from("<h2>Uncertainty of the reference</h2>\n<div class=\"wide\"><table>\n<tr><th>outcome</th><th>value</th>");
    for part in &first.parts {
        let _ = write!(h, "<th>{}</th>", escape(&part.name));
    }
    h += "<th>combined</th></tr>\n";
    for u in &results.uncertainty {
        let _ = write!(h, "<tr><td>{} [{}]</td><td>{}</td>", escape(&u.outcome), escape(&u.unit), u.value.map_or("–".into(), number));
        let cell = |half: Option<f64>| {
            let share = |h| u.relative(h).map_or(String::new(), |r| format!("<br><small>{}</small>", percent(r)));
            half.map_or("not known".into(), |h| format!("± {}{}", number(h), share(h)))
        };
        for part in &u.parts {
            let _ = write!(h, "<td>{}</td>", cell(part.half_width));
        }
        let least = if u.complete || u.combined.is_none() { "" } else { "at least " };
        let _ = writeln!(h, "<td>{least}{}</td></tr>", cell(u.combined));
    }
    h + "</table></div>\n<p>Half widths: the largest difference of the rows of a contribution to the base, the 95 % interval of a mean over seeds, \
         the 95 % interval over the places. Combined: the root of the sum of their squares.</p>\n"
}

/// What the reference can judge.
fn judged(plan: &Plan, results: &Results) -> String {
    let Some(floor) = reference_floor(&plan.file.study) else { return String::new() };
    let below: Vec<String> = results.rows.iter().filter(|r| r.cumulated.is_some_and(|c| c <= floor)).map(|r| escape(&r.label())).collect();
    let rows = if below.is_empty() { "none of the rows".to_owned() } else { format!("<b>{}</b>", below.join("; ")) };
    format!(" What is not known of the reference adds up to {}: smaller errors cannot be told from none ({rows}).", percent(floor))
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
        let known = study.reference_uncertainty.get(&o.name);
        let known = known.map_or(String::new(), |u| format!("; not known of the reference: {}", percent(u.0)));
        let _ = writeln!(h, "<li>Error of {}: {error}{known}.</li>", escape(&o.name));
    }
    h += "<li>The cumulated error is the sum of these errors.</li>\n";
    for a in &study.assumptions {
        let _ = writeln!(h, "<li>{}</li>", escape(a));
    }
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
    let either = |numbers: BTreeSet<usize>, none: usize| {
        if numbers.is_empty() { none.to_string() } else { numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(" or ") }
    };
    let jobs = either(records().map(|r| r.jobs).collect(), machine.jobs);
    let threads = either(results.rows.iter().filter_map(|r| r.threads).collect(), machine.threads.unwrap_or(1));
    let mut h = format!(
        "<h2>Machine</h2>\n<p>braid-ecs {}, {}, {} processors, {} runs at a time with {} thread{} each: wall times are of runs that share the machine.",
        escape(&machine.version),
        escape(&machine.target),
        machine.processors,
        jobs,
        threads,
        if threads == "1" { "" } else { "s" }
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
