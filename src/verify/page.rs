//! `verification.html`: the table and a plot per scene on one page that needs nothing else.
use super::order::NEGLIGIBLE;
use super::table::{AUTHOR, Outcome, Row};
use crate::output::page::{END, head, inline};
use crate::output::plot::{Axis, Plot, Series, line_plot};
use crate::study::chart::{Mark, RowChart};
use crate::study::text::{escape, seconds};
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Width of the diagrams in pixels.
const WIDTH: u32 = 820;

/// Quantities in a diagram over the mesh: as many as there are colours to tell apart, less one for the slope.
const CURVES: usize = 6;

/// The whole page.
pub(super) fn page(outcome: &Outcome) -> String {
    let mut h = head("Verification", AUTHOR);
    let rows = &outcome.rows;
    let scenes: BTreeSet<&str> = rows.iter().map(|r| r.scene.as_str()).collect();
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let promised = rows.iter().filter(|r| r.mesh >= 1.0).count();
    let missed = rows.iter().filter(|r| r.missed()).count();
    let _ = writeln!(
        h,
        "<p class=\"about\">{} with known answers; {} of {promised} quantities as expected. braid-ecs {}, {}.</p>",
        count(scenes.len(), "scene"),
        promised - missed,
        escape(outcome.version),
        escape(&outcome.target)
    );
    for b in &outcome.broken {
        let _ = writeln!(h, "<p><b>{}</b> could not be run:</p><pre>{}</pre>", escape(&b.scene), escape(&b.message));
    }
    h += "<h2>Quantities</h2>\n";
    h += &table(rows);
    h += "<h2>Plots</h2>\n<p>Dots: what came out over its reference, on the finest mesh; on the line both are the same. \
          Bars: the size of the error over what is allowed; the green line is 1, and errors of nothing have no bar. \
          Curves, where a scene was run on several meshes: the error over the number of elements, and over its cost, the steps of all elements.</p>\n";
    for scene in scenes {
        let own: Vec<&Row> = rows.iter().filter(|r| r.scene == scene).collect();
        let _ = writeln!(h, "<figure id=\"{}\">{}</figure>", escape(scene), inline(&bars(&own)));
        let costs = [Cost { label: "elements [-]", of: |r| r.elements as f64, order: Some(2.0) }, ELEMENT_STEPS];
        let plots = solution(&own).into_iter().chain(costs.iter().filter_map(|cost| curves(&own, cost)));
        for svg in plots {
            let _ = writeln!(h, "<figure>{}</figure>", inline(&svg));
        }
    }
    h + END
}

fn table(rows: &[Row]) -> String {
    let meshes = rows.iter().any(|r| r.mesh != 1.0);
    let mut h = String::from("<div class=\"wide\"><table>\n<tr><th>scene</th><th class=\"text\">quantity</th>");
    if meshes {
        h += "<th>mesh</th>";
    }
    h += "<th>elements</th><th>reference</th><th>computed</th><th>error</th><th>allowed</th><th>order</th><th>steps</th><th>time</th></tr>\n";
    for r in rows {
        let class = if r.missed() { " class=\"failed\"" } else { "" };
        let _ = write!(h, "<tr><td><a href=\"#{s}\">{s}</a></td><td class=\"text\">{}</td>", escape(&r.quantity), s = escape(&r.scene));
        if meshes {
            let _ = write!(h, "<td>{}</td>", r.mesh);
        }
        let _ = writeln!(
            h,
            "<td>{}</td><td>{:.6e}</td><td>{}</td><td{class}>{}</td><td>{:.1e}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            r.elements,
            r.reference,
            r.computed.map_or("–".into(), |v| format!("{v:.6e}")),
            r.error.map_or("–".into(), |e| format!("{e:+.1e}")),
            r.allowed,
            r.order.map_or("–".into(), |o| format!("{o:.2}")),
            r.steps,
            seconds(r.seconds)
        );
    }
    h + "</table></div>\n<p>Errors are relative, or as they are where the reference is zero. The order is that of the error from the next coarser mesh to this one; \
         it is not given where the error does not fall, or is less than 1e-7 of the reference.</p>\n"
}

fn finest<'a>(rows: &[&'a Row]) -> Vec<&'a Row> {
    let finest = rows.iter().map(|r| r.mesh).fold(0.0, f64::max);
    rows.iter().copied().filter(|r| r.mesh == finest).collect()
}

fn title(rows: &[&Row]) -> String {
    rows.first().map_or(String::new(), |r| format!("{}: {}", r.scene, r.title))
}

/// Error over what is allowed, quantity by quantity.
fn bars(rows: &[&Row]) -> String {
    let mark = |r: &&Row| Mark {
        label: r.quantity.clone(),
        value: r.error.filter(|_| r.allowed > 0.0).map(|e| e.abs() / r.allowed),
        band: Some((1.0, 1.0)),
        ..Mark::default()
    };
    let rows_of = finest(rows).iter().map(mark).collect();
    let x = Axis::log("error / allowed [-]");
    RowChart { title: title(rows), x, rows: rows_of, bars: true, sources: Vec::new() }.svg(WIDTH)
}

