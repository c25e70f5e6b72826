//! All records of a step, and the way of their forces to the nodes.
//!
//! Records write their own force (in parallel); every segment sums what acts on it, every node sums
//! what acts on it and on the tangents it takes part in. Each sum has one fixed order, so the bits
//! do not depend on the number of threads. A force on the image of a segment also pulls on the
//! dummy nodes that carry the period.
use super::curve::{Range, weights};
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

/// One point record, with all that can be said about it.
pub fn of_point(penalty: &Penalty, lines: &Lines, now: &Centrelines, record: &PointRecord, state: &PointState) -> Contact<f64> {
    point_contact(penalty, lines, now, std::slice::from_ref(record), std::slice::from_ref(state))
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
            states[lane] = LineState { stiffness: APART, ..LineState::at(t) };
            forces[lane] = LineForce([0.0, 0.0, 0.0, t]);
            sum.strayed |= strayed(t);
        }
        return;
    }
    let c = line_contact(penalty, lines, now, records, states, &at);
    let (r, kept) = (&c.response, kept_stiffness(c.stiffness, c.penetration + c.offset));
    for lane in 0..L::WIDTH {
        let (t, f) = (c.t[1].lane(lane), r.force.lane(lane));
        sum.count(penalty, r, states[lane].offset, lane);
        states[lane] = LineState {
            t,
            slip: r.memory.slip.lane(lane),
            damper: r.memory.damper.lane(lane),
            offset: c.offset.lane(lane),
            stiffness: kept.lane(lane),
        };
        forces[lane] = LineForce([f.x, f.y, f.z, t]);
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
        forces[lane] = PointForce { force: r.force.lane(lane), t };
        sum.strayed |= t.iter().any(|t| strayed(*t));
    }
}

/// Which records act on which segment, and the sums on the way to the nodes.
#[derive(Resource, Clone, Debug, Default)]
pub struct Gather {
    /// Records of each node: first record, and the end.
    node_start: Vec<u32>,
    /// Line records of each segment.
    line_start: Vec<u32>,
    line_list: Vec<u32>,
    /// Sides of point records of each segment (record x 2 + side).
    point_start: Vec<u32>,
    point_list: Vec<u32>,
    /// Records with an image (line records, then point records).
    shifted: [Vec<u32>; 2],
    /// Force on each slot.
    pub slot_force: Vec<DVec3>,
    tangent_force: Vec<DVec3>,
    segment_force: Vec<[DVec3; 4]>,
    image_force: Vec<DVec3>,
}

/// Lists the entries of each key, in the order in which they come.
fn lists(keys: impl Iterator<Item = u32> + Clone, count: usize, start: &mut Vec<u32>, list: &mut Vec<u32>) {
    start.clear();
    start.resize(count + 1, 0);
    let mut total = 0;
    for k in keys.clone() {
        start[k as usize + 1] += 1;
        total += 1;
    }
    for k in 0..count {
        start[k + 1] += start[k];
    }
    list.clear();
    list.resize(total, 0);
    let mut at = start.clone();
    for (entry, k) in keys.enumerate() {
        list[at[k as usize] as usize] = entry as u32;
        at[k as usize] += 1;
    }
}

impl Gather {
    /// Brings the lists up to date with the records.
    pub fn index(&mut self, lines: &Lines, line_records: &[LineRecord], point_records: &[PointRecord]) {
        let n = lines.slots.len();
        self.node_start.clear();
        self.node_start.resize(n + 1, 0);
        for r in line_records {
            self.node_start[r.node as usize + 1] += 1;
        }
        for k in 0..n {
            self.node_start[k + 1] += self.node_start[k];
        }
        lists(line_records.iter().map(|r| r.segment), n, &mut self.line_start, &mut self.line_list);
        let sides = point_records.iter().flat_map(|r| r.segments);
        lists(sides, n, &mut self.point_start, &mut self.point_list);
        let zero = lines.images.zero();
        for list in &mut self.shifted {
            list.clear();
        }
        self.shifted[0].extend((0..line_records.len()).filter(|&k| line_records[k].image != zero).map(|k| k as u32));
        self.shifted[1].extend((0..point_records.len()).filter(|&k| point_records[k].image != zero).map(|k| k as u32));
    }

