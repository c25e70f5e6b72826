//! Materials and sections.
use super::{Builder, at};
use crate::model::{Material, Section};
use crate::registry::SpecError;
use crate::scene::schema::{MaterialSpec, Scene, SectionSpec};
use crate::scene::spans::Path;

/// Stands in for what could not be read, so that everything that refers to it is still checked.
const STAND_IN: Material = Material { young: 1.0, poisson: 0.0, density: 1.0 };

impl Builder<'_> {
    pub(super) fn add_materials(&mut self, scene: &Scene) {
        for (name, m) in &scene.materials {
            let good = self.check_material(&at("materials").key(name), name, m);
            let material = if good { Material { young: m.young.0, poisson: m.poisson.0, density: m.density.0 } } else { STAND_IN };
            self.materials.insert(name.clone(), material);
        }
        for (name, s) in &scene.sections {
            let section = self.section(&at("sections").key(name), name, s);
            let section = section.unwrap_or_else(|| Section::round(&STAND_IN, 1.0, 1.0));
            self.sections.insert(name.clone(), section);
        }
    }

    fn check_material(&mut self, path: &Path, name: &str, m: &MaterialSpec) -> bool {
        let before = self.problems.len();
        let field = |long: &str, short: &str| {
            let key = if self.root.find(&path.key(short)).is_some() { short } else { long };
            path.key(key)
        };
        let (young, poisson, density) = (field("young", "E"), field("poisson", "nu"), field("density", "rho"));
        self.above_zero(young, &format!("Young's modulus of material `{name}`"), m.young.0);
        self.above_zero(density, &format!("density of material `{name}`"), m.density.0);
        let nu = m.poisson.0;
        if !(nu > -1.0 && nu <= 0.5) {
            self.bad_value(poisson, format!("Poisson's ratio of material `{name}` must be above -1 and at most 0.5, not {nu}"));
        }
        self.problems.len() == before
    }

    fn section(&mut self, path: &Path, name: &str, spec: &SectionSpec) -> Option<Section> {
        let before = self.problems.len();
        let section = match spec {
            SectionSpec::Round { material, radius, axial_radius, bending_radius } => {
                let material = self.material(path, material);
                for (key, value) in [("radius", Some(*radius)), ("axial_radius", *axial_radius), ("bending_radius", *bending_radius)] {
                    if let Some(v) = value {
                        self.above_zero(path.key(key), &format!("{} of section `{name}`", key.replace('_', " ")), v.0);
                    }
                }
                Section::round(&material?, axial_radius.unwrap_or(*radius).0, bending_radius.unwrap_or(*radius).0)
            }
            SectionSpec::Rectangle { material, width, height } => {
                let material = self.material(path, material);
                self.above_zero(path.key("width"), &format!("width of section `{name}`"), width.0);
                self.above_zero(path.key("height"), &format!("height of section `{name}`"), height.0);
                rectangle(&material?, width.0, height.0)
            }
            SectionSpec::Stiffness { ea, ei, ei3, gj, ga, mass, inertia } => {
                self.not_negative(path.key("ea"), &format!("EA of section `{name}`"), ea.0);
                self.not_negative(path.key("ei"), &format!("EI of section `{name}`"), ei.0);
                self.not_negative(path.key("ei3"), &format!("EI of section `{name}`"), ei3.map_or(0.0, |v| v.0));
                self.not_negative(path.key("gj"), &format!("GJ of section `{name}`"), gj.0);
                self.above_zero(path.key("ga"), &format!("GA of section `{name}`"), ga.map_or(1.0, |v| v.0));
                self.above_zero(path.key("mass"), &format!("mass per length of section `{name}`"), mass.0);
                self.not_negative(path.key("inertia"), &format!("inertia of section `{name}`"), inertia.map_or(0.0, |v| v.0));
                let ei = [ei.0, ei3.map_or(ei.0, |v| v.0)];
                // A homogeneous section has rho I = rho A x EI / EA.
                let homogeneous = if ea.0 > 0.0 { mass.0 * (ei[0] + ei[1]) / ea.0 } else { 0.0 };
                let inertia = inertia.map_or(homogeneous, f64::from);
                Section { ea: ea.0, ei, gj: gj.0, ga: ga.map_or(f64::INFINITY, |v| v.0), mass: mass.0, inertia }
            }
        };
        (self.problems.len() == before).then_some(section)
    }

    fn material(&mut self, section: &Path, name: &str) -> Option<Material> {
        let found = self.materials.get(name).copied();
        let known = self.materials.keys().map(String::as_str);
        let found = found.ok_or_else(|| SpecError::unknown("material", "material", name, known));
        self.noted(section, found)
    }
}

/// A full rectangle, `width` along the second and `height` along the third section axis. The torsion
/// constant is the series a b^3 (1/3 - 64/pi^5 b/a sum tanh(n pi a / 2b) / n^5), n odd, a the long
/// side: S. P. Timoshenko and J. N. Goodier, *Theory of Elasticity*, 3rd ed. (1970), section 109.
fn rectangle(m: &Material, width: f64, height: f64) -> Section {
    let area = width * height;
    let (second, third) = (width * height.powi(3) / 12.0, height * width.powi(3) / 12.0);
    let (long, short) = (width.max(height), width.min(height));
    let pi = std::f64::consts::PI;
    let sum: f64 = (1..200).step_by(2).map(f64::from).map(|n| (n * pi * long / (2.0 * short)).tanh() / n.powi(5)).sum();
    let torsion = long * short.powi(3) * (1.0 / 3.0 - 64.0 / pi.powi(5) * short / long * sum);
    let shear = m.young / (2.0 * (1.0 + m.poisson));
    Section {
        ea: m.young * area,
        ei: [m.young * second, m.young * third],
        gj: shear * torsion,
        ga: f64::INFINITY,
        mass: m.density * area,
        inertia: m.density * (second + third),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_has_the_torsion_constant_of_the_tables() {
        let m = Material { young: 2.0, poisson: 0.0, density: 1.0 };
        let s = rectangle(&m, 1.0, 1.0);
        assert!((s.gj - 0.140577).abs() < 1e-6, "J = 0.140577 a^4, got {}", s.gj);
        let s = rectangle(&m, 2.0, 1.0);
        assert_eq!(s.ei, [2.0 * 2.0 / 12.0, 2.0 * 8.0 / 12.0]);
        assert!((s.gj - 2.0 * 0.228682).abs() < 2e-6, "J = 0.228682 a b^3 for a = 2 b, got {}", s.gj);
    }
}
