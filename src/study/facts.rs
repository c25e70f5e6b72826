//! What a reader asks first about the scenes of the rows: what they share, and what they differ in.
use super::plan::Row;
use super::text::{escape, number};
use crate::scene::LoadedScene;
use std::fmt::Write as _;

/// What a number is counted in.
#[derive(Clone, Copy)]
enum Unit {
    None,
    Force,
    Length,
    Stiffness,
}

/// Name, where it stands in a scene, unit.
const FACTS: [(&str, &str, Unit); 17] = [
    ("tows", "braid.tows", Unit::None),
    ("pattern", "braid.pattern", Unit::None),
    ("radius of the braid", "braid.radius", Unit::Length),
    ("cell", "braid.cell", Unit::None),
    ("real filaments per tow", "tow.real_filaments", Unit::None),
    ("radius of a real filament", "tow.filament_radius", Unit::Length),
    ("axial force", "load.force", Unit::Force),
    ("friction", "contact.friction", Unit::None),
    ("mandrel", "mandrel.shape", Unit::None),
    ("model", "tow.model", Unit::None),
    ("bending", "tow.bending", Unit::None),
    ("filaments per tow", "tow.filaments", Unit::None),
    ("elements per filament", "tow.elements", Unit::None),
    ("spread", "tow.spread", Unit::None),
    ("contact stiffness", "contact.stiffness", Unit::Stiffness),
    ("hardening", "contact.hardening", Unit::None),
    ("damping", "damping", Unit::None),
];

/// Name and value of all facts that a scene has.
pub(super) fn facts(scene: &LoadedScene) -> Vec<(&'static str, String)> {
    let (system, words) = (scene.scene.units, scene.words());
    let fact = |(name, path, unit): &(&'static str, &str, Unit)| {
        let word = words.at(path).filter(|w| *w != "None")?;
        let (word, known) = match word.parse::<f64>() {
            Ok(v) if word.contains('.') => (number(v), true),
            // A group is written over several lines.
            Err(_) => (word.split_whitespace().collect::<Vec<_>>().join(" "), false),
            Ok(_) => (word.to_owned(), true),
        };
        let unit = match unit {
            Unit::Force if known => format!(" {}", system.force()),
            Unit::Length if known => format!(" {}", system.length()),
            Unit::Stiffness if known => format!(" {}/{}", system.force(), system.length()),
            _ => String::new(),
        };
        Some((*name, format!("{word}{unit}")))
    };
    FACTS.iter().filter_map(fact).collect()
}

/// The facts as a part of a page: one line of what all rows share, a table of the others.
pub(super) fn html(rows: &[Row]) -> String {
    let of = |row: &Row, name: &str| row.facts.iter().find(|f| f.0 == name).map_or("–".to_owned(), |f| f.1.clone());
    let names = FACTS.iter().map(|f| f.0).filter(|n| rows.iter().any(|r| r.facts.iter().any(|f| f.0 == *n)));
    let (common, other): (Vec<&str>, Vec<&str>) = names.partition(|n| rows.iter().all(|r| of(r, n) == of(&rows[0], n)));
    if common.is_empty() && other.is_empty() {
        return String::new();
    }
    let mut h = String::from("<h2>The scenes</h2>\n");
    if !common.is_empty() {
        let all: Vec<String> = common.iter().map(|n| format!("{} {}", escape(n), escape(&of(&rows[0], n)))).collect();
        let _ = writeln!(h, "<p>In all rows: {}.</p>", all.join("; "));
    }
    if !other.is_empty() {
        h += "<div class=\"wide\"><table>\n<tr><th>row</th>";
        for name in &other {
            let _ = write!(h, "<th>{}</th>", escape(name));
        }
        h += "</tr>\n";
        for row in rows {
            let _ = write!(h, "<tr><td>{}</td>", escape(&row.label()));
            for name in &other {
                let _ = write!(h, "<td>{}</td>", escape(&of(row, name)));
            }
            h += "</tr>\n";
        }
        h += "</table></div>\n";
    }
    h
}
