//! Which node or element is meant: `node 40`, `node tip`, `tow 3 fil 2 node 40`, `element lab.spring 5`.
use super::inspect::{Inspected, Kind};
use crate::components::{NodeId, Tie};
use crate::model::Model;
use crate::registry::SpecError;
use crate::systems::contact::records::{LineRecord, LiveRecords, PointRecord};
use crate::systems::surface::records::{EdgeRecord, LiveSurfaceRecords, SurfaceRecord};
use bevy_ecs::prelude::*;
use std::str::FromStr;

/// The words of a command that are still to be read.
#[derive(Clone, Debug)]
pub struct Words<'a> {
    rest: &'a str,
}

impl<'a> Words<'a> {
    /// The words of a text.
    pub fn of(text: &'a str) -> Self {
        Words { rest: text.trim() }
    }

    /// The next word, which stays.
    pub fn peek(&self) -> Option<&'a str> {
        self.rest.split_whitespace().next()
    }

    /// All that is left.
    pub fn rest(&self) -> &'a str {
        self.rest
    }

    /// Takes the next word if it is this one.
    pub fn skip_word(&mut self, word: &str) -> bool {
        let found = self.peek() == Some(word);
        if found {
            self.next();
        }
        found
    }

    /// The next word as a number or the like; `what` it is stands in the message.
    ///
    /// # Errors
    /// No word, or another one.
    pub fn number<T: FromStr>(&mut self, what: &str) -> Result<T, SpecError> {
        let word = self.next().ok_or_else(|| SpecError::new("", format!("{what} is missing")))?;
        word.parse().map_err(|_| SpecError::new(word, format!("`{word}` is not {what}")))
    }

    /// The next word as a number, if there is one.
    ///
    /// # Errors
    /// Another word.
    pub fn number_or<T: FromStr>(&mut self, what: &str, default: T) -> Result<T, SpecError> {
        if self.rest.is_empty() { Ok(default) } else { self.number(what) }
    }

    /// Nothing may be left.
    ///
    /// # Errors
    /// A word is left.
    pub fn end(&self) -> Result<(), SpecError> {
        self.peek().map_or(Ok(()), |word| Err(SpecError::new(word, format!("`{word}` is too much here"))))
    }
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let word = self.peek()?;
        self.rest = self.rest[word.len()..].trim_start();
        Some(word)
    }
}

/// Reads `node N`, `node NAME` or `tow T fil F node N`, N counted along the filament.
///
/// # Errors
/// What is not there, with what is.
pub fn node(words: &mut Words<'_>, model: &Model) -> Result<NodeId, SpecError> {
    if words.skip_word("tow") {
        let tow: usize = words.number("the number of a tow")?;
        if !words.skip_word("fil") {
            return Err(SpecError::new(words.peek().unwrap_or(""), "the filament is missing").help("tow 0 fil 0 node 0"));
        }
        let index: usize = words.number("the number of a filament")?;
        let filament = model.filaments.iter().find(|f| f.tow == tow && f.index == index).ok_or_else(|| {
            let tows = model.filaments.iter().map(|f| f.tow + 1).max().unwrap_or(0);
            let inside = model.filaments.iter().filter(|f| f.tow == tow).count();
            SpecError::new("", format!("filament {index} of tow {tow} does not exist"))
                .help(format!("{tows} tows, numbered from 0; {inside} filaments in this one"))
        })?;
        if !words.skip_word("node") {
            return Err(SpecError::new(words.peek().unwrap_or(""), "the node is missing").help("tow 0 fil 0 node 0"));
        }
        let n: usize = words.number("the number of a node along the filament")?;
        let count = filament.nodes.len();
        return filament.nodes.get(n).copied().ok_or_else(|| {
            SpecError::new("", format!("node {n} of this filament does not exist")).help(format!("it has {count} nodes, numbered from 0"))
        });
    }
    if !words.skip_word("node") {
        return Err(SpecError::new(words.peek().unwrap_or(""), "a node is missing").help("node 3, node NAME, or tow 0 fil 0 node 3"));
    }
    let word = words.next().ok_or_else(|| SpecError::new("", "number or name of the node is missing"))?;
    let meant = word.parse().map_or_else(|_| crate::measure::NodeRef::Name(word.into()), crate::measure::NodeRef::Id);
    meant.resolve(word, model)
}

