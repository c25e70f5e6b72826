//! `info`, `top`, `list`, `diff`: the whole model at a glance.
use super::address::{self, Words};
use super::commands::snapshot;
use super::inspect::{Inspected, fields};
use super::reading::looked_at;
use super::session::Session;
use super::text::{number, quantity, shortened, table, vector};
use crate::assembly::{KindReports, node_states};
use crate::components::*;
use crate::ledger::{ContactSummary, EnergyLedger};
use crate::output::lines::Lines;
use crate::registry::SpecError;
use crate::simulation::NodeRows;
use crate::state;
use crate::systems::contact::{ContactKind, ContactReport, all_contacts};
use bevy_ecs::prelude::*;
use glam::DVec3;

const TOPICS: [&str; 9] = ["time", "dt", "energy", "systems", "breaks", "contacts", "mesh", "stored", "memory"];

/// `info TOPIC`
pub(super) fn info(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    let topic = words.next().ok_or_else(|| SpecError::new("", "about what?").help(TOPICS.join(", ")))?;
    words.end()?;
    let units = session.scene.scene.units;
    let clock = session.clock().clone();
    let rows: Vec<(String, String)> = match topic {
        "time" => vec![
            ("step".into(), clock.step.to_string()),
            ("time".into(), quantity(clock.time, units.time())),
            ("within a step".into(), if session.between_steps() { "no" } else { "yes" }.into()),
            ("modified".into(), session.modified.map_or("no".into(), |s| format!("since step {s}"))),
            ("failed".into(), session.failure().cloned().unwrap_or("no".into())),
        ],
        "dt" => [("last step", clock.dt), ("next step", clock.dt_next), ("wanted", clock.dt_target), ("stable limit", clock.dt_limit)]
            .map(|(name, v)| (name.into(), quantity(v, units.time())))
            .into_iter()
            .chain([("limited by".into(), clock.limited_by)])
            .collect(),
        "energy" => looked_at(&mut session.sim, |world| {
            let e = world.get_resource::<EnergyLedger>().copied().unwrap_or_default();
            let terms = [
                ("initial", e.initial),
                ("work", e.external_work),
                ("kinetic", e.kinetic),
                ("strain", e.strain),
                ("contact", e.contact),
                ("friction", e.friction),
                ("damping", e.damping),
                ("axial", e.axial),
                ("imbalance", e.imbalance()),
            ];
            terms.map(|(name, v)| (name.into(), quantity(v, units.energy()))).into()
        }),
        "systems" => {
            let next = session.driver.next(&session.sim);
            let mark = |n: usize| if n == next { "next" } else { "" };
            session.systems().into_iter().enumerate().map(|(n, name)| (name, mark(n).into())).collect()
        }
        "breaks" => {
            let systems = session.systems();
            session.stops.iter().map(|s| (s.number.to_string(), s.about(&systems))).collect()
        }
        "contacts" => contacts(session),
        "mesh" => mesh(session),
        "stored" => stored(session),
        "memory" => {
            let mib = |bytes: usize| format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20));
            let named: usize = session.snapshots.values().map(|s| s.state.len()).sum();
            let state = session.sim.save_state().map_err(|e| SpecError::new("", e))?;
            vec![
                ("a state".into(), mib(state.len())),
                ("states to go back to".into(), format!("{}, {}", session.past.len(), mib(session.past.bytes()))),
                ("states with a name".into(), format!("{}, {}", session.snapshots.len(), mib(named))),
            ]
        }
        other => return Err(SpecError::unknown(other, "topic", other, TOPICS)),
    };
    Ok(if rows.is_empty() { "none".into() } else { table(&rows) })
}

fn contacts(session: &mut Session) -> Vec<(String, String)> {
    let units = session.scene.scene.units;
    let records = address::contact_records(&mut session.sim.world).map(|list| list.len());
    if !session.sim.world.contains_resource::<ContactSummary>() {
        return Vec::new();
    }
    let c = looked_at(&mut session.sim, |world| *world.resource::<ContactSummary>());
    let names = ["records side by side", "records of crossings", "records on surfaces", "records over edges"];
    let mut rows: Vec<(String, String)> = names.into_iter().zip(records).map(|(name, n)| (name.into(), n.to_string())).collect();
    rows.extend([
        ("with a force".into(), c.active.to_string()),
        ("sum of normal forces".into(), quantity(c.total_force, units.force())),
        ("largest normal force".into(), quantity(c.max_force, units.force())),
        ("largest penetration / radius".into(), number(c.max_penetration_to_radius)),
        ("lists made".into(), c.rebuilds.to_string()),
    ]);
    rows
}

