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
const CHUNK: usize = 256;

/// Sums over the records of one step, and which of them need more than that.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Totals {
    /// Work lost to friction.
    pub friction: f64,
    /// Work lost to damping.
    pub damping: f64,
    /// Work put in by overlap that goes away in time.
    pub relaxed: f64,
    /// The angle between touching filaments has grown so that crossings must be looked for.
    pub turned: bool,
    /// Records that have left their segment, in order.
    pub strayed: Vec<u32>,
    /// Records with a force, in order.
    pub touching: Vec<u32>,
    /// Records that touch or may do so within [`AHEAD`] steps, with their stiffness (force / length).
    pub bearing: Vec<(u32, f64)>,
}

/// Steps in which a record whose overlap grows as in the last one counts as touching: the time step needs two to follow.
pub const AHEAD: f64 = 4.0;

/// How an overlap has grown in this step, and the largest that is to be expected in the next ones if it goes on to grow as fast, and
/// if it grows ever faster as in this step: the first for how stiff the contact will be, the second for whether there will be one.
#[inline(always)]
fn expected<L: Lane>(overlap: L, before: impl Fn(usize) -> f64, growth_before: impl Fn(usize) -> f64) -> [L; 3] {
    let zero = L::splat(0.0);
    let growth = overlap - L::from_fn(before);
    // A record just found does not know its overlap before: not a number is neither less nor more.
    let growth = growth.upper(zero) - (-growth).upper(zero);
    let faster = (growth - L::from_fn(growth_before)).upper(zero);
    let steady = growth * L::splat(AHEAD);
    let more = steady + faster * L::splat(0.5 * AHEAD * (AHEAD + 1.0));
    [growth, overlap + steady.upper(zero), overlap + more.upper(zero)]
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
    fn add(&mut self, other: Totals) {
        self.friction += other.friction;
        self.damping += other.damping;
        self.relaxed += other.relaxed;
        self.turned |= other.turned;
        self.strayed.extend(other.strayed);
        self.touching.extend(other.touching);
        self.bearing.extend(other.bearing);
    }

    /// Notes the stiffness of record `k` if it touches or soon will.
    #[inline(always)]
    fn bear(&mut self, k: usize, stiffness: f64) {
        if stiffness > 0.0 {
            self.bearing.push((k as u32, stiffness));
        }
    }

    /// Notes where record `k` is now, and whether it has a force.
    #[inline(always)]
    fn note(&mut self, k: usize, strayed: bool, force: DVec3) {
        if strayed {
            self.strayed.push(k as u32);
        }
        if force != DVec3::ZERO {
            self.touching.push(k as u32);
        }
    }
}

/// Runs `f` on every group of four records (or single ones) of three columns, with the number of its first one, and adds up
/// what it counts, always in the same order.
fn by_groups<A: Sync, B: Send, C: Send>(
    a: &[A],
    b: &mut [B],
    c: &mut [C],
    f: impl Fn(usize, &[A], &mut [B], &mut [C], &mut Totals) + Sync,
) -> Totals {
    let of = |(number, ((a, b), c)): (usize, ((&[A], &mut [B]), &mut [C]))| {
        let mut sum = Totals::default();
        for group in lane::groups(a.len()) {
            f(number * CHUNK + group.start, &a[group.clone()], &mut b[group.clone()], &mut c[group], &mut sum);
        }
        sum
    };
    let parts: Vec<Totals> = if a.len() < 2 * CHUNK || rayon::current_num_threads() == 1 {
        a.chunks(CHUNK).zip(b.chunks_mut(CHUNK)).zip(c.chunks_mut(CHUNK)).enumerate().map(of).collect()
    } else {
        a.par_chunks(CHUNK).zip(b.par_chunks_mut(CHUNK)).zip(c.par_chunks_mut(CHUNK)).enumerate().map(of).collect()
    };
    let mut sum = Totals::default();
    parts.into_iter().for_each(|part| sum.add(part));
    sum
}

/// One line record, with all that can be said about it.
pub fn of_line(penalty: &Penalty, lines: &Lines, now: &Centrelines, record: &LineRecord, state: &LineState) -> Contact<f64> {
    let (record, state) = (std::slice::from_ref(record), std::slice::from_ref(state));
    line_contact(penalty, lines, now, record, state, &beside(lines, now, record, state))
}

