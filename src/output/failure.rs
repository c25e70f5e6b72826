//! `failure.json`: why and where a run has failed, for whoever has to find the cause.
//!
//! | key | meaning |
//! |---|---|
//! | `provenance` | as in `summary.json` |
//! | `message` | what was found, likely causes, what to try |
//! | `time`, `step`, `dt`, `dt_limit`, `limited_by` | when, and the time step with its limit |
//! | `node` | where: number, place in its filament, position, distance moved, speed |
//! | `system` | what acts on that node most: a kind of element, `contact` or `loads` |
//! | `elements` | those that meet at the node: kind, number among its kind, nodes, section forces |
//! | `contacts` | those nearest to the node, at most three: bodies, gap, normal force |
//! | `looks` | the last looks at the energies, the oldest first |
//! | `last_good` | state from before the failure: step, time, checkpoint, frame |
//!
//! Numbers that are not finite are written as null.
use super::file::{OutputError, json, write_atomic};
use crate::assembly::{KindReports, node_states};
use crate::components::*;
use crate::element::{NodeState, SectionForce};
use crate::simulation::{NodeRows, Simulation, SimulationError};
use crate::step::Clock;
use crate::systems::contact::{ContactKind, ContactReport, all_contacts};
use crate::systems::watch::{Look, NodePlaces, Recent, Suspect};
use bevy_ecs::prelude::*;
use glam::DVec3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// The node where the failure shows.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FailedNode {
    pub id: u32,
    pub place: Option<String>,
    pub position: [f64; 3],
    pub moved: f64,
    pub speed: f64,
}

/// An element at that node; forces in the unit of the scene.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FailedElement {
    pub kind: String,
    pub index: usize,
    pub nodes: Vec<u32>,
    pub axial: f64,
    pub shear: f64,
    pub bending: f64,
    pub torsion: f64,
}

/// A contact near that node.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FailedContact {
    pub bodies: String,
    pub gap: f64,
    pub normal_force: f64,
}

/// State from before the failure that was kept.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct LastGood {
    pub step: u64,
    pub time: f64,
    pub checkpoint: String,
    pub frame: Option<String>,
}

/// The whole file.
#[derive(Clone, Debug, Serialize)]
#[allow(missing_docs)]
pub struct FailureReport {
    pub provenance: BTreeMap<String, String>,
    pub message: String,
    pub time: f64,
    pub step: u64,
    pub dt: f64,
    pub dt_limit: f64,
    pub limited_by: String,
    pub node: Option<FailedNode>,
    pub system: String,
    pub elements: Vec<FailedElement>,
    pub contacts: Vec<FailedContact>,
    pub looks: Vec<Look>,
    pub last_good: Option<LastGood>,
}

/// Name of the file in the output folder.
pub const FILE: &str = "failure.json";

/// Contacts that are told of.
const NEAREST: usize = 3;

impl FailureReport {
    /// Looks for where the failure shows in the state in which it was found.
    pub fn of(sim: &mut Simulation, error: &SimulationError) -> Self {
        let message = match error {
            SimulationError::Numerical { message, .. } => message.clone(),
            other => other.to_string(),
        };
        let clock = sim.world.resource::<Clock>().clone();
        let states = node_states(&mut sim.world);
        let finite = states.iter().all(|s| s.x.is_finite());
        // The search for contacts needs numbers.
        let contacts = if finite { all_contacts(&mut sim.world) } else { Vec::new() };
        let row = suspect(&mut sim.world, &states, &contacts);
        let elements = row.map_or(Vec::new(), |row| elements_at(&mut sim.world, row));
        let near = row.map_or(Vec::new(), |row| nearest(&contacts, states[row].x));
        FailureReport {
            provenance: BTreeMap::new(),
            message,
            time: clock.time,
            step: clock.step,
            dt: clock.dt,
            dt_limit: clock.dt_limit,
            limited_by: clock.limited_by,
            node: row.map(|row| node_at(&mut sim.world, &states, row)),
            system: culprit(&elements, &near),
            elements,
            contacts: near,
            looks: sim.world.get_resource::<Recent>().map_or(Vec::new(), |r| r.looks.iter().copied().collect()),
            last_good: None,
        }
    }

    /// Writes the file into an output folder.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        write_atomic(&folder.join(FILE), &json(self))
    }
}

/// Row of the node where the failure shows: what the watch has found, else the first number that is not finite, else
/// a contact pressed in by more than its radius, else the node with most kinetic energy.
fn suspect(world: &mut World, states: &[NodeState], contacts: &[ContactReport]) -> Option<usize> {
    if let Some(row) = world.get_resource::<Suspect>().and_then(|s| s.0) {
        return Some(row);
    }
    let forces: Vec<DVec3> = world.query::<&Force>().iter(world).map(|f| f.0).collect();
    let broken = |(s, f): (&NodeState, &DVec3)| !(s.x.is_finite() && s.v.is_finite() && f.is_finite());
    if let Some(row) = states.iter().zip(&forces).position(broken) {
        return Some(row);
    }
    let depth = |c: &ContactReport| (-c.gap - c.offset) / c.radius;
    // The first one, as the message names it.
    if let Some(c) = contacts.iter().find(|c| c.normal_force > 0.0 && depth(c) > 1.0) {
        let distance = |s: &NodeState| (s.x - c.place).length_squared();
        return (0..states.len()).min_by(|a, b| distance(&states[*a]).total_cmp(&distance(&states[*b])));
    }
    let energies: Vec<f64> = world.query::<(&Velocity, &Mass)>().iter(world).map(|(v, m)| m.0 * v.0.length_squared()).collect();
    (0..energies.len()).max_by(|a, b| energies[*a].total_cmp(&energies[*b]))
}

