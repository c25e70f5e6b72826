//! The recorder: watches a run and fills its output folder.
//!
//! | file | when |
//! |---|---|
//! | `scene.resolved.ron` | at the start: the scene with every default filled in |
//! | `history.csv` | a row per sample |
//! | `frames/*.vtp`, `results.pvd` | a frame per sample |
//! | `frames/contacts_*.vtp`, `contacts.pvd` | the contacts of each frame: gap, forces, angle, kind, stick or slip |
//! | `initial.png`, `final.png` | at the start and the end |
//! | `history.svg` | at the end |
//! | `failure.json`, `frames/last_good.vtp` | where the run has failed |
//! | `summary.json` | last of all: where it exists, the run is over and everything is there |
mod end;
mod state;

pub use end::Outcome;
pub use state::RecorderState;

use super::disk;
use super::file::{OutputError, write_atomic};
use super::frame::{contact_frame, frame};
use super::history::{Column, History};
use super::lines::Lines;
use super::measured::{Probes, probes, surfaces};
use super::picture::Scenery;
use super::provenance::{self, Provenance, provenance};
use super::render::render;
use super::sampling::Sampler;
use super::summary::{Retry, cpu_seconds};
use super::vtp;
use crate::assembly::node_states;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::model::Model;
use crate::run::Observer;
use crate::scene::LoadedScene;
use crate::scene::schema::Scene;
use crate::scene::units::UnitSystem;
use crate::simulation::{NodeRows, Simulation, SimulationError};
use crate::step::Clock;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The frame of the last good state.
const LAST_GOOD: &str = "frames/last_good.vtp";

/// Size of the pictures in pixels.
const PICTURE: (u32, u32) = (1000, 750);

/// Watches a run and fills its output folder. Errors of files are kept and stop the run; ask with
/// [`Recorder::error`].
pub struct Recorder<'a> {
    folder: PathBuf,
    scene: &'a Scene,
    model: &'a Model,
    name: String,
    units: UnitSystem,
    provenance: Provenance,
    lines: Lines,
    scenery: Option<Scenery>,
    probes: Probes,
    dummies: Vec<(String, usize)>,
    history: Option<History>,
    history_sampler: Sampler,
    frame_sampler: Sampler,
    frames: Vec<(f64, String)>,
    contact_frames: Vec<(f64, String)>,
    plots: bool,
    started: bool,
    /// Step of the last history row and of the last frame.
    last: (Option<u64>, Option<u64>),
    begin: Instant,
    cpu_begin: Option<f64>,
    /// Seconds of earlier parts of the run: wall, processor.
    before: [f64; 2],
    /// Seconds spent on writing, which do not count for the speed of the steps.
    writing: f64,
    retries: Vec<Retry>,
    error: Option<OutputError>,
}

impl<'a> Recorder<'a> {
    /// A recorder for a simulation that has been built from the scene, in a folder that exists.
    /// `duration` is the expected length of the run (time), for samplings by count.
    ///
    /// # Errors
    /// What the operating system says about the first files.
    pub fn new(loaded: &'a LoadedScene, sim: &mut Simulation, folder: &Path, duration: Option<f64>) -> Result<Self, OutputError> {
        let mut recorder = Recorder::without_files(loaded, sim, folder, duration);
        let resolved = provenance::lines(&recorder.provenance, "//") + &loaded.resolved();
        write_atomic(&folder.join("scene.resolved.ron"), resolved.as_bytes())?;
        if recorder.history_sampler.wanted() {
            let columns = recorder.columns();
            recorder.history = Some(History::create(&folder.join("history.csv"), &recorder.provenance, columns)?);
        }
        if recorder.frame_sampler.wanted() {
            recorder.make_frame_folder()?;
        }
        Ok(recorder)
    }

