//! Surfaces that hold filaments without penalty: where the next step would take a node, or the point of a filament over
//! an edge, into the body, an impulse takes that part of the velocity away, and as much of the sliding as Coulomb's law
//! allows. No stiffness, hence no limit on the time step, no penetration and no elastic slip.
//!
//! The force of the step before acts as a load, so that the implicit axial scheme finds its equilibrium with it; when all
//! velocities are known it is corrected, node by node and then edge by edge. With the inverse mass w of the point along
//! the normal n, the kick k, the coming step dt and the overlap g that the step would leave,
//!
//!   N = max(N_before + g / (w k dt), 0),    T = T_before - v_t / (w k), cut to |T| <= mu N.
//!
//! This is one sweep a step of projected Gauss-Seidel with a warm start (J. J. Moreau, *Comput. Methods Appl. Mech. Engrg.*
//! 177 (1999) 329-349, for the time stepping). Hits are without rebound; the work of both parts is accounted for.
//!
//! A node whose velocity depends on others, or on which the period depends, keeps the penalty.
use super::kernel::{EdgePlace, Touching, edge_place};
use super::records::*;
use super::systems::{CHUNK, SurfaceReactions, SurfaceSet};
use crate::systems::axial_implicit::AxialChains;
use crate::systems::constraint::Constraints;
use crate::systems::contact::assemble::{CARRIERS, carriers, first_carrier};
use crate::systems::contact::lines::{Centrelines, Lines, NONE, xyz};
use crate::systems::integration::MassDamping;
use braid_ecs::prelude::*;

/// Share of an overlap that is there already which a step leaves: taking it away at once would be a blow.
const BACK: f64 = 0.9;

/// What holds a point: the force of the surface, and the velocity before the kick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Hold {
    /// Force on the filament (force).
    pub force: DVec3,
    /// Velocity before the kick (length / time).
    pub before: DVec3,
}

/// Registers the correction of velocities, behind everything else that changes them.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("kinematic surfaces", install);
}

fn install(cx: &mut Install<'_>) {
    if !cx.world.get_resource::<SurfaceSet>().is_some_and(|set| set.surfaces.iter().any(|s| s.kinematic)) {
        return;
    }
    let mut movable: Vec<bool> = cx.world.query::<&InverseMass>().iter(cx.world).map(|w| w.0.max_element() > 0.0).collect();
    if let Some(constraints) = cx.world.get_resource::<Constraints>() {
        for j in 0..constraints.border_len() {
            constraints.responses(j).for_each(|(row, ..)| movable[row] = false);
            movable[constraints.border_dof(j).0] = false;
        }
    }
    let lines = cx.world.resource::<Lines>();
    let left = lines.slots.iter().zip(&lines.joints).filter(|(s, j)| s.looks && !movable[j.row as usize]).count();
    if left > 0 {
        cx.note(format!("{left} nodes of filaments are held, tied to others or periodic: kinematic surfaces meet them with their penalty"));
    }
    cx.world.resource_mut::<SurfaceSet>().movable = movable;
    cx.add_system(StepSet::Dynamics, correct);
}

impl SurfaceSet {
    /// True if the surface holds the node of a record without penalty.
    pub fn holds_node(&self, lines: &Lines, record: &SurfaceRecord) -> bool {
        let row = lines.joints[record.node as usize].row as usize;
        self.surfaces[record.surface as usize].kinematic && self.movable.get(row) == Some(&true)
    }

    /// The same for the point of a segment over an edge, which four nodes carry.
    pub fn holds_edge(&self, lines: &Lines, record: &EdgeRecord) -> bool {
        let own = |s: u32| {
            let s = &lines.joints[s as usize];
            s.row == NONE || s.image == lines.images.zero() && self.movable.get(s.row as usize) == Some(&true)
        };
        let j = record.segment;
        self.surfaces[record.surface as usize].kinematic && [j - 1, j, j + 1, j + 2].into_iter().all(own)
    }
}

