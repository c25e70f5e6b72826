//! A mechanical model as plain data: what a scene becomes before it is spawned into the world.
//!
//! Readers and generators fill a [`Model`]; [`Simulation::build`](crate::simulation::Simulation::build)
//! spawns it. Nothing here knows files or systems. All quantities are in the consistent unit
//! system of the scene.
use crate::amplitude::Amplitude;
use crate::components::*;
use glam::{DQuat, DVec3};
use std::any::{Any, TypeId};
use std::collections::BTreeMap;

/// A node before it is spawned.
#[derive(Clone, Debug)]
pub struct Node {
    /// Initial position (length); of a dummy node the initial period vector.
    pub position: DVec3,
    /// Initial velocity (length / time).
    pub velocity: DVec3,
    /// Initial angular velocity (1 / time).
    pub angular_velocity: DVec3,
    /// Mass in addition to what the elements bring (mass).
    pub added_mass: f64,
    /// Rotary inertia in addition to what the elements bring (mass x length^2).
    pub added_inertia: f64,
    /// True for dummy nodes.
    pub dummy: bool,
}

impl Node {
    /// A node at rest.
    pub fn at(position: DVec3) -> Self {
        Node { position, velocity: DVec3::ZERO, angular_velocity: DVec3::ZERO, added_mass: 0.0, added_inertia: 0.0, dummy: false }
    }
}

/// A chain of nodes with a round contact surface: what contact, pictures and braid measures see.
#[derive(Clone, Debug)]
pub struct Filament {
    /// Nodes in order, at least two. The last node of a filament that runs through a periodic
    /// face is the image of the first node of its successor.
    pub nodes: Vec<NodeId>,
    /// Contact radius (length).
    pub radius: f64,
    /// Tow number, the same for all filaments of a tow.
    pub tow: usize,
    /// Number of the filament inside its tow.
    pub index: usize,
    /// True if the last node is also the first one (a ring without a periodic face).
    pub closed: bool,
    /// False for filaments that are only drawn and measured, not checked for contact.
    pub contact: bool,
}

/// Linear elastic isotropic material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Young's modulus E (stress).
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Density (mass / length^3).
    pub density: f64,
}

/// Stiffness and inertia of a cross-section per unit length, about its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Axial stiffness EA (force).
    pub ea: f64,
    /// Bending stiffness about the second and third section axis (force x length^2).
    pub ei: [f64; 2],
    /// Torsional stiffness GJ (force x length^2).
    pub gj: f64,
    /// Shear stiffness GA (force); infinite for the shear-rigid (Bernoulli) beam.
    pub ga: f64,
    /// Mass per unit length (mass / length).
    pub mass: f64,
    /// Polar mass moment per unit length, rho I_p (mass x length).
    pub inertia: f64,
}

impl Section {
    /// A round section with three radii: `axial` gives EA and the mass, `bending` gives EI and GJ.
    pub fn round(material: &Material, axial: f64, bending: f64) -> Self {
        let area = std::f64::consts::PI * axial * axial;
        let inertia = std::f64::consts::FRAC_PI_4 * bending.powi(4);
        let ei = material.young * inertia;
        let shear = material.young / (2.0 * (1.0 + material.poisson));
        Section {
            ea: material.young * area,
            ei: [ei, ei],
            gj: shear * 2.0 * inertia,
            ga: f64::INFINITY,
            mass: material.density * area,
            inertia: material.density * area * 0.5 * axial * axial,
        }
    }
}

/// The shape in which a beam is free of stress.
#[derive(Clone, Copy, Debug, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub enum NaturalShape {
    /// The initial shape, curvature and twist included.
    #[default]
    AsBuilt,
    /// Straight, but twisted by `twist` (radian / length) against the initial shape.
    Straight {
        /// Initial twist of the material about the axis (radian / length). Default 0.
        #[serde(default, deserialize_with = "crate::scene::units::finite")]
        twist: f64,
    },
}

/// A run of nodes that one kind of element follows, handed to [`Element::along`](crate::element::Element::along).
#[derive(Clone, Debug)]
pub struct Chain {
    /// Nodes in order.
    pub nodes: Vec<NodeId>,
    /// Section of every element.
    pub section: Section,
    /// Stress-free shape.
    pub natural: NaturalShape,
    /// Direction of the second section axis; `None` lets the element choose.
    pub orientation: Option<DVec3>,
    /// True if the last node is joined to the first by one more element.
    pub closed: bool,
}

