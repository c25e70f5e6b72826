//! Units of the fields of components, from what [`Simulation::add_units`](crate::simulation::Simulation::add_units) was told.
use crate::registry::Registry;
use crate::scene::units::UnitSystem;

/// The unit of a field of a component by its full name; empty where nothing was told or nothing has a unit. Parts of a
/// field (`before[1]`) have that of the field.
pub fn unit_of(registry: &Registry, system: UnitSystem, component: &str, path: &str) -> String {
    let fields = registry.units.get(component).copied().unwrap_or_default();
    // Of a list every item has the fields.
    let path = if path.starts_with('[') { path.split_once("].").map_or(path, |(_, rest)| rest) } else { path };
    let part_of = |field: &str| path.strip_prefix(field).is_some_and(|rest| rest.is_empty() || rest.starts_with(['[', '.']));
    let found = fields.iter().find(|(field, _)| *field == path || !field.is_empty() && part_of(field));
    found.map_or(String::new(), |(_, dimension)| written(dimension, system))
}

/// A dimension such as `force / length^3` in the units of a system.
pub fn written(dimension: &str, system: UnitSystem) -> String {
    if system == UnitSystem::Consistent {
        return String::new();
    }
    let word = |w: &str| match w {
        "length" => system.length().to_string(),
        "mass" => system.mass().into(),
        "time" => system.time().into(),
        "force" => system.force().into(),
        "stress" => system.stress().into(),
        "energy" => system.energy().into(),
        other => other.into(),
    };
    let mut out = String::new();
    let mut letters = String::new();
    for c in dimension.chars().chain([' ']) {
        if c.is_alphabetic() {
            letters.push(c);
        } else {
            out += &word(&std::mem::take(&mut letters));
            out.push(c);
        }
    }
    out.trim_end().replace(" x ", " ").replace(" / ", "/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dimensions_are_written_in_units() {
        assert_eq!(written("force / length^3", UnitSystem::MmNTonne), "N/mm^3");
        assert_eq!(written("force x time / length", UnitSystem::Si), "N s/m");
        assert_eq!(written("1 / time", UnitSystem::Si), "1/s");
        assert_eq!(written("length", UnitSystem::Consistent), "");
    }
}
