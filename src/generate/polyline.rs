//! One filament through given points.
use super::bundle::finish;
use super::chain::{Path, lay};
use super::frame::EndCondition;
use super::tow::{FilamentModel, Natural, Radii, at_least, finite, material, positive, recipe};
use super::{Generated, next_tow};
use crate::registry::{Build, Registry, SpecError};
use crate::scene::units::Length;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A filament of straight legs between points. Its first and last nodes are called `NAME.0.start`
/// and `NAME.0.end`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolylineSpec {
    /// Name of the filament, first part of its node names (default `polyline`).
    #[serde(default = "polyline_name")]
    pub name: String,
    /// Corner points, at least two (length).
    #[serde(with = "crate::scene::units::lists")]
    pub points: Vec<[Length; 3]>,
    /// Elements per leg (default 1).
    #[serde(default = "one")]
    pub subdivisions: usize,
    /// True if a last leg joins the last point to the first (default false).
    #[serde(default)]
    pub closed: bool,
    /// Radius of the filament: contact, EA and mass (length).
    pub radius: Length,
    /// Radius for bending and torsion (length; default: `radius`).
    #[serde(default)]
    pub bending_radius: Option<Length>,
    /// Name of the material.
    pub material: String,
    /// Elements the filament is made of (default `Beams`).
    #[serde(default = "beams")]
    pub model: FilamentModel,
    /// What holds the first node (default `Free`).
    #[serde(default)]
    pub start: EndCondition,
    /// What holds the last node (default `Free`).
    #[serde(default)]
    pub end: EndCondition,
    /// Stress-free shape (default `AsBuilt`).
    #[serde(default)]
    pub natural: Natural,
}

fn polyline_name() -> String {
    "polyline".into()
}
fn one() -> usize {
    1
}
fn beams() -> FilamentModel {
    FilamentModel::Beams
}

impl PolylineSpec {
    /// A beam through `points` with free ends.
    pub fn new(points: &[[f64; 3]], subdivisions: usize, radius: f64, material: impl Into<String>) -> Self {
        PolylineSpec {
            name: polyline_name(),
            points: points.iter().map(|p| p.map(Length)).collect(),
            subdivisions,
            closed: false,
            radius: Length(radius),
            bending_radius: None,
            material: material.into(),
            model: beams(),
            start: EndCondition::Free,
            end: EndCondition::Free,
            natural: Natural::default(),
        }
    }
}

/// Adds a filament through points. Fields are named `polyline.` in errors.
///
/// # Errors
/// A field out of range, coincident points, an unknown material or element, a name that is taken.
pub fn polyline(spec: &PolylineSpec, registry: &Registry, build: &mut Build<'_>) -> Result<Generated, SpecError> {
    at_least("polyline", "subdivisions", spec.subdivisions, 1)?;
    positive("polyline", "radius", spec.radius.0)?;
    if let Some(r) = spec.bending_radius {
        positive("polyline", "bending_radius", r.0)?;
    }
    let least = if spec.closed { 3 } else { 2 };
    if spec.points.len() < least {
        return Err(
            SpecError::new("polyline.points", format!("{} points make no filament", spec.points.len())).help(format!("at least {least}"))
        );
    }
    for (i, p) in spec.points.iter().enumerate() {
        for x in p {
            finite("polyline", &format!("points[{i}]"), x.0)?;
        }
    }
    let mut corners: Vec<DVec3> = spec.points.iter().map(|p| DVec3::from_array(p.map(|x| x.0))).collect();
    if spec.closed {
        corners.push(corners[0]);
    }
    if let Some(i) = corners.windows(2).position(|w| w[0] == w[1]) {
        let next = (i + 1) % spec.points.len();
        return Err(SpecError::new(format!("polyline.points[{next}]"), format!("zero-length element: points {i} and {next} are the same")));
    }
    let mut points: Vec<DVec3> = Vec::with_capacity((corners.len() - 1) * spec.subdivisions + 1);
    for leg in corners.windows(2) {
        points.extend((0..spec.subdivisions).map(|i| leg[0].lerp(leg[1], i as f64 / spec.subdivisions as f64)));
    }
    if !spec.closed {
        points.push(corners[corners.len() - 1]);
    }
    let r = spec.radius.0;
    let radii = Radii { bending: spec.bending_radius.map_or(r, |b| b.0), ..Radii::solid(r) };
    let made_of = recipe("polyline", &spec.model, &material("polyline", &spec.material, build)?, radii, spec.natural, registry)?;
    let path = Path { points, radius: r, tow: next_tow(build), index: 0, successor: None, closed: spec.closed, recipe: 0 };
    finish(&spec.name, lay(&[path], &[made_of], None, build)?, [&spec.start, &spec.end], build)
}
