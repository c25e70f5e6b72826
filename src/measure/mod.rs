//! Measures: numbers read off a model, without any influence on it.
//!
//! | file | measures |
//! |---|---|
//! | `line.rs` | points of filaments, centre lines of tows continued through periodic faces |
//! | `crossings.rs` | cell length, angle and thickness of a braid |
//! | `topology.rs` | whether filaments have passed through each other |
//! | `stats.rs` | means with 95 % confidence intervals |
//! | `probe.rs`, `node_ref.rs` | named values of a scene, as it describes them |
//! | `reading.rs` | reading them from the world |
mod crossings;
mod line;
mod node_ref;
mod probe;
mod reading;
mod stats;
mod topology;

pub use crossings::{BraidMeasures, CrossingMeasure, CrossingOptions, Heights, braid_measures, measure_braid, measure_crossing};
pub use line::{TowLine, Trace, initial_traces, polyline_length, segment_distance, traces};
pub use node_ref::NodeRef;
pub(crate) use probe::inside_settings;
pub use probe::{Component, EnergyTerm, ProbeSpec, SectionTerm};
pub use reading::{Probe, Quantity, Reduce, position};
pub use stats::{Estimate, quantile};
pub use topology::{Passage, passages, signed_crossings};