/// Parameter on its segment, and stiffness, of every line record.
pub fn line_stiffnesses(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &[LineState],
) -> Vec<(f64, f64)> {
    let of = |range: std::ops::Range<usize>| {
        let mut out = Vec::with_capacity(range.len());
        for group in lane::groups(range.len()) {
            let group = range.start + group.start..range.start + group.end;
            let (records, states) = (&records[group.clone()], &states[group]);
            if records.len() == f64x4::WIDTH {
                let c = line_contact::<f64x4>(penalty, lines, now, records, states, &beside(lines, now, records, states));
                out.extend((0..f64x4::WIDTH).map(|lane| (c.t[1].lane(lane), c.stiffness.lane(lane))));
            } else {
                let c = of_line(penalty, lines, now, &records[0], &states[0]);
                out.push((c.t[1], c.stiffness));
            }
        }
        out
    };
    parallel::chunks(records.len(), CHUNK, of).concat()
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
    by_groups(records, states, forces, |first, records, states, forces, sum| {
        if records.len() == f64x4::WIDTH {
            lines_at_once::<f64x4>(penalty, lines, now, first, records, states, forces, sum);
        } else {
            lines_at_once::<f64>(penalty, lines, now, first, records, states, forces, sum);
        }
    })
}

/// Forces of `L::WIDTH` line records. Most records of a list do not touch: they only follow.
#[inline(always)]
fn lines_at_once<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    first: usize,
    records: &[LineRecord],
    states: &mut [LineState],
    forces: &mut [LineForce],
    sum: &mut Totals,
) {
    let at = beside::<L>(lines, now, records, states);
    let [growth, deep, deepest] = expected(at.overlap, |l| states[l].overlap, |l| states[l].growth);
    let soon = L::splat(0.0).less(deepest);
    if !L::any(soon) && states.iter().all(|s| s.damper == 0.0) {
        for lane in 0..L::WIDTH {
            let t = at.t.lane(lane);
            // Who did not touch before has no force to take back.
            if states[lane].stiffness != APART {
                forces[lane].0.force = DVec3::ZERO;
            }
            states[lane] = LineState { stiffness: APART, overlap: at.overlap.lane(lane), growth: growth.lane(lane), ..LineState::at(t) };
            sum.note(first + lane, strayed(t), DVec3::ZERO);
        }
        return;
    }
    let c = line_contact(penalty, lines, now, records, states, &at);
    let (r, kept) = (&c.response, kept_stiffness(c.stiffness, at.overlap));
    let bears = L::pick(soon, c.stiffness * penalty.law.slope(deep - c.offset, c.reach), L::splat(0.0));
    for lane in 0..L::WIDTH {
        let t = c.t[1].lane(lane);
        sum.bear(first + lane, bears.lane(lane));
        sum.count(penalty, r, states[lane].offset, lane);
        states[lane] = LineState {
            t,
            slip: r.memory.slip.lane(lane),
            damper: r.memory.damper.lane(lane),
            offset: c.offset.lane(lane),
            stiffness: kept.lane(lane),
            overlap: at.overlap.lane(lane),
            growth: growth.lane(lane),
        };
        forces[lane] = LineForce(action(&c, lane));
        sum.note(first + lane, strayed(t), forces[lane].0.force);
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
    by_groups(records, states, forces, |first, records, states, forces, sum| {
        if records.len() == f64x4::WIDTH {
            points_at_once::<f64x4>(penalty, lines, now, first, records, states, forces, sum);
        } else {
            points_at_once::<f64>(penalty, lines, now, first, records, states, forces, sum);
        }
    })
}

/// Forces of `L::WIDTH` point records.
#[inline(always)]
fn points_at_once<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    first: usize,
    records: &[PointRecord],
    states: &mut [PointState],
    forces: &mut [PointForce],
    sum: &mut Totals,
) {
    let c = point_contact::<L>(penalty, lines, now, records, states);
    let r = &c.response;
    let overlap = c.penetration + c.offset;
    let kept = kept_stiffness(c.stiffness, overlap);
    let [growth, deep, deepest] = expected(overlap, |l| states[l].overlap, |l| states[l].growth);
    let bears = L::pick(L::splat(0.0).less(deepest), c.stiffness * penalty.law.slope(deep - c.offset, c.reach), L::splat(0.0));
    for lane in 0..L::WIDTH {
        let t = [c.t[0].lane(lane), c.t[1].lane(lane)];
        sum.bear(first + lane, bears.lane(lane));
        sum.count(penalty, r, states[lane].offset, lane);
        states[lane] = PointState {
            t,
            slip: r.memory.slip.lane(lane),
            damper: r.memory.damper.lane(lane),
            offset: c.offset.lane(lane),
            stiffness: kept.lane(lane),
            overlap: overlap.lane(lane),
            growth: growth.lane(lane),
        };
        forces[lane] = PointForce(action(&c, lane));
        sum.note(first + lane, t.iter().any(|t| strayed(*t)), forces[lane].0.force);
    }
}

