//! The systems of contact with rigid surfaces.
use super::kernel::{Surface, Touching, edge_contact, edge_step, node_contact};
use super::records::*;
use super::shape::Shape;
use super::spec::{Mandrel, SurfaceSpec, Surfaces, surface_specs};
use crate::systems::contact::assemble::{put, put_along};
use crate::systems::contact::inner::{Marks, Needed, refresh_all};
use crate::systems::contact::law::{APART, Law, kept_stiffness, raised};
use crate::systems::contact::lines::{Centrelines, Lines, NONE, xyz};
use crate::systems::contact::records::{rehome, strayed};
use crate::systems::contact::stiffness::{Spread, element_frequency, share_copies};
use crate::systems::contact::systems::{Relaxation, shortage};
use crate::systems::contact::{ContactKind, ContactReport, InitialOverlap, TOLERATED_OVERLAP, install_lines, monitor};
use braid_ecs::prelude::*;

/// Registers contact with the [`Surfaces`] and the [`Mandrel`] of the model.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Surfaces>();
    sim.add_settings::<Mandrel>();
    sim.add_installer("surfaces", install);
}

/// The surfaces, and when the list of near nodes was made.
#[derive(Resource)]
pub struct SurfaceSet {
    /// All surfaces.
    pub surfaces: Vec<Surface>,
    specs: Vec<SurfaceSpec>,
    resolved: bool,
    skin: f64,
    budget: f64,
    reference: Vec<DVec3>,
    /// Times the list was made.
    pub rebuilds: u64,
    moved: bool,
}

/// What changes of the surfaces: the stiffness, once it is found, and the list.
#[derive(Serialize, Deserialize)]
pub struct SurfaceSetState {
    stiffness: Vec<[f64; 3]>,
    resolved: bool,
    budget: f64,
    reference: Vec<DVec3>,
    rebuilds: u64,
    moved: bool,
}

impl Kept for SurfaceSet {
    type State = SurfaceSetState;

    fn state(&self) -> SurfaceSetState {
        SurfaceSetState {
            stiffness: self.surfaces.iter().map(|s| [s.line_stiffness, s.point_stiffness, s.keep]).collect(),
            resolved: self.resolved,
            budget: self.budget,
            reference: self.reference.clone(),
            rebuilds: self.rebuilds,
            moved: self.moved,
        }
    }

    fn put_back(&mut self, state: SurfaceSetState) {
        for (s, k) in self.surfaces.iter_mut().zip(state.stiffness) {
            [s.line_stiffness, s.point_stiffness, s.keep] = k;
        }
        (self.resolved, self.budget, self.reference) = (state.resolved, state.budget, state.reference);
        (self.rebuilds, self.moved) = (state.rebuilds, state.moved);
    }
}

/// Force and moment about the origin that filaments put on each surface, and the work of friction on it.
#[derive(Resource, Clone, Debug, Default)]
pub struct SurfaceReactions {
    /// Name of each surface.
    pub names: Vec<String>,
    /// Force (force).
    pub force: Vec<DVec3>,
    /// Moment about the origin (force x length).
    pub moment: Vec<DVec3>,
}

/// Distance beyond touching that the list covers, in mean radii.
const SKIN: f64 = 2.0;
/// Penalty stiffness x dt^2 / nodal mass against a rigid body that stays stable at 0.9 of the elements' time step.
const SHARE: f64 = 0.4;

fn install(cx: &mut Install<'_>) {
    let specs = surface_specs(cx.model);
    if specs.is_empty() {
        return;
    }
    if let Err(message) = install_surfaces(cx, specs) {
        cx.world.resource_mut::<Failure>().0.get_or_insert(message);
    }
}

