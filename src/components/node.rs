//! Nodes: one entity each, the same bundle for all of them.
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Index of a node: its position in the model's node list and its row in every node column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct NodeId(pub u32);

impl NodeId {
    /// The row of the node in the node columns.
    #[inline]
    pub fn row(self) -> usize {
        self.0 as usize
    }
}

/// Current position x (length). Of a dummy node: the current period vector.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Position(pub DVec3);

/// Position in the initial configuration (length).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize)]
pub struct InitialPosition(pub DVec3);

/// Velocity v at the half step t + dt/2 (length / time).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Velocity(pub DVec3);

/// Sum of all forces on the node at time t (force), after condensation of the constraints.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Force(pub DVec3);

/// Lumped mass (mass).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Mass(pub f64);

/// Inverse of the mass that each direction moves with; zero where the motion is fixed, prescribed
/// or follows from a constraint.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize)]
pub struct InverseMass(pub DVec3);

/// Rotation of the node's cross-section from the initial configuration (identity at the start).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Orientation(pub DQuat);

/// Spatial angular velocity at the half step (1 / time).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AngularVelocity(pub DVec3);

/// Sum of all moments on the node, about its own position, in global axes (force x length).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Moment(pub DVec3);

/// Isotropic rotary inertia J (mass x length^2).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RotaryInertia(pub f64);

/// Inverse of the rotary inertia per global axis; zero where the rotation is fixed or dependent.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize)]
pub struct InverseInertia(pub DVec3);

/// One of the six degrees of freedom of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Dof {
    /// displacement along x
    Ux,
    /// displacement along y
    Uy,
    /// displacement along z
    Uz,
    /// rotation about x
    Rx,
    /// rotation about y
    Ry,
    /// rotation about z
    Rz,
}

impl Dof {
    /// All six, displacements first.
    pub const ALL: [Dof; 6] = [Dof::Ux, Dof::Uy, Dof::Uz, Dof::Rx, Dof::Ry, Dof::Rz];
    /// The axis, 0 to 2.
    pub fn axis(self) -> usize {
        self as usize % 3
    }
    /// True for the three rotations.
    pub fn is_rotation(self) -> bool {
        self as usize >= 3
    }
}
