//! Which nodes are near a surface and which segments near one of its edges: a list with a skin, made anew when the
//! fastest node may have used it up.
use super::kernel::{Surface, edge_step};
use super::records::*;
use super::systems::{SurfaceSet, resolve};
use crate::systems::contact::inner::{Marks, Needed, refresh_all};
use crate::systems::contact::lines::{Centrelines, Lines, xyz};
use crate::systems::contact::records::rehome;
use crate::systems::contact::systems::shortage;
use braid_ecs::prelude::*;

/// Nodes per parallel chunk.
const CHUNK: usize = 2048;

/// Records over edges that have left their segment move on; decides whether a new list is due.
pub(super) fn follow(
    clock: Res<Clock>,
    lines: Res<Lines>,
    live: Res<LiveSurfaceRecords>,
    mut set: ResMut<SurfaceSet>,
    mut needed: ResMut<Needed>,
    mut edges: Query<(&mut EdgeRecord, &mut EdgeState)>,
    mut nodes: Query<&Velocity>,
) {
    if set.moved {
        let (mut records, mut states) = columns(&mut edges);
        for (r, s) in records.bypass_change_detection()[..live.edges].iter_mut().zip(states.bypass_change_detection()) {
            (r.segment, s.t, _) = rehome(&lines, r.segment, s.t);
        }
        set.moved = false;
        needed.stale = true;
    }
    let v = columns(&mut nodes);
    let fastest = parallel::largest(lines.rows.len(), CHUNK, |k| v[lines.rows[k] as usize].0.length_squared());
    set.budget -= clock.dt * fastest.sqrt();
}

pub(super) fn rebuild(world: &mut World) {
    resolve(world);
    if world.resource::<SurfaceSet>().budget > 0.0 {
        return;
    }
    refresh_all(world);
    let (skin, farthest) = {
        let (set, now) = (world.resource::<SurfaceSet>(), world.resource::<Centrelines>());
        let moved = set.reference.iter().zip(&now.x).fold(0.0f64, |m, (a, b)| m.max((*a - xyz(b)).length_squared()));
        (set.skin, if set.reference.is_empty() { f64::INFINITY } else { moved.sqrt() })
    };
    if farthest < 0.98 * skin {
        world.resource_mut::<SurfaceSet>().budget = skin - farthest;
    } else {
        make_list(world);
        world.get_resource_or_init::<StiffnessChanged>().0 = true;
    }
}

/// Lists the nodes near surfaces and the segments near edges, with the history of the old records.
pub(super) fn make_list(world: &mut World) {
    let mut set = world.remove_resource::<SurfaceSet>().expect("inserted by the installer");
    let live = *world.resource::<LiveSurfaceRecords>();
    let mut node_query = world.query::<(&mut SurfaceRecord, &mut SurfaceState)>();
    let mut edge_query = world.query::<(&mut EdgeRecord, &mut EdgeState)>();
    let old_nodes: Vec<_> = node_query.iter(world).take(live.nodes).map(|(r, s)| (*r, *s)).collect();
    let old_edges: Vec<_> = edge_query.iter(world).take(live.edges).map(|(r, s)| (*r, *s)).collect();
    let (mut nodes, mut edges) = (Vec::new(), Vec::new());
    {
        let (lines, now) = (world.resource::<Lines>(), world.resource::<Centrelines>());
        for (k, surface) in set.surfaces.iter().enumerate() {
            near_nodes(surface, k as u32, set.skin, lines, now, &mut nodes);
            near_edges(surface, k as u32, set.skin, lines, now, &mut edges);
        }
        inherit(lines, &old_nodes, &old_edges, &mut nodes, &mut edges);
        set.reference.clear();
        set.reference.extend(now.x.iter().map(xyz));
    }
    set.budget = set.skin;
    set.rebuilds += 1;
    world.insert_resource(set);
    grow_nodes(world, nodes.len());
    grow_edges(world, edges.len());
    for (new, (mut r, mut s)) in nodes.iter().zip(node_query.iter_mut(world)) {
        (*r, *s) = *new;
    }
    for (new, (mut r, mut s)) in edges.iter().zip(edge_query.iter_mut(world)) {
        (*r, *s) = *new;
    }
    *world.resource_mut::<LiveSurfaceRecords>() = LiveSurfaceRecords { nodes: nodes.len(), edges: edges.len() };
    world.resource_mut::<Needed>().stale = true;
}

/// Marks the slots that the records need.
pub(super) fn mark(world: &mut World, marks: &mut Marks) {
    let live = *world.resource::<LiveSurfaceRecords>();
    world.query::<&SurfaceRecord>().iter(world).take(live.nodes).for_each(|r| marks.place(r.node));
    world.query::<&EdgeRecord>().iter(world).take(live.edges).for_each(|r| marks.segment(r.segment));
}

