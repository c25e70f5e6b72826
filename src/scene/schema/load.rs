//! Supports, prescribed motions, loads and their course in time.
use super::NodeRef;
use crate::components::Dof;
use crate::scene::units::*;
use ron::value::RawValue;
use serde::{Deserialize, Serialize};

/// A degree of freedom or a group of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub enum DofWord {
    /// Displacement along x.
    Ux,
    /// Displacement along y.
    Uy,
    /// Displacement along z.
    Uz,
    /// Rotation about x.
    Rx,
    /// Rotation about y.
    Ry,
    /// Rotation about z.
    Rz,
    /// All three displacements.
    U,
    /// All three rotations.
    R,
    /// All six.
    All,
}

impl DofWord {
    /// The degrees of freedom meant.
    pub fn dofs(self) -> &'static [Dof] {
        match self {
            DofWord::Ux => &[Dof::Ux],
            DofWord::Uy => &[Dof::Uy],
            DofWord::Uz => &[Dof::Uz],
            DofWord::Rx => &[Dof::Rx],
            DofWord::Ry => &[Dof::Ry],
            DofWord::Rz => &[Dof::Rz],
            DofWord::U => &Dof::ALL[..3],
            DofWord::R => &Dof::ALL[3..],
            DofWord::All => &Dof::ALL,
        }
    }
}

/// Degrees of freedom held at zero.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct FixedSpec {
    /// The nodes.
    pub nodes: Vec<NodeRef>,
    /// What is held: `Ux` ... `Rz`, `U` (displacements), `R` (rotations), `All`.
    pub dofs: Vec<DofWord>,
}

/// Prescribed displacements and rotations: amplitude(t) x value.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PrescribedSpec {
    /// The nodes.
    pub nodes: Vec<NodeRef>,
    /// Displacement along x (length). Default free.
    #[serde(default)]
    pub ux: Option<Length>,
    /// Displacement along y (length). Default free.
    #[serde(default)]
    pub uy: Option<Length>,
    /// Displacement along z (length). Default free.
    #[serde(default)]
    pub uz: Option<Length>,
    /// Rotation about x (degrees). Default free.
    #[serde(default)]
    pub rx: Option<Angle>,
    /// Rotation about y (degrees). Default free.
    #[serde(default)]
    pub ry: Option<Angle>,
    /// Rotation about z (degrees). Default free.
    #[serde(default)]
    pub rz: Option<Angle>,
    /// Name of the amplitude. Default constant 1.
    #[serde(default)]
    pub amplitude: Option<String>,
}

impl PrescribedSpec {
    /// The prescribed values by degree of freedom.
    pub fn values(&self) -> impl Iterator<Item = (Dof, f64)> {
        let lengths = [self.ux, self.uy, self.uz].map(|v| v.map(f64::from));
        let angles = [self.rx, self.ry, self.rz].map(|v| v.map(f64::from));
        Dof::ALL.into_iter().zip(lengths.into_iter().chain(angles)).filter_map(|(d, v)| v.map(|v| (d, v)))
    }
}

/// Force along the period vector of a periodic structure, raised smoothly. It sets the time scale
/// tF = sqrt(mass x stroke / force) of automatic damping and of the steady state.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PeriodLoadSpec {
    /// Force along the period vector (force), above zero to pull.
    pub force: Force,
    /// The dummy node. Default: the only one.
    #[serde(default)]
    pub node: Option<NodeRef>,
    /// Duration of the rise from zero (time). Default 2 tF.
    #[serde(default)]
    pub rise: Option<Time>,
    /// Way that the force travels, only for the time scale (length). Default for a braid: arc length of
    /// a tow less length of the cell; else a tenth of the period.
    #[serde(default)]
    pub stroke: Option<Length>,
}

/// Force and moment on nodes: amplitude(t) x value.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct NodalLoadSpec {
    /// The nodes; each gets the whole of it.
    pub nodes: Vec<NodeRef>,
    /// Force in global axes (force). Default zero.
    #[serde(default)]
    pub force: Triple<Force>,
    /// Moment in global axes (force x length). Default zero.
    #[serde(default)]
    pub moment: Triple<Moment>,
    /// True: force and moment turn with the node. Default false.
    #[serde(default)]
    pub follower: bool,
    /// Name of the amplitude. Default constant 1.
    #[serde(default)]
    pub amplitude: Option<String>,
}

/// Uniform acceleration of all masses.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct GravitySpec {
    /// Acceleration (length / time^2).
    pub acceleration: Triple<Acceleration>,
    /// Name of the amplitude. Default constant 1.
    #[serde(default)]
    pub amplitude: Option<String>,
}

/// A function of time.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub enum AmplitudeSpec {
    /// Always 1.
    Constant,
    /// From 0 to 1 with zero velocity and acceleration at both ends.
    SmoothStep {
        /// Duration (time), above zero.
        rise: Time,
    },
    /// From 0 to 1 in a straight line.
    Ramp {
        /// Duration (time), above zero.
        rise: Time,
    },
    /// Straight lines between points, constant outside.
    Table(Vec<(Time, Ratio)>),
    /// sin(2 pi f t + phase).
    Sine {
        /// Frequency (1 / time).
        frequency: Rate,
        /// Phase (degrees). Default 0.
        #[serde(default)]
        phase: Angle,
    },
    /// An amplitude of a plugin.
    Custom {
        /// Its name (`lab.pulse`).
        amplitude: String,
        /// What it is made of (default `()`).
        #[serde(default = "crate::scene::nothing")]
        settings: Box<RawValue>,
    },
}
