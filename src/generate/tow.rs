//! What a filament of a generator is made of: model, radii, material.
//!
//! A virtual filament stands for `real_filaments / filaments` real ones and has three radii
//! (r: real radius, N: real filaments, Nv: virtual ones):
//!
//! | radius | value | gives |
//! |---|---|---|
//! | contact | r sqrt(N / Nv) | the surface that contact sees |
//! | axial | r sqrt(N / Nv) | EA and the mass: the same total area |
//! | bending | own, r, r (N / Nv)^(1/4), or given | EI and GJ |
//!
//! The fourth root makes the bending stiffnesses of the virtual filaments add up to those of the
//! real ones, which is the limit of filaments that slide freely on each other.
use super::chain::{Layer, Recipe};
use super::packing::{Packing, outer_distance};
use crate::model::{Material, NaturalShape, Section};
use crate::registry::{Build, Registry, SpecError};
use crate::scene::units::Length;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// Which elements a filament is made of.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum FilamentModel {
    /// Trusses: tension and compression, no bending stiffness.
    Trusses,
    /// Beams that carry everything.
    Beams,
    /// Trusses that carry tension, mass and contact, with beams tied to their nodes that carry
    /// bending and torsion alone.
    #[default]
    Embedded,
    /// Trusses with rotation-free bending on the same nodes; for straight filaments without torsion.
    RotationFree,
    /// One registered kind of element along every filament, with the full section.
    Custom(String),
}

/// The radius that gives the bending and torsional stiffness of a virtual filament.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Bending {
    /// The axial radius of the virtual filament.
    Own,
    /// The radius of one real filament.
    OneFilament,
    /// r (N / Nv)^(1/4): the bending stiffnesses of the real filaments added up.
    SumOfFilaments,
    /// A given radius.
    Radius(Length),
}

/// How far from each other the filaments of a tow start.
///
/// Filaments that lie outermost in a tow are the longest, fall slack where it lies flat, and bow off: they decide how
/// thick a braid is. The centres of a few thick filaments, packed, do not reach as far out as those of the many that
/// they stand for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Spread {
    /// Packed: neighbours are `gap` diameters apart.
    #[default]
    Packed,
    /// Spread until the outermost centres lie as far out as those of the real filaments, packed with the same gap.
    /// What lies outermost then stands for real filaments, and thickness is counted to their surface.
    Real,
}

/// The shape in which the filaments are free of stress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Natural {
    /// The generated shape, curvature and twist included.
    #[default]
    AsBuilt,
    /// Straight and untwisted.
    Straight,
}

impl From<Natural> for NaturalShape {
    fn from(natural: Natural) -> Self {
        match natural {
            Natural::AsBuilt => NaturalShape::AsBuilt,
            Natural::Straight => NaturalShape::Straight { twist: 0.0 },
        }
    }
}

/// The filaments of every tow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TowSpec {
    /// Elements the filaments are made of (default `Embedded`).
    #[serde(default)]
    pub model: FilamentModel,
    /// Virtual filaments per tow (default 7).
    #[serde(default = "seven")]
    pub filaments: usize,
    /// Real filaments per tow (default 100).
    #[serde(default = "hundred")]
    pub real_filaments: usize,
    /// Radius of a real filament (length).
    pub filament_radius: Length,
    /// Elements per filament (default 31).
    #[serde(default = "thirty_one")]
    pub elements: usize,
    /// Name of the material.
    pub material: String,
    /// Radius for bending (default `OneFilament` for `Embedded` and `RotationFree`, else `Own`).
    #[serde(default)]
    pub bending: Option<Bending>,
    /// Arrangement in the plane normal to the tow (default `Hexagonal`).
    #[serde(default)]
    pub packing: Packing,
    /// Distance of neighbouring filaments over their diameter at the start (default 1.02).
    #[serde(default = "default_gap")]
    pub gap: f64,
    /// Whether virtual filaments are packed like solid ones, or reach as far out as the real ones (default `Packed`).
    #[serde(default)]
    pub spread: Spread,
    /// Random shift of every node across the tow, as a fraction of the contact radius (default 0).
    #[serde(default)]
    pub perturbation: f64,
    /// Stress-free shape (default `AsBuilt`).
    #[serde(default)]
    pub natural: Natural,
    /// Contact radius instead of r sqrt(N / Nv) (length).
    #[serde(default)]
    pub contact_radius: Option<Length>,
    /// Radius for EA and mass instead of r sqrt(N / Nv) (length).
    #[serde(default)]
    pub axial_radius: Option<Length>,
}

fn seven() -> usize {
    7
}
fn hundred() -> usize {
    100
}
fn thirty_one() -> usize {
    31
}
pub(crate) fn default_gap() -> f64 {
    1.02
}

/// The three radii of a virtual filament.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radii {
    /// Contact surface (length).
    pub contact: f64,
    /// EA and mass (length).
    pub axial: f64,
    /// EI and GJ (length).
    pub bending: f64,
}

impl Radii {
    /// One radius for everything.
    pub fn solid(radius: f64) -> Self {
        Radii { contact: radius, axial: radius, bending: radius }
    }
}

