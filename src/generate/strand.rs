//! A wire strand: helical wires in one layer around a straight core wire (6 + 1).
//!
//! The wires touch the core: their centre lines are helices of radius R_core + R_wire. Their
//! lay angle from the strand axis is atan(2 pi (R_core + R_wire) / pitch) (Costello 1997, Theory of
//! Wire Rope, ch. 3).
use super::bundle::{along_z, finish};
use super::chain::{Path, lay};
use super::frame::{EndCondition, Frame};
use super::tow::{FilamentModel, Natural, Radii, at_least, finite, material, positive, recipe};
use super::{Generated, Hand, next_tow};
use crate::registry::{Build, Registry, SpecError};
use crate::scene::units::Length;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A strand of one core wire (number 0) and helical wires (1, 2, ...) around it. The first and last
/// nodes are called `NAME.0.start`, `NAME.0.end`, `NAME.1.start`, ...
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrandSpec {
    /// Name of the strand, first part of its node names (default `strand`).
    #[serde(default = "strand_name")]
    pub name: String,
    /// Radius of the core wire (length).
    pub core_radius: Length,
    /// Radius of the helical wires (length).
    pub wire_radius: Length,
    /// Number of helical wires (default 6).
    #[serde(default = "six")]
    pub wires: usize,
    /// Length of one turn of a wire (length).
    pub pitch: Length,
    /// Length of the strand (length; default one pitch, or the smallest cell if periodic).
    #[serde(default)]
    pub length: Option<Length>,
    /// Elements per wire.
    pub elements: usize,
    /// Name of the material.
    pub material: String,
    /// Elements the wires are made of (default `Beams`).
    #[serde(default = "beams")]
    pub model: FilamentModel,
    /// Space between core and wires at the start (length; default 0, touching).
    #[serde(default)]
    pub clearance: Length,
    /// Sense of the wires (default `Right`).
    #[serde(default)]
    pub hand: Hand,
    /// True for an endless strand (default false): its length is a multiple of pitch / wires, and
    /// wire k continues in wire k + 1; the dummy node is called `NAME.period`.
    #[serde(default)]
    pub periodic: bool,
    /// Start point of the axis (length; default the origin).
    #[serde(default, with = "crate::scene::units::list")]
    pub origin: [Length; 3],
    /// Direction of the axis (default z).
    #[serde(default = "along_z", with = "crate::scene::units::list")]
    pub axis: [f64; 3],
    /// What holds the first nodes (default `Free`).
    #[serde(default)]
    pub start: EndCondition,
    /// What holds the last nodes (default `Free`).
    #[serde(default)]
    pub end: EndCondition,
    /// Stress-free shape (default `AsBuilt`).
    #[serde(default)]
    pub natural: Natural,
}

fn strand_name() -> String {
    "strand".into()
}
fn six() -> usize {
    6
}
fn beams() -> FilamentModel {
    FilamentModel::Beams
}

impl StrandSpec {
    /// One pitch of a right-handed 6 + 1 strand of beams along z with free ends.
    pub fn new(core_radius: f64, wire_radius: f64, pitch: f64, elements: usize, material: impl Into<String>) -> Self {
        StrandSpec {
            name: strand_name(),
            core_radius: Length(core_radius),
            wire_radius: Length(wire_radius),
            wires: six(),
            pitch: Length(pitch),
            length: None,
            elements,
            material: material.into(),
            model: beams(),
            clearance: Length(0.0),
            hand: Hand::Right,
            periodic: false,
            origin: [Length(0.0); 3],
            axis: along_z(),
            start: EndCondition::Free,
            end: EndCondition::Free,
            natural: Natural::default(),
        }
    }

    /// Radius of the helices on which the wires lie (length).
    pub fn helix_radius(&self) -> f64 {
        self.core_radius.0 + self.wire_radius.0 + self.clearance.0
    }

    /// Angle between wires and strand axis (radian).
    pub fn lay_angle(&self) -> f64 {
        (TAU * self.helix_radius() / self.pitch.0).atan()
    }

    /// Length along the axis (length).
    pub fn axial_length(&self) -> f64 {
        let default = if self.periodic { self.pitch.0 / self.wires as f64 } else { self.pitch.0 };
        self.length.map_or(default, |l| l.0)
    }

    /// Smallest distance between the centre lines of neighbouring wires less their diameter
    /// (length): negative if the wires do not fit around the core.
    pub fn wire_gap(&self) -> f64 {
        let (rho, k) = (self.helix_radius(), TAU / self.pitch.0);
        let apart = TAU / self.wires as f64;
        // Squared distance of a point to the neighbouring helix, dz further along the axis: its
        // minimum is where the derivative 2 rho^2 k sin(apart - k dz) = 2 dz crosses zero.
        let (mut low, mut high) = (0.0, apart / k);
        for _ in 0..100 {
            let dz = 0.5 * (low + high);
            if rho * rho * k * (apart - k * dz).sin() > dz { low = dz } else { high = dz }
        }
        let distance = (2.0 * rho * rho * (1.0 - (apart - k * low).cos()) + low * low).sqrt();
        distance - 2.0 * self.wire_radius.0
    }