    fn without_files(loaded: &'a LoadedScene, sim: &mut Simulation, folder: &Path, duration: Option<f64>) -> Self {
        let (model, output, units) = (&loaded.model, &loaded.scene.output, loaded.scene.units);
        let lines = Lines::of(model, sim);
        let rows = sim.world.resource::<NodeRows>();
        let dummies = model.nodes.iter().enumerate().filter(|(_, n)| n.dummy).map(|(i, _)| {
            let id = crate::components::NodeId(i as u32);
            let name = model.node_names.iter().find(|(_, n)| **n == id).map_or(format!("node {i}"), |(name, _)| name.clone());
            (format!("length {name}"), rows.of(id))
        });
        let mut recorder = Recorder {
            folder: folder.to_owned(),
            scene: &loaded.scene,
            model,
            name: loaded.name(),
            units,
            provenance: provenance(loaded, &loaded.resolved()),
            dummies: dummies.collect(),
            scenery: None,
            probes: Probes::new(probes(loaded), units),
            history: None,
            history_sampler: Sampler::new(output.history, duration),
            frame_sampler: Sampler::new(output.frames, duration),
            frames: Vec::new(),
            contact_frames: Vec::new(),
            plots: output.plots,
            started: false,
            last: (None, None),
            begin: Instant::now(),
            cpu_begin: cpu_seconds(),
            before: [0.0; 2],
            writing: 0.0,
            retries: Vec::new(),
            error: None,
            lines,
        };
        if output.pictures && !recorder.lines.lines.is_empty() {
            recorder.scenery = Some(Scenery::of(model, &recorder.lines, surfaces(model), sim));
        }
        recorder
    }

    fn make_frame_folder(&self) -> Result<(), OutputError> {
        let frames = self.folder.join("frames");
        disk::create_dir_all(&frames).map_err(|e| OutputError::io("create the folder", &frames, e))
    }

    /// Seconds of wall time of the whole run so far.
    pub fn wall(&self) -> f64 {
        self.before[0] + self.begin.elapsed().as_secs_f64()
    }

    /// Seconds of processor time, where the system tells.
    fn cpu(&self) -> Option<f64> {
        cpu_seconds().zip(self.cpu_begin).map(|(b, a)| self.before[1] + b - a)
    }

