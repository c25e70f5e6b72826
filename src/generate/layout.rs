//! What the measures need to know about a generated braid.
use super::geometry::{BraidGeometry, Crossing, TowId};
use super::tow::Radii;
use crate::components::NodeId;
use std::ops::Range;

/// One tow of a generated braid.
#[derive(Clone, Debug, PartialEq)]
pub struct TowLayout {
    /// Direction and number.
    pub id: TowId,
    /// Filaments of the model, in the order of their packing sites.
    pub filaments: Range<usize>,
    /// The tow (index into [`BraidLayout::tows`]) that enters the cell where this one leaves it.
    pub successor: usize,
}

/// A generated braid; stored in the model with [`Model::insert`](crate::model::Model::insert).
#[derive(Clone, Debug, PartialEq)]
pub struct BraidLayout {
    /// Tows, A first; their numbers are the tow numbers of the filaments less `first_tow`.
    pub tows: Vec<TowLayout>,
    /// Tow number of the first tow in the model.
    pub first_tow: usize,
    /// Crossings inside the cell.
    pub crossings: Vec<Crossing>,
    /// Centre lines at the start.
    pub geometry: BraidGeometry,
    /// The dummy node, whose position is the period vector.
    pub dummy: NodeId,
    /// Initial length of the cell (length).
    pub cell_length: f64,
    /// Arc length of a tow through the cell (length).
    pub arc_length: f64,
    /// Elements per filament.
    pub elements: usize,
    /// The three radii of the filaments.
    pub radii: Radii,
    /// Largest distance of a filament's surface from the centre line of its tow (length).
    pub outer_radius: f64,
    /// Radius of the filaments to whose surface thickness is counted (length).
    pub surface_radius: f64,
    /// Mass of all filaments in the cell (mass).
    pub mass: f64,
    /// Bending stiffness EI of one tow, its filaments added up (force x length^2).
    pub bending_stiffness: f64,
    /// Poisson's ratio of the filaments.
    pub poisson: f64,
}

impl BraidLayout {
    /// Index of a tow in [`tows`](Self::tows).
    pub fn tow(&self, id: TowId) -> usize {
        if id.plus { id.index } else { self.geometry.per_direction + id.index }
    }

    /// Axial force that holds the smooth, stress-free helix at cell length `length` (force):
    /// F = N_tows (dphi / L)^2 EI [(s0 - s) c / s + (c - c0) / (1 + nu)] with c = length / L,
    /// s = sqrt(1 - c^2) and the turn dphi of the cell (Love 1927, art. 270, for a helix of fixed
    /// turn with bending and torsion). Valid before the braid touches its mandrel or itself.
    pub fn helix_force(&self, length: f64) -> f64 {
        let l = self.arc_length;
        let turn = std::f64::consts::TAU * self.cell_length / self.geometry.pitch;
        let (c, c0) = (length / l, self.cell_length / l);
        let (s, s0) = ((1.0 - c * c).sqrt(), (1.0 - c0 * c0).sqrt());
        self.tows.len() as f64 * (turn / l).powi(2) * self.bending_stiffness * ((s0 - s) * c / s + (c - c0) / (1.0 + self.poisson))
    }
}
