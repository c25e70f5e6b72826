//! Generators: from a specification to nodes, filaments and elements of a model.
//!
//! A generator is a pure function of its specification and a seed. It adds to the model under
//! construction: filaments, the elements that follow them (by the names of registered kinds), ties
//! of embedded nodes, and for periodic structures the image pairs with their dummy node.
//!
//! | specification | structure |
//! |---|---|
//! | [`BraidSpec`] + [`TowSpec`] | biaxial braid on the smallest periodic cell or a full turn |
//! | [`BundleSpec`] | straight or twisted bundle of parallel filaments |
//! | [`StrandSpec`] | wires wound in one layer on a straight core (6 + 1) |
//! | [`PolylineSpec`] | one filament through given points |
mod braid;
mod bundle;
mod chain;
mod frame;
mod geometry;
mod layout;
mod packing;
mod polyline;
mod strand;
mod tow;

pub use crate::scene::units::{Angle, Length};
pub use braid::{BraidSpec, Cell, Hand, Pattern};
pub use bundle::{BundleSpec, EndCondition, bundle};
pub use geometry::{BraidGeometry, Crossing, TowId};
pub use layout::{BraidLayout, TowLayout};
pub use packing::{Packing, outer_distance};
pub use polyline::{PolylineSpec, polyline};
pub use strand::{StrandSpec, strand};
pub use tow::{Bending, FilamentModel, Natural, Radii, Spread, TowSpec};

use crate::components::NodeId;
use crate::registry::{Build, Registry, SpecError};
use chain::{Path, lay};
use glam::DVec3;
use rand_pcg::Pcg64;
use rand_pcg::rand_core::Rng;
use std::f64::consts::TAU;
use std::ops::Range;

/// Filaments that a generator has added, with their first and last nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Generated {
    /// Filaments of the model.
    pub filaments: Range<usize>,
    /// First node of every filament.
    pub starts: Vec<NodeId>,
    /// Last node of every filament (of a periodic one the image of a first node).
    pub ends: Vec<NodeId>,
    /// Dummy node of a periodic structure; its position is the period vector.
    pub dummy: Option<NodeId>,
    /// Mass of all filaments (mass).
    pub mass: f64,
}

/// Adds a braid about the z axis, from z = 0 to the cell length. Fields are named `braid.` and
/// `tow.` in errors. The dummy node is called `period`; its z is free, all else is fixed.
///
/// The layout is stored in the model as well.
///
/// # Errors
/// A field out of range, a pattern that does not close, an unknown material or element.
pub fn braid(spec: &BraidSpec, tow: &TowSpec, seed: u64, registry: &Registry, build: &mut Build<'_>) -> Result<BraidLayout, SpecError> {
    tow.check("tow")?;
    spec.check("braid")?;
    let recipe = tow.recipe("tow", registry, build)?;
    let material = tow::material("tow", &tow.material, build)?;
    let radii = tow.radii();
    let outer_radius = tow.outer_radius();
    let geometry = spec.geometry(outer_radius * tow.gap);
    if geometry.radius - geometry.undulation <= outer_radius {
        return Err(SpecError::new("braid.radius", format!("radius {} leaves no room for tows of radius {outer_radius}", geometry.radius)));
    }
    let sites = tow.sites();
    let h = geometry.cell_length();
    let first_tow = next_tow(build);
    let tow_index = |id: TowId| if id.plus { id.index } else { geometry.per_direction + id.index };

    let mut paths = Vec::with_capacity(spec.tows * tow.filaments);
    let mut tows = Vec::with_capacity(spec.tows);
    let first_filament = build.model.filaments.len();
    for (t, id) in geometry.tows().enumerate() {
        let successor = tow_index(geometry.successor(id));
        for (index, site) in sites.iter().enumerate() {
            let mut noise = Noise::new(seed, paths.len() as u64);
            let points = (0..tow.elements)
                .map(|i| {
                    let z = h * i as f64 / tow.elements as f64;
                    let [outward, sideways] = geometry.section_axes(id, z);
                    let [a, b] = noise.in_disc(tow.perturbation * radii.contact);
                    geometry.centre(id, z) + outward * (site.x + a) + sideways * (site.y + b)
                })
                .collect();
            paths.push(Path {
                points,
                radius: radii.contact,
                tow: first_tow + t,
                index,
                successor: Some(successor * tow.filaments + index),
                closed: false,
                recipe: 0,
            });
        }
        let start = first_filament + t * tow.filaments;
        tows.push(TowLayout { id, filaments: start..start + tow.filaments, successor });
    }
    let laid = lay(&paths, &[recipe], Some((DVec3::Z * h, "period")), build)?;
    let layout = BraidLayout {
        tows,
        first_tow,
        crossings: geometry.crossings(),
        geometry,
        dummy: laid.dummy.expect("a period gives a dummy node"),
        cell_length: h,
        arc_length: geometry.arc_length(),
        elements: tow.elements,
        radii,
        outer_radius,
        surface_radius: tow.surface_radius(),
        mass: laid.mass,
        bending_stiffness: match tow.model {
            FilamentModel::Trusses => 0.0,
            _ => tow.filaments as f64 * crate::model::Section::round(&material, radii.axial, radii.bending).ei[0],
        },
        poisson: material.poisson,
    };
    build.model.insert(layout.clone());
    Ok(layout)
}

/// The first tow number that no filament of the model has.
fn next_tow(build: &Build<'_>) -> usize {
    build.model.filaments.iter().map(|f| f.tow + 1).max().unwrap_or(0)
}

/// Random shifts of one filament: its own generator, so that they depend on the seed and on the
/// number of the filament but not on the order of generation.
struct Noise(Pcg64);

impl Noise {
    fn new(seed: u64, filament: u64) -> Self {
        // Streams of neighbouring numbers are correlated, so the seed is scattered by the number
        // first (the finaliser of SplitMix64, Steele et al. 2014).
        let mut state = seed ^ filament.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        state = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state = (state ^ (state >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        state ^= state >> 31;
        Noise(Pcg64::new(u128::from(state), u128::from(filament)))
    }

    /// Uniform in [0, 1).
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in a disc.
    fn in_disc(&mut self, radius: f64) -> [f64; 2] {
        let (r, phi) = (radius * self.unit().sqrt(), TAU * self.unit());
        [r * phi.cos(), r * phi.sin()]
    }
}
