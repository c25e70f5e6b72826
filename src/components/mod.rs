//! What is stored: every piece of state of a model as a component of one entity.
//!
//! | entity | components | file |
//! |---|---|---|
//! | node | [`Position`], [`Velocity`], [`Force`], [`Mass`], [`InverseMass`], [`InitialPosition`]; with rotations also [`Orientation`], [`AngularVelocity`], [`Moment`], [`RotaryInertia`], [`InverseInertia`] | `node.rs` |
//! | element | its own type, [`Connectivity`], `EndForces` | `element.rs` |
//! | tie, equation, periodic pair | [`Tie`], [`Equation`], [`PeriodicPair`] | `constraint.rs` |
//! | load, prescribed motion | [`NodalLoad`], [`PrescribedMotion`] | `load.rs` |
//!
//! All nodes of a model, dummy nodes included, live in one table, spawned in the order of their
//! [`NodeId`]; the row of a node in its columns is its id.
mod constraint;
mod element;
mod load;
mod node;

pub use constraint::*;
pub use element::*;
pub use load::*;
pub use node::*;
