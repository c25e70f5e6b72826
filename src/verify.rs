//! Scenes with known answers: a run without files, compared with what the scene expects.
//!
//! | step | file |
//! |---|---|
//! | a scene, run and compared | this one |
//! | the same scene on several meshes: the order of convergence | `order.rs` |
//! | one line per scene, mesh and quantity; `verification.json` | `table.rs` |
//! | plots and the self-contained `verification.html` | `page.rs` |
pub mod order;
mod page;
mod table;

pub use table::{Broken, Outcome, Row, rows};

use crate::assembly::KindReports;
use crate::output::expected::{Comparison, compare};
use crate::output::measured::{Probes, measures, probes};
use crate::output::sampling::Sampler;
use crate::output::summary::Summary;
use crate::run::{self, Observer, expected_duration};
use crate::scene::LoadedScene;
use crate::simulation::{Simulation, SimulationError};
use crate::step::Clock;
use std::time::Instant;

/// The outcome of one scene.
#[derive(Clone, Debug)]
pub struct Verified {
    /// Name of the scene.
    pub scene: String,
    /// Its title.
    pub title: String,
    /// Factor on the numbers that make its mesh finer; 1 on the mesh of the scene itself.
    pub mesh: f64,
    /// Elements of all kinds.
    pub elements: usize,
    /// Every expectation of the scene against what came out.
    pub rows: Vec<Comparison>,
    /// Steps made.
    pub steps: u64,
    /// Wall time of the run (s).
    pub seconds: f64,
}

impl Verified {
    /// True if all expectations hold.
    pub fn holds(&self) -> bool {
        self.rows.iter().all(Comparison::holds)
    }
}

/// Takes the probes when the history would.
struct Watch {
    probes: Probes,
    sampler: Sampler,
    started: bool,
}

impl Observer for Watch {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError> {
        let (time, step) = (sim.world.resource::<Clock>().time, sim.world.resource::<Clock>().step);
        if self.sampler.due(time, step) || !self.started {
            self.started = true;
            self.probes.sample(sim);
        }
        Ok(())
    }
}

/// Runs a scene in a simulation that has its plugins and no model yet, and compares. The mesh counts as
/// that of the scene itself.
///
/// # Errors
/// A model that cannot be built, or a run that fails.
pub fn verify(loaded: &LoadedScene, mut sim: Simulation) -> Result<Verified, SimulationError> {
    let (model, units) = (&loaded.model, loaded.scene.units);
    let begin = Instant::now();
    sim.build(model)?;
    run::start(&mut sim, model)?;
    let dt = sim.world.resource::<Clock>().dt_target;
    let duration = expected_duration(model, dt);
    let sampler = Sampler::new(loaded.scene.output.history, duration);
    let interval = sampler.interval(dt);
    let mut watch = Watch { probes: Probes::new(probes(loaded), units), sampler, started: false };
    run::continue_run(&mut sim, model, interval, &mut watch)?;
    watch.probes.sample(&mut sim);
    let elements = sim.world.get_resource::<KindReports>().map_or(0, |k| k.0.iter().map(|k| k.count).sum());
    let summary = Summary { measures: measures(model, &mut sim, units), probes: watch.probes.values(), ..Summary::default() };
    Ok(Verified {
        scene: loaded.name(),
        title: loaded.scene.title.clone(),
        mesh: 1.0,
        elements,
        rows: compare(&loaded.scene, &summary),
        steps: sim.world.resource::<Clock>().step,
        seconds: begin.elapsed().as_secs_f64(),
    })
}
