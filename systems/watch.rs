//! The watch: looks with the energies (every `integration.monitor_every` steps) for what a sound run never shows.
//!
//! | looked for | meaning |
//! |---|---|
//! | strain | an element with axial stiffness is stretched or squeezed by more than [`Watch::strain`] of its initial length; an element that is turned inside out has been squeezed before |
//! | rotation | a node turns by more than [`Watch::rotation`] radian in one step |
//! | balance | more than [`Watch::balance`] of the largest energy is not accounted for, sixteen looks in a row |
//! | time step | the step has shrunk below [`Watch::time_step`] of what it was when the run had settled |
//!
//! Numbers that are not finite and runaway energy are found in `energy.rs`, deep contacts in `contact/monitor.rs`.
//! The first find is left in [`Failure`], its node in [`Suspect`]; the last looks are kept in [`Recent`].
use crate::systems::energy::{fastest_node, rounding};
use braid_ecs::prelude::*;
use std::collections::VecDeque;

/// Registers what has to be read of the elements before the implicit scheme takes their springs.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("watch", install);
}

/// Looks in a row with a bad balance that stop a run.
const PATIENCE: u32 = 16;

/// How far the time step may fall until it is remembered, of the mean one.
const SETTLES_TO: f64 = 1e-3;
/// Steps after which the time step is remembered as that of the settled run.
const SETTLED: u64 = 64;

/// Looks that are kept.
const KEPT: usize = 16;

/// An element with axial stiffness, as the watch sees it.
#[derive(Clone, Copy, Debug)]
struct Bar {
    rows: [u32; 2],
    /// One over the initial length.
    per_length: f64,
    kind: &'static str,
    /// Number among its kind.
    index: u32,
}

/// What is looked at, with the queries for it: making them anew at every look would cost small models.
#[derive(Resource)]
struct Eyes {
    rule: Watch,
    fixed_step: bool,
    bars: Vec<Bar>,
    positions: QueryState<&'static Position>,
    spins: QueryState<&'static AngularVelocity>,
}

/// Row of the node that the watch has found, if it was the watch.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Suspect(pub Option<usize>);

/// The run at one look; energies in force x length, the rest as in `history.csv`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub struct Look {
    pub step: u64,
    pub time: f64,
    pub dt: f64,
    pub kinetic: f64,
    pub strain: f64,
    pub external_work: f64,
    pub balance_error: f64,
    pub contacts: usize,
    pub penetration: f64,
}

/// The last looks, the oldest first, and what the watch remembers between them.
#[derive(Resource, Clone, Debug, Default, Serialize, Deserialize)]
pub struct Recent {
    /// At most sixteen of them.
    pub looks: VecDeque<Look>,
    /// Looks in a row with a bad balance.
    out_of_balance: u32,
    /// Time step of the settled run (time); zero before.
    settled_dt: f64,
}

fn install(cx: &mut Install<'_>) {
    let mut bars = Vec::new();
    if let Some(kinds) = cx.world.remove_resource::<KindReports>() {
        for kind in &kinds.0 {
            let springs = (kind.springs)(cx.world).into_iter().enumerate();
            let positions = node_states(cx.world);
            bars.extend(springs.filter_map(|(index, spring)| {
                let (rows, _) = spring?;
                let length = (positions[rows[1] as usize].x - positions[rows[0] as usize].x).length();
                (length > 0.0).then_some(Bar { rows, per_length: 1.0 / length, kind: kind.name, index: index as u32 })
            }));
        }
        cx.world.insert_resource(kinds);
    }
    let (positions, spins) = (cx.world.query(), cx.world.query());
    let (rule, fixed_step) = (cx.model.watch, cx.model.integration.dt.is_some());
    cx.world.insert_resource(Eyes { rule, fixed_step, bars, positions, spins });
    cx.world.insert_resource(NodePlaces::of(cx.model));
    cx.world.init_resource::<Suspect>();
    cx.world.init_resource::<Recent>();
    cx.remember_resource::<Recent>();
}

