//! `print` and `set`: components and resources by name, with units.
use super::address::{self, Words};
use super::inspect::{Inspected, Shown, field, fields};
use super::reading::NodeVector;
use super::session::Session;
use super::text::{shortened, table};
use super::units::unit_of;
use crate::components::NodeId;
use crate::measure::NodeRef;
use crate::registry::SpecError;
use crate::simulation::{NodeEntities, NodeRows};
use bevy_ecs::prelude::*;

/// Rows of a table: name or path, value with unit.
type Rows = Vec<(String, String)>;

impl Session {
    fn rows_of(&self, component: &Shown) -> Rows {
        let Some(text) = &component.text else { return vec![(component.name.clone(), "(known by its name alone)".into())] };
        let (registry, system) = (&self.sim.registry, self.scene.scene.units);
        let row = |(path, value): (String, String)| {
            let unit = unit_of(registry, system, component.full, &path);
            let dot = if path.is_empty() || path.starts_with('[') { "" } else { "." };
            (format!("{}{dot}{path}", component.name), format!("{} {unit}", shortened(&value)).trim_end().to_string())
        };
        let rows: Rows = fields(text).into_iter().map(row).collect();
        // A component without fields is a mark.
        if rows.is_empty() { vec![(component.name.clone(), "present".into())] } else { rows }
    }

    fn components(&self, title: String, entity: Entity, wanted: impl Fn(&str) -> bool) -> String {
        let all = Inspected::components_of(&self.sim.world, entity);
        let rows: Rows = all.iter().filter(|c| wanted(&c.name)).flat_map(|c| self.rows_of(c)).collect();
        format!("{title}\n{}", table(&rows))
    }

    pub(super) fn node_entity(&self, id: NodeId) -> Entity {
        let row = self.sim.world.resource::<NodeRows>().of(id);
        self.sim.world.resource::<NodeEntities>().0[row]
    }

    fn node_title(&self, id: NodeId) -> String {
        let host = self.scene.model.host(id);
        let tied = if host == id { String::new() } else { format!(", tied to node {}, which carries it", host.0) };
        format!("{}{tied}", address::called(id, &self.scene.model))
    }
}

/// `print ...`
pub(super) fn print(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    match words.peek() {
        None => Err(SpecError::new("", "what to print is missing").help("help print")),
        Some("node" | "tow") => {
            let id = address::node(&mut words, &session.scene.model)?;
            let mut wanted = Vec::new();
            for word in words {
                let vector = NodeVector::of(word)?;
                wanted.extend(NodeVector::ALL.iter().find(|a| a.1 == vector).map(|a| a.2));
            }
            let title = session.node_title(id);
            Ok(session.components(title, session.node_entity(id), |name| wanted.is_empty() || wanted.contains(&name)))
        }
        Some("dummy") => {
            words.next();
            let id = dummy(session, &mut words)?;
            words.end()?;
            let title = session.node_title(id);
            Ok(session.components(title, session.node_entity(id), |_| true))
        }
        Some("element") => {
            words.next();
            let place = address::element(&mut words, &mut session.sim.world)?;
            words.end()?;
            Ok(session.components(format!("element {} {}", place.kind.name, place.index), place.entity, |_| true))
        }
        Some("tie") => {
            words.next();
            let all = address::ties(&mut session.sim.world);
            let n = numbered(&mut words, "tie", all.len())?;
            Ok(session.components(format!("tie {n}"), all[n], |_| true))
        }
        Some("contact") => {
            words.next();
            let all = address::contact_records(&mut session.sim.world);
            let names = ["side by side", "crossing", "on a surface", "over an edge"];
            let flat: Vec<(&str, Entity)> =
                names.into_iter().zip(all).flat_map(|(name, list)| list.into_iter().map(move |e| (name, e))).collect();
            let n = numbered(&mut words, "contact record", flat.len())?;
            Ok(session.components(format!("contact {n}, {}", flat[n].0), flat[n].1, |_| true))
        }
        Some(word) => {
            let resource = Inspected::resources(&session.sim.world).into_iter().find(|r| r.name == word && words.rest() == word);
            match resource {
                Some(r) => match r.text(&session.sim.world) {
                    Some(text) => {
                        let shown = Shown { name: r.name.clone(), full: r.full, text: Some(text) };
                        Ok(table(&session.rows_of(&shown)))
                    }
                    None => Ok(format!("{} is not there now", r.name)),
                },
                None => match stored(session, words.clone())? {
                    Some(said) => Ok(said),
                    None => value(session, words.rest()),
                },
            }
        }
    }
}

/// Reads `COMPONENT N`: everything of the entity with number N among those that have this component.
fn stored(session: &mut Session, mut words: Words<'_>) -> Result<Option<String>, SpecError> {
    let types = Inspected::components(&session.sim.world);
    let Some(component) = words.next().and_then(|name| types.into_iter().find(|c| c.name == name)) else { return Ok(None) };
    let all = (component.members)(&mut session.sim.world);
    let n = numbered(&mut words, &component.name, all.len())?;
    Ok(Some(session.components(format!("{} {n}", component.name), all[n], |_| true)))
}

