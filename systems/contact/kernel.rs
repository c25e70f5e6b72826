//! Forces of line and point records: geometry on the C1 centrelines, weights, and the law.
//!
//! Side by side, the force per length of two filaments is `line_stiffness` x penetration, sampled at
//! the nodes of one of them, each standing for its share of length. Crossing, the force at the
//! closest point is `point_stiffness` x penetration. In between the two exchange weight by the angle
//! at which they part (the all-angle idea of Meier, Wall and Popp 2017), in a window of its sine given
//! in units of diameter over sampling length: below it a line contact is long enough for the nodes to
//! see it.
use super::curve::{Range, Segment, Weights, weights};
use super::images::Image;
use super::law::{Law, Memory, Response, Touch, Zero, respond};
use super::lines::{Centrelines, Lines};
use super::records::*;
use braid_ecs::prelude::*;

/// Numbers shared by all records.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

/// The segments of one record, or of several side by side: what their centrelines need.
#[derive(Clone, Copy)]
pub struct Side<L> {
    x: V3<L>,
    radius: L,
    length: L,
    /// The centrelines, relative to their first nodes.
    pub curve: Segment<L>,
}

/// What a force on a segment needs to know of its motion.
#[derive(Clone, Copy)]
struct Motion<L> {
    va: V3<L>,
    chord: V3<L>,
    ta: V3<L>,
    tb: V3<L>,
    mass: [L; 2],
}

#[inline(always)]
fn gather<L: Lane>(rows: &[[f64; 4]], index: impl Fn(usize) -> usize) -> (V3<L>, L) {
    let [x, y, z, w] = L::rows(|lane| rows[index(lane)]);
    (V3::new(x, y, z), w)
}

/// Vectors of the images by which the second bodies are shifted.
#[inline(always)]
fn image<L: Lane>(from: &[glam::DVec3], image: impl Fn(usize) -> Image) -> V3<L> {
    let [x, y, z, _] = L::rows(|lane| {
        let v = from[image(lane) as usize];
        [v.x, v.y, v.z, 0.0]
    });
    V3::new(x, y, z)
}

/// Slip and damper of the step before, from slip and damper of each lane.
#[inline(always)]
fn memory<L: Lane>(of: impl Fn(usize) -> (glam::DVec3, f64)) -> Memory<L> {
    let [x, y, z, damper] = L::rows(|lane| {
        let (slip, damper) = of(lane);
        [slip.x, slip.y, slip.z, damper]
    });
    Memory { slip: V3::new(x, y, z), damper }
}

impl<L: Lane> Side<L> {
    /// Of the segment in the slot that `index` says for each lane.
    #[inline(always)]
    pub fn load(lines: &Lines, now: &Centrelines, index: impl Fn(usize) -> usize + Copy) -> Self {
        let (x, radius) = gather::<L>(&now.x, index);
        let (xb, _) = gather::<L>(&now.x, |l| index(l) + 1);
        let (ta, length) = gather::<L>(&now.tangent, index);
        let (tb, _) = gather::<L>(&now.tangent, |l| index(l) + 1);
        let curve = Segment::new(xb - x, ta * length, tb * length, Range::new(|l| lines.joints[index(l)].free));
        Side { x, radius, length, curve }
    }
}

impl<L: Lane> Motion<L> {
    #[inline(always)]
    fn load(now: &Centrelines, length: L, index: impl Fn(usize) -> usize + Copy) -> Self {
        let (va, ma) = gather::<L>(&now.v, index);
        let (vb, mb) = gather::<L>(&now.v, |l| index(l) + 1);
        let (wa, _) = gather::<L>(&now.rate, index);
        let (wb, _) = gather::<L>(&now.rate, |l| index(l) + 1);
        Motion { va, chord: vb - va, ta: wa * length, tb: wb * length, mass: [ma, mb] }
    }

    #[inline(always)]
    fn velocity(&self, w: &Weights<L>) -> V3<L> {
        self.va + self.chord * w.b + self.ta * w.ta + self.tb * w.tb
    }

    /// Rate of the tangent by the parameter, taken as linear between the ends.
    #[inline(always)]
    fn turning(&self, t: L) -> V3<L> {
        self.ta + (self.tb - self.ta) * t.within(L::splat(0.0), L::splat(1.0))
    }

