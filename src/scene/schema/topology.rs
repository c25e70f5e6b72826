//! Nodes, curves, contact surfaces and what joins them.
use super::NodeRef;
use crate::components::Dof;
use crate::scene::units::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Added masses.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct NodeMassSpec {
    /// The nodes; each gets the whole of it.
    pub nodes: Vec<NodeRef>,
    /// Mass. Default 0.
    #[serde(default)]
    pub mass: Mass,
    /// Rotary inertia (mass x length^2). Default 0.
    #[serde(default)]
    pub inertia: Inertia,
}

/// Velocities at the start.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct InitialVelocitySpec {
    /// The nodes.
    pub nodes: Vec<NodeRef>,
    /// Velocity (length / time). Default zero.
    #[serde(default)]
    pub velocity: Triple<Velocity>,
    /// Angular velocity (radian / time). Default zero.
    #[serde(default)]
    pub angular: Triple<AngularVelocity>,
}

fn contact_default() -> bool {
    true
}

/// A contact surface along existing nodes.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FilamentSpec {
    /// Nodes in order, at least two.
    pub nodes: Vec<NodeRef>,
    /// Radius (length).
    pub radius: Length,
    /// Tow number. Default 0.
    #[serde(default)]
    pub tow: usize,
    /// False: drawn but not checked for contact. Default true.
    #[serde(default = "contact_default")]
    pub contact: bool,
}

/// Two coincident nodes that move as one.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct TieSpec {
    /// The dependent node.
    pub embedded: NodeRef,
    /// The node that carries both.
    pub host: NodeRef,
}

/// One term c u of an equation: `(c, node, dof)`.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct TermSpec(
    /// Coefficient.
    pub Ratio,
    /// Node.
    pub NodeRef,
    /// Degree of freedom.
    pub Dof,
);

/// A linear equation: the sum of its terms equals a constant. The first term is the dependent one.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct EquationSpec {
    /// The terms.
    pub terms: Vec<TermSpec>,
    /// Right-hand side (length or radian). Default 0.
    #[serde(default)]
    pub constant: Ratio,
}

/// One periodic pair: the displacement of `image` is that of `node` plus those of the dummy nodes.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PairSpec {
    /// The independent node.
    pub node: NodeRef,
    /// The dependent node.
    pub image: NodeRef,
    /// Names of the dummy nodes between the two.
    pub dummies: Vec<String>,
}

/// Periodicity through dummy nodes.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PeriodicSpec {
    /// Dummy nodes: name and period vector (length).
    pub dummies: BTreeMap<String, Point>,
    /// Pairs by hand. Default none.
    #[serde(default)]
    pub pairs: Vec<PairSpec>,
    /// True: pairs every node with its image under the period vectors. Default false.
    #[serde(default)]
    pub matching: bool,
    /// Largest distance between a node and the place where its partner wants it (length).
    /// Default 1e-9 of the longest period vector.
    #[serde(default)]
    pub tolerance: Option<Length>,
}