impl Chain {
    /// The node pairs of the elements, in order.
    pub fn segments(&self) -> Vec<[NodeId; 2]> {
        let mut pairs: Vec<_> = self.nodes.windows(2).map(|w| [w[0], w[1]]).collect();
        if self.closed {
            pairs.push([self.nodes[self.nodes.len() - 1], self.nodes[0]]);
        }
        pairs
    }
}

/// Displacement and rotation components held at zero.
#[derive(Clone, Debug)]
pub struct Fixed {
    /// The node.
    pub node: NodeId,
    /// The degrees of freedom held.
    pub dofs: Vec<Dof>,
}

/// How axial forces are integrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AxialScheme {
    /// Central differences; the axial wave limits the time step.
    Explicit,
    /// Tensions at the end of the step from one tridiagonal solve per chain.
    #[default]
    Implicit,
}

/// Rotary inertia of the nodes of beams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RotaryInertiaRule {
    /// J = factor x (mass of the node) x (length of its longest beam element)^2. Free for an equilibrium.
    Scaled(f64),
    /// J = rho I_p l / 2 per element end (or the section's own value): for torsional dynamics.
    Physical,
}

/// Velocity-proportional damping and its kin.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Damping {
    /// No damping.
    #[default]
    None,
    /// Mass damping f = -alpha m v with the given alpha (1 / time).
    Mass(f64),
    /// Mass damping with the given alpha until the motion has calmed down, then as its slowest mode needs it (1 / time);
    /// without one, as the slowest mode of the motion needs it from the first step on.
    Adaptive(Option<f64>),
    /// All velocities set to zero at every peak of the kinetic energy.
    Kinetic,
}

/// When a run ends.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Stop {
    /// End time.
    pub time: Option<f64>,
    /// Number of steps.
    pub steps: Option<u64>,
    /// Steady state, if wanted.
    pub steady: Option<Steady>,
}

/// Steady state: the watched quantity changes by less than `change` (relative) per `interval`,
/// `repeats` times in a row, and not before `earliest`.
#[derive(Clone, Debug, PartialEq)]
pub struct Steady {
    /// What is watched: the length of this dummy node's period vector, or the largest speed ratio if `None`.
    pub dummy: Option<NodeId>,
    /// Interval between two looks (time); by default the natural time that adaptive damping has found.
    pub interval: Option<f64>,
    /// Largest relative change per interval.
    pub change: f64,
    /// Looks in a row.
    pub repeats: u32,
    /// Not before this time.
    pub earliest: f64,
    /// Largest kinetic energy relative to the strain energy at the end; infinite to ignore.
    pub kinetic_to_strain: f64,
}

/// Time integration settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Integration {
    /// Axial scheme.
    pub axial: AxialScheme,
    /// Safety factor on the stable time step, below 1.
    pub safety: f64,
    /// Time step given by the scene (time); refused above the stable limit.
    pub dt: Option<f64>,
    /// Rotary inertia of beam nodes.
    pub rotary_inertia: RotaryInertiaRule,
    /// Least shear flexibility 12 EI / (GA L^2) of beams, for longer time steps (0: that of the section alone).
    pub shear_flexibility: f64,
    /// Longest step of the implicit axial scheme over the stable step of the explicit one: Courant number of the axial wave.
    pub courant: f64,
    /// Damping.
    pub damping: Damping,
    /// Linear bulk viscosity coefficient of explicit axial elements (0.06 is usual, 0 is none).
    pub bulk_viscosity: f64,
    /// Steps between two looks at energies, limits and finiteness.
    pub monitor_every: u32,
}

impl Default for Integration {
    fn default() -> Self {
        Integration {
            axial: AxialScheme::Implicit,
            safety: 0.9,
            dt: None,
            rotary_inertia: RotaryInertiaRule::Scaled(1.0),
            shear_flexibility: 0.0,
            courant: 20.0,
            damping: Damping::None,
            bulk_viscosity: 0.0,
            monitor_every: 64,
        }
    }
}

/// What a sound run never shows; see `systems/watch.rs`. Infinite (`time_step`: zero) where it is not looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Watch {
    /// Largest change of the length of an element with axial stiffness over its initial length.
    pub strain: f64,
    /// Largest rotation of a node in one step (radian).
    pub rotation: f64,
    /// Largest work that is not accounted for over the largest energy.
    pub balance: f64,
    /// Smallest time step over that of the settled run.
    pub time_step: f64,
}

impl Default for Watch {
    fn default() -> Self {
        Watch { strain: 0.5, rotation: 0.5, balance: 0.5, time_step: 1e-3 }
    }
}

