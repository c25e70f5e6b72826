//! Everything that a system or an element needs, from inside or outside the project.
pub use crate::amplitude::Amplitude;
pub use crate::assembly::{
    ActingStiffness, Incidence, KindReport, KindReports, StiffnessChanged, StiffnessSource, StiffnessSources, node_states,
};
pub use crate::columns::columns;
pub use crate::components::*;
pub use crate::element::*;
pub use crate::lane::{self, Lane, V3};
pub use crate::ledger::{ContactSummary, EnergyLedger};
pub use crate::measure::{NodeRef, Quantity};
pub use crate::model::*;
pub use crate::parallel;
pub use crate::registry::{Build, CustomAmplitude, CustomProbe, MeasureKind, Settings, SpecError};
pub use crate::simulation::{Failure, HeldDofs, Install, NodeEntities, NodeRows, Simulation};
pub use crate::state::Kept;
pub use crate::step::{Clock, StepSet};
pub use bevy_ecs::prelude::*;
pub use glam::{DMat3, DQuat, DVec3};
pub use serde::{Deserialize, Serialize};
pub use wide::f64x4;