/// Looks at the run now; the energies have just been taken.
pub fn look(world: &mut World) {
    let Some(mut eyes) = world.remove_resource::<Eyes>() else { return };
    let mut recent = world.remove_resource::<Recent>().unwrap_or_default();
    recent.add(world);
    let found = found(world, &mut eyes, &mut recent);
    world.insert_resource(recent);
    world.insert_resource(eyes);
    if let Some((row, message)) = found
        && world.resource::<Failure>().0.is_none()
    {
        world.resource_mut::<Failure>().0 = Some(message);
        world.resource_mut::<Suspect>().0 = row;
    }
}

impl Recent {
    fn add(&mut self, world: &World) {
        let (clock, e) = (world.resource::<Clock>(), world.resource::<EnergyLedger>());
        let contacts = world.get_resource::<ContactSummary>().copied().unwrap_or_default();
        // The last step of a run may be looked at twice.
        let again = self.looks.back().is_some_and(|l| l.step == clock.step);
        if again {
            self.looks.pop_back();
        } else if self.looks.len() == KEPT {
            self.looks.pop_front();
        }
        self.looks.push_back(Look {
            step: clock.step,
            time: clock.time,
            dt: clock.dt,
            kinetic: e.kinetic,
            strain: e.strain,
            external_work: e.external_work,
            balance_error: e.balance_error(),
            contacts: contacts.active,
            penetration: contacts.max_penetration_to_radius,
        });
    }
}

/// What is wrong, with the row of its node where it has one.
fn found(world: &mut World, eyes: &mut Eyes, recent: &mut Recent) -> Option<(Option<usize>, String)> {
    strained(world, eyes)
        .or_else(|| spinning(world, eyes))
        .or_else(|| collapsed(world, eyes, recent))
        .or_else(|| unbalanced(world, eyes, recent))
}

/// The most strained element, if it is too much.
fn strained(world: &mut World, eyes: &mut Eyes) -> Option<(Option<usize>, String)> {
    let mut worst = (eyes.rule.strain, None);
    {
        let mut query = eyes.positions.query(world);
        let x = columns(&mut query);
        for bar in &eyes.bars {
            let [a, b] = bar.rows.map(|r| x[r as usize].0);
            let strain = (b - a).length() * bar.per_length - 1.0;
            if strain.abs() > worst.0 {
                worst = (strain.abs(), Some((*bar, strain)));
            }
        }
    }
    let (bar, strain) = worst.1?;
    let [a, b] = bar.rows.map(|r| world.resource::<NodeRows>().id(r as usize).0);
    let place = place_of(world, bar.rows[0] as usize);
    let how = if strain > 0.0 { "stretched" } else { "squeezed" };
    let message = format!(
        "{} {} (nodes {a} and {b}{place}) is {how} by {:.0} % of its length. Likely causes: a load or a prescribed motion far above what the section bears, \
         a stiffness or a unit that is wrong, or a motion that is about to become unstable. \
         If it is meant: watch: (strain: None)",
        bar.kind,
        bar.index,
        100.0 * strain.abs()
    );
    Some((Some(bar.rows[0] as usize), message))
}

