//! Single numbers of a simulation by name: what expressions are made of.
//!
//! Words stand for numbers of the whole model ([`Word::ALL`]). Braces hold anything else: a node (`{node 3 v.x}`,
//! `{tow 0 fil 1 node 3 f}`), an element (`{element lab.spring 0 rest_length}`), a probe of the scene by its name (`{tip}`), or
//! a probe as a scene writes it (`{Displacement(node: 3, component: X)}`).
use super::address::{self, Words};
use super::inspect::{Inspected, Kind, field};
use crate::catalog::PROBES;
use crate::components::*;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::measure::{Probe, ProbeSpec, Quantity};
use crate::registry::SpecError;
use crate::scene::{LoadedScene, ron_options};
use crate::simulation::{Failure, NodeEntities, NodeRows, Simulation};
use crate::step::Clock;
use crate::systems::contact::monitor::summarise;
use crate::systems::energy::LookNow;
use crate::systems::watch::{Recent, Suspect};
use bevy_ecs::prelude::*;
use glam::DVec3;

/// A number of the whole model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// Time.
    T,
    /// Time step.
    Dt,
    /// Completed steps.
    Step,
    /// Kinetic energy.
    Kinetic,
    /// Strain energy.
    Strain,
    /// Work of loads and prescribed motions.
    Work,
    /// Energy in contacts.
    Contact,
    /// Energy taken by friction.
    Friction,
    /// Energy taken by damping.
    Damping,
    /// Energy taken by the implicit axial solve.
    Axial,
    /// Work that is not accounted for.
    Imbalance,
    /// Contacts that carry a force.
    Contacts,
    /// Sum of all normal contact forces.
    ContactForce,
    /// Largest normal contact force.
    LargestContactForce,
    /// Largest penetration over the smaller radius.
    Penetration,
    /// Largest speed of a node.
    Speed,
    /// Largest force on a node.
    Force,
}

impl Word {
    /// All words with what they stand for.
    pub const ALL: [(&'static str, Word, Quantity, &'static str); 17] = [
        ("t", Word::T, Quantity::Time, "time"),
        ("dt", Word::Dt, Quantity::Time, "time step"),
        ("step", Word::Step, Quantity::Number, "completed steps"),
        ("kinetic", Word::Kinetic, Quantity::Energy, "kinetic energy"),
        ("strain", Word::Strain, Quantity::Energy, "strain energy"),
        ("work", Word::Work, Quantity::Energy, "work of loads and prescribed motions"),
        ("contact", Word::Contact, Quantity::Energy, "energy in contacts"),
        ("friction", Word::Friction, Quantity::Energy, "energy taken by friction"),
        ("damping", Word::Damping, Quantity::Energy, "energy taken by damping"),
        ("axial", Word::Axial, Quantity::Energy, "energy taken by the implicit axial solve"),
        ("imbalance", Word::Imbalance, Quantity::Energy, "work that is not accounted for"),
        ("contacts", Word::Contacts, Quantity::Number, "contacts that carry a force"),
        ("contact_force", Word::ContactForce, Quantity::Force, "sum of all normal contact forces"),
        ("largest_contact_force", Word::LargestContactForce, Quantity::Force, "largest normal contact force"),
        ("penetration", Word::Penetration, Quantity::Number, "largest penetration over the smaller radius"),
        ("speed", Word::Speed, Quantity::Velocity, "largest speed of a node"),
        ("force", Word::Force, Quantity::Force, "largest force on a node"),
    ];
}

/// A vector of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeVector {
    /// Position.
    X,
    /// Velocity.
    V,
    /// Force.
    F,
    /// Moment.
    M,
    /// Angular velocity.
    W,
}

impl NodeVector {
    /// All vectors by the letter that stands for them, with the name of their component.
    pub const ALL: [(&'static str, NodeVector, &'static str); 5] = [
        ("x", NodeVector::X, "Position"),
        ("v", NodeVector::V, "Velocity"),
        ("f", NodeVector::F, "Force"),
        ("m", NodeVector::M, "Moment"),
        ("w", NodeVector::W, "AngularVelocity"),
    ];

    /// The vector called by a letter.
    ///
    /// # Errors
    /// Another word.
    pub fn of(word: &str) -> Result<Self, SpecError> {
        let found = Self::ALL.iter().find(|a| a.0 == word).map(|a| a.1);
        found.ok_or_else(|| SpecError::new(word, format!("`{word}` is no vector of a node")).help("x, v, f, m and w are"))
    }

