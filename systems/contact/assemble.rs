//! All records of a step, and the way of their forces to the nodes.
//!
//! Records write their own force (in parallel); those that touch then hand it to the nodes of both
//! bodies, through the shape functions of the centrelines, in one fixed order. A force on the image of
//! a segment also pulls on the dummy nodes that carry the period.
use super::curve::{Range, weights};
use super::images::Image;
use super::kernel::{Contact, Penalty, beside, line_contact, point_contact};
use super::law::{APART, Response, kept_stiffness};
use super::lines::{Centrelines, Lines, NONE};
use super::records::*;
use braid_ecs::prelude::*;
use rayon::prelude::*;

/// Records per parallel chunk.
const CHUNK: usize = 512;

/// Sums over the records of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Totals {
    /// Work lost to friction.
    pub friction: f64,
    /// Work lost to damping.
    pub damping: f64,
    /// Work put in by overlap that goes away in time.
    pub relaxed: f64,
    /// Records that have left their segment.
    pub strayed: bool,
    /// The angle between touching filaments has grown so that crossings must be looked for.
    pub turned: bool,
}

impl Totals {
    /// Counts the works of one record that had the given offset.
    #[inline(always)]
    fn count<L: Lane>(&mut self, penalty: &Penalty, response: &Response<L>, offset: f64, lane: usize) {
        if penalty.keep < 1.0 {
            self.relaxed += response.normal_force.lane(lane) * offset * (1.0 - penalty.keep);
        }
        self.friction += response.friction.lane(lane);
        self.damping += response.damping.lane(lane);
    }

    /// Adds another part.
    pub fn add(&mut self, other: Totals) {
        self.friction += other.friction;
        self.damping += other.damping;
        self.relaxed += other.relaxed;
        self.strayed |= other.strayed;
        self.turned |= other.turned;
    }
}

/// Runs `f` over chunks of three columns and adds up what it returns, always in the same order.
fn by_chunks<A: Sync, B: Send, C: Send>(
    a: &[A],
    b: &mut [B],
    c: &mut [C],
    f: impl Fn(&[A], &mut [B], &mut [C]) -> Totals + Sync,
) -> Totals {
    let mut sum = Totals::default();
    if a.len() < 2 * CHUNK || rayon::current_num_threads() == 1 {
        for ((a, b), c) in a.chunks(CHUNK).zip(b.chunks_mut(CHUNK)).zip(c.chunks_mut(CHUNK)) {
            sum.add(f(a, b, c));
        }
    } else {
        let parts: Vec<Totals> =
            a.par_chunks(CHUNK).zip(b.par_chunks_mut(CHUNK)).zip(c.par_chunks_mut(CHUNK)).map(|((a, b), c)| f(a, b, c)).collect();
        for part in parts {
            sum.add(part);
        }
    }
    sum
}

/// One line record, with all that can be said about it.
pub fn of_line(penalty: &Penalty, lines: &Lines, now: &Centrelines, record: &LineRecord, state: &LineState) -> Contact<f64> {
    let (record, state) = (std::slice::from_ref(record), std::slice::from_ref(state));
    line_contact(penalty, lines, now, record, state, &beside(lines, now, record, state))
}

/// Calls `f` with the number of every line record, the parameter on its segment, and its stiffness.
pub fn each_line(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &[LineState],
    mut f: impl FnMut(usize, f64, f64),
) {
    for group in lane::groups(records.len()) {
        let (records, states, wide) = (&records[group.clone()], &states[group.clone()], group.len() == f64x4::WIDTH);
        if wide {
            let c = line_contact::<f64x4>(penalty, lines, now, records, states, &beside(lines, now, records, states));
            group.enumerate().for_each(|(lane, k)| f(k, c.t[1].lane(lane), c.stiffness.lane(lane)));
        } else {
            let c = of_line(penalty, lines, now, &records[0], &states[0]);
            f(group.start, c.t[1], c.stiffness);
        }
    }
}

/// One point record, with all that can be said about it.
pub fn of_point(penalty: &Penalty, lines: &Lines, now: &Centrelines, record: &PointRecord, state: &PointState) -> Contact<f64> {
    point_contact(penalty, lines, now, std::slice::from_ref(record), std::slice::from_ref(state))
}

