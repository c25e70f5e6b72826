//! The table at the end of a run.
use super::message::out;
use super::progress::duration_text;
use crate::output::Outcome;
use std::fmt::Write as _;

/// Prints the outcome of a run.
pub(super) fn print(outcome: &Outcome) {
    out(&table(outcome));
}

fn value(v: Option<f64>) -> String {
    match v {
        Some(v) if v == 0.0 || (1e-3..1e5).contains(&v.abs()) => {
            let digits = (4 - v.abs().max(1e-9).log10().floor() as i32).clamp(0, 7) as usize;
            format!("{:.*}", if v == 0.0 { 0 } else { digits }, v)
        }
        Some(v) => format!("{v:.4e}"),
        None => "-".into(),
    }
}

/// Penetration over the radius that is warned of: 2 % of the diameter.
const DEEP: f64 = 0.04;

/// The outcome as text.
fn table(o: &Outcome) -> String {
    let s = &o.summary;
    let mut t = String::new();
    let time = o.units.time();
    let mut row = |name: &str, text: String| {
        let _ = writeln!(t, "  {name:<12} {text}");
    };
    row("status", format!("{} at t = {} {time} after {} steps", s.status, value(s.time), s.steps));
    row("time step", format!("{} {time}, limit {} by {}", value(s.dt), value(s.dt_limit.value), s.dt_limit.by));
    let speed = s.element_steps_per_s.map_or(String::new(), |v| format!(", {:.1} million element-steps/s", v / 1e6));
    row("run", format!("{} with {} thread{}{speed}", duration_text(s.wall_s), s.threads, if s.threads == 1 { "" } else { "s" }));
    for (name, m) in &s.measures {
        let interval = m.ci95.map_or(String::new(), |c| format!(" +- {} (95 %, n = {})", value(Some(c)), m.n));
        row(name, format!("{} {}{interval}", value(m.mean), m.unit));
    }
    let e = &s.energy;
    let unit = o.units.energy();
    let terms = [("work", e.external_work), ("kinetic", e.kinetic), ("strain", e.strain), ("contact", e.contact)];
    let losses = [("friction", e.friction), ("damping", e.damping)];
    let list = |terms: &[(&str, Option<f64>)]| terms.iter().map(|(n, v)| format!("{n} {}", value(*v))).collect::<Vec<_>>().join(", ");
    row("energy", format!("{} {unit}", list(&terms)));
    row("", format!("{} {unit}, balance error {}", list(&losses), percent(e.balance_error)));
    let q = &s.quality;
    let figures = [
        ("force residual", q.force_residual.map(|v| percent(Some(v)))),
        ("dummy balance", q.dummy_balance.map(|v| percent(Some(v)))),
        ("penetration", q.max_penetration_to_radius.filter(|_| s.contacts > 0).map(|v| format!("{} of the radius", percent(Some(v))))),
    ];
    let figures: Vec<String> = figures.into_iter().filter_map(|(n, v)| v.map(|v| format!("{n} {v}"))).collect();
    if !figures.is_empty() {
        row("quality", figures.join(", "));
    }
    if let Some(depth) = q.max_penetration_to_radius.filter(|d| *d > DEEP) {
        let half = percent(Some(0.5 * depth));
        row(
            "warning",
            format!(
                "contacts are pressed in by up to {half} of a diameter; above 2 %, give `contact` or the surface more `stiffness`, or a target `penetration`"
            ),
        );
    }
    if let Some(raised) = q.stiffness_raised {
        let half = percent(q.p99_penetration_to_radius.map(|d| 0.5 * d));
        row(
            "contacts",
            format!("made {} times stiffer for the target penetration; 99 % are now below {half} of the diameter", value(Some(raised))),
        );
    }
    for (name, v, unit) in o.probes.table() {
        row(name, format!("{} {unit}", value(v)));
    }
    for c in &o.expected {
        let verdict = if c.holds() { "as expected" } else { "NOT as expected" };
        row(&c.name, format!("{verdict}: {} against {} +- {}", value(c.found), value(Some(c.expected)), value(Some(c.allowed))));
    }
    row("files", o.folder.display().to_string());
    t.trim_end().to_owned()
}

fn percent(v: Option<f64>) -> String {
    v.map_or("-".into(), |v| format!("{:.2} %", 100.0 * v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::expected::Comparison;
    use crate::output::measured::Probes;
    use crate::output::summary::{Measure, Summary};
    use crate::scene::units::UnitSystem;

    #[test]
    fn numbers_have_five_digits() {
        let all = [3.6431234, 36.03, 0.0001234, 123456.0, 0.0, -0.19407].map(|v| value(Some(v)));
        assert_eq!(all, ["3.6431", "36.030", "1.2340e-4", "1.2346e5", "0", "-0.19407"]);
    }

    #[test]
    fn the_table_names_measures_with_interval_and_unit() {
        let mut summary =
            Summary { status: "converged".into(), time: Some(0.02), steps: 70_000, threads: 2, wall_s: 48.0, ..Default::default() };
        summary.measures.insert("angle".into(), Measure { mean: Some(36.03), ci95: Some(0.62), n: 12, unit: "deg".into() });
        summary.energy.balance_error = Some(-0.0012);
        let expected = vec![Comparison { name: "angle".into(), found: Some(36.03), expected: 35.0, allowed: 0.5 }];
        let outcome = Outcome { summary, expected, probes: Probes::default(), units: UnitSystem::MmNTonne, folder: "results/a".into() };
        let text = table(&outcome);
        for part in [
            "converged at t = 0.020000 s after 70000 steps",
            "48 s with 2 threads",
            "36.030 deg +- 0.62000 (95 %, n = 12)",
            "-0.12 %",
            "NOT as expected: 36.030 against 35.000 +- 0.50000",
            "results/a",
        ] {
            assert!(text.contains(part), "{part} is missing in\n{text}");
        }
    }
}
