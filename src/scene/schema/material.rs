//! Materials and cross-sections.
use crate::scene::units::*;
use serde::{Deserialize, Serialize};

/// Linear elastic isotropic material.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialSpec {
    /// Young's modulus (stress), above zero.
    #[serde(alias = "E")]
    pub young: Stress,
    /// Poisson's ratio, above -1 and at most 0.5.
    #[serde(alias = "nu")]
    pub poisson: Ratio,
    /// Density (mass / length^3), above zero.
    #[serde(alias = "rho")]
    pub density: Density,
}

/// A cross-section.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub enum SectionSpec {
    /// A full circle.
    Round {
        /// Name of the material.
        material: String,
        /// Radius (length).
        radius: Length,
        /// Radius that gives EA and the mass (length). Default `radius`.
        #[serde(default)]
        axial_radius: Option<Length>,
        /// Radius that gives EI and GJ (length). Default `radius`.
        #[serde(default)]
        bending_radius: Option<Length>,
    },
    /// A full rectangle; bending about the second axis uses width x height^3 / 12.
    Rectangle {
        /// Name of the material.
        material: String,
        /// Size along the second section axis (length).
        width: Length,
        /// Size along the third section axis (length).
        height: Length,
    },
    /// Stiffness and mass as they are.
    Stiffness {
        /// Axial stiffness EA (force).
        ea: Force,
        /// Bending stiffness about both axes (force x length^2). Default 0.
        #[serde(default)]
        ei: BendingStiffness,
        /// Bending stiffness about the third axis where it differs (force x length^2). Default `ei`.
        #[serde(default)]
        ei3: Option<BendingStiffness>,
        /// Torsional stiffness GJ (force x length^2). Default 0.
        #[serde(default)]
        gj: BendingStiffness,
        /// Shear stiffness GA (force). Default: rigid in shear.
        #[serde(default)]
        ga: Option<Force>,
        /// Mass per length (mass / length), above zero.
        mass: LinearDensity,
        /// Rotary inertia per length (mass x length). Default mass x (EI + EI3) / EA.
        #[serde(default)]
        inertia: Option<LinearInertia>,
    },
}