fn value(session: &mut Session, text: &str) -> Result<String, SpecError> {
    let read = session.expression(text);
    let expression = read.map_err(|e| {
        let bare = text.chars().all(|c| c.is_alphanumeric() || c == '_');
        if bare && e.message.starts_with("unknown quantity") {
            let world = &session.sim.world;
            let resources = Inspected::resources(world).into_iter().map(|r| r.name);
            let stored: Vec<String> = resources.chain(Inspected::components(world).into_iter().map(|c| c.name)).collect();
            let things = ["node", "tow", "element", "tie", "dummy", "contact"];
            let known = things.into_iter().chain(super::reading::Word::ALL.iter().map(|w| w.0)).chain(stored.iter().map(String::as_str));
            return SpecError::unknown(text, "thing", text, known);
        }
        e
    })?;
    let v = expression.value(&mut session.sim).map_err(|e| SpecError::new(text, e))?;
    Ok(format!("{} = {}", expression.text, session.with_unit(&expression, v)))
}

fn numbered(words: &mut Words<'_>, what: &str, count: usize) -> Result<usize, SpecError> {
    let n: usize = words.number(&format!("the number of a {what}"))?;
    words.end()?;
    if n < count {
        Ok(n)
    } else {
        Err(SpecError::new("", format!("{what} {n} does not exist")).help(format!("there are {count}, numbered from 0")))
    }
}

/// A dummy node by its number among the dummy nodes, or by its name.
fn dummy(session: &Session, words: &mut Words<'_>) -> Result<NodeId, SpecError> {
    let model = &session.scene.model;
    let all: Vec<NodeId> = (0..model.nodes.len()).filter(|i| model.nodes[*i].dummy).map(|i| NodeId(i as u32)).collect();
    let word = words.next().ok_or_else(|| SpecError::new("", "number or name of the dummy node is missing"))?;
    match word.parse::<usize>() {
        Ok(n) => all.get(n).copied().ok_or_else(|| {
            SpecError::new(word, format!("dummy node {n} does not exist")).help(format!("there are {}, numbered from 0", all.len()))
        }),
        Err(_) => NodeRef::Name(word.into()).resolve(word, model),
    }
}

/// `set ...`
pub(super) fn set(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    session.refuse_within_step("values are set")?;
    session.refuse_if_failed()?;
    match words.peek() {
        Some("node" | "tow") => {
            let id = address::node(&mut words, &session.scene.model)?;
            let entity = session.node_entity(id);
            set_component(session, entity, None, words)
        }
        Some("element") => {
            words.next();
            let place = address::element(&mut words, &mut session.sim.world)?;
            set_component(session, place.entity, Some(place.kind.component), words)
        }
        Some(word) => {
            let name = word.split(['.', '[']).next().unwrap_or(word);
            let all = Inspected::resources(&session.sim.world);
            let known: Vec<&str> = all.iter().map(|r| r.name.as_str()).collect();
            let resource =
                all.iter().find(|r| r.name == name).ok_or_else(|| SpecError::unknown(name, "resource", name, known.iter().copied()))?;
            words.next();
            let path = word[name.len()..].trim_start_matches('.');
            let before = resource.text(&session.sim.world).ok_or_else(|| SpecError::new(name, format!("{name} is not there now")))?;
            let after = replaced(&before, path, word, words.rest())?;
            resource.put(&mut session.sim.world, &after).map_err(|e| SpecError::new(words.rest(), e))?;
            changed(session, word, &before, path, words.rest())
        }
        None => Err(SpecError::new("", "what to set is missing").help("help set")),
    }
}

fn set_component(session: &mut Session, entity: Entity, own: Option<&str>, mut words: Words<'_>) -> Result<String, SpecError> {
    let word = words.next().ok_or_else(|| SpecError::new("", "the component is missing"))?;
    let all = Inspected::components_of(&session.sim.world, entity);
    let first = word.split(['.', '[']).next().unwrap_or(word);
    // The fields of an element itself need no name in front.
    let named = all.iter().find(|c| c.name == first).map(|c| (c, word[first.len()..].trim_start_matches('.')));
    let meant = named.or_else(|| all.iter().find(|c| Some(c.full) == own).map(|c| (c, word)));
    let (component, path) = meant.ok_or_else(|| SpecError::unknown(first, "component", first, all.iter().map(|c| c.name.as_str())))?;
    let Some(before) = &component.text else { return Err(SpecError::new(first, format!("{first} is known by its name alone"))) };
    let after = replaced(before, path, word, words.rest())?;
    Inspected::put(&mut session.sim.world, entity, component.full, &after)
        .map_err(|e| SpecError::new(word, format!("{}: {e}", component.name)))?;
    changed(session, word, before, path, words.rest())
}

/// The text of a value with one field replaced.
fn replaced(text: &str, path: &str, word: &str, new: &str) -> Result<String, SpecError> {
    if new.is_empty() {
        return Err(SpecError::new("", "the new value is missing"));
    }
    let known: Vec<String> = fields(text).into_iter().map(|f| f.0).collect();
    let range = field(text, path).ok_or_else(|| SpecError::unknown(word, "field", path, known.iter().map(String::as_str)))?;
    Ok(format!("{}{new}{}", &text[..range.start], &text[range.end..]))
}

fn changed(session: &mut Session, word: &str, before: &str, path: &str, new: &str) -> Result<String, SpecError> {
    let step = session.clock().step;
    session.modified.get_or_insert(step);
    let state = session.sim.save_state().map_err(|e| SpecError::new("", e))?;
    session.past.keep(step, state, true);
    session.arrive()?;
    let old = field(before, path).map_or("", |r| &before[r]);
    Ok(format!("{word}: {} -> {new}", shortened(old)))
}
