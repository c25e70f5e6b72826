//! The systems of contact with rigid surfaces.
use super::kernel::{Surface, Touching, edge_contact, edge_motion, node_contact};
use super::kinematic::{Hold, held};
use super::list::*;
use super::records::*;
use super::shape::Shape;
use super::spec::{Enforcement, Mandrel, SurfaceSpec, Surfaces, surface_specs};
use crate::systems::contact::assemble::{put, put_along};
use crate::systems::contact::inner::{Needed, refresh_all};
use crate::systems::contact::law::{APART, Law, kept_stiffness, raised};
use crate::systems::contact::lines::{Centrelines, Lines, NONE, xyz};
use crate::systems::contact::records::strayed;
use crate::systems::contact::stiffness::{Spread, element_frequency, share_copies};
use crate::systems::contact::systems::Relaxation;
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
    pub(super) skin: f64,
    pub(super) budget: f64,
    pub(super) reference: Vec<DVec3>,
    /// Times the list was made.
    pub rebuilds: u64,
    pub(super) moved: bool,
    /// Rows that a kinematic surface can hold; none if there is no such surface.
    pub(super) movable: Vec<bool>,
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
            hardening: 0.0,
            dt: 0.0,
        };
        let shape = Shape::new(s).map_err(at)?;
        let kinematic = s.enforcement == Enforcement::Kinematic;
        surfaces.push(Surface { name: s.name.clone(), shape, law, line_stiffness: 1.0, point_stiffness: 1.0, keep: 1.0, kinematic });
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
        movable: Vec::new(),
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
    // A kinematic surface would throw out in one step what reaches into it.
    let leaves = |s: &SurfaceSpec| s.initial_overlap != InitialOverlap::Error || s.enforcement == Enforcement::Kinematic;
    let lenient: Vec<bool> = set.specs.iter().map(leaves).collect();
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
pub(super) fn resolve(world: &mut World) {
    if world.resource::<SurfaceSet>().resolved {
        return;
    }
    let mut set = world.remove_resource::<SurfaceSet>().expect("inserted by the installer");
    let (length, lightest) = {
        let (lines, now) = (world.resource::<Lines>(), world.resource::<Centrelines>());
        let masses = lines.joints.iter().zip(&now.v).filter(|(s, v)| s.row != NONE && v[3] > 0.0).map(|(_, v)| v[3]);
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

/// Records per parallel chunk.
pub(super) const CHUNK: usize = 256;

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
    let SurfaceSet { surfaces, specs, .. } = &mut *set;
    for (surface, spec) in surfaces.iter_mut().zip(specs) {
        surface.law.dt = clock.dt;
        surface.keep = Relaxation { rule: spec.initial_overlap }.keep(clock.time, clock.dt);
    }
    let mut moved = false;
    let surfaces = &set.surfaces;
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
        if set.holds_node(&lines, record) {
            state.hold.before = xyz(&now.v[record.node as usize]);
            put(&lines, record.node, state.hold.force, &mut add);
            continue;
        }
        let c = node_contact(&surfaces[record.surface as usize], &lines, &now, record, state);
        account(record.surface as usize, &c, state.offset);
        *state = SurfaceState {
            slip: c.response.memory.slip.lane(0),
            damper: c.response.memory.damper,
            offset: c.offset,
            hold: Hold::default(),
        };
        put(&lines, record.node, c.response.force.lane(0), &mut add);
    }
    let (records, mut states) = columns(&mut edge_query);
    let (records, states) = (&records[..live.edges], &mut states.bypass_change_detection()[..live.edges]);
    // What is held needs to know no more than where it is and how it moves.
    parallel::zip2(states, records, CHUNK, |state, record| {
        if set.holds_edge(&lines, record) {
            (state.t, state.hold.before) = edge_motion(&surfaces[record.surface as usize], &lines, &now, record, state);
        }
    });
    for (record, state) in records.iter().zip(states) {
        if set.holds_edge(&lines, record) {
            moved |= strayed(state.t);
            put_along(&lines, &now, record.segment, state.t, (state.hold.force, DVec3::ZERO), &mut add);
            continue;
        }
        let c = edge_contact(&surfaces[record.surface as usize], &lines, &now, record, state);
        moved |= strayed(c.t);
        account(record.surface as usize, &c, state.offset);
        let (memory, overlap) = (c.response.memory, c.penetration + c.offset);
        let stiffness = kept_stiffness(c.stiffness, overlap);
        let (slip, damper) = (memory.slip.lane(0), memory.damper);
        *state = EdgeState { t: c.t, slip, damper, offset: c.offset, stiffness, overlap, hold: Hold::default() };
        put_along(&lines, &now, record.segment, c.t, (c.response.force.lane(0), DVec3::ZERO), &mut add);
    }
    set.moved |= moved;
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
    let (mut s, mut kappa) = (Spread::without_friction(lines), vec![0.0; masses.len()]);
    let mut add = |row: u32, k: f64| kappa[row as usize] += k;
    for (record, state) in node_query.iter(world).take(live.nodes).filter(|(r, _)| !set.holds_node(lines, r)) {
        let surface = &surfaces[record.surface as usize];
        let c = node_contact(surface, lines, now, record, state);
        s.node(record.node, 1.0);
        s.add(c.stiffness * surface.law.damped_stiffness(), &mut add);
    }
    for (record, state) in edge_query.iter(world).take(live.edges).filter(|(r, _)| !set.holds_edge(lines, r)) {
        let surface = &surfaces[record.surface as usize];
        let c = edge_contact(surface, lines, now, record, state);
        s.segment(now, record.segment, c.t);
        s.add(c.stiffness * surface.law.damped_stiffness(), &mut add);
    }
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
        let c = if set.holds_node(lines, record) { held(&state.hold, c) } else { c };
        push(&c, record.surface, record.node, ContactKind::Surface, 0.0);
    }
    for (record, state) in edge_query.iter(world).take(live.edges) {
        let surface = &surfaces[record.surface as usize];
        let c = edge_contact(surface, lines, now, record, state);
        let c = if set.holds_edge(lines, record) { held(&state.hold, c) } else { c };
        let tangent = xyz(&now.tangent[record.segment as usize]).normalize_or_zero();
        let angle = surface.shape.flat_direction(tangent).length().clamp(0.0, 1.0).asin();
        push(&c, record.surface, record.segment, ContactKind::Edge, angle);
    }
    out
}
