//! Probes: named values of a scene, read from the world at every sample.
//!
//! A [`ProbeSpec`] is what the scene says, with nodes by number or name; [`ProbeSpec::resolve`] checks it
//! against the model and gives a [`Probe`], which reads.
use crate::assembly::KindReports;
use crate::components::*;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::model::Model;
use crate::registry::{Registry, SpecError};
use crate::simulation::{HeldDofs, NodeEntities, NodeRows};
use crate::step::Clock;
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Deserializer, Serialize};

/// A node by number or by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum NodeRef {
    /// Number in the node list.
    Id(u32),
    /// Name.
    Name(String),
}

impl<'de> Deserialize<'de> for NodeRef {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = NodeRef;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a node number or a node name in quotes")
            }
            fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<NodeRef, E> {
                u32::try_from(v).map(NodeRef::Id).map_err(|_| E::custom(format!("node number {v} is too large")))
            }
            fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<NodeRef, E> {
                u32::try_from(v).map(NodeRef::Id).map_err(|_| E::custom(format!("{v} is not a node number")))
            }
            fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<NodeRef, E> {
                Ok(NodeRef::Name(v.to_string()))
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

impl NodeRef {
    /// The node meant; errors name the field `path`.
    ///
    /// # Errors
    /// A number or name that no node has.
    pub fn resolve(&self, path: &str, model: &Model) -> Result<NodeId, SpecError> {
        match self {
            NodeRef::Id(id) if (*id as usize) < model.nodes.len() => Ok(NodeId(*id)),
            NodeRef::Id(id) => Err(SpecError::new(path, format!("node {id} does not exist"))
                .help(format!("the scene has {} nodes, numbered from 0", model.nodes.len()))),
            NodeRef::Name(name) => model
                .node_names
                .get(name)
                .copied()
                .ok_or_else(|| SpecError::unknown(path, "node", name, model.node_names.keys().map(String::as_str))),
        }
    }

    /// The nodes meant, where a name may hold one `*` for any text (`strand.*.end`); errors name the field `path`.
    ///
    /// # Errors
    /// A number or name that no node has.
    pub fn resolve_all(&self, path: &str, model: &Model) -> Result<Vec<NodeId>, SpecError> {
        if let NodeRef::Name(pattern) = self
            && let Some((head, tail)) = pattern.split_once('*')
        {
            let matches = |n: &str| n.len() >= head.len() + tail.len() && n.starts_with(head) && n.ends_with(tail);
            let found: Vec<NodeId> = model.node_names.iter().filter(|(n, _)| matches(n)).map(|(_, id)| *id).collect();
            if found.is_empty() {
                return Err(SpecError::unknown(path, "node", pattern, model.node_names.keys().map(String::as_str)));
            }
            return Ok(found);
        }
        Ok(vec![self.resolve(path, model)?])
    }
}

/// What is read of a vector.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Component {
    /// Along x.
    X,
    /// Along y.
    Y,
    /// Along z.
    Z,
    /// Its length.
    #[default]
    Magnitude,
}

impl Component {
    fn of(self, v: DVec3) -> f64 {
        match self {
            Component::X => v.x,
            Component::Y => v.y,
            Component::Z => v.z,
            Component::Magnitude => v.length(),
        }
    }
}

/// A section force of an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SectionTerm {
    /// Axial force, positive in tension.
    N,
    /// Resultant shear force.
    V,
    /// Largest bending moment of the two ends.
    M,
    /// Torsional moment.
    T,
}

/// A term of the energy balance. Kinetic, strain and contact energy are those of the last monitor step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnergyTerm {
    /// Kinetic energy.
    Kinetic,
    /// Strain energy.
    Strain,
    /// Work of loads and prescribed motions.
    ExternalWork,
    /// Energy stored in contacts.
    Contact,
    /// Energy dissipated by friction.
    Friction,
    /// Energy dissipated by damping.
    Damping,
    /// Energy dissipated by the implicit axial solve.
    Axial,
    /// Work that is not accounted for.
    Imbalance,
}

