//! Where pairs of close segments cross: the closest points of their centrelines, four pairs at a time.
use super::kernel::{Penalty, Side, closest_step, limits};
use super::lines::{Centrelines, Lines, xyz};
use super::list::{FOUND, PointFound, look_from, sine, to_vec};
use super::near::closest_parameters;
use super::records::*;
use super::search::Candidate;
use braid_ecs::prelude::*;

/// A pair that may cross, and the closest points of its chords.
#[derive(Clone, Copy)]
struct Start {
    pair: Candidate,
    place: [f64; 2],
}

/// Point records of those candidates that cross.
pub fn crossings(penalty: &Penalty, lines: &Lines, now: &Centrelines, candidates: &[Candidate]) -> Vec<PointFound> {
    let starts: Vec<Start> = candidates.iter().filter_map(|c| start(penalty, lines, now, *c)).collect();
    let mut found = Vec::new();
    for group in lane::groups(starts.len()) {
        let starts = &starts[group];
        let places = if starts.len() == f64x4::WIDTH { closest::<f64x4>(lines, now, starts) } else { closest::<f64>(lines, now, starts) };
        found.extend(starts.iter().zip(places).filter_map(|(start, place)| record(penalty, lines, now, start.pair, place)));
    }
    found
}

/// Sine of the angle from which a crossing of a pair is looked for: the sampling length is that of the filament whose nodes look for
/// the other one.
fn least_sine(penalty: &Penalty, lines: &Lines, pair: Candidate) -> f64 {
    let (a, b) = (&lines.slots[pair.a as usize], &lines.slots[pair.b as usize]);
    let first = Lines::looks_first(lines.chain_of(pair.a), lines.chain_of(pair.b));
    look_from(penalty, a.radius + b.radius, if first { a.length } else { b.length })
}

/// Where to begin with a pair, if it may cross.
fn start(penalty: &Penalty, lines: &Lines, now: &Centrelines, pair: Candidate) -> Option<Start> {
    let (a, b) = (pair.a as usize, pair.b as usize);
    let ends = |j: usize| [xyz(&now.tangent[j]), xyz(&now.tangent[j + 1])];
    let least = least_sine(penalty, lines, pair);
    let crosses = |u: DVec3, v: DVec3, least: f64| u.cross(v).length_squared() > least * least * u.length_squared() * v.length_squared();
    let (ends_a, ends_b) = (ends(a), ends(b));
    if !ends_a.iter().any(|u| ends_b.iter().any(|v| crosses(*u, *v, least))) {
        return None;
    }
    let shift = now.shift[pair.image as usize];
    let [p, p2, q, q2] = [xyz(&now.x[a]), xyz(&now.x[a + 1]), xyz(&now.x[b]) + shift, xyz(&now.x[b + 1]) + shift];
    if crosses_elsewhere(p, p2 - p, q, q2 - q) {
        return None;
    }
    let (s, t) = closest_parameters::<f64>((p2 - p).into(), (q2 - q).into(), (p - q).into());
    let beside = beside_all_along([p2 - p, q2 - q], ends_a, ends_b, [s, t], |u, v| crosses(u, v, EARLY * least));
    (!beside).then_some(Start { pair, place: [s, t] })
}

/// Most steps towards the closest points.
const STEPS: usize = 12;

/// Parameters of the closest points of the centrelines of `L::WIDTH` pairs.
#[inline(always)]
fn closest<L: Lane>(lines: &Lines, now: &Centrelines, starts: &[Start]) -> Vec<[f64; 2]> {
    let (a, b) = (|l: usize| starts[l].pair.a as usize, |l: usize| starts[l].pair.b as usize);
    let (side_a, side_b) = (Side::<L>::load(lines, now, a), Side::<L>::load(lines, now, b));
    let (limits_a, limits_b) = (limits(lines, a), limits(lines, b));
    let apart = V3::gather(|l| xyz(&now.x[a(l)]) - xyz(&now.x[b(l)]) - now.shift[starts[l].pair.image as usize]);
    let [mut s, mut t] = [0, 1].map(|k| L::from_fn(|l| starts[l].place[k]));
    let mut on_the_way = L::splat(0.0).less(L::splat(1.0));
    for _ in 0..STEPS {
        let (s1, t1) = closest_step(&side_a.curve, &side_b.curve, apart, s, t, limits_a, limits_b);
        let step = (s1 - s).magnitude() + (t1 - t).magnitude();
        // Who has arrived stays.
        (s, t) = (L::pick(on_the_way, s1, s), L::pick(on_the_way, t1, t));
        on_the_way = on_the_way & L::splat(FOUND).less(step);
        if !L::any(on_the_way) {
            break;
        }
    }
    (0..L::WIDTH).map(|l| [s.lane(l), t.lane(l)]).collect()
}