fn mesh(session: &mut Session) -> Vec<(String, String)> {
    let model = &session.scene.model;
    let dummies = model.nodes.iter().filter(|n| n.dummy).count();
    let mut rows = vec![
        ("nodes".to_string(), format!("{} ({dummies} dummy, {} tied)", model.nodes.len(), model.ties.len())),
        ("filaments".into(), model.filaments.len().to_string()),
        ("constraints".into(), format!("{} periodic pairs, {} equations", model.periodic.len(), model.equations.len())),
    ];
    let mut first = 0;
    for kind in Inspected::kinds(&session.sim.world) {
        let count = (kind.members)(&mut session.sim.world).len();
        rows.push((format!("elements {}", kind.name), format!("{count}, from {first}")));
        first += count;
    }
    rows
}

/// Everything that `print` knows by name: components with the number of entities that have them, resources.
fn stored(session: &mut Session) -> Vec<(String, String)> {
    let world = &mut session.sim.world;
    let components = Inspected::components(world).into_iter().map(|c| (c.name, (c.members)(world).len())).filter(|c| c.1 > 0);
    let mut rows: Vec<(String, String)> = components.map(|(name, n)| (name, format!("component, {n}"))).collect();
    let world = &session.sim.world;
    rows.extend(Inspected::resources(world).into_iter().filter(|r| r.text(world).is_some()).map(|r| (r.name, "resource".to_string())));
    rows.sort();
    rows
}

/// A value, the unit of all, and where it is.
type Ranking = (Vec<(f64, String)>, String);

/// `top N WHAT`
pub(super) fn top(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    const WHAT: [&str; 5] = ["speed", "force", "penetration", "strain", "curvature"];
    let count: usize = words.number("how many to show")?;
    let what = words.next().ok_or_else(|| SpecError::new("", "what is missing").help(WHAT.join(", ")))?;
    words.end()?;
    let (mut all, unit) = match what {
        "speed" => nodes(session, |s| s.v.length(), session.scene.scene.units.velocity()),
        "force" => {
            let forces: Vec<f64> = session.sim.world.query::<&Force>().iter(&session.sim.world).map(|f| f.0.length()).collect();
            let unit = session.scene.scene.units.force().to_string();
            (forces.into_iter().enumerate().map(|(row, f)| (f, session.row_name(row))).collect(), unit)
        }
        "penetration" => {
            let all = all_contacts(&mut session.sim.world);
            let unit = "of the radius".to_string();
            (all.iter().filter(|c| c.normal_force > 0.0).map(|c| (-c.gap / c.radius, contact_name(c))).collect(), unit)
        }
        "strain" => along_lines(session, 2, |now, start| now[0].distance(now[1]) / start[0].distance(start[1]) - 1.0, "since the start"),
        "curvature" => {
            let unit = session.scene.scene.units.length();
            let unit = if unit == "-" { String::new() } else { format!("1/{unit}") };
            along_lines(session, 3, |now, _| bend(now), &unit)
        }
        other => return Err(SpecError::unknown(other, "quantity to rank", other, WHAT)),
    };
    all.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let rows: Vec<(String, String)> = all.into_iter().take(count).map(|(v, name)| (quantity(v, &unit), name)).collect();
    Ok(if rows.is_empty() { "none".into() } else { table(&rows) })
}

fn nodes(session: &mut Session, of: fn(&crate::element::NodeState) -> f64, unit: String) -> Ranking {
    let states = node_states(&mut session.sim.world);
    (states.iter().enumerate().map(|(row, s)| (of(s), session.row_name(row))).collect(), unit)
}

/// Values of every so many neighbouring points of all lines, from the points now and at the start.
fn along_lines(session: &mut Session, points: usize, of: fn(&[DVec3], &[DVec3]) -> f64, unit: &str) -> Ranking {
    let lines = Lines::of(&session.scene.model, &mut session.sim);
    let now: Vec<DVec3> = node_states(&mut session.sim.world).iter().map(|s| s.x).collect();
    let start: Vec<DVec3> = session.sim.world.query::<&InitialPosition>().iter(&session.sim.world).map(|x| x.0).collect();
    let mut all = Vec::new();
    for window in lines.lines.iter().flat_map(|l| l.rows.windows(points)) {
        let at = |x: &[DVec3]| window.iter().map(|r| x[*r as usize]).collect::<Vec<_>>();
        let name = if points == 2 {
            format!("{} to {}", session.row_name(window[0] as usize), session.row_name(window[1] as usize))
        } else {
            session.row_name(window[1] as usize)
        };
        all.push((of(&at(&now), &at(&start)), name));
    }
    (all, unit.to_string())
}

/// Curvature of a polyline at its middle point: 2 tan(angle / 2) over the mean length.
fn bend(p: &[DVec3]) -> f64 {
    let (a, b) = (p[1] - p[0], p[2] - p[1]);
    2.0 * (0.5 * a.angle_between(b)).tan() / (0.5 * (a.length() + b.length()))
}