#[inline(always)]
fn action<L: Lane>(c: &Contact<L>, lane: usize) -> Action {
    Action {
        force: c.response.force.lane(lane),
        normal: c.normal.lane(lane),
        turn: c.turn.map(|l| l.lane(lane)),
        t: c.t.map(|l| l.lane(lane)),
    }
}

/// Forces of all line records, four at a time.
pub fn evaluate_lines(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &mut [LineState],
    forces: &mut [LineForce],
) -> Totals {
    by_chunks(records, states, forces, |records, states, forces| {
        let mut sum = Totals::default();
        for group in lane::groups(records.len()) {
            let wide = group.len() == f64x4::WIDTH;
            let (records, states, forces) = (&records[group.clone()], &mut states[group.clone()], &mut forces[group]);
            if wide {
                lines_at_once::<f64x4>(penalty, lines, now, records, states, forces, &mut sum);
            } else {
                lines_at_once::<f64>(penalty, lines, now, records, states, forces, &mut sum);
            }
        }
        sum
    })
}

/// Forces of `L::WIDTH` line records. Most records of a list do not touch: they only follow.
#[inline(always)]
fn lines_at_once<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &mut [LineState],
    forces: &mut [LineForce],
    sum: &mut Totals,
) {
    let at = beside::<L>(lines, now, records, states);
    if !L::any(L::splat(0.0).less(at.overlap)) && states.iter().all(|s| s.damper == 0.0) {
        for lane in 0..L::WIDTH {
            let t = at.t.lane(lane);
            states[lane] = LineState { stiffness: APART, overlap: at.overlap.lane(lane), ..LineState::at(t) };
            (forces[lane].0.force, forces[lane].0.t) = (DVec3::ZERO, [0.0, t]);
            sum.strayed |= strayed(t);
        }
        return;
    }
    let c = line_contact(penalty, lines, now, records, states, &at);
    let (r, kept) = (&c.response, kept_stiffness(c.stiffness, at.overlap));
    for lane in 0..L::WIDTH {
        let t = c.t[1].lane(lane);
        sum.count(penalty, r, states[lane].offset, lane);
        states[lane] = LineState {
            t,
            slip: r.memory.slip.lane(lane),
            damper: r.memory.damper.lane(lane),
            offset: c.offset.lane(lane),
            stiffness: kept.lane(lane),
            overlap: at.overlap.lane(lane),
        };
        forces[lane] = LineForce(action(&c, lane));
        sum.strayed |= strayed(t);
        sum.turned |= c.turned.lane(lane) > 0.0;
    }
}

/// Forces of all point records.
pub fn evaluate_points(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[PointRecord],
    states: &mut [PointState],
    forces: &mut [PointForce],
) -> Totals {
    by_chunks(records, states, forces, |records, states, forces| {
        let mut sum = Totals::default();
        for group in lane::groups(records.len()) {
            let wide = group.len() == f64x4::WIDTH;
            let (records, states, forces) = (&records[group.clone()], &mut states[group.clone()], &mut forces[group]);
            if wide {
                points_at_once::<f64x4>(penalty, lines, now, records, states, forces, &mut sum);
            } else {
                points_at_once::<f64>(penalty, lines, now, records, states, forces, &mut sum);
            }
        }
        sum
    })
}

/// Forces of `L::WIDTH` point records.
#[inline(always)]
fn points_at_once<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[PointRecord],
    states: &mut [PointState],
    forces: &mut [PointForce],
    sum: &mut Totals,
) {
    let c = point_contact::<L>(penalty, lines, now, records, states);
    let r = &c.response;
    let overlap = c.penetration + c.offset;
    let kept = kept_stiffness(c.stiffness, overlap);
    for lane in 0..L::WIDTH {
        let t = [c.t[0].lane(lane), c.t[1].lane(lane)];
        sum.count(penalty, r, states[lane].offset, lane);
        states[lane] = PointState {
            t,
            slip: r.memory.slip.lane(lane),
            damper: r.memory.damper.lane(lane),
            offset: c.offset.lane(lane),
            stiffness: kept.lane(lane),
            overlap: overlap.lane(lane),
        };
        forces[lane] = PointForce(action(&c, lane));
        sum.strayed |= t.iter().any(|t| strayed(*t));
    }
}

