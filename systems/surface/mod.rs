//! Rigid surfaces: mandrels and floors, with friction.
//!
//! Nodes near a surface meet it by a signed distance ([`shape`]); a filament over a sharp edge
//! between two nodes meets it at the point nearest to the edge ([`kernel`]). The law is that between
//! filaments; or the surface holds them without penalty ([`kinematic`]). Surfaces rest.
pub mod kernel;
pub mod kinematic;
mod list;
pub mod records;
pub mod section;
pub mod shape;
mod spec;
mod systems;

pub use kernel::Surface;
pub use spec::{Enforcement, Mandrel, ShapeSpec, SurfaceSpec, Surfaces, surface_specs};
pub use systems::{SurfaceReactions, SurfaceSet, plugin, raise_stiffness, surface_contacts};
