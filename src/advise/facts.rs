//! What a study has covered, and where a scene lies outside.
use crate::scene::units::UnitSystem;
use crate::scene::{LoadedScene, Words};
use serde::{Deserialize, Serialize};

/// Something that all rows of a study share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fact {
    /// What it is.
    pub name: String,
    /// Its value as in the scene, numbers in SI units (angles in degrees).
    pub value: String,
}

/// All of them.
pub type Facts = Vec<Fact>;

/// Name, path in the scene, powers of length, mass and time.
const SHARED: [(&str, &str, [i32; 3]); 11] = [
    ("tows", "braid.tows", [0, 0, 0]),
    ("pattern", "braid.pattern", [0, 0, 0]),
    ("angle of the tows", "braid.angle", [0, 0, 0]),
    ("radius of the braid", "braid.radius", [1, 0, 0]),
    ("cell", "braid.cell", [0, 0, 0]),
    ("filaments of a tow", "tow.real_filaments", [0, 0, 0]),
    ("radius of a filament", "tow.filament_radius", [1, 0, 0]),
    ("axial force", "load.force", [1, 1, -2]),
    ("friction", "contact.friction", [0, 0, 0]),
    ("shape of the mandrel", "mandrel.shape", [0, 0, 0]),
    ("side of the mandrel", "mandrel.shape.side", [1, 0, 0]),
];

/// Relative difference up to which two numbers count as one.
const SAME: f64 = 1e-3;

/// The value at `path` of the effective scene: a word, or a number in SI units.
pub(super) fn value((words, units): &(Words, UnitSystem), path: &str, powers: [i32; 3]) -> Option<String> {
    let word = words.at(path)?;
    match word.parse::<f64>() {
        Ok(number) => Some((number * units.si(powers)?).to_string()),
        // The kind of a shape is its name; what is in the brackets has facts of its own.
        Err(_) => Some(word.split('(').next().unwrap_or(word).trim().to_owned()),
    }
}

/// What a scene has of the facts; what it does not have is left out.
pub(super) fn of(scene: &LoadedScene) -> Facts {
    let words = (scene.words(), scene.scene.units);
    let fact =
        |(name, path, powers): &(&str, &str, [i32; 3])| value(&words, path, *powers).map(|value| Fact { name: (*name).to_owned(), value });
    let mut facts: Facts = SHARED.iter().filter_map(fact).collect();
    let material = value(&words, "tow.material", [0; 3]).map(|m| m.trim_matches('"').to_owned());
    let young = material.and_then(|m| value(&words, &format!("materials.{m}.young"), [-1, 1, -2]));
    facts.extend(young.map(|value| Fact { name: "Young's modulus".into(), value }));
    facts
}

/// Where a scene differs from what a study has covered: name, value of the study, value of the scene.
pub fn outside(covered: &[Fact], scene: &LoadedScene) -> Vec<(String, String, String)> {
    let mine = of(scene);
    let differs = |f: &Fact| {
        let own = mine.iter().find(|m| m.name == f.name).map_or("none", |m| &m.value);
        let same = match (f.value.parse::<f64>(), own.parse::<f64>()) {
            (Ok(a), Ok(b)) => (a - b).abs() <= SAME * a.abs().max(b.abs()),
            _ => f.value == own,
        };
        (!same).then(|| (f.name.clone(), short(&f.value), short(own)))
    };
    let mut all: Vec<_> = covered.iter().filter_map(differs).collect();
    let new = |m: &&Fact| covered.iter().all(|f| f.name != m.name);
    all.extend(mine.iter().filter(new).map(|m| (m.name.clone(), "none".into(), short(&m.value))));
    all
}

fn short(value: &str) -> String {
    value.parse::<f64>().map_or(value.to_owned(), |v| {
        let text = format!("{v:.4e}").parse::<f64>().expect("a number");
        if text != 0.0 && !(1e-3..1e5).contains(&text.abs()) { format!("{text:e}") } else { text.to_string() }
    })
}
