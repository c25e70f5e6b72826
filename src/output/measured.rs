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
use crate::systems::surface::section::Section;
use crate::systems::surface::shape::{Body, Shape};
use crate::systems::surface::surface_specs;
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

    /// The running values.
    pub fn state(&self) -> Vec<Option<f64>> {
        self.values.clone()
    }

    /// Goes on from values of the same probes.
    pub fn put_back(&mut self, values: Vec<Option<f64>>) {
        if values.len() == self.list.len() {
            self.values = values;
        }
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
    let times = |unit: &str| if unit == "-" { unit.to_string() } else { format!("{unit} {}", units.time()) };
    match quantity {
        Quantity::Length => units.length().into(),
        Quantity::Angle => "rad".into(),
        Quantity::Velocity => units.velocity(),
        Quantity::Force => units.force().into(),
        Quantity::Moment => units.moment(),
        Quantity::Energy => units.energy().into(),
        Quantity::Momentum => times(units.force()),
        Quantity::AngularMomentum => times(units.energy()),
        Quantity::Time => units.time().into(),
        Quantity::Number => "-".into(),
    }
}

/// The measures of the present state: cell length, of a braid angle (degrees) and thickness, and those of plugins.
pub fn measures(model: &Model, sim: &mut Simulation, units: UnitSystem) -> BTreeMap<String, Measure> {
    let of = |e: Estimate, unit: &str| Measure { mean: finite(e.mean), ci95: e.ci95.and_then(finite), n: e.n, unit: unit.into() };
    let single = |v: f64| Measure { mean: finite(v), ci95: None, n: 1, unit: units.length().into() };
    let mut out = BTreeMap::new();
    for kind in sim.registry.measures.clone() {
        if let Some(value) = (kind.take)(model, &mut sim.world) {
            out.insert(kind.name.into(), Measure { mean: finite(value), ci95: None, n: 1, unit: unit(kind.quantity, units) });
        }
    }
    if let Some(braid) = braid_measures(model, &mut sim.world, heights(model)) {
        out.insert("length".into(), single(braid.length));
        out.insert("angle".into(), of(braid.angle.scaled(180.0 / std::f64::consts::PI), "deg"));
        out.insert("thickness".into(), of(braid.thickness, units.length()));
    } else if let Some(first) = model.nodes.iter().position(|n| n.dummy) {
        out.insert("length".into(), single(position(&sim.world, NodeId(first as u32)).length()));
    }
    out
}

/// From where the heights of a braid are measured: the faces of a prism along z, else the axis.
fn heights(model: &Model) -> Heights {
    let first = surface_specs(model).into_iter().next();
    let Some(shape) = first.and_then(|spec| Shape::new(&spec).ok()) else { return Heights::Radial };
    let along_z = shape.frame.z_axis.cross(DVec3::Z) == DVec3::ZERO;
    match &shape.body {
        Body::Bar(Section::Polygon(corners, edge)) if along_z => {
            let face = |(i, c): (usize, &DVec2)| {
                let n = outward(*c, corners[(i + 1) % corners.len()]);
                let normal = shape.lift(n);
                (normal, n.dot(*c) + edge + normal.dot(shape.origin))
            };
            Heights::Faces(corners.iter().enumerate().map(face).collect())
        }
        _ => Heights::Radial,
    }
}

/// Outward normal of the side from `a` to `b` of a figure whose corners run counter-clockwise.
fn outward(a: DVec2, b: DVec2) -> DVec2 {
    -(b - a).normalize_or_zero().perp()
}

/// Corners of a polygon grown by an edge radius, the round edges in steps.
fn grown(corners: &[DVec2], edge: f64) -> Vec<DVec2> {
    const STEPS: usize = 8;
    if edge == 0.0 {
        return corners.to_vec();
    }
    let n = corners.len();
    let arc = |i: usize| {
        let (a, b, c) = (corners[(i + n - 1) % n], corners[i], corners[(i + 1) % n]);
        let (from, to) = (outward(a, b), outward(b, c));
        (0..=STEPS).map(move |k| b + edge * DVec2::from_angle(from.angle_to(to) * k as f64 / STEPS as f64).rotate(from))
    };
    (0..n).flat_map(arc).collect()
}

/// Probes of a scene.
pub fn probes(loaded: &LoadedScene) -> Vec<(String, Probe)> {
    loaded.probes.clone()
}

/// Rigid surfaces of a model, for pictures; frustums and solids are not drawn.
pub fn surfaces(model: &Model) -> Vec<Surface> {
    surface_specs(model)
        .iter()
        .filter_map(|spec| {
            let shape = Shape::new(spec).ok()?;
            let axis = shape.frame.z_axis;
            let Body::Bar(section) = &shape.body else { return None };
            Some(match section {
                Section::HalfPlane => Surface::Plane { point: shape.origin, normal: shape.frame.x_axis },
                Section::Circle(radius) => Surface::Cylinder { centre: shape.origin, axis, radius: *radius },
                Section::Polygon(corners, edge) => {
                    Surface::Prism { axis, corners: grown(corners, *edge).into_iter().map(|c| shape.origin + shape.lift(c)).collect() }
                }
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_edges_keep_the_size_of_the_figure() {
        // A square of side 2 with edges of radius 0.25: corner centres at 0.75.
        let c = [(0.75, -0.75), (0.75, 0.75), (-0.75, 0.75), (-0.75, -0.75)].map(|(x, y)| DVec2::new(x, y));
        assert_eq!(grown(&c, 0.0), c);
        let round = grown(&c, 0.25);
        let far = |d: DVec2| round.iter().map(|p| p.dot(d)).fold(f64::NEG_INFINITY, f64::max);
        for d in [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y] {
            assert!((far(d) - 1.0).abs() < 1e-12);
        }
        assert!((far(DVec2::ONE.normalize()) - (0.75 * std::f64::consts::SQRT_2 + 0.25)).abs() < 1e-12);
        // Still convex and counter-clockwise.
        let n = round.len();
        assert!((0..n).all(|i| (round[(i + 1) % n] - round[i]).perp_dot(round[(i + 2) % n] - round[(i + 1) % n]) > -1e-12));
    }

    #[test]
    fn heights_are_counted_from_the_faces_of_the_mandrel() {
        use crate::scene::units::{Angle, Length};
        use crate::systems::surface::{Mandrel, ShapeSpec, SurfaceSpec};
        let mut model = Model::new("a");
        assert_eq!(heights(&model), Heights::Radial);
        let mut spec = SurfaceSpec::new(ShapeSpec::Square { side: Length(2.0), edge_radius: Length(0.25) });
        spec.turn = Angle(0.3);
        model.insert(Mandrel(spec));
        let (Heights::Faces(found), Heights::Faces(expected)) = (heights(&model), Heights::square(2.0, 0.3)) else { panic!("faces") };
        assert_eq!(found.len(), 4);
        for (n, d) in expected {
            assert!(found.iter().any(|f| (f.0 - n).length() < 1e-12 && (f.1 - d).abs() < 1e-12), "{n} {d} in {found:?}");
        }
    }
}