    /// Sums the forces of the records on the slots.
    pub fn sum(
        &mut self,
        lines: &Lines,
        now: &Centrelines,
        line_records: &[LineRecord],
        line_forces: &[LineForce],
        point_records: &[PointRecord],
        point_forces: &[PointForce],
    ) {
        let n = lines.slots.len();
        self.segment_force.resize(n, [DVec3::ZERO; 4]);
        self.slot_force.resize(n, DVec3::ZERO);
        self.tangent_force.resize(n, DVec3::ZERO);
        let Gather { node_start, line_start, line_list, point_start, point_list, segment_force, slot_force, tangent_force, .. } = self;
        let on_segment = |j: usize, out: &mut [DVec3; 4]| {
            let mut sum = [DVec3::ZERO; 4];
            let h = now.tangent[j][3];
            let range = Range::new(|_| lines.slots[j].free);
            let mut add = |f: DVec3, t: f64| {
                let w = weights(t, range);
                for (s, w) in sum.iter_mut().zip([w.a, w.b, w.ta * h, w.tb * h]) {
                    *s += f * w;
                }
            };
            for &k in &line_list[line_start[j] as usize..line_start[j + 1] as usize] {
                let f = &line_forces[k as usize].0;
                if f[0] == 0.0 && f[1] == 0.0 && f[2] == 0.0 {
                    continue;
                }
                add(-DVec3::new(f[0], f[1], f[2]), f[3]);
            }
            for &k in &point_list[point_start[j] as usize..point_start[j + 1] as usize] {
                let f = &point_forces[k as usize / 2];
                let side = k as usize % 2;
                add(if side == 0 { f.force } else { -f.force }, f.t[side]);
            }
            *out = sum;
        };
        for_rows(segment_force, on_segment);
        let segment_force = &*segment_force;
        let on_slot = |i: usize, out: &mut DVec3| {
            let mut sum = segment_force[i][0];
            if i > 0 {
                sum += segment_force[i - 1][1];
            }
            for k in node_start[i] as usize..node_start[i + 1] as usize {
                let f = &line_forces[k].0;
                sum += DVec3::new(f[0], f[1], f[2]);
            }
            *out = sum;
        };
        for_rows(slot_force, on_slot);
        for_rows(tangent_force, |i, out| {
            *out = segment_force[i][2];
            if i > 0 {
                *out += segment_force[i - 1][3];
            }
        });
        let tangent_force = &*tangent_force;
        for_rows(slot_force, |i, out| {
            for k in i.saturating_sub(2)..(i + 3).min(n) {
                let slot = &lines.slots[k];
                if let Some(c) = slot.tangent.get((i as isize - k as isize - slot.first) as usize) {
                    *out += tangent_force[k] * *c;
                }
            }
        });

        self.image_force.clear();
        self.image_force.resize(lines.images.count(), DVec3::ZERO);
        for &k in &self.shifted[0] {
            let f = &line_forces[k as usize].0;
            self.image_force[line_records[k as usize].image as usize] -= DVec3::new(f[0], f[1], f[2]);
        }
        for &k in &self.shifted[1] {
            self.image_force[point_records[k as usize].image as usize] -= point_forces[k as usize].force;
        }
        for (slot, f) in lines.slots.iter().zip(&self.slot_force) {
            if slot.row != NONE {
                self.image_force[slot.image as usize] += *f;
            }
        }
    }

    /// Adds the forces of the slots to the rows of the nodes, and those of the images to the dummy nodes.
    pub fn scatter(&self, lines: &Lines, mut add: impl FnMut(usize, DVec3)) {
        for (slot, f) in lines.slots.iter().zip(&self.slot_force) {
            if slot.row != NONE {
                add(slot.row as usize, *f);
            }
        }
        for (image, f) in self.image_force.iter().enumerate() {
            let k = lines.images.multiples(image as u8);
            for (d, row) in lines.images.dummies.iter().enumerate() {
                if k[d] != 0 {
                    add(*row as usize, *f * f64::from(k[d]));
                }
            }
        }
    }
}

fn for_rows<T: Send>(out: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    if out.len() < 2 * CHUNK || rayon::current_num_threads() == 1 {
        for (i, o) in out.iter_mut().enumerate() {
            f(i, o);
        }
    } else {
        out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, chunk)| {
            for (i, o) in chunk.iter_mut().enumerate() {
                f(c * CHUNK + i, o);
            }
        });
    }
}