    fn value(self, world: &World, node: NodeId) -> DVec3 {
        let row = world.resource::<NodeRows>().of(node);
        let entity = world.entity(world.resource::<NodeEntities>().0[row]);
        match self {
            NodeVector::X => entity.get::<Position>().map(|p| p.0),
            NodeVector::V => entity.get::<Velocity>().map(|v| v.0),
            NodeVector::F => entity.get::<Force>().map(|f| f.0),
            NodeVector::M => entity.get::<Moment>().map(|m| m.0),
            NodeVector::W => entity.get::<AngularVelocity>().map(|w| w.0),
        }
        .unwrap_or_default()
    }
}

/// One number, found.
#[derive(Clone)]
pub enum Reading {
    /// Of the whole model.
    Word(Word),
    /// Of a node: a component of a vector, or its length.
    Node(NodeId, NodeVector, Option<usize>),
    /// Of an element: kind, number, path of the field.
    Element(Kind, usize, String),
    /// A probe.
    Probe(Probe),
}

impl Reading {
    /// What a name stands for.
    ///
    /// # Errors
    /// A name that stands for nothing, with the nearest that does.
    pub fn of(name: &str, scene: &LoadedScene, sim: &mut Simulation) -> Result<Self, SpecError> {
        if let Some((_, word, ..)) = Word::ALL.iter().find(|w| w.0 == name) {
            return Ok(Reading::Word(*word));
        }
        if let Some((_, probe)) = scene.probes.iter().find(|p| p.0 == name) {
            return Ok(Reading::Probe(probe.clone()));
        }
        let mut words = Words::of(name);
        match words.peek() {
            Some("node" | "tow") => {
                let id = address::node(&mut words, &scene.model)?;
                let what = words.next().ok_or_else(|| SpecError::new("", "the vector is missing").help("{node 3 v.x}"))?;
                let (vector, component) = what.split_once('.').map_or((what, None), |(v, c)| (v, Some(c)));
                let axis = match component {
                    None => None,
                    Some(c) => Some(
                        ["x", "y", "z"]
                            .iter()
                            .position(|a| *a == c)
                            .ok_or_else(|| SpecError::unknown(c, "component", c, ["x", "y", "z"]))?,
                    ),
                };
                words.end()?;
                Ok(Reading::Node(id, NodeVector::of(vector)?, axis))
            }
            Some("element") => {
                words.next();
                let place = address::element(&mut words, &mut sim.world)?;
                let reading = Reading::Element(place.kind, place.index, words.rest().to_string());
                reading.value(sim).map_err(|message| SpecError::new(words.rest(), message)).map(|_| reading)
            }
            Some(_) if name.contains('(') || PROBES.iter().any(|p| p.0 == name) => {
                let read = scene.scene.units.while_reading(|| ron_options().from_str::<ProbeSpec>(name));
                let spec = read.map_err(|e| SpecError::new(name, e.code.to_string()))?;
                spec.resolve(&scene.model, &sim.registry).map(Reading::Probe).map_err(|e| SpecError { path: name.into(), ..e })
            }
            _ => {
                let known = Word::ALL.iter().map(|w| w.0).chain(scene.probes.iter().map(|p| p.0.as_str()));
                Err(SpecError::unknown(name, "quantity", name, known))
            }
        }
    }

    /// What the number is, where that is known.
    pub fn quantity(&self) -> Option<Quantity> {
        match self {
            Reading::Word(word) => Word::ALL.iter().find(|w| w.1 == *word).map(|w| w.2),
            Reading::Node(_, NodeVector::X, _) => Some(Quantity::Length),
            Reading::Node(_, NodeVector::V, _) => Some(Quantity::Velocity),
            Reading::Node(_, NodeVector::F, _) => Some(Quantity::Force),
            Reading::Node(_, NodeVector::M, _) => Some(Quantity::Moment),
            Reading::Node(_, NodeVector::W, _) | Reading::Element(..) => None,
            Reading::Probe(probe) => Some(probe.quantity()),
        }
    }