fn node_at(world: &mut World, states: &[NodeState], row: usize) -> FailedNode {
    let id = world.resource::<NodeRows>().id(row);
    let start = world.query::<&InitialPosition>().iter(world).nth(row).map_or(DVec3::NAN, |x| x.0);
    let s = &states[row];
    FailedNode {
        id: id.0,
        place: world.get_resource::<NodePlaces>().and_then(|p| p.text(id)),
        position: s.x.to_array(),
        moved: (s.x - start).length(),
        speed: s.v.length(),
    }
}

/// The elements of the scene that meet at a row, with their section forces.
fn elements_at(world: &mut World, row: usize) -> Vec<FailedElement> {
    let mut found = Vec::new();
    let Some(kinds) = world.remove_resource::<KindReports>() else { return found };
    for kind in &kinds.0 {
        let mut index = 0;
        let mut here: Vec<(usize, Vec<u32>, SectionForce)> = Vec::new();
        (kind.sections)(world, &mut |rows, force| {
            if rows.contains(&(row as u32)) {
                here.push((index, rows.to_vec(), force));
            }
            index += 1;
        });
        let ids = world.resource::<NodeRows>();
        found.extend(here.into_iter().map(|(index, rows, f)| FailedElement {
            kind: kind.name.into(),
            index,
            nodes: rows.iter().map(|r| ids.id(*r as usize).0).collect(),
            axial: f.axial,
            shear: f.shear,
            bending: f.bending,
            torsion: f.torsion,
        }));
    }
    world.insert_resource(kinds);
    found
}

fn nearest(contacts: &[ContactReport], place: DVec3) -> Vec<FailedContact> {
    let mut near: Vec<(f64, &ContactReport)> = contacts.iter().map(|c| ((c.place - place).length() / c.radius, c)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let told = |c: &ContactReport| FailedContact {
        bodies: match c.kind {
            ContactKind::Line | ContactKind::Point => format!("filaments {} and {}", c.filament, c.other),
            ContactKind::Surface | ContactKind::Edge => format!("filament {} and surface {}", c.filament, c.other),
        },
        gap: c.gap,
        normal_force: c.normal_force,
    };
    // Farther away than four radii a contact has nothing to do with the node.
    near.into_iter().take_while(|(d, _)| *d < 4.0).take(NEAREST).map(|(_, c)| told(c)).collect()
}

/// What acts on the node most.
fn culprit(elements: &[FailedElement], contacts: &[FailedContact]) -> String {
    let size = |e: &FailedElement| e.axial.abs().max(e.shear.abs());
    if let Some(e) = elements.iter().find(|e| !size(e).is_finite()) {
        return e.kind.clone();
    }
    let element = elements.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
    let contact = contacts.iter().map(|c| c.normal_force).fold(0.0, f64::max);
    match element {
        Some(e) if size(e) > 0.0 && size(e) >= contact => e.kind.clone(),
        _ if contact > 0.0 => "contact".into(),
        _ => "loads".into(),
    }
}

/// Lines below the message, for the person at the keyboard.
impl fmt::Display for FailureReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(n) = &self.node {
            let [x, y, z] = n.position;
            let place = n.place.as_ref().map_or(String::new(), |p| format!(" ({p})"));
            writeln!(f, "  node         {}{place} at ({x:.4e}, {y:.4e}, {z:.4e}), moved by {:.3e}, speed {:.3e}", n.id, n.moved, n.speed)?;
        }
        for e in self.elements.iter().take(4) {
            let nodes: Vec<String> = e.nodes.iter().map(u32::to_string).collect();
            writeln!(f, "  element      {} {} (nodes {}): N {:.3e}, M {:.3e}", e.kind, e.index, nodes.join(", "), e.axial, e.bending)?;
        }
        for c in &self.contacts {
            writeln!(f, "  contact      {}: gap {:.3e}, normal force {:.3e}", c.bodies, c.gap, c.normal_force)?;
        }
        writeln!(f, "  system       {} acts most there; the time step is limited by {}", self.system, self.limited_by)?;
        for l in self.looks.iter().rev().take(4).rev() {
            writeln!(
                f,
                "  before       t {:.4e} step {} dt {:.2e}: kinetic {:.3e}, strain {:.3e}, work {:.3e}, balance error {:.1} %, penetration {:.1} %",
                l.time,
                l.step,
                l.dt,
                l.kinetic,
                l.strain,
                l.external_work,
                100.0 * l.balance_error,
                100.0 * l.penetration
            )?;
        }
        if let Some(good) = &self.last_good {
            let frame = good.frame.as_ref().map_or(String::new(), |frame| format!(", {frame}"));
            writeln!(f, "  last good    t {:.4e} step {}: {}{frame}", good.time, good.step, good.checkpoint)?;
        }
        write!(f, "  all of it    {FILE}")
    }
}
