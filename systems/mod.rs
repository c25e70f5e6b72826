//! The physics: one file per system, all written against the prelude.
use braid_ecs::prelude::*;

pub mod contact;

/// The first-party systems; this order is the order of assembly.
pub fn default_plugins(_sim: &mut Simulation) {}
