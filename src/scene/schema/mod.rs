//! The schema of a scene: every key with its unit and default.
//!
//! The text of a scene is read into a [`Scene`]; `build` makes a [`Model`](crate::model::Model) of it.
//! Written back, a scene has every default filled in.
mod load;
mod material;
mod run;
mod topology;

pub use load::*;
pub use material::*;
pub use run::*;
pub use topology::*;

pub use crate::generate::{BraidSpec, BundleSpec, PolylineSpec, StrandSpec, TowSpec};
pub use crate::measure::{NodeRef, ProbeSpec};

use super::units::UnitSystem;
use ron::value::RawValue;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Versions of the scene format that this program reads.
pub const VERSIONS: [u32; 1] = [1];

fn version() -> u32 {
    VERSIONS[VERSIONS.len() - 1]
}

fn seed() -> u64 {
    1
}

/// A whole scene.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of the scene format. Default 1.
    #[serde(default = "version")]
    pub version: u32,
    /// One line for outputs. Default empty.
    #[serde(default)]
    pub title: String,
    /// Unit system of all plain numbers and of the results. Must be given.
    pub units: UnitSystem,
    /// Seed of all random numbers. Default 1.
    #[serde(default = "seed")]
    pub seed: u64,
    /// Materials by name.
    #[serde(default)]
    pub materials: BTreeMap<String, MaterialSpec>,
    /// Cross-sections by name.
    #[serde(default)]
    pub sections: BTreeMap<String, SectionSpec>,
    /// Points of the nodes (length), numbered from 0.
    #[serde(default)]
    pub nodes: Vec<super::units::Point>,
    /// Names for nodes, for other sections, messages and probes.
    #[serde(default)]
    pub node_names: BTreeMap<String, u32>,
    /// Masses in addition to what the elements bring.
    #[serde(default)]
    pub node_masses: Vec<NodeMassSpec>,
    /// Velocities at the start.
    #[serde(default)]
    pub initial_velocity: Vec<InitialVelocitySpec>,
    /// A braid about the z axis; needs `tow`.
    #[serde(default)]
    pub braid: Option<BraidSpec>,
    /// The filaments of the tows of the braid.
    #[serde(default)]
    pub tow: Option<TowSpec>,
    /// Bundles of parallel filaments.
    #[serde(default)]
    pub bundles: Vec<BundleSpec>,
    /// Wires wound around a core.
    #[serde(default)]
    pub strands: Vec<StrandSpec>,
    /// Filaments through points.
    #[serde(default)]
    pub polylines: Vec<PolylineSpec>,
    /// Elements by kind; every kind has its own entries.
    #[serde(default)]
    pub elements: BTreeMap<String, Box<RawValue>>,
    /// Contact surfaces along existing nodes.
    #[serde(default)]
    pub filaments: Vec<FilamentSpec>,
    /// Pairs of coincident nodes that share every degree of freedom.
    #[serde(default)]
    pub ties: Vec<TieSpec>,
    /// Linear equations between degrees of freedom.
    #[serde(default)]
    pub equations: Vec<EquationSpec>,
    /// Periodicity through dummy nodes.
    #[serde(default)]
    pub periodic: Option<PeriodicSpec>,
    /// Degrees of freedom held at zero.
    #[serde(default)]
    pub fixed: Vec<FixedSpec>,
    /// Prescribed displacements and rotations.
    #[serde(default)]
    pub prescribed: Vec<PrescribedSpec>,
    /// Force along the period of a periodic structure.
    #[serde(default)]
    pub load: Option<PeriodLoadSpec>,
    /// Forces and moments on nodes.
    #[serde(default)]
    pub loads: Vec<NodalLoadSpec>,
    /// Uniform acceleration of all masses.
    #[serde(default)]
    pub gravity: Option<GravitySpec>,
    /// Functions of time by name.
    #[serde(default)]
    pub amplitudes: BTreeMap<String, AmplitudeSpec>,
    /// Velocity-proportional damping and its kin. Default `Auto` with `load`, else `None`.
    #[serde(default)]
    pub damping: Option<DampingSpec>,
    /// Time integration.
    #[serde(default)]
    pub integration: IntegrationSpec,
    /// When the run ends. Default: a steady state with `load`, else it must be given.
    #[serde(default)]
    pub stop: StopSpec,
    /// When a run is given up.
    #[serde(default)]
    pub watch: WatchSpec,
    /// What is written.
    #[serde(default)]
    pub output: OutputSpec,
    /// Named values, sampled into the history and reported at the end.
    #[serde(default)]
    pub probes: BTreeMap<String, ProbeSpec>,
    /// Expected values of measures and probes, compared at the end.
    #[serde(default)]
    pub expect: BTreeMap<String, ExpectSpec>,
    /// Paths of the whole numbers that make the mesh finer, all by the same factor: `polylines[0].subdivisions`.
    #[serde(default)]
    pub refine: Vec<String>,
    /// Settings of plugins (`contact`, `mandrel` ...) by key, as text with all defaults.
    #[serde(skip)]
    pub settings: BTreeMap<String, String>,
}