/// An element: its kind, its number in it, its entity.
pub struct ElementPlace {
    /// The kind.
    pub kind: Kind,
    /// Number among those of its kind.
    pub index: usize,
    /// The entity.
    pub entity: Entity,
}

/// Reads `[KIND] N`; without a kind elements are counted over all kinds, in the order of `info mesh`.
///
/// # Errors
/// What is not there, with what is.
pub fn element(words: &mut Words<'_>, world: &mut World) -> Result<ElementPlace, SpecError> {
    let kinds = Inspected::kinds(world);
    let word = words.peek().ok_or_else(|| SpecError::new("", "the number of the element is missing"))?;
    let named = kinds.iter().find(|k| k.name == word);
    if named.is_some() {
        words.next();
    } else if word.parse::<usize>().is_err() {
        return Err(SpecError::unknown(word, "kind of element", word, kinds.iter().map(|k| k.name)));
    }
    let index: usize = words.number("the number of an element")?;
    let mut left = index;
    let mut counts = Vec::new();
    for kind in kinds.iter().filter(|k| named.is_none_or(|n| n.name == k.name)) {
        let members = (kind.members)(world);
        if let Some(&entity) = members.get(left) {
            return Ok(ElementPlace { kind: *kind, index: left, entity });
        }
        left -= members.len();
        counts.push(format!("{} {}", members.len(), kind.name));
    }
    Err(SpecError::new("", format!("element {index} does not exist")).help(format!("there are {}, numbered from 0", counts.join(", "))))
}

/// The entities of all contact records in use: side by side, crossing, on surfaces, over edges of surfaces.
pub fn contact_records(world: &mut World) -> [Vec<Entity>; 4] {
    fn first<C: Component>(world: &mut World, live: usize) -> Vec<Entity> {
        world.query_filtered::<Entity, With<C>>().iter(world).take(live).collect()
    }
    let live = world.get_resource::<LiveRecords>().copied().unwrap_or_default();
    let surfaces = world.get_resource::<LiveSurfaceRecords>().copied().unwrap_or_default();
    [
        first::<LineRecord>(world, live.lines),
        first::<PointRecord>(world, live.points),
        first::<SurfaceRecord>(world, surfaces.nodes),
        first::<EdgeRecord>(world, surfaces.edges),
    ]
}

/// The entities of all ties.
pub fn ties(world: &mut World) -> Vec<Entity> {
    world.query_filtered::<Entity, With<Tie>>().iter(world).collect()
}

/// Name and place of a node, for people: `node 40 (tip; tow 3 fil 2 node 5)`.
pub fn called(id: NodeId, model: &Model) -> String {
    let name = model.node_names.iter().find(|(_, n)| **n == id).map(|(name, _)| name.clone());
    let filament = model.filaments.iter().find_map(|f| Some((f, f.nodes.iter().position(|n| *n == id)?)));
    let place = filament.map(|(f, n)| format!("tow {} fil {} node {n}", f.tow, f.index));
    let about: Vec<String> = name.into_iter().chain(place).collect();
    if about.is_empty() { format!("node {}", id.0) } else { format!("node {} ({})", id.0, about.join("; ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_taken_one_by_one() {
        let mut words = Words::of("  step  12 x > 3 ");
        assert!(words.skip_word("step") && !words.skip_word("step"));
        assert_eq!(words.number::<u64>("a number").ok(), Some(12));
        assert_eq!(words.rest(), "x > 3");
        assert_eq!(words.number::<u64>("a number").expect_err("a word").message, "`x` is not a number");
        assert!(words.end().is_err());
    }
}