impl TowSpec {
    /// Seven embedded elements of 31 segments per tow of 100 filaments.
    pub fn new(filament_radius: f64, material: impl Into<String>) -> Self {
        TowSpec {
            model: FilamentModel::default(),
            filaments: seven(),
            real_filaments: hundred(),
            filament_radius: Length(filament_radius),
            elements: thirty_one(),
            material: material.into(),
            bending: None,
            packing: Packing::default(),
            gap: default_gap(),
            spread: Spread::default(),
            perturbation: 0.0,
            natural: Natural::default(),
            contact_radius: None,
            axial_radius: None,
        }
    }

    /// The radii of a virtual filament.
    pub fn radii(&self) -> Radii {
        let ratio = self.real_filaments as f64 / self.filaments as f64;
        let r = self.filament_radius.0;
        let packed = r * ratio.sqrt();
        let axial = self.axial_radius.map_or(packed, |r| r.0);
        let bending = match self.bending.unwrap_or(match self.model {
            FilamentModel::Embedded | FilamentModel::RotationFree => Bending::OneFilament,
            _ => Bending::Own,
        }) {
            Bending::Own => axial,
            Bending::OneFilament => r,
            Bending::SumOfFilaments => r * ratio.powf(0.25),
            Bending::Radius(r) => r.0,
        };
        Radii { contact: self.contact_radius.map_or(packed, |r| r.0), axial, bending }
    }

    /// Centres of the filaments in the plane normal to the tow (length).
    pub fn sites(&self) -> Vec<DVec2> {
        let packed = self.packing.sites(self.filaments, 2.0 * self.radii().contact * self.gap);
        if self.spread == Spread::Packed {
            return packed;
        }
        let real = outer_distance(&self.packing.sites(self.real_filaments, 2.0 * self.filament_radius.0 * self.gap));
        // Never closer than packed: filaments would start inside each other.
        let stretch = (real / outer_distance(&packed)).max(1.0);
        packed.into_iter().map(|s| s * stretch).collect()
    }

    /// Largest distance of a filament's surface from the centre line of the tow.
    pub fn outer_radius(&self) -> f64 {
        outer_distance(&self.sites()) + self.radii().contact
    }

    /// Radius to whose surface thickness is counted: that of the filaments, of the real ones if those lie outermost.
    pub fn surface_radius(&self) -> f64 {
        match self.spread {
            Spread::Packed => self.radii().contact,
            Spread::Real => self.filament_radius.0,
        }
    }

    /// Checks the numbers; errors name the field after `prefix`.
    ///
    /// # Errors
    /// The first field that makes no sense.
    pub fn check(&self, prefix: &str) -> Result<(), SpecError> {
        at_least(prefix, "filaments", self.filaments, 1)?;
        at_least(prefix, "real_filaments", self.real_filaments, 1)?;
        at_least(prefix, "elements", self.elements, 1)?;
        positive(prefix, "filament_radius", self.filament_radius.0)?;
        for (name, radius) in [("contact_radius", self.contact_radius), ("axial_radius", self.axial_radius)] {
            if let Some(r) = radius {
                positive(prefix, name, r.0)?;
            }
        }
        if let Some(Bending::Radius(r)) = self.bending {
            positive(prefix, "bending", r.0)?;
        }
        if !(self.gap >= 1.0 && self.gap.is_finite()) {
            return Err(SpecError::new(format!("{prefix}.gap"), format!("gap {} makes the filaments overlap at the start", self.gap))
                .help("distance of neighbours over their diameter, at least 1; 1.02 is usual"));
        }
        if self.spread == Spread::Real && self.filaments < 2 {
            return Err(
                SpecError::new(format!("{prefix}.spread"), "a single filament cannot be spread").help("`Packed`, or more filaments")
            );
        }
        if !(0.0..1.0).contains(&self.perturbation) {
            return Err(SpecError::new(format!("{prefix}.perturbation"), format!("perturbation {} is not in [0, 1)", self.perturbation))
                .help("a fraction of the contact radius; 0.01 is usual"));
        }
        Ok(())
    }

    pub(crate) fn recipe(&self, prefix: &str, registry: &Registry, build: &Build<'_>) -> Result<Recipe, SpecError> {
        let material = material(prefix, &self.material, build)?;
        recipe(prefix, &self.model, &material, self.radii(), self.natural, registry)
    }
}

/// The material called `name`; errors name the field `prefix.material`.
pub(crate) fn material(prefix: &str, name: &str, build: &Build<'_>) -> Result<Material, SpecError> {
    let path = format!("{prefix}.material");
    build.materials.get(name).copied().ok_or_else(|| SpecError::unknown(path, "material", name, build.materials.keys().map(String::as_str)))
}