/// The node that turns fastest, if it is too fast.
fn spinning(world: &mut World, eyes: &mut Eyes) -> Option<(Option<usize>, String)> {
    let dt = world.resource::<Clock>().dt_next;
    let fastest = {
        let spins = eyes.spins.query(world);
        spins.iter().map(|w| w.0.length_squared()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (row, speed) = fastest?;
    let angle = speed.sqrt() * dt;
    (angle > eyes.rule.rotation).then(|| {
        let (id, place) = (world.resource::<NodeRows>().id(row).0, place_of(world, row));
        let message = format!(
            "node {id}{} turns by {angle:.2} radian in one step of {dt:.3e}. Likely causes: a moment on a node with little rotary inertia, or a time step above \
             the stable limit. Try integration: (safety: 0.5), or rotary_inertia: Scaled(1). If it is meant: watch: (rotation: None)",
            bracketed(&place)
        );
        (Some(row), message)
    })
}

/// A time step that has shrunk so far that the run would not end.
fn collapsed(world: &mut World, eyes: &Eyes, recent: &mut Recent) -> Option<(Option<usize>, String)> {
    let clock = world.resource::<Clock>().clone();
    if eyes.fixed_step || clock.step < SETTLED {
        return None;
    }
    if recent.settled_dt == 0.0 {
        // It may have collapsed already.
        recent.settled_dt = clock.dt_target.max(SETTLES_TO * clock.time / clock.step as f64);
    }
    (clock.dt_target < eyes.rule.time_step * recent.settled_dt).then(|| {
        let row = fastest_node(world);
        let (id, place) = (world.resource::<NodeRows>().id(row).0, place_of(world, row));
        let message = format!(
            "the time step has collapsed from {:.3e} to {:.3e}; it is limited by {}. Fastest is node {id}{}. Likely causes: an element squeezed to nothing, \
             a contact that has become far too stiff, or a load far above what the nodes are heavy. If it is meant: watch: (time_step: None)",
            recent.settled_dt,
            clock.dt_target,
            clock.limited_by,
            bracketed(&place)
        );
        (Some(row), message)
    })
}

/// Energy that comes from nowhere or goes nowhere.
fn unbalanced(world: &mut World, eyes: &Eyes, recent: &mut Recent) -> Option<(Option<usize>, String)> {
    let e = *world.resource::<EnergyLedger>();
    // What vibrations near the limit of the step show in the middle of a swing is no energy that has come from nowhere.
    let allowed = eyes.rule.balance * e.largest();
    let out =
        e.imbalance().abs() > allowed && (e.imbalance() + of_the_step(world)).abs() > allowed && e.imbalance().abs() > rounding(world);
    recent.out_of_balance = if out { recent.out_of_balance + 1 } else { 0 };
    (recent.out_of_balance >= PATIENCE).then(|| {
        let message = format!(
            "the energies do not balance: {:.3e} of {:.3e} put in is not accounted for. Likely causes: a time step near its limit, contacts that jump, or an \
             element of a plugin that does not book what it dissipates. Try integration: (safety: 0.5). If it is meant: watch: (balance: None)",
            e.imbalance(),
            e.initial + e.external_work
        );
        (None, message)
    })
}

/// (dt^2 / 8) sum m a.a: kinetic and strain energy less this is what central differences keep.
fn of_the_step(world: &mut World) -> f64 {
    let dt = world.resource::<Clock>().dt_next;
    let mut nodes = world.query::<(&Force, &InverseMass)>();
    let forces: f64 = nodes.iter(world).map(|(f, w)| f.0.dot(f.0 * w.0)).sum();
    let mut nodes = world.query::<(&Moment, &InverseInertia)>();
    let moments: f64 = nodes.iter(world).map(|(m, w)| m.0.dot(m.0 * w.0)).sum();
    0.125 * dt * dt * (forces + moments)
}

/// `; tow 3, filament 2, node 17 of 31` for the node in a row, or nothing.
fn place_of(world: &World, row: usize) -> String {
    let id = world.resource::<NodeRows>().id(row);
    world.resource::<NodePlaces>().text(id).map_or(String::new(), |p| format!("; {p}"))
}

fn bracketed(place: &str) -> String {
    place.strip_prefix("; ").map_or(String::new(), |p| format!(" ({p})"))
}

/// Where nodes sit in the filaments, for messages.
#[derive(Resource, Clone, Debug, Default)]
pub struct NodePlaces {
    /// Filament and place in it by node; `u32::MAX` for nodes that are in none.
    nodes: Vec<[u32; 2]>,
    /// Tow, number in the tow and number of nodes by filament.
    filaments: Vec<[usize; 3]>,
}

impl NodePlaces {
    fn of(model: &Model) -> Self {
        let mut nodes = vec![[u32::MAX; 2]; model.nodes.len()];
        for (f, filament) in model.filaments.iter().enumerate() {
            for (k, n) in filament.nodes.iter().enumerate() {
                nodes[n.row()] = [f as u32, k as u32];
            }
        }
        // What is tied to a node says where it is, if nothing else does.
        for t in &model.ties {
            if nodes[t.host.row()][0] == u32::MAX {
                nodes[t.host.row()] = nodes[t.embedded.row()];
            }
        }
        NodePlaces { nodes, filaments: model.filaments.iter().map(|f| [f.tow, f.index, f.nodes.len()]).collect() }
    }

    /// `tow 3, filament 2, node 17 of 31`, if the node is part of a filament.
    pub fn text(&self, node: NodeId) -> Option<String> {
        let [filament, k] = *self.nodes.get(node.row())?;
        let [tow, index, count] = self.filaments.get(filament as usize)?;
        Some(format!("tow {tow}, filament {index}, node {k} of {count}"))
    }
}
