//! Reading probes from the world.
use super::probe::{Component as Of, EnergyTerm, SectionTerm};
use crate::assembly::KindReports;
use crate::components::*;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::registry::ReadProbe;
use crate::simulation::{HeldDofs, NodeEntities, NodeRows};
use crate::step::Clock;
use crate::systems::surface::SurfaceReactions;
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};

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
    /// force x time
    Momentum,
    /// force x length x time
    AngularMomentum,
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
    pub(super) read: Read,
    pub(super) reduce: Reduce,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Read {
    Position(NodeId, Of),
    Displacement(NodeId, Of),
    Velocity(NodeId, Of),
    Rotation(NodeId, Of),
    Reaction(Vec<NodeId>, Of),
    ReactionMoment(NodeId, Of),
    TotalReactionMoment(Vec<NodeId>, Of),
    SectionForce(String, usize, SectionTerm),
    Energy(EnergyTerm),
    ContactForce,
    MaxContactForce,
    MaxPenetration,
    SurfaceForce(usize, Of),
    SurfaceMoment(usize, Of),
    Momentum(Of),
    AngularMomentum(Of),
    Direction(NodeId, DVec3, Of),
    TimeStep,
    DummyLength(NodeId),
    Distance([NodeId; 2]),
    Angle([NodeId; 4]),
    Custom(CustomRead),
}

/// A probe of a plugin, checked against the model.
#[derive(Clone)]
pub(super) struct CustomRead {
    pub(super) quantity: Quantity,
    pub(super) read: ReadProbe,
}

impl PartialEq for CustomRead {
    fn eq(&self, other: &Self) -> bool {
        self.quantity == other.quantity && std::sync::Arc::ptr_eq(&self.read, &other.read)
    }
}

impl std::fmt::Debug for CustomRead {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CustomRead").field("quantity", &self.quantity).finish_non_exhaustive()
    }
}

impl Probe {
    /// What the value is.
    pub fn quantity(&self) -> Quantity {
        match &self.read {
            Read::Position(..) | Read::Displacement(..) | Read::DummyLength(_) | Read::Distance(_) => Quantity::Length,
            Read::Velocity(..) => Quantity::Velocity,
            Read::Rotation(..) | Read::Angle(_) => Quantity::Angle,
            Read::Reaction(..) | Read::ContactForce | Read::MaxContactForce | Read::SurfaceForce(..) => Quantity::Force,
            Read::ReactionMoment(..) | Read::TotalReactionMoment(..) | Read::SurfaceMoment(..) => Quantity::Moment,
            Read::SectionForce(_, _, SectionTerm::N | SectionTerm::V) => Quantity::Force,
            Read::SectionForce(_, _, SectionTerm::M | SectionTerm::T) => Quantity::Moment,
            Read::Energy(_) => Quantity::Energy,
            Read::TimeStep => Quantity::Time,
            Read::Momentum(_) => Quantity::Momentum,
            Read::AngularMomentum(_) => Quantity::AngularMomentum,
            Read::MaxPenetration | Read::Direction(..) => Quantity::Number,
            Read::Custom(custom) => custom.quantity,
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
            Read::SurfaceForce(k, c) => {
                c.of(world.get_resource::<SurfaceReactions>().and_then(|r| r.force.get(*k).copied()).unwrap_or_default())
            }
            Read::SurfaceMoment(k, c) => {
                c.of(world.get_resource::<SurfaceReactions>().and_then(|r| r.moment.get(*k).copied()).unwrap_or_default())
            }
            Read::Momentum(c) => c.of(momentum(world)),
            Read::AngularMomentum(c) => c.of(angular_momentum(world)),
            Read::Direction(n, axis, c) => c.of(column::<Orientation>(world, *n).map_or(DQuat::IDENTITY, |q| q.0) * *axis),
            Read::TimeStep => world.get_resource::<Clock>().map_or(0.0, |c| c.dt),
            Read::DummyLength(n) => position(world, *n).length(),
            Read::Distance([a, b]) => position(world, *a).distance(position(world, *b)),
            Read::Angle([a, b, c, d]) => {
                (position(world, *b) - position(world, *a)).angle_between(position(world, *d) - position(world, *c))
            }
            Read::Custom(custom) => (custom.read)(world),
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

/// Time from the positions to the velocities, which stand half a step later.
fn half_step(world: &World) -> f64 {
    world.get_resource::<Clock>().map_or(0.0, |c| 0.5 * c.dt_next)
}

fn momentum(world: &mut World) -> DVec3 {
    let back = half_step(world);
    let mut nodes = world.query::<(&Velocity, &Force, &InverseMass, &Mass)>();
    nodes.iter(world).map(|(v, f, w, m)| (v.0 - f.0 * w.0 * back) * m.0).sum()
}

fn angular_momentum(world: &mut World) -> DVec3 {
    let back = half_step(world);
    let mut nodes = world.query::<(&Position, &Velocity, &Force, &InverseMass, &Mass)>();
    let orbits: DVec3 = nodes.iter(world).map(|(x, v, f, w, m)| x.0.cross(v.0 - f.0 * w.0 * back) * m.0).sum();
    let mut nodes = world.query::<(&AngularVelocity, &Moment, &InverseInertia, &RotaryInertia)>();
    orbits + nodes.iter(world).map(|(o, m, w, j)| (o.0 - m.0 * w.0 * back) * j.0).sum::<DVec3>()
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
