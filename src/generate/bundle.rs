//! A straight or twisted bundle of parallel filaments.
use super::chain::{Path, lay};
pub use super::frame::EndCondition;
use super::frame::{Frame, name_ends};
use super::tow::{FilamentModel, Natural, Radii, at_least, material, positive, recipe};
use super::{Generated, Noise, Packing, next_tow};
use crate::registry::{Build, Registry, SpecError};
use crate::scene::units::Length;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Parallel filaments packed around a straight axis. The first and last nodes are called
/// `NAME.0.start`, `NAME.0.end`, `NAME.1.start`, ...
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BundleSpec {
    /// Name of the bundle, first part of its node names (default `bundle`).
    #[serde(default = "bundle_name")]
    pub name: String,
    /// Number of filaments (default 7).
    #[serde(default = "seven")]
    pub filaments: usize,
    /// Radius of a filament: contact, EA and mass (length).
    pub radius: Length,
    /// Radius for bending and torsion (length; default: `radius`).
    #[serde(default)]
    pub bending_radius: Option<Length>,
    /// Length along the axis (length).
    pub length: Length,
    /// Elements per filament.
    pub elements: usize,
    /// Name of the material.
    pub material: String,
    /// Elements the filaments are made of (default `Beams`).
    #[serde(default = "beams")]
    pub model: FilamentModel,
    /// Arrangement in the cross-section (default `Hexagonal`).
    #[serde(default)]
    pub packing: Packing,
    /// Distance of neighbouring filaments over their diameter (default 1, touching).
    #[serde(default = "touching")]
    pub gap: f64,
    /// Length of one right-handed turn of the bundle about its axis (length; default: no twist).
    #[serde(default)]
    pub pitch: Option<Length>,
    /// True for an endless bundle whose filaments continue in themselves through periodic faces
    /// (default false); the dummy node is called `NAME.period`.
    #[serde(default)]
    pub periodic: bool,
    /// Random shift of every node across the bundle, as a fraction of the radius (default 0).
    #[serde(default)]
    pub perturbation: f64,
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

fn bundle_name() -> String {
    "bundle".into()
}
fn seven() -> usize {
    7
}
fn beams() -> FilamentModel {
    FilamentModel::Beams
}
fn touching() -> f64 {
    1.0
}
pub(crate) fn along_z() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

impl BundleSpec {
    /// Seven touching beams along z with free ends.
    pub fn new(radius: f64, length: f64, elements: usize, material: impl Into<String>) -> Self {
        BundleSpec {
            name: bundle_name(),
            filaments: seven(),
            radius: Length(radius),
            bending_radius: None,
            length: Length(length),
            elements,
            material: material.into(),
            model: beams(),
            packing: Packing::default(),
            gap: touching(),
            pitch: None,
            periodic: false,
            perturbation: 0.0,
            origin: [Length(0.0); 3],
            axis: along_z(),
            start: EndCondition::Free,
            end: EndCondition::Free,
            natural: Natural::default(),
        }
    }

    fn check(&self) -> Result<(), SpecError> {
        at_least("bundle", "filaments", self.filaments, 1)?;
        at_least("bundle", "elements", self.elements, 1)?;
        positive("bundle", "radius", self.radius.0)?;
        positive("bundle", "length", self.length.0)?;
        if let Some(r) = self.bending_radius {
            positive("bundle", "bending_radius", r.0)?;
        }
        if !(self.gap >= 1.0 && self.gap.is_finite()) {
            return Err(
                SpecError::new("bundle.gap", format!("gap {} makes the filaments overlap at the start", self.gap)).help("at least 1")
            );
        }
        if !(0.0..1.0).contains(&self.perturbation) {
            return Err(SpecError::new("bundle.perturbation", format!("perturbation {} is not in [0, 1)", self.perturbation)));
        }
        if let Some(p) = self.pitch {
            positive("bundle", "pitch", p.0)?;
            let turns = self.length.0 / p.0;
            if self.periodic && (turns - turns.round()).abs() > 1e-9 * turns {
                return Err(SpecError::new("bundle.length", format!("a periodic bundle of {turns} turns does not close"))
                    .help("the length must be a whole number of pitches"));
            }
        }
        Ok(())
    }
}

/// Adds a bundle. Fields are named `bundle.` in errors.
///
/// # Errors
/// A field out of range, an unknown material or element, a name that is taken.
pub fn bundle(spec: &BundleSpec, seed: u64, registry: &Registry, build: &mut Build<'_>) -> Result<Generated, SpecError> {
    spec.check()?;
    let frame = Frame::new("bundle", spec.origin, spec.axis)?;
    let r = spec.radius.0;
    let radii = Radii { bending: spec.bending_radius.map_or(r, |b| b.0), ..Radii::solid(r) };
    let made_of = recipe("bundle", &spec.model, &material("bundle", &spec.material, build)?, radii, spec.natural, registry)?;
    let tow = next_tow(build);
    let stations = if spec.periodic { spec.elements } else { spec.elements + 1 };
    let paths: Vec<Path> = spec
        .packing
        .sites(spec.filaments, 2.0 * r * spec.gap)
        .into_iter()
        .enumerate()
        .map(|(index, site)| {
            let mut noise = Noise::new(seed, index as u64);
            let points = (0..stations)
                .map(|i| {
                    let z = spec.length.0 * i as f64 / spec.elements as f64;
                    let turn = DVec2::from_angle(spec.pitch.map_or(0.0, |p| TAU * z / p.0));
                    let at = turn.rotate(site) + DVec2::from_array(noise.in_disc(spec.perturbation * r));
                    frame.point(at.extend(z))
                })
                .collect();
            Path { points, radius: r, tow, index, successor: spec.periodic.then_some(index), closed: false, recipe: 0 }
        })
        .collect();
    let period_name = format!("{}.period", spec.name);
    let period = spec.periodic.then(|| (frame.direction(DVec3::Z * spec.length.0), period_name.as_str()));
    finish(&spec.name, lay(&paths, &[made_of], period, build)?, [&spec.start, &spec.end], build)
}

/// Names and holds the ends of what was laid.
pub(crate) fn finish(
    name: &str,
    laid: super::chain::Laid,
    conditions: [&EndCondition; 2],
    build: &mut Build<'_>,
) -> Result<Generated, SpecError> {
    let filaments = &build.model.filaments[laid.filaments.clone()];
    let starts: Vec<_> = filaments.iter().map(|f| f.nodes[0]).collect();
    let ends: Vec<_> = filaments.iter().map(|f| *f.nodes.last().expect("a filament has nodes")).collect();
    name_ends(name, &starts, &ends, build)?;
    conditions[0].hold(&starts, build);
    conditions[1].hold(&ends, build);
    Ok(Generated { filaments: laid.filaments, starts, ends, dummy: laid.dummy, mass: laid.mass })
}
