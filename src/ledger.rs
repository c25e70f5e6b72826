//! Running totals and quality figures that systems fill and outputs read.
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};

/// Energies of the whole model since the start (force x length).
///
/// `external_work` is kept by the loads, `damping` by the integration, `axial` by the implicit
/// axial solve (what it dissipates), `contact` and `friction` by the contact systems; `kinetic`
/// and `strain` are evaluated at monitor steps.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergyLedger {
    /// Kinetic and strain energy at the start.
    pub initial: f64,
    /// Work of loads, prescribed motions and body forces.
    pub external_work: f64,
    /// Kinetic energy at the last monitor step, with velocities at the time of the positions.
    pub kinetic: f64,
    /// Strain energy at the last monitor step.
    pub strain: f64,
    /// Energy stored in contacts (normal and tangential springs) at the last monitor step.
    pub contact: f64,
    /// Energy dissipated by friction.
    pub friction: f64,
    /// Energy dissipated by mass damping, contact damping, bulk viscosity and velocity resets.
    pub damping: f64,
    /// Energy dissipated by the implicit axial solve.
    pub axial: f64,
}

impl EnergyLedger {
    /// Work that is not accounted for (force x length).
    pub fn imbalance(&self) -> f64 {
        self.initial + self.external_work - (self.kinetic + self.strain + self.contact + self.friction + self.damping + self.axial)
    }
    /// The largest term of the balance (force x length).
    pub fn largest(&self) -> f64 {
        [self.initial, self.external_work, self.kinetic, self.strain, self.contact].iter().fold(0.0f64, |m, e| m.max(e.abs()))
    }
    /// Imbalance relative to the largest term of the balance; zero while nothing has moved.
    pub fn balance_error(&self) -> f64 {
        let scale = self.largest();
        if scale > 0.0 { self.imbalance() / scale } else { 0.0 }
    }
}

/// State of the contacts at the last monitor step.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactSummary {
    /// Live records of the neighbour lists, filament to filament.
    pub records: usize,
    /// Those of them that may touch before all records are looked at again.
    pub near: usize,
    /// Records that carry a force.
    pub active: usize,
    /// Largest penetration over the smaller radius, filaments and surfaces; an overlap left free of force does not count.
    pub max_penetration_to_radius: f64,
    /// 99th percentile of the same over active contacts.
    pub p99_penetration_to_radius: f64,
    /// Sum of all normal forces (force).
    pub total_force: f64,
    /// Largest normal force (force).
    pub max_force: f64,
    /// Times the neighbour list was rebuilt.
    pub rebuilds: u64,
    /// Times all records of the list were looked at.
    pub looks: u64,
    /// Factor by which the contacts were made stiffer for a target penetration; zero without one.
    pub raised: f64,
}
