//! Multi-point constraints: ties, linear equations, periodic pairs through dummy nodes.
use super::{Dof, NodeId};
use bevy_ecs::prelude::*;
use serde::Serialize;

/// Two coincident nodes that share every degree of freedom. The embedded node is condensed: the
/// elements on it act on the host, and it has no motion of its own.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Tie {
    /// The dependent node.
    pub embedded: NodeId,
    /// The node that carries both.
    pub host: NodeId,
}

/// One term c u of a linear equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Coefficient.
    pub coefficient: f64,
    /// Node.
    pub node: NodeId,
    /// Degree of freedom of the node.
    pub dof: Dof,
}

/// Linear equation sum(c_i u_i) = constant between degrees of freedom (u: displacements and
/// rotations from the initial configuration). The first term is the dependent one.
#[derive(Component, Clone, Debug, PartialEq)]
pub struct Equation {
    /// Terms, the first one dependent.
    pub terms: Vec<Term>,
    /// Right-hand side.
    pub constant: f64,
}

/// Periodicity u(image) = u(node) + sum(u(dummy)) in displacement, equal rotations.
#[derive(Component, Clone, Debug, PartialEq)]
pub struct PeriodicPair {
    /// The independent node P.
    pub node: NodeId,
    /// The dependent node P'.
    pub image: NodeId,
    /// The dummy nodes that carry the period vectors between the two.
    pub dummies: Vec<NodeId>,
}

/// Marks a dummy node; its [`Position`](super::Position) is the period vector.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
#[component(storage = "SparseSet")]
pub struct DummyNode;
