//! The element interface: a kernel on one element; the loops over all of them are in `assembly.rs`.
use crate::components::Connectivity;
use crate::lane::{self, Lane};
use crate::model::Chain;
use crate::registry::{Build, SpecError};
use bevy_ecs::component::Mutable;
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use wide::f64x4;

/// What a kernel sees of a node. Kinds without rotations get the identity and zero spin.
#[derive(Clone, Copy, Debug)]
pub struct NodeState {
    /// Position (length).
    pub x: DVec3,
    /// Velocity at the last half step (length / time).
    pub v: DVec3,
    /// Rotation from the initial configuration.
    pub q: DQuat,
    /// Spatial angular velocity (1 / time).
    pub w: DVec3,
}

impl NodeState {
    /// A node at rest without rotation.
    pub fn at(x: DVec3) -> Self {
        NodeState { x, v: DVec3::ZERO, q: DQuat::IDENTITY, w: DVec3::ZERO }
    }
}

/// Where kernels read the nodes, by row: only what they ask for is loaded.
pub trait NodeColumns: Copy + Sync {
    /// Position (length).
    fn x(self, row: u32) -> DVec3;
    /// Velocity at the last half step (length / time).
    fn v(self, row: u32) -> DVec3;
    /// Rotation from the initial configuration.
    fn q(self, row: u32) -> DQuat;
    /// Spatial angular velocity (1 / time).
    fn w(self, row: u32) -> DVec3;
    /// All of it.
    #[inline(always)]
    fn state(self, row: u32) -> NodeState {
        NodeState { x: self.x(row), v: self.v(row), q: self.q(row), w: self.w(row) }
    }
}

impl NodeColumns for &[NodeState] {
    #[inline(always)]
    fn x(self, row: u32) -> DVec3 {
        self[row as usize].x
    }
    #[inline(always)]
    fn v(self, row: u32) -> DVec3 {
        self[row as usize].v
    }
    #[inline(always)]
    fn q(self, row: u32) -> DQuat {
        self[row as usize].q
    }
    #[inline(always)]
    fn w(self, row: u32) -> DVec3 {
        self[row as usize].w
    }
}

/// Force and moment on one end of an element.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force in global axes (force).
    pub force: DVec3,
    /// Moment about the node in global axes (force x length).
    pub moment: DVec3,
}

/// What an element puts on a node: a force, or a force and a moment.
pub trait NodeForce: Copy + Default + Send + Sync + 'static {
    /// True if moments are included: then the nodes need rotations.
    const ROTATIONS: bool;
    /// The force.
    fn force(&self) -> DVec3;
    /// The moment (zero for plain forces).
    fn moment(&self) -> DVec3;
}

impl NodeForce for DVec3 {
    const ROTATIONS: bool = false;
    #[inline]
    fn force(&self) -> DVec3 {
        *self
    }
    #[inline]
    fn moment(&self) -> DVec3 {
        DVec3::ZERO
    }
}

impl NodeForce for Wrench {
    const ROTATIONS: bool = true;
    #[inline]
    fn force(&self) -> DVec3 {
        self.force
    }
    #[inline]
    fn moment(&self) -> DVec3 {
        self.moment
    }
}

/// Mass and rotary inertia at one node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeMass {
    /// Mass.
    pub mass: f64,
    /// Rotary inertia (mass x length^2).
    pub inertia: f64,
}

/// Bound on the tangent stiffness that an element adds to one node: K <= diag(translation, rotation).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StiffnessBound {
    /// Per displacement (force / length).
    pub translation: f64,
    /// Per rotation (force x length).
    pub rotation: f64,
}

/// An axial spring that an element offers to the implicit axial solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxialSpring {
    /// Rest length (length).
    pub rest_length: f64,
    /// Axial stiffness EA (force).
    pub ea: f64,
}

/// Section forces of an element, for probes and frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SectionForce {
    /// Axial force N, positive in tension (force).
    pub axial: f64,
    /// Resultant shear force V (force).
    pub shear: f64,
    /// Largest bending moment M of the two ends (force x length).
    pub bending: f64,
    /// Torsional moment T (force x length).
    pub torsion: f64,
}

