//! What a scene asks to be measured: probes at every sample, measures at the end.
use super::history::Column;
use super::render::Surface;
use super::summary::{Measure, finite};
use crate::components::NodeId;
use crate::measure::{Estimate, Heights, Probe, Quantity, braid_measures, position};
use crate::model::Model;
use crate::scene::LoadedScene;
use crate::scene::units::UnitSystem;
use crate::simulation::Simulation;
use crate::systems::surface::shape::{Section, Shape};
use crate::systems::surface::{Mandrel, ShapeSpec, SurfaceSpec, Surfaces};
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// Named probes with their running values.
#[derive(Default)]
pub struct Probes {
    list: Vec<(String, Probe, String)>,
    values: Vec<Option<f64>>,
}

impl Probes {
    /// Probes by name; the unit system gives the units in headers.
    pub fn new(probes: Vec<(String, Probe)>, units: UnitSystem) -> Self {
        let list: Vec<_> = probes.into_iter().map(|(name, p)| (name, unit(p.quantity(), units), p)).map(|(n, u, p)| (n, p, u)).collect();
        Probes { values: vec![None; list.len()], list }
    }

    /// Columns of the history.
    pub fn columns(&self) -> impl Iterator<Item = Column> + '_ {
        self.list.iter().map(|(name, _, unit)| Column::new(name.clone(), unit.clone()))
    }

    /// Reads all probes now; the largest or smallest so far where the probe is one.
    pub fn sample(&mut self, sim: &mut Simulation) -> Vec<f64> {
        for ((_, probe, _), value) in self.list.iter().zip(&mut self.values) {
            *value = Some(probe.reduce().fold(*value, probe.evaluate(&mut sim.world)));
        }
        self.values.iter().map(|v| v.unwrap_or(f64::NAN)).collect()
    }

    /// Name and last value.
    pub fn values(&self) -> BTreeMap<String, Option<f64>> {
        self.list.iter().zip(&self.values).map(|((name, ..), v)| (name.clone(), v.and_then(finite))).collect()
    }

    /// Name, last value and unit, in the order of the scene.
    pub fn table(&self) -> impl Iterator<Item = (&str, Option<f64>, &str)> {
        self.list.iter().zip(&self.values).map(|((name, _, unit), v)| (name.as_str(), *v, unit.as_str()))
    }
}

/// Unit of a quantity.
pub fn unit(quantity: Quantity, units: UnitSystem) -> String {
    match quantity {
        Quantity::Length => units.length().into(),
        Quantity::Angle => "rad".into(),
        Quantity::Velocity => units.velocity(),
        Quantity::Force => units.force().into(),
        Quantity::Moment => units.moment(),
        Quantity::Energy => units.energy().into(),
        Quantity::Time => units.time().into(),
        Quantity::Number => "-".into(),
    }
}

/// The measures of the present state: cell length, and of a braid angle (degrees) and thickness.
pub fn measures(model: &Model, sim: &mut Simulation, units: UnitSystem) -> BTreeMap<String, Measure> {
    let of = |e: Estimate, unit: &str| Measure { mean: finite(e.mean), ci95: e.ci95.and_then(finite), n: e.n, unit: unit.into() };
    let single = |v: f64| Measure { mean: finite(v), ci95: None, n: 1, unit: units.length().into() };
    let mut out = BTreeMap::new();
    if let Some(braid) = braid_measures(model, &mut sim.world, heights(model)) {
        out.insert("length".into(), single(braid.length));
        out.insert("angle".into(), of(braid.angle.scaled(180.0 / std::f64::consts::PI), "deg"));
        out.insert("thickness".into(), of(braid.thickness, units.length()));
    } else if let Some(first) = model.nodes.iter().position(|n| n.dummy) {
        out.insert("length".into(), single(position(&sim.world, NodeId(first as u32)).length()));
    }
    out
}

/// The rigid surfaces of a model, the mandrel first.
fn surface_specs(model: &Model) -> Vec<SurfaceSpec> {
    let mandrel = model.get::<Mandrel>().map(|m| m.0.clone());
    mandrel.into_iter().chain(model.get::<Surfaces>().cloned().unwrap_or_default().0).collect()
}

/// From where the heights of a braid are measured: the faces of a square mandrel along z, else the axis.
fn heights(model: &Model) -> Heights {
    let Some(first) = surface_specs(model).into_iter().next() else { return Heights::Radial };
    let along_z = DVec3::from_array(first.axis).cross(DVec3::Z) == DVec3::ZERO;
    match first.shape {
        ShapeSpec::Square { side, .. } if along_z => Heights::square(side.0, first.turn.0),
        _ => Heights::Radial,
    }
}

/// Probes of a scene.
pub fn probes(loaded: &LoadedScene) -> Vec<(String, Probe)> {
    loaded.probes.clone()
}

/// Rigid surfaces of a model, for pictures.
pub fn surfaces(model: &Model) -> Vec<Surface> {
    surface_specs(model)
        .iter()
        .filter_map(|spec| {
            let shape = Shape::new(spec).ok()?;
            let axis = shape.frame.z_axis;
            Some(match &shape.section {
                Section::HalfPlane => Surface::Plane { point: shape.origin, normal: shape.frame.x_axis },
                Section::Circle(radius) => Surface::Cylinder { centre: shape.origin, axis, radius: *radius },
                // Pictures show the sharp figure around a rounded one.
                Section::Polygon(corners, edge) => {
                    let centre = corners.iter().sum::<DVec2>() / corners.len() as f64;
                    let grow = |c: &DVec2| *c + (*c - centre).normalize_or_zero() * *edge;
                    Surface::Prism { axis, corners: corners.iter().map(|c| shape.origin + shape.lift(grow(c))).collect() }
                }
            })
        })
        .collect()
}