pub(super) fn grow_nodes(world: &mut World, need: usize) {
    let rows = shortage(need, world.query::<&SurfaceRecord>().iter(world).len());
    let idle = (SurfaceRecord { surface: u32::MAX, node: u32::MAX }, SurfaceState::default());
    world.spawn_batch(vec![idle; rows]);
}

pub(super) fn grow_edges(world: &mut World, need: usize) {
    let rows = shortage(need, world.query::<&EdgeRecord>().iter(world).len());
    let idle = (EdgeRecord { surface: u32::MAX, edge: u32::MAX, segment: u32::MAX }, EdgeState::at(0.0));
    world.spawn_batch(vec![idle; rows]);
}

fn near_nodes(surface: &Surface, k: u32, skin: f64, lines: &Lines, now: &Centrelines, out: &mut Vec<(SurfaceRecord, SurfaceState)>) {
    for (i, slot) in lines.slots.iter().enumerate() {
        if slot.looks && surface.shape.distance(xyz(&now.x[i])).0 < slot.radius + skin {
            out.push((SurfaceRecord { surface: k, node: i as u32 }, SurfaceState::default()));
        }
    }
}

fn near_edges(surface: &Surface, k: u32, skin: f64, lines: &Lines, now: &Centrelines, out: &mut Vec<(EdgeRecord, EdgeState)>) {
    for (e, edge) in surface.shape.edges.iter().enumerate() {
        let from = out.len();
        for j in lines.segments() {
            let i = j as usize;
            let reach = lines.slots[i].radius + edge.radius + skin;
            let (a, b) = (surface.shape.flat(xyz(&now.x[i])), surface.shape.flat(xyz(&now.x[i + 1])));
            let chord = b - a;
            let start =
                if chord.length_squared() > 0.0 { ((edge.centre - a).dot(chord) / chord.length_squared()).clamp(0.0, 1.0) } else { 0.5 };
            // The centreline leaves its chord by less than a quarter of it, on any sensible mesh.
            if (a + chord * start).distance(edge.centre) > reach + 0.25 * lines.slots[i].length {
                continue;
            }
            let mut t = start;
            for _ in 0..8 {
                t = edge_step(lines, now, &surface.shape, edge.centre, j, t);
            }
            if !(-0.25..=1.25).contains(&t) {
                continue;
            }
            let (segment, mut t, _) = rehome(lines, j, t);
            for _ in 0..3 {
                t = edge_step(lines, now, &surface.shape, edge.centre, segment, t);
            }
            let (segment, t, _) = rehome(lines, segment, t);
            let twice = out[from..].iter().any(|(r, s)| same_place(lines, (r.segment, s.t), (segment, t)).is_some_and(|d| d.abs() < 0.25));
            if !twice {
                out.push((EdgeRecord { surface: k, edge: e as u32, segment }, EdgeState::at(t)));
            }
        }
        out[from..].sort_by_key(|(r, _)| r.segment);
    }
}

/// Distance along a filament between two places on the same or on neighbouring segments.
fn same_place(lines: &Lines, a: (u32, f64), b: (u32, f64)) -> Option<f64> {
    if a.0 == b.0 {
        return Some(b.1 - a.1);
    }
    [(0, 1.0), (1, -1.0)].iter().find_map(|(side, sign)| match lines.links[a.0 as usize][*side] {
        Some((to, _)) if to == b.0 => Some(sign + b.1 - a.1),
        _ => None,
    })
}

fn inherit(
    lines: &Lines,
    old_nodes: &[(SurfaceRecord, SurfaceState)],
    old_edges: &[(EdgeRecord, EdgeState)],
    nodes: &mut [(SurfaceRecord, SurfaceState)],
    edges: &mut [(EdgeRecord, EdgeState)],
) {
    let mut from = 0;
    for (record, state) in nodes {
        let key = (record.surface, record.node);
        while from < old_nodes.len() && (old_nodes[from].0.surface, old_nodes[from].0.node) < key {
            from += 1;
        }
        if let Some((old, was)) = old_nodes.get(from)
            && (old.surface, old.node) == key
        {
            *state = *was;
        }
    }
    for (record, state) in edges {
        let mut nearest = 0.5;
        for (old, was) in old_edges.iter().filter(|(o, _)| o.surface == record.surface && o.edge == record.edge) {
            if let Some(d) = same_place(lines, (old.segment, was.t), (record.segment, state.t))
                && d.abs() < nearest
            {
                nearest = d.abs();
                *state = EdgeState { t: state.t, ..*was };
            }
        }
    }
}
