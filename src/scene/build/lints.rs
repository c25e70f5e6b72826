//! Plausibility: numbers that are allowed and hardly ever meant.
//!
//! Bounds are those of fibres and wires that exist: densities from polyethylene (970 kg/m3) to tungsten (19 300 kg/m3), moduli
//! from rubber (a few MPa) to graphene (1 TPa), each with a factor to spare.
use super::{Builder, at};
use crate::generate::BraidLayout;
use crate::model::Filament;
use crate::scene::error::Problem;
use crate::scene::schema::Scene;
use crate::scene::spans::Path;
use std::f64::consts::{PI, TAU};

/// Densities of fibres (kg/m3).
const DENSITY: [f64; 2] = [500.0, 25_000.0];

/// Young's moduli of fibres (Pa).
const YOUNG: [f64; 2] = [1e6, 2e12];

/// Radii of fibres and wires (m): from a thin nanofibre to a rope.
const RADIUS: [f64; 2] = [1e-8, 0.1];

/// Powers of length, mass and time.
const STRESS: [i32; 3] = [-1, 1, -2];
const MASS_PER_VOLUME: [i32; 3] = [-3, 1, 0];
const LENGTH: [i32; 3] = [1, 0, 0];

impl Builder<'_> {
    /// What is implausible about the materials, the mesh and the braid.
    pub(super) fn implausible(&self, scene: &Scene) -> Vec<Problem> {
        let mut hints = Vec::new();
        for (name, m) in &scene.materials {
            let path = at("materials").key(name);
            let field = |long: &str, short: &str| path.key(if self.root.find(&path.key(short)).is_some() { short } else { long });
            hints.extend(self.unlikely(
                scene,
                field("density", "rho"),
                &format!("density of material `{name}`"),
                m.density.0,
                MASS_PER_VOLUME,
                DENSITY,
                "kg/m3",
            ));
            hints.extend(self.unlikely(
                scene,
                field("young", "E"),
                &format!("Young's modulus of material `{name}`"),
                m.young.0,
                STRESS,
                YOUNG,
                "Pa",
            ));
            if m.poisson.0 >= 0.5 {
                let text = format!("Poisson's ratio of material `{name}` is {}: it would be incompressible", m.poisson.0);
                hints.push(Problem::new(field("poisson", "nu"), text).help("fibres have 0.2 to 0.45"));
            }
        }
        hints.extend(self.filament_sizes(scene));
        if let Some(braid) = &self.braid {
            hints.extend(jammed(braid));
        }
        hints.extend(self.unmatched_faces());
        hints
    }

    /// A value outside the range of what exists, both in SI, with the factor that would bring it there.
    #[allow(clippy::too_many_arguments)]
    fn unlikely(
        &self,
        scene: &Scene,
        path: Path,
        what: &str,
        value: f64,
        powers: [i32; 3],
        range: [f64; 2],
        unit: &str,
    ) -> Option<Problem> {
        let si = value * scene.units.si(powers)?;
        let [low, high] = range;
        if (low..=high).contains(&si) {
            return None;
        }
        let factor = [1e3, 1e-3, 1e6, 1e-6, 1e9, 1e-9, 1e12, 1e-12].into_iter().find(|f| (low..=high).contains(&(si * f)));
        let slip = factor.map_or(String::new(), |f| format!("; {f:e} times that would be usual: is the unit right?"));
        Some(
            Problem::new(path, format!("{what} is {si:.3e} {unit}, and fibres have {low:e} to {high:e}{slip}"))
                .help("a unit can stand with the number: \"72 GPa\", \"2.58 g/cm3\", \"2.5 um\""),
        )
    }

    /// Filaments that are too thin or thick to be fibres, and elements shorter than their diameter: one hint per entry of the scene.
    fn filament_sizes(&self, scene: &Scene) -> Vec<Problem> {
        let mut hints = Vec::new();
        let touches = ["contact", "mandrel", "surfaces"].iter().any(|key| self.root.find(&at(key)).is_some());
        for (path, filaments) in &self.sources {
            let touching = || self.model.filaments[filaments.clone()].iter().filter(|f| f.contact);
            let Some(shortest) = touching().filter_map(|f| self.shortest(f)).min_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1))) else {
                continue;
            };
            let (length, diameter) = shortest;
            // Where nothing touches, thick beams are just thick; and many meshes are exactly as long as thick.
            if touches && length < 0.999 * diameter {
                let text =
                    format!("elements are shorter than their diameter: {length:.3e} against {diameter:.3e} {}", scene.units.length());
                hints.push(
                    Problem::new(path.clone(), text).help(
                        "fewer elements are as good and quicker, for contact sees filaments as smooth curves; or is the radius wrong?",
                    ),
                );
            }
            hints.extend(self.unlikely(scene, path.clone(), "the radius of the filaments", 0.5 * diameter, LENGTH, RADIUS, "m"));
        }
        hints
    }

    /// Faces of a periodic structure of which only some nodes have an image: probably the period or the mesh does not match.
    fn unmatched_faces(&self) -> Vec<Problem> {
        let nodes = &self.model.nodes;
        let mut paired = vec![false; nodes.len()];
        self.model.periodic.iter().for_each(|p| paired[p.image.row()] = true);
        let mut tied = vec![false; nodes.len()];
        self.model.ties.iter().for_each(|t| tied[t.embedded.row()] = true);
        let dummies = nodes.iter().filter(|n| n.dummy && n.position.length() > 0.0);
        let of_period = |period: glam::DVec3| {
            let along = |i: usize| nodes[i].position.dot(period) / period.length_squared();
            let free = || (0..nodes.len()).filter(|i| !nodes[*i].dummy && !tied[*i]);
            let far = free().map(along).fold(f64::NEG_INFINITY, f64::max);
            // Relative to the period: far more than rounding, far less than an element.
            let face: Vec<usize> = free().filter(|i| along(*i) > far - 1e-6).collect();
            let alone = face.iter().filter(|i| !paired[**i]).count();
            (0 < alone && alone < face.len()).then(|| {
                let text = format!("the period {period} matches only {} of the {} nodes of its far face", face.len() - alone, face.len());
                Problem::new(at("periodic"), text)
                    .help("are period and mesh those of the structure? Nodes without an image are a free end there")
            })
        };
        dummies.filter_map(|d| of_period(d.position)).collect()
    }

    /// Length of the shortest segment of a filament, and the diameter.
    fn shortest(&self, f: &Filament) -> Option<(f64, f64)> {
        let place = |n: crate::components::NodeId| self.model.nodes[n.row()].position;
        let length = f.nodes.windows(2).map(|w| (place(w[1]) - place(w[0])).length()).reduce(f64::min)?;
        Some((length, 2.0 * f.radius))
    }
}

/// A braid whose tows have no room beside each other. Parallel tows stand 2 pi R cos(angle) / n apart; the cover factor
/// 1 - (1 - w / p)^2 of two directions with tows of width w (J. L. Brunnschweiler, J. Text. Inst. 44 (1953) P666) reaches one,
/// and the braid jams, where w = p.
fn jammed(braid: &BraidLayout) -> Option<Problem> {
    let geometry = &braid.geometry;
    let cosine = 1.0 / (1.0 + (TAU * geometry.radius / geometry.pitch).powi(2)).sqrt();
    let pitch = TAU * geometry.radius * cosine / geometry.per_direction as f64;
    let width = 2.0 * braid.outer_radius;
    (width > pitch).then(|| {
        let angle = cosine.acos() * 180.0 / PI;
        let text = format!(
            "the braid jams: tows of one direction are {width:.3e} wide and stand {pitch:.3e} apart at {angle:.1} degrees (cover factor over 1)"
        );
        Problem::new(at("braid"), text).help("take fewer or thinner tows, a larger radius, or a longer pitch")
    })
}
