//! Forces of line and point records: geometry on the C1 centrelines, weights, and the law.
//!
//! Side by side, the force per length of two filaments is `line_stiffness` x penetration, sampled at
//! the nodes of one of them, each standing for its share of length. Crossing, the force at the
//! closest point is `point_stiffness` x penetration. In between the two exchange weight by the angle
//! (the all-angle idea of Meier, Wall and Popp 2017), in a window of sin(alpha) given in units of
//! diameter over sampling length: below it a line contact is long enough for the nodes to see it.
use super::curve::{Range, Segment, Weights, weights};
use super::lane::{Lane, V3};
use super::law::{Law, Response, Touch, respond};
use super::lines::{Centrelines, Lines};
use super::records::*;
use bevy_ecs::prelude::*;

/// Numbers shared by all records.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct Penalty {
    /// The law.
    pub law: Law,
    /// Normal stiffness per length of line contact (force / length^2).
    pub line_stiffness: f64,
    /// Normal stiffness of a crossing (force / length).
    pub point_stiffness: f64,
    /// Blend window of sin(angle) in units of diameter / sampling length.
    pub window: [f64; 2],
    /// Factor on the offsets in this step.
    pub keep: f64,
}

impl Penalty {
    /// Length of line contact that is as stiff as a crossing.
    pub fn point_length(&self) -> f64 {
        if self.line_stiffness > 0.0 { self.point_stiffness / self.line_stiffness } else { 0.0 }
    }
}

/// One record, or several side by side, read from the columns.
#[derive(Clone, Copy)]
struct Side<L> {
    chord: V3<L>,
    ta: V3<L>,
    tb: V3<L>,
    chord_v: V3<L>,
    ta_v: V3<L>,
    tb_v: V3<L>,
    va: V3<L>,
    length: L,
    mass: [L; 2],
}

#[inline(always)]
fn gather<L: Lane>(rows: &[[f64; 4]], index: impl Fn(usize) -> usize) -> (V3<L>, L) {
    let take = |k: usize| L::from_fn(|lane| rows[index(lane)][k]);
    (V3::new(take(0), take(1), take(2)), take(3))
}

impl<L: Lane> Side<L> {
    #[inline(always)]
    fn load(now: &Centrelines, index: impl Fn(usize) -> usize + Copy) -> (Self, V3<L>, L) {
        let (xa, radius) = gather::<L>(&now.x, index);
        let (xb, _) = gather::<L>(&now.x, |l| index(l) + 1);
        let (ta, length) = gather::<L>(&now.tangent, index);
        let (tb, _) = gather::<L>(&now.tangent, |l| index(l) + 1);
        let (va, ma) = gather::<L>(&now.v, index);
        let (vb, mb) = gather::<L>(&now.v, |l| index(l) + 1);
        let (wa, _) = gather::<L>(&now.rate, index);
        let (wb, _) = gather::<L>(&now.rate, |l| index(l) + 1);
        let side = Side {
            chord: xb - xa,
            ta: ta * length,
            tb: tb * length,
            chord_v: vb - va,
            ta_v: wa * length,
            tb_v: wb * length,
            va,
            length,
            mass: [ma, mb],
        };
        (side, xa, radius)
    }

    #[inline(always)]
    fn curve(&self, lines: &Lines, segment: impl Fn(usize) -> u32) -> Segment<L> {
        Segment::new(self.chord, self.ta, self.tb, Range::new(|l| lines.slots[segment(l) as usize].free))
    }

    #[inline(always)]
    fn velocity(&self, w: &Weights<L>) -> V3<L> {
        self.va + self.chord_v * w.b + self.ta_v * w.ta + self.tb_v * w.tb
    }

    #[inline(always)]
    fn mass_at(&self, t: L) -> L {
        let s = t.within(L::splat(0.0), L::splat(1.0));
        self.mass[0] + (self.mass[1] - self.mass[0]) * s
    }
}

/// Everything about a record at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Contact<L> {
    /// What the law gave.
    pub response: Response<L>,
    /// Parameters on first and second body (the first one is zero for a node).
    pub t: [L; 2],
    /// Penetration less the offset (length).
    pub penetration: L,
    /// Offset of the penetration (length).
    pub offset: L,
    /// Normal towards the first body.
    pub normal: V3<L>,
    /// Sine of the angle between the centrelines.
    pub sine: L,
    /// Stiffness with weights (force / length).
    pub stiffness: L,
    /// Sum of the radii (length).
    pub reach: L,
    /// Positive if the angle now calls for a crossing that was not looked for.
    pub turned: L,
}

#[inline(always)]
fn point_weight<L: Lane>(penalty: &Penalty, sine: L, reach: L, sampling: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let unit = reach / sampling.upper(L::splat(penalty.point_length()));
    let (low, high) = (L::splat(penalty.window[0]), L::splat(penalty.window[1]));
    ((sine - low * unit) / ((high - low) * unit)).within(zero, one)
}