fn install_surfaces(cx: &mut Install<'_>, specs: Vec<SurfaceSpec>) -> Result<(), String> {
    let mut surfaces = Vec::new();
    for (k, s) in specs.iter().enumerate() {
        let at = |e: SpecError| format!("surface {k} (`{}`), {}: {e}", s.name, e.path);
        s.check().map_err(at)?;
        let law = Law {
            friction: s.friction.map_or(0.2, f64::from),
            tangential: s.friction_stiffness.0,
            damping: s.damping.0,
            toe: 1e-3,
            dt: 0.0,
        };
        let shape = Shape::new(s).map_err(at)?;
        surfaces.push(Surface { name: s.name.clone(), shape, law, line_stiffness: 1.0, point_stiffness: 1.0, keep: 1.0 });
    }
    if !install_lines(cx)? {
        return Ok(());
    }
    let radius = cx.world.resource::<Lines>().mean_radius;
    cx.world.insert_resource(SurfaceReactions {
        names: specs.iter().map(|s| s.name.clone()).collect(),
        force: vec![DVec3::ZERO; specs.len()],
        moment: vec![DVec3::ZERO; specs.len()],
    });
    cx.world.insert_resource(SurfaceSet {
        surfaces,
        specs,
        resolved: false,
        skin: SKIN * radius,
        budget: -1.0,
        reference: Vec::new(),
        rebuilds: 0,
        moved: false,
    });
    cx.world.init_resource::<LiveSurfaceRecords>();
    cx.world.init_resource::<EnergyLedger>();
    cx.world.resource_mut::<Needed>().sources.push(mark);
    make_list(cx.world);
    treat_overlap(cx.world)?;
    cx.world.get_resource_or_init::<StiffnessSources>().0.push(("surface", bounds));
    cx.remember_pool::<SurfaceRecord>(grow_nodes);
    cx.remember_pool::<SurfaceState>(grow_nodes);
    cx.remember_pool::<EdgeRecord>(grow_edges);
    cx.remember_pool::<EdgeState>(grow_edges);
    cx.remember_resource::<LiveSurfaceRecords>();
    cx.remember_part::<SurfaceSet>();
    cx.add_system(StepSet::ContactSearch, follow);
    cx.add_system(StepSet::ContactSearch, rebuild);
    cx.add_system(StepSet::ContactForces, forces);
    monitor::install(cx);
    Ok(())
}

/// Refuses overlaps at the start or leaves them free of force, as each surface says.
fn treat_overlap(world: &mut World) -> Result<(), String> {
    let contacts = surface_contacts(world);
    let set = world.resource::<SurfaceSet>();
    let strict = |c: &&ContactReport| set.specs[c.other].initial_overlap == InitialOverlap::Error;
    if let Some(worst) = contacts.iter().filter(strict).min_by(|a, b| (a.gap / a.radius).total_cmp(&(b.gap / b.radius)))
        && -worst.gap > TOLERATED_OVERLAP * worst.radius
    {
        let p = worst.place;
        let count = contacts.iter().filter(strict).filter(|c| -c.gap > TOLERATED_OVERLAP * c.radius).count();
        return Err(format!(
            "filament {} reaches into the surface `{}` by {:.3e} at the start, {:.1} % of its radius, at ({:.4e}, {:.4e}, {:.4e}); {count} places do. \
             Move it out, or set initial_overlap: Offset for this surface to leave the overlap free of force",
            worst.filament,
            set.specs[worst.other].name,
            -worst.gap,
            -100.0 * worst.gap / worst.radius,
            p.x,
            p.y,
            p.z
        ));
    }
    let lenient: Vec<bool> = set.specs.iter().map(|s| s.initial_overlap != InitialOverlap::Error).collect();
    for (r, mut s) in world.query::<(&SurfaceRecord, &mut SurfaceState)>().iter_mut(world) {
        if lenient.get(r.surface as usize) == Some(&true) {
            s.offset = f64::MAX;
        }
    }
    for (r, mut s) in world.query::<(&EdgeRecord, &mut EdgeState)>().iter_mut(world) {
        // What touches at the start does so with its full stiffness.
        s.stiffness = APART;
        if lenient.get(r.surface as usize) == Some(&true) {
            s.offset = f64::MAX;
        }
    }
    Ok(())
}

/// Finds the stiffness of surfaces that leave it open.
fn resolve(world: &mut World) {
    if world.resource::<SurfaceSet>().resolved {
        return;
    }
    let mut set = world.remove_resource::<SurfaceSet>().expect("inserted by the installer");
    let (length, lightest) = {
        let (lines, now) = (world.resource::<Lines>(), world.resource::<Centrelines>());
        let masses = lines.slots.iter().zip(&now.v).filter(|(s, v)| s.row != NONE && v[3] > 0.0).map(|(_, v)| v[3]);
        (lines.mean_length, masses.fold(f64::INFINITY, f64::min))
    };
    for (surface, spec) in set.surfaces.iter_mut().zip(&set.specs) {
        let (line, point) = match (spec.line_stiffness, spec.stiffness) {
            (Some(l), Some(p)) => (l.0, p.0),
            (Some(l), None) => (l.0, l.0 * length),
            (None, Some(p)) => (p.0 / length, p.0),
            (None, None) => {
                // dt = 0.9 x 2 / omega of the elements.
                let k = SHARE * lightest * element_frequency(world) / (4.0 * 0.81);
                (k / length, k)
            }
        };
        (surface.line_stiffness, surface.point_stiffness) = (line, point);
    }
    set.resolved = true;
    world.insert_resource(set);
}

