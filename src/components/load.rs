//! Loads and prescribed motions, each an entity that points at a node and an amplitude.
use super::{Dof, NodeId};
use bevy_ecs::prelude::*;
use glam::DVec3;

/// Concentrated force and moment on one node: amplitude(t) x value.
#[derive(Component, Clone, Debug, PartialEq)]
pub struct NodalLoad {
    /// The loaded node (a dummy node takes a force like any other).
    pub node: NodeId,
    /// Force in global axes (force).
    pub force: DVec3,
    /// Moment in global axes (force x length); needs a node with rotations.
    pub moment: DVec3,
    /// True when force and moment turn with the node.
    pub follower: bool,
    /// Index into the model's amplitudes.
    pub amplitude: usize,
}

/// Prescribed displacement or rotation of one degree of freedom: u = amplitude(t) x value.
#[derive(Component, Clone, Debug, PartialEq)]
pub struct PrescribedMotion {
    /// The node.
    pub node: NodeId,
    /// The degree of freedom.
    pub dof: Dof,
    /// Final value (length or radian).
    pub value: f64,
    /// Index into the model's amplitudes.
    pub amplitude: usize,
}