    #[inline(always)]
    fn mass_at(&self, t: L) -> L {
        let s = t.within(L::splat(0.0), L::splat(1.0));
        self.mass[0] + (self.mass[1] - self.mass[0]) * s
    }
}

/// How the surface of a filament moves along it while the filament turns, as a section across it does: by the arm from
/// the centreline to the surface.
#[derive(Clone, Copy)]
struct Lever<L> {
    /// Tangent x arm / |tangent|^2.
    along: V3<L>,
    /// Rate of the tangent.
    rate: V3<L>,
}

impl<L: Lane> Lever<L> {
    #[inline(always)]
    fn new(tangent: V3<L>, rate: V3<L>, arm: L) -> Self {
        Lever { along: tangent * (arm / tangent.dot(tangent)), rate }
    }

    /// Velocity of the surface over that of the centreline.
    #[inline(always)]
    fn slip(&self, normal: V3<L>) -> V3<L> {
        self.along * self.rate.dot(normal)
    }
}

/// Everything about a record at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Contact<L> {
    /// What the law gave.
    pub response: Response<L>,
    /// Forces along the normal by which friction turns the tangents of both bodies: the power of friction over the rate
    /// of that tangent (force x length / length of the tangent).
    pub turn: [L; 2],
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
fn point_weight<L: Lane>(penalty: &Penalty, parting: L, reach: L, sampling: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let unit = reach / sampling.upper(L::splat(penalty.point_length()));
    let (low, high) = (L::splat(penalty.window[0]), L::splat(penalty.window[1]));
    ((parting - low * unit) / ((high - low) * unit)).within(zero, one)
}

/// Sine of the angle at which two filaments cross, seen along the normal: filaments that only bend
/// away from each other do not cross.
#[inline(always)]
fn sine_of<L: Lane>(a: V3<L>, b: V3<L>, normal: V3<L>) -> L {
    (a.cross(b).dot(normal)).magnitude() / (a.dot(a) * b.dot(b)).sqrt()
}

/// Sine of the angle at which two filaments part from each other: that of straight ones whose gap
/// opens as fast as this one on both sides. A wire that winds around its core crosses it at the lay
/// angle everywhere and yet stays beside it; there this is zero. From the Hessian of half the
/// squared distance `d`, and never above the sine of the angle, which bears noise better.
#[inline(always)]
fn parting<L: Lane>(sine: L, d: V3<L>, (a, a2): (V3<L>, V3<L>), (b, b2): (V3<L>, V3<L>)) -> L {
    let (aa, bb, ab) = (a.dot(a), b.dot(b), a.dot(b));
    let square = ((aa + d.dot(a2)) * (bb - d.dot(b2)) - ab * ab) / (aa * bb);
    sine.lower(square.upper(L::splat(0.0)).sqrt())
}

#[inline(always)]
fn unit<L: Lane>(d: V3<L>, reach: L) -> (V3<L>, L) {
    let tiny = reach * reach * L::splat(1e-60);
    let distance = (d.dot(d) + tiny).sqrt();
    (d * (L::splat(1.0) / distance), distance)
}

/// Where the nodes of `L::WIDTH` line records are beside their segments.
#[derive(Clone, Copy)]
pub struct Beside<L> {
    side: Side<L>,
    /// Parameter of the closest point.
    pub t: L,
    tangent: V3<L>,
    second: V3<L>,
    apart: V3<L>,
    normal: V3<L>,
    reach: L,
    /// Penetration before any offset (length).
    pub overlap: L,
}

/// Finds the closest points of line records: one Newton step on (y - X) . X' = 0 from where they were.
#[inline(always)]
pub fn beside<L: Lane>(lines: &Lines, now: &Centrelines, records: &[LineRecord], states: &[LineState]) -> Beside<L> {
    let half = L::splat(0.5);
    let side = Side::<L>::load(lines, now, |l| records[l].segment as usize);
    let (xn, rn) = gather::<L>(&now.x, |l| records[l].node as usize);
    let y = xn - side.x - image(&now.shift, |l| records[l].image);
    let t0 = L::from_fn(|l| states[l].t);
    let p = side.curve.at(t0);
    let d = y - p.x;
    let metric = p.d.dot(p.d);
    let slope = (metric - d.dot(p.dd)).upper(L::splat(0.25) * metric);
    let t = (t0 + (d.dot(p.d) / slope).within(-half, half)).within(L::splat(-2.0), L::splat(3.0));
    let p = side.curve.at(t);
    let reach = rn + side.radius;
    let apart = y - p.x;
    let (normal, distance) = unit(apart, reach);
    Beside { side, t, tangent: p.d, second: p.dd, apart, normal, reach, overlap: reach - distance }
}

