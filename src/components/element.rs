//! What every element has besides its own type.
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};

/// Rows of the nodes that an element joins, after condensation of the ties.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Connectivity<const N: usize>(pub [u32; N]);

impl<const N: usize> Serialize for Connectivity<N> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0)
    }
}

/// Axial spring taken out of an element by the implicit solve: N = ea (l / rest_length - 1).
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct AxialBar {
    /// Rows of the two nodes.
    pub rows: [u32; 2],
    /// Rest length (length).
    pub rest_length: f64,
    /// Axial stiffness EA (force).
    pub ea: f64,
}

/// Tension of an axial bar at the end of the step (force, positive in tension).
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tension(pub f64);