    /// Writes a frame of the present state, whatever the sampling says.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write_frame(&mut self, sim: &mut Simulation) -> Result<(), OutputError> {
        let (time, step) = (sim.world.resource::<Clock>().time, sim.world.resource::<Clock>().step);
        if self.lines.lines.is_empty() || self.last.1 == Some(step) {
            return Ok(());
        }
        self.last.1 = Some(step);
        // Somebody may have tidied up since the run began.
        self.make_frame_folder()?;
        let name = format!("frames/{:04}.vtp", self.frames.len());
        vtp::write(&self.folder.join(&name), &frame(&self.lines, &mut sim.world, &self.provenance), time)?;
        if sim.world.contains_resource::<ContactSummary>() {
            let name = format!("frames/contacts_{:04}.vtp", self.frames.len());
            vtp::write(&self.folder.join(&name), &contact_frame(&mut sim.world, &self.provenance), time)?;
            self.contact_frames.push((time, name));
            vtp::write_series(&self.folder.join("contacts.pvd"), &self.contact_frames, &self.provenance)?;
        }
        self.frames.push((time, name));
        vtp::write_series(&self.folder.join("results.pvd"), &self.frames, &self.provenance)
    }

    /// Writes a frame that stands for itself, outside the series: the last good state of a run that has failed. Returns its
    /// name, or none for a model without lines.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn frame_of_last_good(&self, sim: &mut Simulation) -> Result<Option<String>, OutputError> {
        if self.lines.lines.is_empty() {
            return Ok(None);
        }
        self.make_frame_folder()?;
        let time = sim.world.resource::<Clock>().time;
        vtp::write(&self.folder.join(LAST_GOOD), &frame(&self.lines, &mut sim.world, &self.provenance), time)?;
        Ok(Some(LAST_GOOD.into()))
    }

    /// What made the files.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// Tells the summary of failures after which the run went back.
    pub fn tell_retries(&mut self, retries: &[Retry]) {
        self.retries = retries.to_vec();
    }

    /// Shortest interval between two samples (time), for the loop; `dt` is the expected time step.
    pub fn interval(&self, dt: f64) -> f64 {
        self.history_sampler.interval(dt).min(self.frame_sampler.interval(dt))
    }

    /// The first error of a file, if there was one; the run stops on it.
    pub fn error(&mut self) -> Option<OutputError> {
        self.error.take()
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The probes with their last values.
    pub fn probes(&self) -> &Probes {
        &self.probes
    }

    fn columns(&self) -> Vec<Column> {
        let energy = ["external work", "kinetic", "strain", "contact", "friction", "damping", "axial damping"];
        let mut c = vec![Column::new("time", self.units.time()), Column::new("step", "-"), Column::new("dt", self.units.time())];
        c.extend(energy.map(|n| Column::new(n, self.units.energy())));
        c.push(Column::new("balance error", "-"));
        c.extend(["contact records", "active contacts", "max penetration to radius"].map(|n| Column::new(n, "-")));
        c.extend(["contact force", "largest contact force"].map(|n| Column::new(n, self.units.force())));
        c.extend(self.dummies.iter().map(|(name, _)| Column::new(name.clone(), self.units.length())));
        c.extend(self.probes.columns());
        c
    }

    fn row(&mut self, sim: &mut Simulation) -> Vec<f64> {
        let clock = sim.world.resource::<Clock>().clone();
        let e = ledger(sim);
        let contacts = contacts(sim);
        let mut row = vec![clock.time, clock.step as f64, clock.dt];
        row.extend([e.external_work, e.kinetic, e.strain, e.contact, e.friction, e.damping, e.axial, e.balance_error()]);
        let counts = [contacts.records as f64, contacts.active as f64, contacts.max_penetration_to_radius];
        row.extend(counts.into_iter().chain([contacts.total_force, contacts.max_force]));
        let states = node_states(&mut sim.world);
        row.extend(self.dummies.iter().map(|(_, r)| states[*r].x.length()));
        row.extend(self.probes.sample(sim));
        row
    }

    fn write_row(&mut self, sim: &mut Simulation) -> Result<(), OutputError> {
        let step = sim.world.resource::<Clock>().step;
        if self.last.0 == Some(step) {
            return Ok(());
        }
        let row = self.row(sim);
        self.last.0 = Some(step);
        self.history.as_mut().map_or(Ok(()), |h| h.row(&row))
    }

    fn write_picture(&mut self, sim: &mut Simulation, name: &str) -> Result<(), OutputError> {
        let Some(scenery) = &self.scenery else { return Ok(()) };
        let texts: Vec<(&str, &str)> = self.provenance.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
        render(&scenery.picture(&self.lines, sim), PICTURE.0, PICTURE.1).write_png(&self.folder.join(name), &texts)
    }

    fn observe(&mut self, sim: &mut Simulation) -> Result<(), OutputError> {
        let (time, step) = (sim.world.resource::<Clock>().time, sim.world.resource::<Clock>().step);
        let first = !self.started;
        if first {
            self.started = true;
            self.write_picture(sim, "initial.png")?;
        }
        if self.history_sampler.due(time, step) || first {
            self.write_row(sim)?;
        }
        if (self.frame_sampler.due(time, step) || first) && self.frame_sampler.wanted() {
            self.write_frame(sim)?;
        }
        Ok(())
    }
}

impl Observer for Recorder<'_> {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError> {
        let begin = Instant::now();
        if self.error.is_none() {
            self.error = self.observe(sim).err();
        }
        self.writing += begin.elapsed().as_secs_f64();
        Ok(())
    }
    fn stop_requested(&self) -> bool {
        self.error.is_some()
    }
}

fn ledger(sim: &Simulation) -> EnergyLedger {
    sim.world.get_resource::<EnergyLedger>().copied().unwrap_or_default()
}

fn contacts(sim: &Simulation) -> ContactSummary {
    sim.world.get_resource::<ContactSummary>().copied().unwrap_or_default()
}