/// A kind of element with `N` nodes. Implement it, register it with
/// [`Simulation::add_element`](crate::simulation::Simulation::add_element), and the engine does the
/// reading, the loops, the assembly, the time step and the energy.
pub trait Element<const N: usize>: Component<Mutability = Mutable> + Serialize + DeserializeOwned + Clone + Send + Sync + 'static {
    /// The key in the scene file; names from outside carry a prefix (`lab.spring`).
    const NAME: &'static str;
    /// One sentence for `braid-ecs plugins` and messages.
    const ABOUT: &'static str;
    /// `DVec3` for elements on positions alone, [`Wrench`] for elements with rotations.
    type Force: NodeForce;
    /// One entry of the element's list in the scene.
    type Spec: DeserializeOwned;

    /// Adds the elements that one scene entry describes.
    ///
    /// # Errors
    /// What is wrong with the entry, naming the field.
    fn read(spec: Self::Spec, build: &mut Build<'_>) -> Result<(), SpecError>;

    /// Puts elements along a chain of nodes (filaments of a generator).
    ///
    /// # Errors
    /// By default: this kind cannot follow a filament.
    fn along(_chain: &Chain, _build: &mut Build<'_>) -> Result<(), SpecError> {
        Err(SpecError::new("", format!("element `{}` cannot follow a filament", Self::NAME)))
    }

    /// Internal force dE/dx (the engine subtracts it from the loads). May update history.
    fn internal_force(&mut self, nodes: [NodeState; N]) -> [Self::Force; N];

    /// Internal forces of many elements, by default one after the other. Kinds whose kernel is worth it take
    /// several at once ([`LaneElement`]).
    #[inline]
    fn internal_forces(elements: &mut [Self], rows: &[Connectivity<N>], nodes: impl NodeColumns, out: &mut [EndForces<Self, N>]) {
        for ((element, rows), out) in elements.iter_mut().zip(rows).zip(out) {
            out.0 = element.internal_force(std::array::from_fn(|end| nodes.state(rows.0[end])));
        }
    }

    /// Strain energy (force x length), without an axial spring that was released.
    fn strain_energy(&self, nodes: [NodeState; N]) -> f64;

    /// Bound on the tangent stiffness per node; `masses` are those of the whole nodes and may be
    /// used to balance displacements against rotations.
    fn stiffness_bound(&self, nodes: [NodeState; N], masses: [NodeMass; N]) -> [StiffnessBound; N];

    /// Lumped mass and physical rotary inertia that the element gives to each node.
    fn mass(&self) -> [NodeMass; N];

    /// Length L of [`RotaryInertiaRule::Scaled`](crate::model::RotaryInertiaRule): a node gets the
    /// rotary inertia factor x (its whole mass) x L^2. Zero for kinds without rotations.
    fn inertia_length(&self) -> f64 {
        0.0
    }

    /// The axial spring between the first two nodes that the implicit scheme may take over.
    fn axial_spring(&self) -> Option<AxialSpring> {
        None
    }

    /// Called when the implicit scheme has taken the axial spring: leave it out from now on.
    fn release_axial(&mut self) {}

    /// True if the element exerts no force any more, whatever happens: when all of a kind rest, they cost nothing.
    fn rests(&self) -> bool {
        false
    }

    /// Section forces, for output only.
    fn section_force(&self, _nodes: [NodeState; N]) -> SectionForce {
        SectionForce::default()
    }
}

/// A kind of element with a kernel for several at once.
pub trait LaneElement<const N: usize>: Element<N> {
    /// Internal forces of `L::WIDTH` elements with these nodes.
    fn at_once<L: Lane>(elements: &[Self], rows: &[Connectivity<N>], nodes: impl NodeColumns, out: &mut [EndForces<Self, N>]);
}

/// [`Element::internal_force`] of a kind with such a kernel.
#[inline(always)]
pub fn alone<E: LaneElement<N>, const N: usize>(element: &E, nodes: [NodeState; N]) -> [E::Force; N] {
    let mut out = [EndForces::default()];
    E::at_once::<f64>(std::slice::from_ref(element), &[in_order()], &nodes[..], &mut out);
    out[0].0
}

/// Rows 0, 1, ...: of an element whose nodes are given one after the other.
#[inline(always)]
pub fn in_order<const N: usize>() -> Connectivity<N> {
    Connectivity(std::array::from_fn(|k| k as u32))
}

/// [`Element::internal_forces`] of a kind with such a kernel: four at a time, and the rest alone.
#[inline(always)]
pub fn in_lanes<E: LaneElement<N>, const N: usize>(
    elements: &[E],
    rows: &[Connectivity<N>],
    nodes: impl NodeColumns,
    out: &mut [EndForces<E, N>],
) {
    for group in lane::groups(elements.len()) {
        let (some, rows, wide) = (&elements[group.clone()], &rows[group.clone()], group.len() == f64x4::WIDTH);
        if wide {
            E::at_once::<f64x4>(some, rows, nodes, &mut out[group]);
        } else {
            E::at_once::<f64>(some, rows, nodes, &mut out[group]);
        }
    }
}

/// Forces of one element on its ends, written by the element pass, gathered by the node pass.
#[derive(Component, Clone, Copy, Debug)]
pub struct EndForces<E: Element<N>, const N: usize>(pub [E::Force; N]);

impl<E: Element<N>, const N: usize> Default for EndForces<E, N> {
    fn default() -> Self {
        EndForces([E::Force::default(); N])
    }
}