/// The element layers of a filament model.
pub(crate) fn recipe(
    prefix: &str,
    model: &FilamentModel,
    material: &Material,
    radii: Radii,
    natural: Natural,
    registry: &Registry,
) -> Result<Recipe, SpecError> {
    let full = Section::round(material, radii.axial, radii.bending);
    // Each stiffness and the mass belong to exactly one layer.
    let axial = Section { ei: [0.0; 2], gj: 0.0, ..full };
    let bending = Section { ea: 0.0, mass: 0.0, ..full };
    let path = format!("{prefix}.model");
    let layer = |name: &str, section: Section, embedded: bool| {
        let kind = registry
            .element(name)
            .ok_or_else(|| SpecError::unknown(path.clone(), "element", name, registry.elements.iter().map(|k| k.name)))?;
        Ok::<_, SpecError>(Layer { kind: *kind, section, embedded })
    };
    let layers = match model {
        FilamentModel::Trusses => vec![layer("truss", axial, false)?],
        FilamentModel::Beams => vec![layer("beam", full, false)?],
        FilamentModel::Embedded => vec![layer("truss", axial, false)?, layer("beam", bending, true)?],
        FilamentModel::RotationFree => vec![layer("truss", axial, false)?, layer("bending", bending, false)?],
        FilamentModel::Custom(name) => vec![layer(name, full, false)?],
    };
    Ok(Recipe { layers, natural: natural.into(), mass: full.mass })
}

/// An error unless `value` is finite and above zero.
pub(crate) fn positive(prefix: &str, name: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(SpecError::new(format!("{prefix}.{name}"), format!("{name} {value} is not a positive number")))
}

/// An error unless `value` is finite.
pub(crate) fn finite(prefix: &str, name: &str, value: f64) -> Result<(), SpecError> {
    if value.is_finite() {
        return Ok(());
    }
    Err(SpecError::new(format!("{prefix}.{name}"), format!("{name} {value} is not a finite number")))
}

/// An error unless `value` is at least `least`.
pub(crate) fn at_least(prefix: &str, name: &str, value: usize, least: usize) -> Result<(), SpecError> {
    if value >= least {
        return Ok(());
    }
    Err(SpecError::new(format!("{prefix}.{name}"), format!("{name} is {value}")).help(format!("at least {least}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seven_virtual_filaments_keep_area_and_bending_of_a_hundred() {
        let mut tow = TowSpec::new(2.5, "glass");
        assert!((tow.radii().contact - 9.449).abs() < 5e-4);
        assert_eq!(tow.radii().contact, tow.radii().axial);
        assert_eq!(tow.radii().bending, 2.5, "one filament's beam is the default of the embedded element");
        assert!((7.0 * tow.radii().axial.powi(2) / (100.0 * 2.5f64.powi(2)) - 1.0).abs() < 1e-14);
        tow.bending = Some(Bending::SumOfFilaments);
        assert!((tow.radii().bending - 4.86).abs() < 5e-3);
        assert!((7.0 * tow.radii().bending.powi(4) / (100.0 * 2.5f64.powi(4)) - 1.0).abs() < 1e-14);
        tow.model = FilamentModel::Beams;
        tow.bending = None;
        assert_eq!(tow.radii().bending, tow.radii().axial, "a beam is as thick as it is");
        tow.filaments = 100;
        assert_eq!(tow.radii(), Radii::solid(2.5), "a hundred virtual filaments are the real ones");
    }

    #[test]
    fn tow_of_seven_is_three_filaments_wide() {
        let tow = TowSpec::new(2.5, "glass");
        let r = tow.radii().contact;
        assert!((tow.outer_radius() - r * (1.0 + 2.0 * 1.02)).abs() < 1e-12);
    }

    #[test]
    fn spread_filaments_reach_as_far_out_as_the_real_ones() {
        let tow = |filaments, spread| TowSpec { filaments, spread, ..TowSpec::new(2.5, "glass") };
        let real = outer_distance(&tow(100, Spread::Packed).sites());
        for filaments in [7, 19, 37, 61, 91] {
            let (packed, spread) = (tow(filaments, Spread::Packed), tow(filaments, Spread::Real));
            assert!((outer_distance(&spread.sites()) / real - 1.0).abs() < 1e-12, "{filaments}");
            assert!(outer_distance(&packed.sites()) < real, "{filaments}");
            assert_eq!((packed.surface_radius(), spread.surface_radius()), (packed.radii().contact, 2.5));
        }
        // A hundred filaments are the real ones.
        assert_eq!(tow(100, Spread::Real).sites(), tow(100, Spread::Packed).sites());
        assert!(tow(1, Spread::Real).check("tow").unwrap_err().to_string().contains("single filament"));
    }

    #[test]
    fn scene_text_needs_only_radius_and_material() {
        let tow: TowSpec = crate::scene::ron_options().from_str("(filament_radius: 2.5, material: \"glass\")").expect("valid");
        assert_eq!(tow, TowSpec::new(2.5, "glass"));
        let text = "(filament_radius: 2.5, material: \"glass\", model: Custom(\"lab.spring\"), bending: Radius(3.0))";
        let tow: TowSpec = crate::scene::ron_options().from_str(text).expect("valid");
        assert_eq!(tow.model, FilamentModel::Custom("lab.spring".into()));
        assert_eq!(tow.radii().bending, 3.0);
        let wrong = crate::scene::ron_options().from_str::<TowSpec>("(filament_radius: 2.5, material: \"glass\", filment: 3)");
        assert!(wrong.expect_err("unknown field").to_string().contains("filment"));
    }
}