/// Sine of the angle at which two filaments cross, seen along the normal: filaments that only bend
/// away from each other do not cross.
#[inline(always)]
fn sine_of<L: Lane>(a: V3<L>, b: V3<L>, normal: V3<L>) -> L {
    (a.cross(b).dot(normal)).magnitude() / (a.dot(a) * b.dot(b)).sqrt()
}

#[inline(always)]
fn unit<L: Lane>(d: V3<L>, reach: L) -> (V3<L>, L) {
    let tiny = reach * reach * L::splat(1e-60);
    let distance = (d.dot(d) + tiny).sqrt();
    (d * (L::splat(1.0) / distance), distance)
}

/// Evaluates `L::WIDTH` line records.
#[inline(always)]
pub fn line_contact<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &[LineState],
) -> Contact<L> {
    let (zero, half, one) = (L::splat(0.0), L::splat(0.5), L::splat(1.0));
    let (side, xa, ra) = Side::<L>::load(now, |l| records[l].segment as usize);
    let node = |l: usize| records[l].node as usize;
    let (xn, rn) = gather::<L>(&now.x, node);
    let (vn, mn) = gather::<L>(&now.v, node);
    let (tn, _) = gather::<L>(&now.tangent, node);
    let of_shift = |from: &[glam::DVec3]| {
        let take = |k: usize| L::from_fn(|l| from[records[l].image as usize][k]);
        V3::new(take(0), take(1), take(2))
    };
    let (shift, shift_rate) = (of_shift(&now.shift), of_shift(&now.shift_rate));
    let y = xn - xa - shift;

    // Closest point: one Newton step on (y - X) . X' = 0 from where it was.
    let curve = side.curve(lines, |l| records[l].segment);
    let t0 = L::from_fn(|l| states[l].t);
    let p = curve.at(t0);
    let d = y - p.x;
    let metric = p.d.dot(p.d);
    let slope = (metric - d.dot(p.dd)).upper(L::splat(0.25) * metric);
    let t = (t0 + (d.dot(p.d) / slope).within(-half, half)).within(L::splat(-2.0), L::splat(3.0));
    let p = curve.at(t);
    let d = y - p.x;
    let reach = rn + ra;
    let (normal, distance) = unit(d, reach);

    // The share of the node's length that lies beside the other filament, at free ends.
    let turn = tn.dot(p.d);
    let sine = sine_of(tn, p.d, normal);
    let aligned = (turn * turn / (tn.dot(tn) * p.d.dot(p.d))).sqrt().upper(L::splat(0.1));
    let halves = |k: usize| L::from_fn(|l| lines.slots[records[l].node as usize].half[k]);
    let (before, after) = (halves(0), halves(1));
    let forward = zero.less(turn);
    let scale = aligned / side.length;
    let low = t - L::pick(forward, before, after) * scale;
    let high = t + L::pick(forward, after, before) * scale;
    let free = |k: usize, yes: f64, no: f64| L::from_fn(|l| if lines.slots[records[l].segment as usize].free[k] { yes } else { no });
    let covered = high.lower(free(1, 1.0, 1e9)) - low.upper(free(0, 0.0, -1e9));
    let cover = (covered / (high - low)).within(zero, one);

    let tributary = before + after;
    let sampling = L::from_fn(|l| lines.slots[records[l].node as usize].spacing);
    let crossing = L::from_fn(|l| if records[l].crossing { 1.0 } else { 0.0 });
    let share = L::from_fn(|l| if records[l].half { 0.5 } else { 1.0 });
    let cross = point_weight(penalty, sine, reach, sampling);
    let beside = one - crossing * cross;
    let stiffness = L::splat(penalty.line_stiffness) * tributary * share * cover * beside;

    let w = weights(t, curve.range);
    let overlap = reach - distance;
    let offset = (L::from_fn(|l| states[l].offset) * L::splat(penalty.keep)).lower(overlap.upper(zero));
    let ms = side.mass_at(t);
    let touch = Touch {
        stiffness,
        penetration: overlap - offset,
        reach,
        normal,
        velocity: vn - shift_rate - side.velocity(&w),
        mass: mn * ms / (mn + ms),
    };
    let slip = V3::new(L::from_fn(|l| states[l].slip.x), L::from_fn(|l| states[l].slip.y), L::from_fn(|l| states[l].slip.z));
    let response = respond(&penalty.law, &touch, slip);
    let turned = L::pick(zero.less(touch.penetration), (one - crossing) * cross, zero);
    Contact { response, t: [zero, t], penetration: touch.penetration, offset, normal, sine, stiffness, reach, turned }
}

