//! The time step: this is the whole method, in the order in which it runs.
//!
//! ```text
//!  1 Kinematics      x += dt v ; rotate triads                          systems/integration.rs
//!  2 Constraints     prescribed motion; dependents follow independents  systems/boundary.rs, constraint.rs
//!  3 ContactSearch   refit the BVH when the skin is used up             systems/contact/search.rs
//!  4 ElementForces   every kind of element, in parallel                 src/assembly.rs -> systems/truss.rs, beam.rs, bending.rs
//!  5 Assembly        f = loads - internal, in registration order        systems/load.rs, src/assembly.rs
//!  6 ContactForces   penalty and friction over sorted records           systems/contact/, systems/surface/
//!  7 Condensation    forces of dependents to independents (T^t f)       systems/boundary.rs, constraint.rs
//!  8 Dynamics        v += dt f/m ; damping ; implicit axial tension ;   systems/integration.rs, axial_implicit/,
//!                    kinematic surfaces                                 surface/kinematic.rs
//!  9 Monitor         energies, watch, adaptive damping, next dt         systems/energy.rs, watch.rs, adaptive_damping.rs, time_step.rs
//! 10 Output          samples of histories and probes                    src/output/
//! ```
//!
//! Central differences: x is known at t_n, v at the half steps. The step starts by moving to the
//! next position with the known velocity, computes every force there, and ends with the velocity
//! of the following half step. Variable steps use (dt_before + dt_after) / 2 in the kick.
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::ScheduleLabel;
use serde::{Deserialize, Serialize};

/// The sets of one time step, in order.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum StepSet {
    /// Positions and orientations move with the half-step velocities.
    Kinematics,
    /// Prescribed motions; dependent nodes follow their independents.
    Constraints,
    /// Neighbour lists.
    ContactSearch,
    /// Internal forces of the elements, each in its own component.
    ElementForces,
    /// Nodal sums: loads minus internal forces.
    Assembly,
    /// Contact and friction.
    ContactForces,
    /// Forces of dependents to independents.
    Condensation,
    /// New velocities.
    Dynamics,
    /// Energies, checks, the next time step.
    Monitor,
    /// Samples of histories and probes.
    Output,
}

impl StepSet {
    /// All sets in the order of the step.
    pub const ORDER: [StepSet; 10] = [
        StepSet::Kinematics,
        StepSet::Constraints,
        StepSet::ContactSearch,
        StepSet::ElementForces,
        StepSet::Assembly,
        StepSet::ContactForces,
        StepSet::Condensation,
        StepSet::Dynamics,
        StepSet::Monitor,
        StepSet::Output,
    ];
}

/// The schedule of one time step.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct TimeStep;

/// Time and time step.
#[derive(Resource, Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Clock {
    /// Time of the current positions.
    pub time: f64,
    /// Completed steps.
    pub step: u64,
    /// Step with which the positions have moved last (zero in the starting pass).
    pub dt: f64,
    /// Step with which the positions move next.
    pub dt_next: f64,
    /// Step wanted from then on; set by the time-step monitor.
    pub dt_target: f64,
    /// Stable limit found last, without the safety factor (time).
    pub dt_limit: f64,
    /// What sets the limit.
    pub limited_by: String,
    /// True if all velocities have been set to zero in this step: the next kick is the first half of one, as at the start.
    #[serde(skip)]
    pub at_rest: bool,
}

impl Clock {
    /// Step with which the velocities are kicked: the mean of the steps before and after, from rest half of the one after.
    #[inline]
    pub fn kick(&self) -> f64 {
        if self.at_rest { 0.5 * self.dt_next } else { 0.5 * (self.dt + self.dt_next) }
    }
}
