//! Records of nodes near a surface and of segments near one of its edges, pooled like those between
//! filaments.
use super::kinematic::Hold;
use braid_ecs::prelude::*;

/// A node near a surface.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceRecord {
    /// Number of the surface.
    pub surface: u32,
    /// Slot of the node.
    pub node: u32,
}

/// What a surface record remembers.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceState {
    /// Elastic slip of the friction spring (length).
    pub slip: DVec3,
    /// Force of the damper (force).
    pub damper: f64,
    /// Penetration that is left free of force (length).
    pub offset: f64,
    /// What holds the node on a kinematic surface.
    pub hold: Hold,
}

/// A segment near an edge of a surface.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeRecord {
    /// Number of the surface.
    pub surface: u32,
    /// Number of the edge.
    pub edge: u32,
    /// Slot of the segment.
    pub segment: u32,
}

/// What an edge record remembers.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EdgeState {
    /// Parameter of the point nearest to the edge.
    pub t: f64,
    /// Elastic slip of the friction spring (length).
    pub slip: DVec3,
    /// Force of the damper (force).
    pub damper: f64,
    /// Penetration that is left free of force (length).
    pub offset: f64,
    /// Stiffness of the step before, zero for a record just found, `APART` if it did not touch (force / length).
    pub stiffness: f64,
    /// Overlap of the step before; not a number for a record just found (length).
    pub overlap: f64,
    /// What holds the segment on a kinematic surface.
    pub hold: Hold,
}

impl EdgeState {
    /// Of a record just found.
    pub fn at(t: f64) -> Self {
        EdgeState { t, slip: DVec3::ZERO, damper: 0.0, offset: 0.0, stiffness: 0.0, overlap: f64::NAN, hold: Hold::default() }
    }
}

/// How many rows of the pools are in use.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LiveSurfaceRecords {
    /// Nodes near surfaces.
    pub nodes: usize,
    /// Segments near edges.
    pub edges: usize,
}