/// Adds a force on a slot to the row of its node and to the dummy nodes that carry its image.
#[inline(always)]
pub fn put(lines: &Lines, slot: u32, f: DVec3, add: &mut impl FnMut(usize, DVec3)) {
    let s = &lines.joints[slot as usize];
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
    let w = weights(t, Range::new(|_| lines.joints[j].free));
    let (h, s) = (now.tangent[j][3], t.clamp(0.0, 1.0));
    put(lines, segment, f * w.a, add);
    put(lines, segment + 1, f * w.b, add);
    put_turn(lines, segment, (f * w.ta + turn * (1.0 - s)) * h, add);
    put_turn(lines, segment + 1, (f * w.tb + turn * s) * h, add);
}

/// Slots that may carry a point of a segment: tangents take at most two on one side of their own.
pub const CARRIERS: usize = 6;

/// The first of the [`CARRIERS`] of a segment.
#[inline(always)]
pub fn first_carrier(segment: u32) -> u32 {
    segment.wrapping_sub(2)
}

/// Weights of the slots that carry the point at parameter `t` of a segment, from [`first_carrier`] on.
#[inline]
pub fn carriers(lines: &Lines, now: &Centrelines, segment: u32, t: f64) -> [f64; CARRIERS] {
    let w = weights(t, Range::new(|_| lines.joints[segment as usize].free));
    let h = now.tangent[segment as usize][3];
    let first = first_carrier(segment);
    let mut all = [0.0; CARRIERS];
    (all[2], all[3]) = (w.a, w.b);
    for (slot, weight) in [(segment, w.ta * h), (segment + 1, w.tb * h)] {
        for (at, c) in lines.tangent_slots(slot) {
            all[at.wrapping_sub(first) as usize] += c * weight;
        }
    }
    all
}

/// Records, their forces, and which of them have one.
pub type Acting<'a, R, F> = (&'a [R], &'a [F], &'a [u32]);

/// Adds the forces of all records that touch to the rows, record by record: few of a list do, and one order gives
/// one sum, whatever the number of threads.
pub fn scatter(
    lines: &Lines,
    now: &Centrelines,
    (line_records, line_forces, touching_lines): Acting<'_, LineRecord, LineForce>,
    (point_records, point_forces, touching_points): Acting<'_, PointRecord, PointForce>,
    mut add: impl FnMut(usize, DVec3),
) {
    for k in touching_lines {
        let (r, Action { force, normal, turn, t }) = (&line_records[*k as usize], line_forces[*k as usize].0);
        put(lines, r.node, force, &mut add);
        if turn[0] != 0.0 {
            put_turn(lines, r.node, normal * turn[0], &mut add);
        }
        put_along(lines, now, r.segment, t[1], (-force, normal * turn[1]), &mut add);
        put_image(lines, r.image, -force, &mut add);
    }
    for k in touching_points {
        let (r, Action { force, normal, turn, t }) = (&point_records[*k as usize], point_forces[*k as usize].0);
        put_along(lines, now, r.segments[0], t[0], (force, normal * turn[0]), &mut add);
        put_along(lines, now, r.segments[1], t[1], (-force, normal * turn[1]), &mut add);
        put_image(lines, r.image, -force, &mut add);
    }
}