/// Evaluates `L::WIDTH` point records.
#[inline(always)]
pub fn point_contact<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[PointRecord],
    states: &[PointState],
) -> Contact<L> {
    let (a, xa, ra) = Side::<L>::load(now, |l| records[l].segments[0] as usize);
    let (b, xb, rb) = Side::<L>::load(now, |l| records[l].segments[1] as usize);
    let of_shift = |from: &[glam::DVec3]| {
        let take = |k: usize| L::from_fn(|l| from[records[l].image as usize][k]);
        V3::new(take(0), take(1), take(2))
    };
    let apart = xa - xb - of_shift(&now.shift);
    let (ca, cb) = (a.curve(lines, |l| records[l].segments[0]), b.curve(lines, |l| records[l].segments[1]));
    let (s0, t0) = (L::from_fn(|l| states[l].t[0]), L::from_fn(|l| states[l].t[1]));
    let limits = |side: usize| {
        let limit = |k: usize, no: f64| L::from_fn(|l| if lines.slots[records[l].segments[side] as usize].free[k] { k as f64 } else { no });
        (limit(0, -2.0), limit(1, 3.0))
    };
    let reach = ra + rb;
    // The sampling length is that of the filament whose nodes look for the other one.
    let sampling = L::from_fn(|l| {
        let [i, j] = records[l].segments;
        let (ca, cb) = (lines.chain_of(i), lines.chain_of(j));
        lines.slots[if Lines::looks_first(ca, cb) { i } else { j } as usize].length
    });
    // Side by side there is no crossing to follow: the record waits where it is.
    let (p, q) = (ca.at(s0), cb.at(t0));
    let (normal, _) = unit(apart + p.x - q.x, reach);
    let low = L::splat(0.5 * penalty.window[0]) * reach / sampling.upper(L::splat(penalty.point_length()));
    let follow = low.less(sine_of(p.d, q.d, normal));
    let (s, t) = closest_step(&ca, &cb, apart, s0, t0, limits(0), limits(1));
    let (s, t) = (L::pick(follow, s, s0), L::pick(follow, t, t0));

    let (p, q) = (ca.at(s), cb.at(t));
    let (normal, distance) = unit(apart + p.x - q.x, reach);
    let sine = sine_of(p.d, q.d, normal);
    // On the straight extension of a segment nothing is known: wait for the move to the next one.
    let (near, far) = (L::splat(-5.0 * SLACK), L::splat(1.0 + 5.0 * SLACK));
    let valid = near.less(s) & s.less(far) & near.less(t) & t.less(far);
    let weight = L::pick(valid, point_weight(penalty, sine, reach, sampling), L::splat(0.0));
    let stiffness = L::splat(penalty.point_stiffness) * weight;
    let (wa, wb) = (weights(s, ca.range), weights(t, cb.range));
    let overlap = reach - distance;
    let offset = (L::from_fn(|l| states[l].offset) * L::splat(penalty.keep)).lower(overlap.upper(L::splat(0.0)));
    let (ma, mb) = (a.mass_at(s), b.mass_at(t));
    let touch = Touch {
        stiffness,
        penetration: overlap - offset,
        reach,
        normal,
        velocity: a.velocity(&wa) - b.velocity(&wb) - of_shift(&now.shift_rate),
        mass: ma * mb / (ma + mb),
    };
    let slip = V3::new(L::from_fn(|l| states[l].slip.x), L::from_fn(|l| states[l].slip.y), L::from_fn(|l| states[l].slip.z));
    let response = respond(&penalty.law, &touch, slip);
    let turned = L::splat(0.0);
    Contact { response, t: [s, t], penetration: touch.penetration, offset, normal, sine, stiffness, reach, turned }
}

/// One Newton step towards the closest points of two curves, kept on free ends.
#[inline(always)]
pub fn closest_step<L: Lane>(
    a: &Segment<L>,
    b: &Segment<L>,
    apart: V3<L>,
    s: L,
    t: L,
    (s_low, s_high): (L, L),
    (t_low, t_high): (L, L),
) -> (L, L) {
    let half = L::splat(0.5);
    let (p, q) = (a.at(s), b.at(t));
    let d = apart + p.x - q.x;
    let (gs, gt) = (d.dot(p.d), -d.dot(q.d));
    let (ms, mt, c) = (p.d.dot(p.d), q.d.dot(q.d), -p.d.dot(q.d));
    // The full Hessian where it is safely positive, the metric of the curves elsewhere.
    let (hs, ht) = (ms + d.dot(p.dd), mt - d.dot(q.dd));
    let quarter = L::splat(0.25);
    let good = (quarter * ms).less(hs) & (quarter * mt).less(ht) & (L::splat(1e-6) * ms * mt).less(hs * ht - c * c);
    let (hs, ht) = (L::pick(good, hs, ms), L::pick(good, ht, mt));
    let det = (hs * ht - c * c).upper(L::splat(1e-6) * ms * mt);
    let ds = ((c * gt - ht * gs) / det).within(-half, half);
    let s1 = (s + ds).within(s_low, s_high);
    let dt = (-(gt + c * (s1 - s)) / ht).within(-half, half);
    let t1 = (t + dt).within(t_low, t_high);
    // If the second one was held back, the first one has to be found again for it.
    let ds = (-(gs + c * (t1 - t)) / hs).within(-half, half);
    let s1 = (s + ds).within(s_low, s_high);
    (s1, t1)
}
