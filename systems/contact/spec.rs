//! What a scene says about contact between filaments.
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{Ratio, Stiffness, StiffnessPerLength, Time};

/// Contact between filaments.
///
/// Two stiffnesses describe the two ways in which filaments touch. Side by side, the force per
/// length is `line_stiffness` x penetration, whatever the mesh; at a crossing the force is
/// `stiffness` x penetration. For a mesh study both must be given. If only one is given the other
/// follows with the mean length of the segments, so that a node carries as much as a crossing; if
/// none is given both follow from the nodal mass and the time step that the elements allow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ContactSpec {
    /// Coulomb friction coefficient. Default 0.2.
    pub friction: Ratio,
    /// Normal stiffness of a crossing (force / length). Default from mass and time step.
    pub stiffness: Option<Stiffness>,
    /// Normal stiffness per length of filaments side by side (force / length^2). Default from mass and time step.
    pub line_stiffness: Option<StiffnessPerLength>,
    /// Deep contacts are stiffer: the normal force is that of the stiffness times 1 + hardening x (penetration / sum of the radii)^2. Default 0.
    pub hardening: Ratio,
    /// Penetration to keep below while the run goes on; stiffness and time step follow. Default: none.
    pub penetration: Option<TargetPenetration>,
    /// Tangential over normal stiffness of the friction springs. Default 0.5.
    pub friction_stiffness: Ratio,
    /// Damping ratio of the normal springs: 1 is critical for the two nodes alone. Default 0.05.
    pub damping: Ratio,
    /// What to do where filaments overlap at the start by more than 5 % of the radius. Default `Error`.
    pub initial_overlap: InitialOverlap,
    /// Distance beyond touching that the neighbour lists cover, in mean radii. Default 1.
    pub skin: Ratio,
    /// Length of the quadratic start of the penalty law, in diameters. Default 0.001.
    pub toe: Ratio,
    /// Sine of the angle between filaments at which nodes begin to hand over to the crossing point,
    /// and at which only the crossing point is left, in diameters per segment length. Default (0.1, 0.25).
    pub window: (Ratio, Ratio),
    /// True if a filament may touch itself. Default true.
    pub self_contact: bool,
}

/// A target penetration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetPenetration {
    /// 99th percentile of the penetration, in diameters, above which all contacts are made stiffer.
    pub target: Ratio,
    /// Factor by which the time step may shrink for it, at least 1. Default 3.
    #[serde(default = "three")]
    pub slower: Ratio,
}

fn three() -> Ratio {
    Ratio(3.0)
}

/// What to do with overlap at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum InitialOverlap {
    /// Refuse the scene and name the worst place.
    #[default]
    Error,
    /// Leave the overlap free of force; what comes out of it does not go in again.
    Offset,
    /// As `Offset`, and take the overlap away linearly in the given time.
    Relax(Time),
}

impl Default for ContactSpec {
    fn default() -> Self {
        ContactSpec {
            friction: Ratio(0.2),
            stiffness: None,
            line_stiffness: None,
            hardening: Ratio(0.0),
            penetration: None,
            friction_stiffness: Ratio(0.5),
            damping: Ratio(0.05),
            initial_overlap: InitialOverlap::Error,
            skin: Ratio(1.0),
            toe: Ratio(1e-3),
            window: (Ratio(0.1), Ratio(0.25)),
            self_contact: true,
        }
    }
}

/// Refuses a number that is not finite or below `low` (or equal to it where `open`).
pub(crate) fn bounded(path: &str, what: &str, value: f64, low: f64, high: f64) -> Result<(), SpecError> {
    if value.is_finite() && value >= low && value <= high {
        return Ok(());
    }
    let help = if high.is_finite() { format!("a number between {low} and {high}") } else { format!("a number not below {low}") };
    Err(SpecError::new(path, format!("{what} cannot be {value}")).help(help))
}

/// Refuses a stiffness that is not a positive number.
pub(crate) fn positive(path: &str, what: &str, value: Option<f64>) -> Result<(), SpecError> {
    match value {
        Some(v) if !(v > 0.0 && v.is_finite()) => Err(SpecError::new(path, format!("{what} must be a positive number, not {v}"))),
        _ => Ok(()),
    }
}

impl Settings for ContactSpec {
    const KEY: &'static str = "contact";
    const ABOUT: &'static str = "contact and friction between filaments";

    fn check(&mut self, _build: &mut Build<'_>) -> Result<(), SpecError> {
        ContactSpec::check(self)
    }
}

impl ContactSpec {
    /// Checks the numbers.
    ///
    /// # Errors
    /// The first field that makes no sense.
    pub fn check(&self) -> Result<(), SpecError> {
        bounded("friction", "the friction coefficient", self.friction.0, 0.0, f64::INFINITY)?;
        positive("stiffness", "the stiffness of a crossing", self.stiffness.map(f64::from))?;
        positive("line_stiffness", "the stiffness per length", self.line_stiffness.map(f64::from))?;
        bounded("hardening", "the hardening", self.hardening.0, 0.0, 1e6)?;
        if let Some(p) = &self.penetration {
            bounded("penetration.target", "the target penetration", p.target.0, 1e-5, 0.5)?;
            bounded("penetration.slower", "the factor on the time step", p.slower.0, 1.0, 1000.0)?;
        }
        bounded("friction_stiffness", "the stiffness ratio of friction", self.friction_stiffness.0, 1e-6, 1.0)?;
        bounded("damping", "the damping ratio", self.damping.0, 0.0, 1.0)?;
        bounded("skin", "the skin", self.skin.0, 0.01, 100.0)?;
        bounded("toe", "the length of the toe", self.toe.0, 0.0, 0.1)?;
        bounded("window", "the lower end of the window", self.window.0.0, 1e-3, 10.0)?;
        if self.window.1.0 <= self.window.0.0 || !self.window.1.0.is_finite() {
            return Err(SpecError::new("window", "the upper end of the window must be above the lower end").help("(0.1, 0.25) is usual"));
        }
        if let InitialOverlap::Relax(t) = self.initial_overlap {
            positive("initial_overlap", "the time in which the overlap goes away", Some(t.0))?;
        }
        Ok(())
    }
}
