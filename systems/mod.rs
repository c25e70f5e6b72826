//! The physics: one file per system, all written against the prelude.
use braid_ecs::prelude::*;

pub mod adaptive_damping;
pub mod axial_implicit;
pub mod beam;
pub mod bending;
pub mod boundary;
pub mod constraint;
pub mod contact;
pub mod energy;
pub mod integration;
pub mod load;
pub mod surface;
pub mod time_step;
pub mod truss;
pub mod units;
pub mod watch;

/// The first-party systems. The order is the order of the sums: loads, elements, then the rest
/// inside each set of the step.
pub fn default_plugins(sim: &mut Simulation) {
    load::plugin(sim);
    truss::plugin(sim);
    beam::plugin(sim);
    bending::plugin(sim);
    contact::plugin(sim);
    surface::plugin(sim);
    boundary::inertia_plugin(sim);
    constraint::plugin(sim);
    integration::plugin(sim);
    boundary::plugin(sim);
    watch::plugin(sim);
    axial_implicit::plugin(sim);
    surface::kinematic::plugin(sim);
    boundary::work_plugin(sim);
    energy::plugin(sim);
    adaptive_damping::plugin(sim);
    time_step::plugin(sim);
    units::plugin(sim);
}
