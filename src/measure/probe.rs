//! Probes: named values of a scene, read from the world at every sample.
//!
//! A [`ProbeSpec`] is what the scene says, with nodes by number or name; [`ProbeSpec::resolve`] checks it
//! against the model and gives a [`Probe`], which reads.
use super::node_ref::NodeRef;
use super::reading::{CustomRead, Probe, Read, Reduce};
use crate::model::Model;
use crate::registry::{ReadError, Registry, SpecError};
use crate::scene::units::{Ratio, Triple};
use crate::systems::surface::surface_specs;
use glam::DVec3;
use ron::value::RawValue;
use serde::{Deserialize, Serialize};

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
    pub(super) fn of(self, v: DVec3) -> f64 {
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
    /// Force of the filaments on a rigid surface.
    SurfaceForce {
        /// Name of the surface (default `mandrel`).
        #[serde(default = "mandrel")]
        surface: String,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Moment of the filaments on a rigid surface about the origin.
    SurfaceMoment {
        /// Name of the surface (default `mandrel`).
        #[serde(default = "mandrel")]
        surface: String,
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Momentum of all nodes.
    Momentum {
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Moment of momentum of all nodes about the origin, those of their rotary inertias included.
    AngularMomentum {
        /// Component (default `Magnitude`).
        #[serde(default)]
        component: Component,
    },
    /// Where a direction that is fixed in the cross-section of a node points now (no unit).
    Direction {
        /// The node.
        node: NodeRef,
        /// The direction at the start.
        axis: Triple<Ratio>,
        /// Component of its unit vector.
        component: Component,
    },
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
    /// A probe of a plugin.
    Custom {
        /// Its name (`lab.drag`).
        probe: String,
        /// What it asks for (default `()`).
        #[serde(default = "crate::scene::nothing")]
        settings: Box<RawValue>,
    },
    /// Largest value of a probe over all samples so far.
    Max(Box<ProbeSpec>),
    /// Smallest value of a probe over all samples so far.
    Min(Box<ProbeSpec>),
}

fn period() -> NodeRef {
    NodeRef::Name("period".into())
}

fn mandrel() -> String {
    "mandrel".into()
}

/// The path of a field of the settings of a plugin's probe or amplitude, seen from there.
pub(crate) fn inside_settings(path: &str) -> String {
    let dot = if path.is_empty() || path.starts_with('[') { "" } else { "." };
    format!("settings{dot}{path}")
}

/// Number of a surface by its name.
fn surface_number(name: &str, model: &Model) -> Result<usize, SpecError> {
    let specs = surface_specs(model);
    let found = specs.iter().position(|s| s.name == name);
    found.ok_or_else(|| SpecError::unknown("surface", "surface", name, specs.iter().map(|s| s.name.as_str())))
}

impl ProbeSpec {
    /// Name and settings of the probe of a plugin, if this is one, or the largest or smallest value of one.
    pub fn custom(&self) -> Option<(&str, &RawValue)> {
        match self {
            ProbeSpec::Custom { probe, settings } => Some((probe, settings)),
            ProbeSpec::Max(inner) | ProbeSpec::Min(inner) => inner.custom(),
            _ => None,
        }
    }

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
            ProbeSpec::Custom { probe, settings } => {
                let known = registry.probes.iter().map(|k| k.name);
                let kind = registry.probe(probe).ok_or_else(|| SpecError::unknown("probe", "probe of a plugin", probe, known))?;
                let read = (kind.read)(settings.get_ron(), model).map_err(|e| match e {
                    ReadError::Syntax(e) => SpecError::new("settings", e.to_string()),
                    ReadError::Whole(e) | ReadError::Entry { error: e, .. } => SpecError { path: inside_settings(&e.path), ..e },
                })?;
                Read::Custom(CustomRead { quantity: kind.quantity, read })
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
            ProbeSpec::SurfaceForce { surface, component } => Read::SurfaceForce(surface_number(surface, model)?, *component),
            ProbeSpec::SurfaceMoment { surface, component } => Read::SurfaceMoment(surface_number(surface, model)?, *component),
            ProbeSpec::Momentum { component } => Read::Momentum(*component),
            ProbeSpec::AngularMomentum { component } => Read::AngularMomentum(*component),
            ProbeSpec::Direction { node: n, axis, component } => {
                rotations()?;
                let axis = DVec3::from(*axis).try_normalize().ok_or_else(|| SpecError::new("axis", "a direction of no length"))?;
                Read::Direction(node(n)?, axis, *component)
            }
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