/// A point with its weights on the rows that carry it.
struct Carried<'a> {
    rows: &'a [(usize, f64)],
    place: DVec3,
    overlap: f64,
    offset: f64,
}

/// Where a segment is over an edge, and the rows that carry it there with their weights, so many of them.
struct OverEdge<'a> {
    at: EdgePlace<'a>,
    rows: [(usize, f64); CARRIERS],
    count: usize,
}

impl<'a> OverEdge<'a> {
    fn new(set: &'a SurfaceSet, lines: &Lines, now: &Centrelines, record: &EdgeRecord, t: f64) -> Self {
        let at = edge_place(&set.surfaces[record.surface as usize], lines, now, record, t);
        let mut over = OverEdge { at, rows: [(0, 0.0); CARRIERS], count: 0 };
        // The first carrier of the very first segment would be before the first slot: it has no weight, and no number.
        let first = first_carrier(record.segment);
        for (k, weight) in (0..).zip(carriers(lines, now, record.segment, t)) {
            if weight != 0.0 {
                over.rows[over.count] = (lines.joints[first.wrapping_add(k) as usize].row as usize, weight);
                over.count += 1;
            }
        }
        over
    }
}

/// Velocities and forces that a correction changes.
struct Motion<'a> {
    v: &'a mut [Velocity],
    f: &'a mut [Force],
    w: &'a [InverseMass],
    /// Changes of the velocities, with their rows.
    changes: Vec<(usize, DVec3)>,
    dt: f64,
    kick: f64,
}

impl Motion<'_> {
    fn velocity(&self, rows: &[(usize, f64)]) -> DVec3 {
        rows.iter().map(|(row, weight)| self.v[*row].0 * *weight).sum()
    }

    /// Corrects the force that holds a point for the step to come. `ahead` gives overlap and normal at a place. Returns the
    /// work of the whole force across and along the surface in this kick.
    fn hold(&mut self, point: &Carried<'_>, friction: f64, ahead: impl Fn(DVec3) -> (f64, DVec3), hold: &mut Hold) -> [f64; 2] {
        let v = self.velocity(point.rows);
        let (overlap, n) = ahead(point.place + v * self.dt);
        let inverse: f64 = point.rows.iter().map(|(row, weight)| weight * weight * n.dot(self.w[*row].0 * n)).sum();
        if inverse <= 0.0 {
            return [0.0; 2];
        }
        let left = BACK * (point.overlap - point.offset).max(0.0);
        let push = (hold.force.dot(n) + (overlap - point.offset - left) / (inverse * self.kick * self.dt)).max(0.0);
        let sliding = v.reject_from_normalized(n);
        let drag = (hold.force.reject_from_normalized(n) - sliding / (inverse * self.kick)).clamp_length_max(friction * push);
        let force = n * push + drag;
        let change = force - hold.force;
        hold.force = force;
        if force == DVec3::ZERO && change == DVec3::ZERO {
            return [0.0; 2];
        }
        for (row, weight) in point.rows {
            let faster = self.w[*row].0 * change * (weight * self.kick);
            self.v[*row].0 += faster;
            self.changes.push((*row, faster));
            self.f[*row].0 += change * *weight;
        }
        let mean = 0.5 * (hold.before + self.velocity(point.rows)) * self.kick;
        [push * n.dot(mean), drag.dot(mean)]
    }
}

