//! What a recorder writes at the end of a run: the last samples, the final picture, plots, the summary.
use super::{Recorder, contacts, ledger};
use crate::assembly::KindReports;
use crate::output::expected::{Comparison, compare};
use crate::output::file::{OutputError, write_atomic};
use crate::output::history::History;
use crate::output::measured::{Probes, measures};
use crate::output::plot::{Axis, Plot, Series, panels};
use crate::output::summary::{DtLimit, Energies, Lists, Quality, Summary, finite, state_hash};
use crate::output::{provenance, quality, timing};
use crate::scene::units::UnitSystem;
use crate::simulation::Simulation;
use crate::step::Clock;
use std::path::PathBuf;

/// What is left of a run when its files are written.
pub struct Outcome {
    /// The content of `summary.json`.
    pub summary: Summary,
    /// Expected values of the scene against what came out.
    pub expected: Vec<Comparison>,
    /// The probes with their last values.
    pub probes: Probes,
    /// Unit system of all numbers.
    pub units: UnitSystem,
    /// The output folder.
    pub folder: PathBuf,
}

impl Recorder<'_> {
    /// Writes what belongs to the end and returns the summary. `status` is that of the summary.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn finish(&mut self, sim: &mut Simulation, status: &str) -> Result<Outcome, OutputError> {
        let (wall, cpu) = (self.wall(), self.cpu());
        self.write_row(sim)?;
        if self.frame_sampler.wanted() {
            self.write_frame(sim)?;
        }
        self.write_picture(sim, "final.png")?;
        if self.plots
            && let Some(history) = &self.history
        {
            let plot = provenance::xml_comment(&self.provenance) + &self.plot(history);
            write_atomic(&self.folder.join("history.svg"), plot.as_bytes())?;
        }
        let summary = self.summary(sim, status, wall, cpu);
        summary.write(&self.folder.join("summary.json"))?;
        let expected = compare(self.scene, &summary);
        Ok(Outcome { summary, expected, probes: std::mem::take(&mut self.probes), units: self.units, folder: self.folder.clone() })
    }

    fn plot(&self, history: &History) -> String {
        let time = || Axis::linear(format!("time [{}]", self.units.time()));
        let mut plots = Vec::new();
        if !self.dummies.is_empty() {
            let series = self.dummies.iter().map(|(name, _)| {
                let label = if self.dummies.len() > 1 { name.trim_start_matches("length ") } else { "" };
                Series::line(label, history.points("time", name))
            });
            plots.push(Plot {
                title: self.name.clone(),
                x: time(),
                y: Axis::linear(format!("length [{}]", self.units.length())),
                series: series.collect(),
            });
        }
        let names = ["external work", "strain", "kinetic", "contact", "friction", "damping", "axial damping"];
        // Rounding noise of the first steps would stretch the axis over thirty decades.
        let curves = names.map(|n| (n, history.points("time", n)));
        let largest = curves.iter().flat_map(|c| &c.1).fold(0.0f64, |m, p| m.max(p.1));
        let series = curves.map(|(n, points)| Series::line(n, points.into_iter().filter(|p| p.1 > 1e-7 * largest).collect()));
        plots.push(Plot {
            title: if plots.is_empty() { self.name.clone() } else { String::new() },
            x: time(),
            y: Axis::log(format!("energy [{}]", self.units.energy())),
            series: series.into_iter().filter(|s| !s.points.is_empty()).collect(),
        });
        panels(&plots, (900, 400 * plots.len() as u32))
    }

    fn summary(&mut self, sim: &mut Simulation, status: &str, wall: f64, cpu: Option<f64>) -> Summary {
        let clock = sim.world.resource::<Clock>().clone();
        let (e, contacts) = (ledger(sim), contacts(sim));
        let elements: usize = sim.world.get_resource::<KindReports>().map_or(0, |k| k.0.iter().map(|k| k.count).sum());
        Summary {
            scene: self.name.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            provenance: provenance::map(&self.provenance),
            status: status.into(),
            time: finite(clock.time),
            steps: clock.step,
            dt: finite(clock.dt),
            dt_limit: DtLimit { value: finite(clock.dt_limit), by: clock.limited_by },
            nodes: self.model.nodes.len(),
            elements,
            contacts: contacts.active,
            lists: match contacts.rebuilds {
                0 => Lists::default(),
                n => Lists { rebuilds: Some(n), steps_per_list: finite(clock.step as f64 / n as f64), records: Some(contacts.records) },
            },
            threads: rayon::current_num_threads(),
            wall_s: wall,
            cpu_s: cpu,
            element_steps_per_s: finite(elements as f64 * clock.step as f64 / (wall - self.writing)),
            share: timing::share(&sim.world),
            energy: Energies::of(&e),
            quality: Quality {
                force_residual: quality::force_residual(&self.lines, sim).and_then(finite),
                dummy_balance: quality::dummy_balance(self.model, sim).and_then(finite),
                kinetic_to_work: finite(e.kinetic / e.external_work.abs()),
                max_penetration_to_radius: finite(contacts.max_penetration_to_radius),
                p99_penetration_to_radius: finite(contacts.p99_penetration_to_radius),
                stiffness_raised: Some(contacts.raised).filter(|r| *r > 0.0),
            },
            measures: measures(self.model, sim, self.units),
            probes: self.probes.values(),
            retries: self.retries.clone(),
            state_hash: state_hash(&mut sim.world),
        }
    }
}