/// Evaluates `L::WIDTH` line records.
#[inline(always)]
pub fn line_contact<L: Lane>(
    penalty: &Penalty,
    lines: &Lines,
    now: &Centrelines,
    records: &[LineRecord],
    states: &[LineState],
    at: &Beside<L>,
) -> Contact<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let Beside { side, t, tangent, second, apart, normal, reach, overlap } = *at;
    let node = |l: usize| records[l].node as usize;
    let (vn, mn) = gather::<L>(&now.v, node);
    let (tn, _) = gather::<L>(&now.tangent, node);
    let (bend, _) = gather::<L>(&now.bend, node);

    // The share of the node's length that lies beside the other filament, at free ends.
    let turn = tn.dot(tangent);
    let sine = sine_of(tn, tangent, normal);
    let aligned = (turn * turn / (tn.dot(tn) * tangent.dot(tangent))).sqrt().upper(L::splat(0.1));
    let halves = |k: usize| L::from_fn(|l| lines.slots[node(l)].half[k]);
    let (before, after) = (halves(0), halves(1));
    let forward = zero.less(turn);
    let scale = aligned / side.length;
    let low = t - L::pick(forward, before, after) * scale;
    let high = t + L::pick(forward, after, before) * scale;
    let free = |k: usize, yes: f64, no: f64| L::from_fn(|l| if lines.joints[records[l].segment as usize].free[k] { yes } else { no });
    let covered = high.lower(free(1, 1.0, 1e9)) - low.upper(free(0, 0.0, -1e9));
    let cover = (covered / (high - low)).within(zero, one);

    let tributary = before + after;
    let sampling = L::from_fn(|l| lines.slots[node(l)].spacing);
    let crossing = L::from_fn(|l| if records[l].crossing { 1.0 } else { 0.0 });
    let share = L::from_fn(|l| if records[l].half { 0.5 } else { 1.0 });
    let cross = point_weight(penalty, parting(sine, apart, (tn, bend), (tangent, second)), reach, sampling);
    let parallel = one - crossing * cross;
    let stiffness = L::splat(penalty.line_stiffness) * tributary * share * cover * parallel;

    let w = weights(t, side.curve.range);
    let mut memory = memory(|l| (states[l].slip, states[l].damper));
    let before = Zero {
        offset: L::from_fn(|l| states[l].offset) * L::splat(penalty.keep),
        stiffness: L::from_fn(|l| states[l].stiffness),
        overlap: L::splat(f64::NAN),
    };
    let offset = before.follow(stiffness, overlap, zero, reach, &mut memory);
    let motion = Motion::<L>::load(now, side.length, |l| records[l].segment as usize);
    let ms = motion.mass_at(t);
    let (wn, _) = gather::<L>(&now.rate, node);
    // Together the arms span the distance, so that bodies that turn as one do not slide.
    let near = (reach - overlap) / reach;
    let levers = [Lever::new(tn, wn, (reach - side.radius) * near), Lever::new(tangent, motion.turning(t), side.radius * near)];
    let touch = Touch {
        stiffness,
        penetration: overlap - offset,
        reach,
        normal,
        velocity: vn - image(&now.shift_rate, |l| records[l].image) - motion.velocity(&w) + levers[0].slip(normal) + levers[1].slip(normal),
        mass: mn * ms / (mn + ms),
    };
    let response = respond(&penalty.law, &touch, &memory);
    let turn = levers.map(|l| l.along.dot(response.drag));
    let turned = L::pick(zero.less(touch.penetration), (one - crossing) * cross, zero);
    Contact { response, turn, t: [zero, t], penetration: touch.penetration, offset, normal, sine, stiffness, reach, turned }
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
    let segment = |side: usize| move |l: usize| records[l].segments[side] as usize;
    let (a, b) = (Side::<L>::load(lines, now, segment(0)), Side::<L>::load(lines, now, segment(1)));
    let apart = a.x - b.x - image(&now.shift, |l| records[l].image);
    let (ca, cb) = (a.curve, b.curve);
    let (s0, t0) = (L::from_fn(|l| states[l].t[0]), L::from_fn(|l| states[l].t[1]));
    let reach = a.radius + b.radius;
    // The sampling length is that of the filament whose nodes look for the other one.
    let sampling = L::from_fn(|l| {
        let [i, j] = records[l].segments;
        let (ca, cb) = (lines.chain_of(i), lines.chain_of(j));
        lines.slots[if Lines::looks_first(ca, cb) { i } else { j } as usize].length
    });
    // Side by side there is no crossing to follow: the record waits where it is.
    let (p, q) = (ca.at(s0), cb.at(t0));
    let d = apart + p.x - q.x;
    let (normal, _) = unit(d, reach);
    let low = L::splat(0.5 * penalty.window[0]) * reach / sampling.upper(L::splat(penalty.point_length()));
    let follow = low.less(parting(sine_of(p.d, q.d, normal), d, (p.d, p.dd), (q.d, q.dd)));
    let (s, t) = closest_step(&ca, &cb, apart, s0, t0, limits(lines, segment(0)), limits(lines, segment(1)));
    let (s, t) = (L::pick(follow, s, s0), L::pick(follow, t, t0));

    let (p, q) = (ca.at(s), cb.at(t));
    let d = apart + p.x - q.x;
    let (normal, distance) = unit(d, reach);
    let sine = sine_of(p.d, q.d, normal);
    let parting = parting(sine, d, (p.d, p.dd), (q.d, q.dd));
    // On the straight extension of a segment nothing is known: wait for the move to the next one.
    let (near, far) = (L::splat(-5.0 * SLACK), L::splat(1.0 + 5.0 * SLACK));
    let valid = near.less(s) & s.less(far) & near.less(t) & t.less(far);
    let weight = L::pick(valid, point_weight(penalty, parting, reach, sampling), L::splat(0.0));
    let stiffness = L::splat(penalty.point_stiffness) * weight;
    let (wa, wb) = (weights(s, ca.range), weights(t, cb.range));
    let overlap = reach - distance;
    let (ma, mb) = (Motion::<L>::load(now, a.length, segment(0)), Motion::<L>::load(now, b.length, segment(1)));
    let near = distance / reach;
    let levers = [Lever::new(p.d, ma.turning(s), a.radius * near), Lever::new(q.d, mb.turning(t), b.radius * near)];
    let velocity = ma.velocity(&wa) - mb.velocity(&wb) - image(&now.shift_rate, |l| records[l].image)
        + levers[0].slip(normal)
        + levers[1].slip(normal);
    let mut memory = memory(|l| (states[l].slip, states[l].damper));
    let before = Zero {
        offset: L::from_fn(|l| states[l].offset) * L::splat(penalty.keep),
        stiffness: L::from_fn(|l| states[l].stiffness),
        overlap: L::from_fn(|l| states[l].overlap),
    };
    let offset = before.follow(stiffness, overlap, velocity.dot(normal) * L::splat(penalty.law.dt), reach, &mut memory);
    let (mass_a, mass_b) = (ma.mass_at(s), mb.mass_at(t));
    let touch = Touch { stiffness, penetration: overlap - offset, reach, normal, velocity, mass: mass_a * mass_b / (mass_a + mass_b) };
    let response = respond(&penalty.law, &touch, &memory);
    let turn = levers.map(|l| l.along.dot(response.drag));
    let turned = L::splat(0.0);
    Contact { response, turn, t: [s, t], penetration: touch.penetration, offset, normal, sine, stiffness, reach, turned }
}

/// How far the closest point of two segments may be followed: to their ends where these are free.
#[inline(always)]
pub fn limits<L: Lane>(lines: &Lines, index: impl Fn(usize) -> usize) -> (L, L) {
    let limit = |k: usize, no: f64| L::from_fn(|l| if lines.joints[index(l)].free[k] { k as f64 } else { no });
    (limit(0, -2.0), limit(1, 3.0))
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