fn correct(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    (lines, now, live, set): (Res<Lines>, Res<Centrelines>, Res<LiveSurfaceRecords>, Res<SurfaceSet>),
    (mut reactions, axial): (ResMut<SurfaceReactions>, Option<ResMut<AxialChains>>),
    mut ledger: ResMut<EnergyLedger>,
    mut node_query: Query<(&SurfaceRecord, &mut SurfaceState)>,
    mut edge_query: Query<(&EdgeRecord, &mut EdgeState)>,
    mut nodes: Query<(&mut Velocity, &mut Force, &InverseMass)>,
) {
    let (mut v, mut f, w) = columns(&mut nodes);
    let (v, f) = (v.bypass_change_detection(), f.bypass_change_detection());
    let mut motion = Motion { v, f, w, changes: Vec::new(), dt: clock.dt_next, kick: damping.kick(clock.kick()).1 };
    let mut account = |surface: u32, place: DVec3, force: DVec3, [across, along]: [f64; 2]| {
        reactions.force[surface as usize] -= force;
        reactions.moment[surface as usize] -= place.cross(force);
        ledger.damping -= across;
        ledger.friction -= along;
    };
    let (records, mut states) = columns(&mut node_query);
    let records = &records[..live.nodes];
    // Where everything is can be found side by side; velocities are corrected one after the other.
    let ahead_of = |record: &SurfaceRecord, x: DVec3| {
        let (distance, normal) = set.surfaces[record.surface as usize].shape.distance(x);
        (lines.slots[record.node as usize].radius - distance, normal)
    };
    let overlaps = parallel::chunks(records.len(), CHUNK, |range| {
        let of = |r: &SurfaceRecord| set.holds_node(&lines, r).then(|| ahead_of(r, xyz(&now.x[r.node as usize])).0);
        records[range].iter().map(of).collect::<Vec<_>>()
    });
    for ((record, state), overlap) in records.iter().zip(states.bypass_change_detection()).zip(overlaps.into_iter().flatten()) {
        let Some(overlap) = overlap else { continue };
        let surface = &set.surfaces[record.surface as usize];
        let row = lines.joints[record.node as usize].row as usize;
        let place = xyz(&now.x[record.node as usize]);
        let ahead = |x: DVec3| ahead_of(record, x);
        state.offset = (state.offset * surface.keep).min(overlap.max(0.0));
        let point = Carried { rows: &[(row, 1.0)], place, overlap, offset: state.offset };
        let work = motion.hold(&point, surface.law.friction, ahead, &mut state.hold);
        account(record.surface, place, state.hold.force, work);
    }
    let (records, mut states) = columns(&mut edge_query);
    let (records, states) = (&records[..live.edges], &mut states.bypass_change_detection()[..live.edges]);
    let places = parallel::chunks(records.len(), CHUNK, |range| {
        let of = |(r, s): (&EdgeRecord, &EdgeState)| set.holds_edge(&lines, r).then(|| OverEdge::new(&set, &lines, &now, r, s.t));
        records[range.clone()].iter().zip(&states[range]).map(of).collect::<Vec<_>>()
    });
    for ((record, state), place) in records.iter().zip(states).zip(places.into_iter().flatten()) {
        let Some(OverEdge { at, rows, count }) = place else { continue };
        let surface = &set.surfaces[record.surface as usize];
        // Beyond its segment, along its edge, or where the nodes see the rounding, a point is not held.
        let held = at.weight > 0.0;
        state.offset = (state.offset * surface.keep).min(at.overlap.max(0.0));
        let point = Carried { rows: &rows[..count], place: at.place, overlap: at.overlap, offset: state.offset };
        let ahead = |x: DVec3| if held { at.ahead(surface, x) } else { (f64::NEG_INFINITY, at.normal) };
        let work = motion.hold(&point, surface.law.friction, ahead, &mut state.hold);
        account(record.surface, at.place, state.hold.force, work);
    }
    if let Some(mut axial) = axial {
        axial.follow(&motion.changes, motion.kick);
    }
}

/// What can be said about a record that is held, in place of what the penalty would do.
pub fn held(hold: &Hold, touching: Touching) -> Touching {
    let normal_force = hold.force.dot(touching.normal).max(0.0);
    let mut response = touching.response;
    response.force = hold.force.into();
    response.drag = (hold.force - touching.normal * normal_force).into();
    (response.normal_force, response.energy) = (normal_force, 0.0);
    Touching { response, ..touching }
}