fn contact_name(c: &ContactReport) -> String {
    let bodies = match c.kind {
        ContactKind::Line => format!("filaments {} and {} side by side", c.filament, c.other),
        ContactKind::Point => format!("filaments {} and {} crossing", c.filament, c.other),
        ContactKind::Surface => format!("filament {} on surface {}", c.filament, c.other),
        ContactKind::Edge => format!("filament {} over an edge of surface {}", c.filament, c.other),
    };
    format!("{bodies} at {}, normal force {}", vector(c.place), number(c.normal_force))
}

impl Session {
    fn row_name(&self, row: usize) -> String {
        address::called(self.sim.world.resource::<NodeRows>().id(row), &self.scene.model)
    }
}

/// Neighbours that are listed, and contacts within so many of their distances.
const NEIGHBOURS: usize = 6;

/// `list near NODE`
pub(super) fn list(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    if !words.skip_word("near") {
        return Err(SpecError::new(words.peek().unwrap_or(""), "near what?").help("list near node 3, list near tow 0 fil 0 node 3"));
    }
    let id = address::node(&mut words, &session.scene.model)?;
    words.end()?;
    let row = session.sim.world.resource::<NodeRows>().of(id);
    let mut elements = Vec::new();
    if let Some(kinds) = session.sim.world.remove_resource::<KindReports>() {
        for k in kinds.0.iter() {
            let mut n = 0;
            (k.sections)(&mut session.sim.world, &mut |rows, force| {
                if rows.contains(&(row as u32)) {
                    elements.push((format!("{} {n}", k.name), format!("axial force {}", number(force.axial))));
                }
                n += 1;
            });
        }
        session.sim.world.insert_resource(kinds);
    }
    let x: Vec<DVec3> = node_states(&mut session.sim.world).iter().map(|s| s.x).collect();
    let mut near: Vec<(f64, usize)> =
        (0..x.len()).filter(|r| *r != row && !session.dummy_row(*r)).map(|r| (x[r].distance(x[row]), r)).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.truncate(NEIGHBOURS);
    let reach = near.last().map_or(0.0, |n| n.0);
    let mut rows = elements;
    rows.extend(near.iter().map(|(d, r)| (session.row_name(*r), format!("{} away", number(*d)))));
    let touching = all_contacts(&mut session.sim.world).into_iter().filter(|c| c.place.distance(x[row]) <= reach);
    rows.extend(touching.map(|c| ("contact".to_string(), format!("{}, gap {}", contact_name(&c), number(c.gap)))));
    Ok(format!("{} at {}\n{}", address::called(id, &session.scene.model), vector(x[row]), table(&rows)))
}

impl Session {
    fn dummy_row(&self, row: usize) -> bool {
        self.scene.model.nodes[self.sim.world.resource::<NodeRows>().id(row).row()].dummy
    }
}

/// `diff NAME`
pub(super) fn diff(session: &mut Session, mut words: Words<'_>) -> Result<String, SpecError> {
    session.refuse_within_step("states are compared")?;
    let fail = |e: String| SpecError::new("", e);
    let now = session.sim.save_state().map_err(fail)?;
    let saved = snapshot(session, &mut words)?;
    let (a, b) = (state::split(&saved.state).map_err(fail)?, state::split(&now).map_err(fail)?);
    let world = &session.sim.world;
    let mut rows = Vec::new();
    for name in state::differences(&saved.state, &now).map_err(fail)? {
        let short = name.rsplit("::").next().unwrap_or(&name).trim_end_matches('>').to_string();
        let both = a.get(name.as_str()).zip(b.get(name.as_str()));
        let texts = both.and_then(|(x, y)| Some((Inspected::saved(world, &name, x)?, Inspected::saved(world, &name, y)?)));
        let said = match texts {
            Some((x, y)) if x.len() == y.len() => {
                let differ: Vec<usize> = (0..x.len()).filter(|i| x[*i] != y[*i]).collect();
                differ.first().map_or("differs in its bits".into(), |&i| first_difference(&x[i], &y[i], i, differ.len(), x.len()))
            }
            Some((x, y)) => format!("{} -> {} of them", x.len(), y.len()),
            None => "differs".into(),
        };
        rows.push((short, said));
    }
    let from = format!("step {} saved; now {}", saved.step, session.now());
    Ok(if rows.is_empty() { format!("the same bits: {from}") } else { format!("{from}\n{}", table(&rows)) })
}

/// The first field in which two values differ; which of how many rows they are, where there are several.
fn first_difference(x: &str, y: &str, row: usize, differ: usize, rows: usize) -> String {
    let of = if rows > 1 { format!("{differ} of {rows} differ, first number {row}: ") } else { String::new() };
    let pair = fields(x).into_iter().zip(fields(y)).find(|(a, b)| a.1 != b.1);
    let ((path, before), (_, after)) = pair.unwrap_or(((String::new(), x.into()), (String::new(), y.into())));
    let space = if path.is_empty() { "" } else { " " };
    format!("{of}{path}{space}{} -> {}", shortened(&before), shortened(&after))
}
