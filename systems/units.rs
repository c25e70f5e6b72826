//! Units of what nodes, elements and the engine store, for whoever looks at it.
use crate::systems::beam::Beam;
use crate::systems::bending::Bending;
use crate::systems::contact::records::{LineForce, LineState, PointForce, PointState};
use crate::systems::surface::records::{EdgeState, SurfaceState};
use crate::systems::truss::Truss;
use braid_ecs::prelude::*;

/// Names the dimensions of all fields that have one.
pub fn plugin(sim: &mut Simulation) {
    sim.add_units::<Clock>(&[("time", "time"), ("dt", "time"), ("dt_next", "time"), ("dt_target", "time"), ("dt_limit", "time")]);
    sim.add_units::<EnergyLedger>(&[
        ("initial", "energy"),
        ("external_work", "energy"),
        ("kinetic", "energy"),
        ("strain", "energy"),
        ("contact", "energy"),
        ("friction", "energy"),
        ("damping", "energy"),
        ("axial", "energy"),
    ]);
    sim.add_units::<Position>(&[("", "length")]);
    sim.add_units::<InitialPosition>(&[("", "length")]);
    sim.add_units::<Velocity>(&[("", "length / time")]);
    sim.add_units::<Force>(&[("", "force")]);
    sim.add_units::<Mass>(&[("", "mass")]);
    sim.add_units::<InverseMass>(&[("", "1 / mass")]);
    sim.add_units::<AngularVelocity>(&[("", "1 / time")]);
    sim.add_units::<Moment>(&[("", "force x length")]);
    sim.add_units::<RotaryInertia>(&[("", "mass x length^2")]);
    sim.add_units::<InverseInertia>(&[("", "1 / (mass x length^2)")]);
    sim.add_units::<Tension>(&[("", "force")]);
    sim.add_units::<Truss>(&[
        ("rest_length", "length"),
        ("ea", "force"),
        ("full_ea", "force"),
        ("mass", "mass / length"),
        ("viscosity", "force x time / length"),
    ]);
    sim.add_units::<Beam>(&[
        ("rest_length", "length"),
        ("ea", "force"),
        ("full_ea", "force"),
        ("stiffness", "force x length"),
        ("phi0", "rad"),
        ("stiffest", "force x length^2"),
        ("mass", "mass / length"),
        ("polar", "mass x length"),
    ]);
    sim.add_units::<Bending>(&[("stiffness", "force x length"), ("length", "length")]);
    sim.add_units::<LineState>(&[("slip", "length"), ("damper", "force"), ("offset", "length"), ("stiffness", "force / length")]);
    sim.add_units::<PointState>(&[
        ("slip", "length"),
        ("damper", "force"),
        ("offset", "length"),
        ("stiffness", "force / length"),
        ("overlap", "length"),
    ]);
    sim.add_units::<LineForce>(&[("force", "force"), ("turn", "force")]);
    sim.add_units::<PointForce>(&[("force", "force"), ("turn", "force")]);
    sim.add_units::<SurfaceState>(&[("slip", "length"), ("damper", "force"), ("offset", "length"), ("hold.force", "force")]);
    sim.add_units::<EdgeState>(&[
        ("slip", "length"),
        ("damper", "force"),
        ("offset", "length"),
        ("stiffness", "force / length"),
        ("overlap", "length"),
        ("hold.force", "force"),
    ]);
}