/// The record of a pair with the closest points at `place`, if it crosses there.
fn record(penalty: &Penalty, lines: &Lines, now: &Centrelines, pair: Candidate, mut place: [f64; 2]) -> Option<PointFound> {
    if !place.iter().all(|t| (-NEARBY..=1.0 + NEARBY).contains(t)) {
        return None;
    }
    let mut record = PointRecord { segments: [pair.a, pair.b], image: pair.image };
    record.rehome(lines, &mut place);
    // Over a node the straight extension was only a guess: a few steps more on the right pair.
    let moved = record.segments != [pair.a, pair.b] || record.image != pair.image;
    let [a, b] = record.segments.map(|s| s as usize);
    let (side_a, side_b) = (Side::<f64>::load(lines, now, |_| a), Side::<f64>::load(lines, now, |_| b));
    let apart: V3<f64> = (xyz(&now.x[a]) - xyz(&now.x[b]) - now.shift[record.image as usize]).into();
    let (limits_a, limits_b) = (limits(lines, |_| a), limits(lines, |_| b));
    for _ in 0..if moved { 4 } else { 0 } {
        (place[0], place[1]) = closest_step(&side_a.curve, &side_b.curve, apart, place[0], place[1], limits_a, limits_b);
    }
    let (p, q) = (side_a.curve.at(place[0]), side_b.curve.at(place[1]));
    let normal = to_vec(apart + p.x - q.x).normalize_or_zero();
    if sine(to_vec(p.d), to_vec(q.d), normal) <= least_sine(penalty, lines, pair) {
        return None;
    }
    record.rehome(lines, &mut place);
    let (record, exchanged) = record.ordered(lines);
    if exchanged {
        place.swap(0, 1);
    }
    Some((record, PointState::at(place)))
}

/// True if the straight lines through two segments come closest so far beyond their ends that the curves
/// will not do so on the segments.
fn crosses_elsewhere(p: DVec3, u: DVec3, q: DVec3, v: DVec3) -> bool {
    let w = p - q;
    let (a, b, c, d, e) = (u.dot(u), u.dot(v), v.dot(v), u.dot(w), v.dot(w));
    let den = a * c - b * b;
    // Nearly parallel ones tell nothing.
    if den < 0.01 * a * c {
        return false;
    }
    let (s, t) = ((b * e - c * d) / den, (a * e - b * d) / den);
    !(-ELSEWHERE..=1.0 + ELSEWHERE).contains(&s) || !(-ELSEWHERE..=1.0 + ELSEWHERE).contains(&t)
}

/// True if two segments of one direction that bend little and alike nowhere cross: tangents of one that lie across an end of
/// the other say nothing, those of places that are beside each other do.
fn beside_all_along([u, v]: [DVec3; 2], a: [DVec3; 2], b: [DVec3; 2], [s, t]: [f64; 2], crosses: impl Fn(DVec3, DVec3) -> bool) -> bool {
    let sine2 = u.cross(v).length_squared() / (u.length_squared() * v.length_squared());
    if sine2 > ALONG * ALONG || [a, b].iter().any(|[from, to]| from.distance_squared(*to) > ALONG * ALONG * from.length_squared()) {
        return false;
    }
    // From the closest points, as far as either segment goes, both ways.
    let ratio = (u.length_squared() / v.length_squared()).sqrt().copysign(u.dot(v));
    let room = |t: f64, rate: f64, end: f64| ((end - t) / rate).max(0.0);
    let backward = room(s, -1.0, -NEARBY).min(room(t, -ratio, if ratio > 0.0 { -NEARBY } else { 1.0 + NEARBY }));
    let forward = room(s, 1.0, 1.0 + NEARBY).min(room(t, ratio, if ratio > 0.0 { 1.0 + NEARBY } else { -NEARBY }));
    // The difference of the tangents changes evenly: it is largest at one end.
    [-backward, forward].into_iter().all(|d| !crosses(a[0].lerp(a[1], s + d), b[0].lerp(b[1], t + ratio * d)))
}

/// Sine of the angle between directions that count as one, and change of a tangent that counts as little.
const ALONG: f64 = 0.1;
/// Share of the least angle from which tangents that change evenly may hide a crossing of curves.
const EARLY: f64 = 0.75;
/// How far beyond its segments a closest point is followed, in segments.
const NEARBY: f64 = 0.25;

/// How far the closest points of curves may be from those of their chords, in segments.
const ELSEWHERE: f64 = 1.0;