/// What came out over its reference, on the finest mesh; none where nothing came out.
fn solution(rows: &[&Row]) -> Option<String> {
    let mut points: Vec<(f64, f64)> = finest(rows).iter().filter_map(|r| r.computed.map(|c| (r.reference, c))).collect();
    let (least, most) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.0), b.max(p.0)));
    if points.is_empty() {
        return None;
    }
    // One value has no range of its own.
    let margin = if most > least { 0.05 * (most - least) } else { 0.5 * most.abs().max(1e-9) };
    let ends = [least - margin, most + margin];
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let series = vec![Series::line("the same", ends.map(|e| (e, e)).to_vec()), Series::dots("computed", points)];
    let plot = Plot { title: title(rows), x: Axis::linear("reference"), y: Axis::linear("computed"), series };
    Some(line_plot(&plot, (WIDTH, 300)))
}

/// What a diagram of errors is drawn over.
struct Cost {
    label: &'static str,
    of: fn(&Row) -> f64,
    /// Order of the line that is drawn for comparison.
    order: Option<f64>,
}

/// Work of a run, whatever the machine.
const ELEMENT_STEPS: Cost = Cost { label: "elements x steps [-]", of: |r| r.elements as f64 * r.steps as f64, order: None };

/// Error over the cost; none of a scene that was run on one mesh.
fn curves(rows: &[&Row], cost: &Cost) -> Option<String> {
    let size = |r: &Row| r.error.map_or(0.0, f64::abs);
    let mut last = finest(rows);
    // What is exact but for rounding says nothing about the mesh, and would stretch the axis over ten decades.
    last.retain(|r| size(r) > NEGLIGIBLE * if r.reference == 0.0 { r.allowed } else { 1.0 });
    last.sort_by(|a, b| size(b).total_cmp(&size(a)));
    let points = |q: &str| rows.iter().filter(|r| r.quantity == q).map(|r| ((cost.of)(r), size(r))).collect::<Vec<_>>();
    let of = last.len();
    last.truncate(CURVES);
    // In the legend in the order of the scene.
    last.sort_by(|a, b| a.quantity.cmp(&b.quantity));
    let mut series: Vec<Series> = last.iter().map(|r| Series::dots(r.quantity.clone(), points(&r.quantity))).collect();
    series.retain(|s| s.points.len() > 1);
    let all: Vec<(f64, f64)> = series.iter().flat_map(|s| &s.points).copied().filter(|p| p.1 > 0.0).collect();
    let (few, many) = all.iter().fold((f64::INFINITY, 0.0), |(a, b): (f64, f64), p| (a.min(p.0), b.max(p.0)));
    if few >= many {
        return None;
    }
    if let Some(order) = cost.order {
        // A line just below all points: above them is the legend.
        let c = all.iter().map(|p| p.1 * p.0.powf(order)).fold(f64::INFINITY, f64::min) / 1.5;
        series.push(Series::line(format!("order {order}"), [few, many].map(|n| (n, c / n.powf(order))).to_vec()));
    }
    let of = if of > CURVES { format!(" ({CURVES} largest of {of})") } else { String::new() };
    let plot = Plot { title: format!("{}{of}", title(rows)), x: Axis::log(cost.label), y: Axis::log("error [-]"), series };
    Some(line_plot(&plot, (WIDTH, 400)))
}

#[cfg(test)]
mod tests {
    use super::super::table::{Broken, tests::two_meshes};
    use super::*;

    #[test]
    fn a_page_has_the_table_and_the_plots_and_no_address() {
        let broken = vec![Broken { scene: "b.ron".into(), mesh: 1.0, message: "a < b".into() }];
        let page = page(&Outcome::new(two_meshes(), broken));
        for part in
            [AUTHOR, "u &lt;x&gt;", "+2.0e-1", "2.00</td>", "a &lt; b", "order 2", "error / allowed", "A: A beam", "0 of 3 quantities"]
        {
            assert!(page.contains(part), "{part} is missing in\n{page}");
        }
        assert!(!page.contains("http") && !page.contains("NaN") && page.ends_with(END));
        assert!(page.contains("elements x steps") && page.contains("the same"));
        assert_eq!(page.matches("<svg").count(), 4);
        let one: Vec<Row> = two_meshes().into_iter().filter(|r| r.mesh == 1.0).collect();
        let page = super::page(&Outcome::new(one, Vec::new()));
        assert_eq!(page.matches("<svg").count(), 2, "one mesh makes no curve");
        assert!(!page.contains("<th>mesh</th>"));
        assert!(super::page(&Outcome::new(Vec::new(), Vec::new())).contains("0 scenes"));
    }
}