    /// The number now. Nothing that counts for the run is changed.
    ///
    /// # Errors
    /// A field that is not there or is no number.
    pub fn value(&self, sim: &mut Simulation) -> Result<f64, String> {
        Ok(match self {
            Reading::Word(word) => of_word(*word, sim),
            Reading::Node(id, vector, axis) => {
                let v = vector.value(&sim.world, *id);
                axis.map_or_else(|| v.length(), |a| v[a])
            }
            Reading::Element(kind, index, path) => of_element(*kind, *index, path, sim)?,
            Reading::Probe(probe) if matches!(probe.quantity(), Quantity::Energy | Quantity::Force | Quantity::Number) => {
                looked_at(sim, |world| probe.evaluate(world))
            }
            Reading::Probe(probe) => probe.evaluate(&mut sim.world),
        })
    }
}

fn of_word(word: Word, sim: &mut Simulation) -> f64 {
    let clock = sim.world.resource::<Clock>();
    match word {
        Word::T => return clock.time,
        Word::Dt => return clock.dt,
        Word::Step => return clock.step as f64,
        Word::Speed => return sim.world.query::<&Velocity>().iter(&sim.world).map(|v| v.0.length()).fold(0.0, f64::max),
        Word::Force => return sim.world.query::<&Force>().iter(&sim.world).map(|f| f.0.length()).fold(0.0, f64::max),
        _ => {}
    }
    looked_at(sim, |world| {
        let e = world.get_resource::<EnergyLedger>().copied().unwrap_or_default();
        let c = world.get_resource::<ContactSummary>().copied().unwrap_or_default();
        match word {
            Word::Kinetic => e.kinetic,
            Word::Strain => e.strain,
            Word::Work => e.external_work,
            Word::Contact => e.contact,
            Word::Friction => e.friction,
            Word::Damping => e.damping,
            Word::Axial => e.axial,
            Word::Imbalance => e.imbalance(),
            Word::Contacts => c.active as f64,
            Word::ContactForce => c.total_force,
            Word::LargestContactForce => c.max_force,
            Word::Penetration => c.max_penetration_to_radius,
            Word::T | Word::Dt | Word::Step | Word::Speed | Word::Force => unreachable!("read from the nodes and the clock"),
        }
    })
}

fn of_element(kind: Kind, index: usize, path: &str, sim: &mut Simulation) -> Result<f64, String> {
    let entity = (kind.members)(&mut sim.world)[index];
    let all = Inspected::components_of(&sim.world, entity);
    let own = all.iter().find(|c| c.full == kind.component);
    let named = all.iter().find_map(|c| Some((c, path.strip_prefix(c.name.as_str())?)).filter(|(_, rest)| rest.starts_with(['.', '['])));
    let (component, path) =
        named.map(|(c, rest)| (c, rest.trim_start_matches('.'))).or(own.map(|c| (c, path))).ok_or("nothing is known of it")?;
    let text = component.text.as_deref().ok_or_else(|| format!("`{}` is known by its name alone", component.name))?;
    let range = field(text, path).ok_or_else(|| format!("`{}` has no field `{path}`: {text}", component.name))?;
    text[range.clone()].parse().map_err(|_| format!("`{path}` is no single number: {}", &text[range]))
}

/// Energies and contacts as they are now, for `read`; what the run keeps of them stays as it was.
pub fn looked_at<T>(sim: &mut Simulation, read: impl FnOnce(&mut World) -> T) -> T {
    let world = &sim.world;
    let (ledger, contacts) = (world.get_resource::<EnergyLedger>().copied(), world.get_resource::<ContactSummary>().copied());
    let (failure, look) = (world.resource::<Failure>().clone(), world.get_resource::<LookNow>().copied());
    let (recent, suspect) = (world.get_resource::<Recent>().cloned(), world.get_resource::<Suspect>().copied());
    let supply = Inspected::resources(world).into_iter().find(|r| r.name == "Supply").and_then(|r| Some((r.text(world)?, r)));
    if contacts.is_some() {
        summarise(&mut sim.world);
    }
    sim.refresh_energies();
    let value = read(&mut sim.world);
    let world = &mut sim.world;
    if let Some(ledger) = ledger {
        world.insert_resource(ledger);
    }
    if let Some(contacts) = contacts {
        world.insert_resource(contacts);
    }
    if let Some(look) = look {
        world.insert_resource(look);
    }
    world.insert_resource(failure);
    if let Some(recent) = recent {
        world.insert_resource(recent);
    }
    if let Some(suspect) = suspect {
        world.insert_resource(suspect);
    }
    if let Some((text, supply)) = supply {
        supply.put(world, &text).expect("what was written reads back");
    }
    value
}
