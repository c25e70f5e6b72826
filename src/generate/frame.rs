//! Placement and end conditions shared by bundle and strand.
use super::tow::finite;
use crate::components::{Dof, NodeId};
use crate::registry::{Build, SpecError};
use crate::scene::units::Length;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// What holds the nodes at one end.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum EndCondition {
    /// Nothing.
    #[default]
    Free,
    /// All displacements are fixed.
    Pinned,
    /// All displacements and rotations are fixed.
    Clamped,
    /// The listed degrees of freedom are fixed.
    Held(Vec<Dof>),
}

impl EndCondition {
    /// The degrees of freedom held.
    pub fn dofs(&self) -> Vec<Dof> {
        match self {
            EndCondition::Free => Vec::new(),
            EndCondition::Pinned => Dof::ALL[..3].to_vec(),
            EndCondition::Clamped => Dof::ALL.to_vec(),
            EndCondition::Held(dofs) => dofs.clone(),
        }
    }

    pub(crate) fn hold(&self, nodes: &[NodeId], build: &mut Build<'_>) {
        let dofs = self.dofs();
        if !dofs.is_empty() {
            for n in nodes {
                build.model.fix(*n, &dofs);
            }
        }
    }
}

/// Origin and axis of a structure that is generated along z.
pub(crate) struct Frame {
    origin: DVec3,
    turn: DQuat,
}

impl Frame {
    pub(crate) fn new(prefix: &str, origin: [Length; 3], axis: [f64; 3]) -> Result<Self, SpecError> {
        for x in origin {
            finite(prefix, "origin", x.0)?;
        }
        let axis = DVec3::from_array(axis).try_normalize().filter(|a| a.is_finite()).ok_or_else(|| {
            SpecError::new(format!("{prefix}.axis"), format!("axis {axis:?} has no direction")).help("[0, 0, 1] is along z")
        })?;
        // Exactly nothing is turned for the usual axis.
        let turn = if axis == DVec3::Z { DQuat::IDENTITY } else { DQuat::from_rotation_arc(DVec3::Z, axis) };
        Ok(Frame { origin: DVec3::from_array(origin.map(|x| x.0)), turn })
    }

    pub(crate) fn point(&self, local: DVec3) -> DVec3 {
        self.origin + self.turn * local
    }

    pub(crate) fn direction(&self, local: DVec3) -> DVec3 {
        self.turn * local
    }
}

/// Names the first and last nodes `name.0.start`, `name.0.end`, `name.1.start`, ...
pub(crate) fn name_ends(name: &str, starts: &[NodeId], ends: &[NodeId], build: &mut Build<'_>) -> Result<(), SpecError> {
    for (what, nodes) in [("start", starts), ("end", ends)] {
        for (i, n) in nodes.iter().enumerate() {
            let key = format!("{name}.{i}.{what}");
            if build.model.node_names.insert(key.clone(), *n).is_some() {
                return Err(SpecError::new("name", format!("a node called `{key}` exists already"))
                    .help("give every bundle, strand and polyline a name of its own"));
            }
        }
    }
    Ok(())
}