/// Adds a force on a slot to the row of its node and to the dummy nodes that carry its image.
#[inline(always)]
pub fn put(lines: &Lines, slot: u32, f: DVec3, add: &mut impl FnMut(usize, DVec3)) {
    let s = &lines.slots[slot as usize];
    if s.row != NONE {
        add(s.row as usize, f);
        put_image(lines, s.image, f, add);
    }
}

/// Adds a force on a body shifted by an image to the dummy nodes that carry the period.
#[inline(always)]
fn put_image(lines: &Lines, image: Image, f: DVec3, add: &mut impl FnMut(usize, DVec3)) {
    if image == lines.images.zero() {
        return;
    }
    let k = lines.images.multiples(image);
    for (d, row) in lines.images.dummies.iter().enumerate() {
        if k[d] != 0 {
            add(*row as usize, f * f64::from(k[d]));
        }
    }
}

/// Adds a force on the tangent of a slot to the nodes that make it.
#[inline(always)]
fn put_turn(lines: &Lines, slot: u32, f: DVec3, add: &mut impl FnMut(usize, DVec3)) {
    for (at, c) in lines.tangent_slots(slot) {
        put(lines, at, f * c, add);
    }
}

/// Adds a force at parameter `t` of a segment, and one on its tangent there: to its nodes, and through the tangents to
/// those beside them.
#[inline(always)]
pub fn put_along(lines: &Lines, now: &Centrelines, segment: u32, t: f64, (f, turn): (DVec3, DVec3), add: &mut impl FnMut(usize, DVec3)) {
    let j = segment as usize;
    let w = weights(t, Range::new(|_| lines.slots[j].free));
    let (h, s) = (now.tangent[j][3], t.clamp(0.0, 1.0));
    put(lines, segment, f * w.a, add);
    put(lines, segment + 1, f * w.b, add);
    put_turn(lines, segment, (f * w.ta + turn * (1.0 - s)) * h, add);
    put_turn(lines, segment + 1, (f * w.tb + turn * s) * h, add);
}

/// Slots that carry the point at parameter `t` of a segment, each once, with their weights.
pub fn carriers(lines: &Lines, now: &Centrelines, segment: u32, t: f64) -> impl Iterator<Item = (u32, f64)> {
    let w = weights(t, Range::new(|_| lines.slots[segment as usize].free));
    let h = now.tangent[segment as usize][3];
    // Tangents take at most two slots on one side of their own.
    let first = segment.wrapping_sub(2);
    let mut all = [0.0, 0.0, w.a, w.b, 0.0, 0.0];
    for (slot, weight) in [(segment, w.ta * h), (segment + 1, w.tb * h)] {
        for (at, c) in lines.tangent_slots(slot) {
            all[at.wrapping_sub(first) as usize] += c * weight;
        }
    }
    all.into_iter().enumerate().filter(|(_, weight)| *weight != 0.0).map(move |(k, weight)| (first.wrapping_add(k as u32), weight))
}

/// Adds the forces of all records to the rows, record by record: few of a list touch, and one order gives
/// one sum, whatever the number of threads.
pub fn scatter(
    lines: &Lines,
    now: &Centrelines,
    (line_records, line_forces): (&[LineRecord], &[LineForce]),
    (point_records, point_forces): (&[PointRecord], &[PointForce]),
    mut add: impl FnMut(usize, DVec3),
) {
    for (r, f) in line_records.iter().zip(line_forces) {
        let Action { force, normal, turn, t } = f.0;
        if force == DVec3::ZERO {
            continue;
        }
        put(lines, r.node, force, &mut add);
        if turn[0] != 0.0 {
            put_turn(lines, r.node, normal * turn[0], &mut add);
        }
        put_along(lines, now, r.segment, t[1], (-force, normal * turn[1]), &mut add);
        put_image(lines, r.image, -force, &mut add);
    }
    for (r, f) in point_records.iter().zip(point_forces) {
        let Action { force, normal, turn, t } = f.0;
        if force == DVec3::ZERO {
            continue;
        }
        put_along(lines, now, r.segments[0], t[0], (force, normal * turn[0]), &mut add);
        put_along(lines, now, r.segments[1], t[1], (-force, normal * turn[1]), &mut add);
        put_image(lines, r.image, -force, &mut add);
    }
}