    fn check(&self) -> Result<(), SpecError> {
        at_least("strand", "wires", self.wires, 2)?;
        at_least("strand", "elements", self.elements, 1)?;
        positive("strand", "core_radius", self.core_radius.0)?;
        positive("strand", "wire_radius", self.wire_radius.0)?;
        positive("strand", "pitch", self.pitch.0)?;
        positive("strand", "length", self.axial_length())?;
        finite("strand", "clearance", self.clearance.0)?;
        if self.clearance.0 < 0.0 {
            return Err(SpecError::new("strand.clearance", format!("clearance {} presses the wires into the core", self.clearance.0)));
        }
        if self.wire_gap() < -1e-12 * self.wire_radius.0 {
            return Err(SpecError::new(
                "strand.wires",
                format!("{} wires of radius {} overlap by {} around this core", self.wires, self.wire_radius.0, -self.wire_gap()),
            )
            .help("fewer or thinner wires, or a thicker core"));
        }
        let cells = self.axial_length() * self.wires as f64 / self.pitch.0;
        if self.periodic && (cells - cells.round()).abs() > 1e-9 * cells {
            return Err(SpecError::new("strand.length", format!("a periodic strand of {cells} cells does not close"))
                .help(format!("a multiple of pitch / wires = {}", self.pitch.0 / self.wires as f64)));
        }
        Ok(())
    }
}

/// Adds a strand. Fields are named `strand.` in errors.
///
/// # Errors
/// A field out of range, wires that do not fit, an unknown material or element, a name that is taken.
pub fn strand(spec: &StrandSpec, registry: &Registry, build: &mut Build<'_>) -> Result<Generated, SpecError> {
    spec.check()?;
    let frame = Frame::new("strand", spec.origin, spec.axis)?;
    let metal = material("strand", &spec.material, build)?;
    let recipes =
        [spec.core_radius.0, spec.wire_radius.0].map(|r| recipe("strand", &spec.model, &metal, Radii::solid(r), spec.natural, registry));
    let [core, wire] = recipes;
    let recipes = [core?, wire?];
    let length = spec.axial_length();
    let stations = if spec.periodic { spec.elements } else { spec.elements + 1 };
    let cells = (length * spec.wires as f64 / spec.pitch.0).round() as usize;
    let hand = if spec.hand == Hand::Right { 1.0 } else { -1.0 };
    let tow = next_tow(build);
    let paths: Vec<Path> = (0..=spec.wires)
        .map(|index| {
            let points = (0..stations)
                .map(|i| {
                    let z = length * i as f64 / spec.elements as f64;
                    if index == 0 {
                        return frame.point(DVec3::Z * z);
                    }
                    let phi = hand * TAU * ((index - 1) as f64 / spec.wires as f64 + z / spec.pitch.0);
                    frame.point(DVec3::new(spec.helix_radius() * phi.cos(), spec.helix_radius() * phi.sin(), z))
                })
                .collect();
            let successor = if index == 0 { 0 } else { 1 + (index - 1 + cells) % spec.wires };
            Path {
                points,
                radius: if index == 0 { spec.core_radius.0 } else { spec.wire_radius.0 },
                tow: tow + index,
                index: 0,
                successor: spec.periodic.then_some(successor),
                closed: false,
                recipe: index.min(1),
            }
        })
        .collect();
    let period_name = format!("{}.period", spec.name);
    let period = spec.periodic.then(|| (frame.direction(DVec3::Z * length), period_name.as_str()));
    finish(&spec.name, lay(&paths, &recipes, period, build)?, [&spec.start, &spec.end], build)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The strand of Utting and Jones (1987): core 3.94 mm, wires 3.73 mm, pitch 115 mm.
    fn utting_jones() -> StrandSpec {
        StrandSpec::new(1.97, 1.865, 115.0, 40, "steel")
    }

    #[test]
    fn lay_angle_of_the_utting_jones_strand() {
        assert!((utting_jones().lay_angle().to_degrees() - 11.834016412).abs() < 1e-8);
    }

    #[test]
    fn wires_of_the_utting_jones_strand_clear_each_other() {
        // Distance of neighbouring helices, minimised independently on a grid of 1e-4 mm. Costello's
        // criterion, which takes the sections of the wires for ellipses, has 0.044088 mm.
        assert!((utting_jones().wire_gap() - 0.042741072).abs() < 1e-8, "{}", utting_jones().wire_gap());
        let straight = StrandSpec { pitch: Length(1e9), ..utting_jones() };
        assert!((straight.wire_gap() - (1.97 + 1.865 - 2.0 * 1.865)).abs() < 1e-9, "a hexagon: side = radius");
        let seven = StrandSpec { wires: 7, ..utting_jones() };
        assert_eq!(seven.check().expect_err("too many").path, "strand.wires");
    }
}