/// A uniform acceleration of all masses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyForce {
    /// Acceleration (length / time^2).
    pub acceleration: DVec3,
    /// Index into the amplitudes.
    pub amplitude: usize,
}

/// The whole model.
#[derive(Default)]
pub struct Model {
    /// Name shown in outputs.
    pub name: String,
    /// Nodes; index = [`NodeId`].
    pub nodes: Vec<Node>,
    /// Names of nodes, for messages and probes.
    pub node_names: BTreeMap<String, NodeId>,
    /// Filaments.
    pub filaments: Vec<Filament>,
    /// Ties.
    pub ties: Vec<Tie>,
    /// Linear equations.
    pub equations: Vec<Equation>,
    /// Periodic pairs.
    pub periodic: Vec<PeriodicPair>,
    /// Fixed degrees of freedom.
    pub fixed: Vec<Fixed>,
    /// Prescribed motions.
    pub prescribed: Vec<PrescribedMotion>,
    /// Nodal loads.
    pub loads: Vec<NodalLoad>,
    /// Gravity and the like.
    pub body_force: Option<BodyForce>,
    /// Amplitudes; index 0 is always the constant 1.
    pub amplitudes: Vec<Amplitude>,
    /// Time integration.
    pub integration: Integration,
    /// Stop criteria.
    pub stop: Stop,
    /// When the run is given up.
    pub watch: Watch,
    elements: BTreeMap<&'static str, Box<dyn Any + Send + Sync>>,
    sections: Vec<(TypeId, Box<dyn Any + Send + Sync>)>,
}

impl Model {
    /// An empty model with the constant amplitude at index 0.
    pub fn new(name: impl Into<String>) -> Self {
        Model { name: name.into(), amplitudes: vec![Amplitude::Constant], ..Default::default() }
    }

    /// Adds a node at rest and returns its id.
    pub fn add_node(&mut self, position: DVec3) -> NodeId {
        self.nodes.push(Node::at(position));
        NodeId(self.nodes.len() as u32 - 1)
    }

    /// Adds an amplitude and returns its index.
    pub fn add_amplitude(&mut self, amplitude: Amplitude) -> usize {
        self.amplitudes.push(amplitude);
        self.amplitudes.len() - 1
    }

    /// Holds degrees of freedom of a node.
    pub fn fix(&mut self, node: NodeId, dofs: &[Dof]) {
        self.fixed.push(Fixed { node, dofs: dofs.to_vec() });
    }

    /// The elements of one kind, in the order in which they were added.
    pub fn elements<E: crate::element::Element<N>, const N: usize>(&self) -> &[(E, [NodeId; N])] {
        self.elements.get(E::NAME).map_or(&[], |b| b.downcast_ref::<Vec<(E, [NodeId; N])>>().expect("one type per element name"))
    }

    /// Adds an element of kind `E`.
    pub fn add_element<E: crate::element::Element<N>, const N: usize>(&mut self, element: E, nodes: [NodeId; N]) {
        self.elements
            .entry(E::NAME)
            .or_insert_with(|| Box::new(Vec::<(E, [NodeId; N])>::new()))
            .downcast_mut::<Vec<(E, [NodeId; N])>>()
            .expect("one type per element name")
            .push((element, nodes));
    }

    /// Stores a section of a plugin (its settings, read from the scene).
    pub fn insert<T: Any + Send + Sync>(&mut self, section: T) {
        let id = TypeId::of::<T>();
        self.sections.retain(|(t, _)| *t != id);
        self.sections.push((id, Box::new(section)));
    }

    /// A section stored with [`insert`](Self::insert).
    pub fn get<T: Any + Send + Sync>(&self) -> Option<&T> {
        self.sections.iter().find(|(t, _)| *t == TypeId::of::<T>()).map(|(_, b)| b.downcast_ref().expect("keyed by type"))
    }

    /// Follows the ties from a node to the one that carries its motion.
    pub fn host(&self, node: NodeId) -> NodeId {
        let mut n = node;
        for _ in 0..=self.ties.len() {
            match self.ties.iter().find(|t| t.embedded == n) {
                Some(t) => n = t.host,
                None => return n,
            }
        }
        n
    }

    /// Rotation that takes the global x axis to `direction` (identity for zero vectors).
    pub fn axis_rotation(direction: DVec3) -> DQuat {
        DQuat::from_rotation_arc(DVec3::X, direction.normalize_or(DVec3::X))
    }
}
