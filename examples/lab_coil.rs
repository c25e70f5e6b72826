//! `lab.coil`: a wire wound into a helical spring, as a generator of a plugin.
//!
//! Under a force F along its axis, led in through the axis, a coil of wire length l, radius R and lead angle a takes up the
//! energy F^2 R^2 l / 2 (cos^2 a / GJ + sin^2 a / EI) (A. E. H. Love, *A Treatise on the Mathematical Theory of
//! Elasticity* (1927), section 271): torsion, and a little bending.
//!
//! ```sh
//! cargo run --example lab_coil -- examples/scenes/lab_coil.ron
//! ```
use braid_ecs::generate::{FilamentModel, Generated, PolylineSpec, polyline};
use braid_ecs::prelude::*;
use braid_ecs::registry::Registry;
use braid_ecs::scene::units::Length;
use std::f64::consts::TAU;
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more generator.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the coil.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Coil>();
}

/// The section `"lab.coil": (...)` of a scene: a coil about the z axis that begins at (radius, 0, 0).
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coil {
    /// Turns.
    turns: f64,
    /// Radius of the coil (length).
    radius: Length,
    /// Height of a turn (length).
    pitch: Length,
    /// Radius of the wire (length).
    wire_radius: Length,
    /// Material of the wire.
    material: String,
    /// Elements of a turn. Default 24.
    #[serde(default = "twenty_four")]
    elements: usize,
    /// What the wire is made of. Default beams.
    #[serde(default = "beams")]
    model: FilamentModel,
}

fn twenty_four() -> usize {
    24
}

fn beams() -> FilamentModel {
    FilamentModel::Beams
}

impl Settings for Coil {
    const KEY: &'static str = "lab.coil";
    const ABOUT: &'static str = "a wire wound about the z axis, called `coil`";
    const GENERATES: bool = true;

    fn generate(&self, _: u64, registry: &Registry, build: &mut Build<'_>) -> Result<Vec<(String, Generated)>, SpecError> {
        let positive = [("turns", self.turns), ("radius", self.radius.0), ("wire_radius", self.wire_radius.0)];
        if let Some((name, value)) = positive.into_iter().find(|(_, v)| *v <= 0.0 || !v.is_finite()) {
            return Err(SpecError::new(name, format!("{name} must be above zero, {value} given")));
        }
        if self.elements == 0 {
            return Err(SpecError::new("elements", "a turn has at least one element"));
        }
        let count = (self.turns * self.elements as f64).ceil() as usize;
        let point = |i: usize| {
            let turn = self.turns * i as f64 / count as f64;
            let (sin, cos) = (TAU * turn).sin_cos();
            [self.radius.0 * cos, self.radius.0 * sin, self.pitch.0 * turn]
        };
        let points: Vec<[f64; 3]> = (0..=count).map(point).collect();
        let wire = PolylineSpec {
            name: "coil".into(),
            model: self.model.clone(),
            ..PolylineSpec::new(&points, 1, self.wire_radius.0, &self.material)
        };
        Ok(vec![("coil".into(), polyline(&wire, registry, build)?)])
    }

    fn check(&mut self, _: &mut Build<'_>) -> Result<(), SpecError> {
        Ok(())
    }
}
