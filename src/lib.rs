//! An entity-component-system simulator of dry-fibre braids and filament bundles.
#![forbid(unsafe_code)]
#![warn(missing_docs)]
extern crate self as braid_ecs;

pub mod advise;
pub mod amplitude;
pub mod assembly;
pub mod catalog;
pub mod checkpoint;
pub mod cli;
pub mod columns;
pub mod components;
pub mod element;
pub mod generate;
pub mod kit;
pub mod lane;
pub mod ledger;
pub mod measure;
pub mod memory;
pub mod model;
pub mod output;
pub mod parallel;
pub mod prelude;
pub mod registry;
pub mod run;
pub mod scene;
pub mod simulation;
pub mod state;
pub mod step;
#[cfg(debug_assertions)]
pub mod stepper;
pub mod study;
pub mod verify;

// The physics lives beside the engine, in a folder of its own that uses nothing but the prelude:
// what a first-party system can do, an outside plugin can do.
#[path = "../systems/mod.rs"]
pub mod systems;
