//! Quantities with a unit, as the specifications of the generators use them.
pub use crate::scene::units::{Angle, Length};