/// Makes all surfaces stiffer by a factor; the friction springs keep their force.
pub fn raise_stiffness(world: &mut World, factor: f64) {
    let Some(mut set) = world.get_resource_mut::<SurfaceSet>() else { return };
    for surface in &mut set.surfaces {
        surface.line_stiffness *= factor;
        surface.point_stiffness *= factor;
    }
    for mut s in world.query::<&mut SurfaceState>().iter_mut(world) {
        s.slip /= factor;
    }
    for mut s in world.query::<&mut EdgeState>().iter_mut(world) {
        s.stiffness = raised(s.stiffness, factor);
        s.slip /= factor;
    }
}

/// Records over edges that have left their segment move on; decides whether a new list is due.
fn follow(
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
    let fastest = lines.rows.iter().fold(0.0f64, |m, row| m.max(v[*row as usize].0.length_squared()));
    set.budget -= clock.dt * fastest.sqrt();
}

fn rebuild(world: &mut World) {
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
fn make_list(world: &mut World) {
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
fn mark(world: &mut World, marks: &mut Marks) {
    let live = *world.resource::<LiveSurfaceRecords>();
    world.query::<&SurfaceRecord>().iter(world).take(live.nodes).for_each(|r| marks.place(r.node));
    world.query::<&EdgeRecord>().iter(world).take(live.edges).for_each(|r| marks.segment(r.segment));
}

fn grow_nodes(world: &mut World, need: usize) {
    let rows = shortage(need, world.query::<&SurfaceRecord>().iter(world).len());
    let idle = (SurfaceRecord { surface: u32::MAX, node: u32::MAX }, SurfaceState::default());
    world.spawn_batch(vec![idle; rows]);
}

fn grow_edges(world: &mut World, need: usize) {
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

/// Forces of all surfaces on the nodes, in record order.
fn forces(
    clock: Res<Clock>,
    (lines, now, live): (Res<Lines>, Res<Centrelines>, Res<LiveSurfaceRecords>),
    mut set: ResMut<SurfaceSet>,
    mut reactions: ResMut<SurfaceReactions>,
    mut ledger: ResMut<EnergyLedger>,
    mut node_query: Query<(&SurfaceRecord, &mut SurfaceState)>,
    mut edge_query: Query<(&EdgeRecord, &mut EdgeState)>,
    mut nodes: Query<&mut Force>,
) {
    let SurfaceSet { surfaces, specs, moved, .. } = &mut *set;
    for (surface, spec) in surfaces.iter_mut().zip(specs) {
        surface.law.dt = clock.dt;
        surface.keep = Relaxation { rule: spec.initial_overlap }.keep(clock.time, clock.dt);
    }
    reactions.force.fill(DVec3::ZERO);
    reactions.moment.fill(DVec3::ZERO);
    let mut force = columns(&mut nodes);
    let force = force.bypass_change_detection();
    let mut add = |row: usize, f: DVec3| force[row].0 += f;
    let mut account = |surface: usize, c: &Touching, offset: f64| {
        let r = &c.response;
        let f = r.force.lane(0);
        reactions.force[surface] -= f;
        reactions.moment[surface] -= c.place.cross(f);
        ledger.friction += r.friction;
        ledger.damping += r.damping;
        let keep = surfaces[surface].keep;
        if keep < 1.0 {
            ledger.external_work += r.normal_force * offset * (1.0 - keep);
        }
    };
    let (records, mut states) = columns(&mut node_query);
    for (record, state) in records[..live.nodes].iter().zip(states.bypass_change_detection()) {
        let c = node_contact(&surfaces[record.surface as usize], &lines, &now, record, state);
        account(record.surface as usize, &c, state.offset);
        *state = SurfaceState { slip: c.response.memory.slip.lane(0), damper: c.response.memory.damper, offset: c.offset };
        put(&lines, record.node, c.response.force.lane(0), &mut add);
    }
    let (records, mut states) = columns(&mut edge_query);
    for (record, state) in records[..live.edges].iter().zip(states.bypass_change_detection()) {
        let c = edge_contact(&surfaces[record.surface as usize], &lines, &now, record, state);
        account(record.surface as usize, &c, state.offset);
        let (memory, overlap) = (c.response.memory, c.penetration + c.offset);
        let stiffness = kept_stiffness(c.stiffness, overlap);
        *state = EdgeState { t: c.t, slip: memory.slip.lane(0), damper: memory.damper, offset: c.offset, stiffness, overlap };
        *moved |= strayed(c.t);
        put_along(&lines, &now, record.segment, c.t, (c.response.force.lane(0), DVec3::ZERO), &mut add);
    }
}

/// Adds the bounds of all records that touch or nearly do.
fn bounds(world: &mut World, out: &mut [StiffnessBound]) {
    resolve(world);
    refresh_all(world);
    let masses: Vec<f64> = world.query::<&Mass>().iter(world).map(|m| m.0).collect();
    let mut node_query = world.query::<(&SurfaceRecord, &SurfaceState)>();
    let mut edge_query = world.query::<(&EdgeRecord, &EdgeState)>();
    let live = *world.resource::<LiveSurfaceRecords>();
    let (lines, now, set) = (world.resource::<Lines>(), world.resource::<Centrelines>(), world.resource::<SurfaceSet>());
    let surfaces: Vec<Surface> = set.surfaces.iter().map(still).collect();
    let mut s = Spread::new(lines, masses.len());
    for (record, state) in node_query.iter(world).take(live.nodes) {
        let surface = &surfaces[record.surface as usize];
        let c = node_contact(surface, lines, now, record, state);
        s.node(record.node, 1.0);
        s.add(c.stiffness * surface.law.damped_stiffness(), 0.0);
    }
    for (record, state) in edge_query.iter(world).take(live.edges) {
        let surface = &surfaces[record.surface as usize];
        let c = edge_contact(surface, lines, now, record, state);
        s.segment(now, record.segment, c.t);
        s.add(c.stiffness * surface.law.damped_stiffness(), 0.0);
    }
    let mut kappa = s.kappa;
    share_copies(lines, &masses, &mut kappa);
    for (o, k) in out.iter_mut().zip(kappa) {
        o.translation += k;
    }
}

/// A surface with which looking changes nothing.
fn still(surface: &Surface) -> Surface {
    let mut s = surface.clone();
    s.law.dt = 0.0;
    s.keep = 1.0;
    s
}

/// All places where filaments touch surfaces or are less than a radius away, in record order.
pub fn surface_contacts(world: &mut World) -> Vec<ContactReport> {
    let mut out = Vec::new();
    if !world.contains_resource::<SurfaceSet>() {
        return out;
    }
    refresh_all(world);
    let mut node_query = world.query::<(&SurfaceRecord, &SurfaceState)>();
    let mut edge_query = world.query::<(&EdgeRecord, &EdgeState)>();
    let live = *world.resource::<LiveSurfaceRecords>();
    let (lines, now, set) = (world.resource::<Lines>(), world.resource::<Centrelines>(), world.resource::<SurfaceSet>());
    let surfaces: Vec<Surface> = set.surfaces.iter().map(still).collect();
    let mut push = |c: &Touching, surface: u32, slot: u32, kind: ContactKind, angle: f64| {
        let radius = lines.slots[slot as usize].radius;
        if c.penetration + c.offset < -radius || c.stiffness <= 0.0 {
            return;
        }
        let r = &c.response;
        let friction_force = r.force.lane(0) - c.normal * r.normal_force;
        let limit = surfaces[surface as usize].law.friction * r.normal_force;
        out.push(ContactReport {
            kind,
            filament: lines.place_of(slot).0,
            other: surface as usize,
            place: c.place,
            normal: c.normal,
            gap: -c.penetration - c.offset,
            offset: c.offset,
            radius,
            normal_force: r.normal_force,
            friction_force,
            angle,
            slides: r.normal_force > 0.0 && friction_force.length() >= limit * (1.0 - 1e-9),
            energy: r.energy,
        });
    };
    for (record, state) in node_query.iter(world).take(live.nodes) {
        let c = node_contact(&surfaces[record.surface as usize], lines, now, record, state);
        push(&c, record.surface, record.node, ContactKind::Surface, 0.0);
    }
    for (record, state) in edge_query.iter(world).take(live.edges) {
        let surface = &surfaces[record.surface as usize];
        let c = edge_contact(surface, lines, now, record, state);
        let tangent = xyz(&now.tangent[record.segment as usize]).normalize_or_zero();
        let angle = surface.shape.flat_direction(tangent).length().clamp(0.0, 1.0).asin();
        push(&c, record.surface, record.segment, ContactKind::Edge, angle);
    }
    out
}