/// One named value, as the scene describes it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum ProbeSpec {
    /// Current position of a node (of a dummy node: its period vector).
    Position {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Displacement of a node from its initial position.
    Displacement {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Velocity of a node.
    Velocity {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Rotation vector of a node from its initial orientation (radian); its magnitude is the angle.
    Rotation {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Force with which the support holds a node.
    Reaction {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Moment with which the support holds a node.
    ReactionMoment {
        /// The node.
        node: NodeRef,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Sum of the support forces of several nodes; a name may hold one `*`.
    TotalReaction {
        /// The nodes.
        nodes: Vec<NodeRef>,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Sum of the support moments of several nodes about the origin, those of their forces included.
    TotalReactionMoment {
        /// The nodes.
        nodes: Vec<NodeRef>,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Section force of one element.
    SectionForce {
        /// Kind of element (`truss`, `beam`, ...).
        kind: String,
        /// Number of the element among those of its kind.
        element: usize,
        /// Which force.
        term: SectionTerm,
    },
    /// A term of the energy balance.
    Energy(EnergyTerm),
    /// Sum of all normal contact forces.
    ContactForce,
    /// Largest normal contact force.
    MaxContactForce,
    /// Largest penetration over the smaller radius.
    MaxPenetration,
    /// Time step.
    TimeStep,
    /// Length of the period vector of a dummy node.
    DummyLength {
        /// The dummy node (default `period`).
        #[serde(default = "period")]
        node: NodeRef,
    },
    /// Distance of two nodes.
    Distance {
        /// The two nodes.
        nodes: Vec<NodeRef>,
    },
    /// Angle between the lines through two pairs of nodes, 0 to pi (radian).
    Angle {
        /// First line, from one node to another.
        from: Vec<NodeRef>,
        /// Second line, from one node to another.
        to: Vec<NodeRef>,
    },
    /// Largest value of a probe over all samples so far.
    Max(Box<ProbeSpec>),
    /// Smallest value of a probe over all samples so far.
    Min(Box<ProbeSpec>),
}

fn period() -> NodeRef {
    NodeRef::Name("period".into())
}

/// What a value is, for units in headers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// length
    Length,
    /// angle in radians
    Angle,
    /// length / time
    Velocity,
    /// force
    Force,
    /// force x length, of a moment
    Moment,
    /// force x length, of an energy
    Energy,
    /// time
    Time,
    /// no unit
    Number,
}

/// How samples become one value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reduce {
    /// The last sample.
    #[default]
    Last,
    /// The largest sample.
    Max,
    /// The smallest sample.
    Min,
}

impl Reduce {
    /// The value after a new sample.
    pub fn fold(self, before: Option<f64>, sample: f64) -> f64 {
        match (self, before) {
            (Reduce::Max, Some(b)) => b.max(sample),
            (Reduce::Min, Some(b)) => b.min(sample),
            _ => sample,
        }
    }
}

/// A probe whose nodes are known to exist.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    read: Read,
    reduce: Reduce,
}

#[derive(Clone, Debug, PartialEq)]
enum Read {
    Position(NodeId, Component),
    Displacement(NodeId, Component),
    Velocity(NodeId, Component),
    Rotation(NodeId, Component),
    Reaction(Vec<NodeId>, Component),
    ReactionMoment(NodeId, Component),
    TotalReactionMoment(Vec<NodeId>, Component),
    SectionForce(String, usize, SectionTerm),
    Energy(EnergyTerm),
    ContactForce,
    MaxContactForce,
    MaxPenetration,
    TimeStep,
    DummyLength(NodeId),
    Distance([NodeId; 2]),
    Angle([NodeId; 4]),
}

impl ProbeSpec {
    /// Checks nodes, elements and rotations; errors name the field inside the probe.
    ///
    /// # Errors
    /// Nodes, kinds or elements that do not exist, rotations of a model without rotations.
    pub fn resolve(&self, model: &Model, registry: &Registry) -> Result<Probe, SpecError> {
        let node = |n: &NodeRef| n.resolve("node", model);
        let all = |list: &[NodeRef]| {
            let mut nodes = Vec::new();
            for (i, n) in list.iter().enumerate() {
                nodes.extend(n.resolve_all(&format!("nodes[{i}]"), model)?);
            }
            Ok::<_, SpecError>(nodes)
        };
        let pair = |path: &str, list: &[NodeRef]| match list {
            [a, b] => Ok([a.resolve(&format!("{path}[0]"), model)?, b.resolve(&format!("{path}[1]"), model)?]),
            _ => Err(SpecError::new(path, format!("two nodes are needed, {} given", list.len()))),
        };
        let rotations = || {
            if registry.elements.iter().any(|k| k.rotations && (k.count)(model) > 0) {
                return Ok(());
            }
            Err(SpecError::new("", "the nodes of this model have no rotations").help("rotations and moments need beams"))
        };
        let read = match self {
            ProbeSpec::Max(inner) | ProbeSpec::Min(inner) => {
                let reduce = if matches!(self, ProbeSpec::Max(_)) { Reduce::Max } else { Reduce::Min };
                return Ok(Probe { reduce, ..inner.resolve(model, registry)? });
            }
            ProbeSpec::Position { node: n, component } => Read::Position(node(n)?, *component),
            ProbeSpec::Displacement { node: n, component } => Read::Displacement(node(n)?, *component),
            ProbeSpec::Velocity { node: n, component } => Read::Velocity(node(n)?, *component),
            ProbeSpec::Rotation { node: n, component } => {
                rotations()?;
                Read::Rotation(node(n)?, *component)
            }
            ProbeSpec::Reaction { node: n, component } => Read::Reaction(vec![node(n)?], *component),
            ProbeSpec::ReactionMoment { node: n, component } => {
                rotations()?;
                Read::ReactionMoment(node(n)?, *component)
            }
            ProbeSpec::TotalReaction { nodes, component } => Read::Reaction(all(nodes)?, *component),
            ProbeSpec::TotalReactionMoment { nodes, component } => Read::TotalReactionMoment(all(nodes)?, *component),
            ProbeSpec::SectionForce { kind, element, term } => {
                let known = registry.elements.iter().map(|k| k.name);
                let found = registry.element(kind).ok_or_else(|| SpecError::unknown("kind", "element", kind, known))?;
                let count = (found.count)(model);
                if *element >= count {
                    return Err(SpecError::new("element", format!("element {element} of kind `{kind}` does not exist"))
                        .help(format!("the scene has {count} elements of this kind, numbered from 0")));
                }
                Read::SectionForce(kind.clone(), *element, *term)
            }
            ProbeSpec::Energy(term) => Read::Energy(*term),
            ProbeSpec::ContactForce => Read::ContactForce,
            ProbeSpec::MaxContactForce => Read::MaxContactForce,
            ProbeSpec::MaxPenetration => Read::MaxPenetration,
            ProbeSpec::TimeStep => Read::TimeStep,
            ProbeSpec::DummyLength { node: n } => {
                let id = node(n)?;
                if !model.nodes[id.row()].dummy {
                    return Err(SpecError::new("node", "this node is not a dummy node").help("only dummy nodes have a period vector"));
                }
                Read::DummyLength(id)
            }
            ProbeSpec::Distance { nodes } => Read::Distance(pair("nodes", nodes)?),
            ProbeSpec::Angle { from, to } => {
                let ([a, b], [c, d]) = (pair("from", from)?, pair("to", to)?);
                Read::Angle([a, b, c, d])
            }
        };
        Ok(Probe { read, reduce: Reduce::Last })
    }
}

impl Probe {
    /// What the value is.
    pub fn quantity(&self) -> Quantity {
        match &self.read {
            Read::Position(..) | Read::Displacement(..) | Read::DummyLength(_) | Read::Distance(_) => Quantity::Length,
            Read::Velocity(..) => Quantity::Velocity,
            Read::Rotation(..) | Read::Angle(_) => Quantity::Angle,
            Read::Reaction(..) | Read::ContactForce | Read::MaxContactForce => Quantity::Force,
            Read::ReactionMoment(..) | Read::TotalReactionMoment(..) => Quantity::Moment,
            Read::SectionForce(_, _, SectionTerm::N | SectionTerm::V) => Quantity::Force,
            Read::SectionForce(_, _, SectionTerm::M | SectionTerm::T) => Quantity::Moment,
            Read::Energy(_) => Quantity::Energy,
            Read::TimeStep => Quantity::Time,
            Read::MaxPenetration => Quantity::Number,
        }
    }

    /// How samples become the final value.
    pub fn reduce(&self) -> Reduce {
        self.reduce
    }

    /// The value now. What no system of the model keeps (contact forces without contact) is zero.
    pub fn evaluate(&self, world: &mut World) -> f64 {
        match &self.read {
            Read::Position(n, c) => c.of(position(world, *n)),
            Read::Displacement(n, c) => {
                let start = column::<InitialPosition>(world, *n).map_or(DVec3::ZERO, |x| x.0);
                c.of(position(world, *n) - start)
            }
            Read::Velocity(n, c) => c.of(column::<Velocity>(world, *n).map_or(DVec3::ZERO, |v| v.0)),
            Read::Rotation(n, c) => {
                let q = column::<Orientation>(world, *n).map_or(DQuat::IDENTITY, |q| q.0);
                // The shorter way round: q and -q are the same rotation.
                c.of(if q.w < 0.0 { -q } else { q }.to_scaled_axis())
            }
            Read::Reaction(nodes, c) => c.of(nodes.iter().map(|n| reaction(world, *n)).sum()),
            Read::ReactionMoment(n, c) => c.of(reaction_moment(world, *n)),
            Read::TotalReactionMoment(nodes, c) => {
                c.of(nodes.iter().map(|n| reaction_moment(world, *n) + position(world, *n).cross(reaction(world, *n))).sum())
            }
            Read::SectionForce(kind, element, term) => {
                let report = world.get_resource::<KindReports>().and_then(|r| r.0.iter().find(|k| k.name == kind));
                let force = report.map(|k| k.section_force).and_then(|f| f(world, *element)).unwrap_or_default();
                match term {
                    SectionTerm::N => force.axial,
                    SectionTerm::V => force.shear,
                    SectionTerm::M => force.bending,
                    SectionTerm::T => force.torsion,
                }
            }
            Read::Energy(term) => {
                let e = world.get_resource::<EnergyLedger>().copied().unwrap_or_default();
                match term {
                    EnergyTerm::Kinetic => e.kinetic,
                    EnergyTerm::Strain => e.strain,
                    EnergyTerm::ExternalWork => e.external_work,
                    EnergyTerm::Contact => e.contact,
                    EnergyTerm::Friction => e.friction,
                    EnergyTerm::Damping => e.damping,
                    EnergyTerm::Axial => e.axial,
                    EnergyTerm::Imbalance => e.imbalance(),
                }
            }
            Read::ContactForce => contacts(world).total_force,
            Read::MaxContactForce => contacts(world).max_force,
            Read::MaxPenetration => contacts(world).max_penetration_to_radius,
            Read::TimeStep => world.get_resource::<Clock>().map_or(0.0, |c| c.dt),
            Read::DummyLength(n) => position(world, *n).length(),
            Read::Distance([a, b]) => position(world, *a).distance(position(world, *b)),
            Read::Angle([a, b, c, d]) => {
                (position(world, *b) - position(world, *a)).angle_between(position(world, *d) - position(world, *c))
            }
        }
    }
}

fn column<T: bevy_ecs::component::Component + Copy>(world: &World, node: NodeId) -> Option<T> {
    let row = world.get_resource::<NodeRows>()?.of(node);
    let entity = *world.get_resource::<NodeEntities>()?.0.get(row)?;
    world.get::<T>(entity).copied()
}

/// Current position of a node (of a dummy node its period vector); zero for a node that is not there.
pub fn position(world: &World, node: NodeId) -> DVec3 {
    column::<Position>(world, node).map_or(DVec3::ZERO, |x| x.0)
}

/// A support carries what the other forces leave over: the node does not accelerate where it is held.
fn reaction(world: &World, node: NodeId) -> DVec3 {
    held(world, node, 0, column::<Force>(world, node).map_or(DVec3::ZERO, |f| -f.0))
}

fn reaction_moment(world: &World, node: NodeId) -> DVec3 {
    held(world, node, 3, column::<Moment>(world, node).map_or(DVec3::ZERO, |m| -m.0))
}

/// The components of `v` whose degrees of freedom, counted from `first`, are held.
fn held(world: &World, node: NodeId, first: usize, v: DVec3) -> DVec3 {
    let row = world.get_resource::<NodeRows>().map(|r| r.of(node));
    let dofs = world.get_resource::<HeldDofs>().and_then(|h| h.0.get(row?).copied()).unwrap_or_default();
    DVec3::from_array(std::array::from_fn(|k| if dofs[first + k] { v[k] } else { 0.0 }))
}

fn contacts(world: &World) -> ContactSummary {
    world.get_resource::<ContactSummary>().copied().unwrap_or_default()
}
