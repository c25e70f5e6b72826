//! From pairs of close segments to records, and from old records to new ones.
use super::crossings::crossings;
use super::curve::{Range, Segment};
use super::images::Image;
use super::kernel::Penalty;
use super::lines::{Centrelines, Lines, xyz};
use super::records::*;
use super::search::Candidate;
use braid_ecs::prelude::*;
use rayon::prelude::*;

/// Sine of the angle from which a crossing is looked for, as a share of the lower end of the window.
const LOOK_FROM: f64 = 0.5;
/// Change of a parameter below which a closest point is found; the next step of the run goes on from there.
pub(super) const FOUND: f64 = 1e-6;
/// Candidates per parallel chunk.
const CHUNK: usize = 1024;

/// New records and scratch space, kept between lists.
#[derive(Default)]
pub struct Builder {
    /// Pairs of close segments.
    pub candidates: Vec<Candidate>,
    /// Line records, sorted.
    pub lines: Vec<LineFound>,
    /// Point records, sorted.
    pub points: Vec<PointFound>,
}

/// A line record, and its parameter.
pub type LineFound = (LineRecord, f64);
/// A point record, and what it remembers.
pub type PointFound = (PointRecord, PointState);

/// True if two segments can never touch: they share a node, or are neighbours along a filament.
pub fn excluded(lines: &Lines, c: Candidate) -> bool {
    let (a, b) = (c.a as usize, c.b as usize);
    let (sa, sb) = (&lines.slots[a], &lines.slots[b]);
    if c.image == lines.images.zero() {
        let [ra, rb] = [a, b].map(|j| [lines.joints[j].row, lines.joints[j + 1].row]);
        if ra.iter().any(|r| rb.contains(r)) {
            return true;
        }
    }
    if lines.chain[sa.filament as usize] != lines.chain[sb.filament as usize] {
        return false;
    }
    // A filament cannot fold onto itself within half a circumference.
    let reach = std::f64::consts::FRAC_PI_2 * (sa.radius + sb.radius);
    for side in 0..2 {
        let (mut at, mut image, mut gone) = (c.a, lines.images.zero(), 0.0);
        while let Some((to, step)) = lines.links[at as usize][side] {
            let Some(sum) = lines.images.sum(image, step) else { break };
            (at, image) = (to, sum);
            if (at, image) == (c.b, c.image) {
                return true;
            }
            gone += lines.slots[at as usize].length;
            if gone > reach || at == c.a {
                break;
            }
        }
    }
    false
}

/// Parameter at which segment `j` is beside the point `y`, if it is: the planes through its nodes
/// normal to the tangents divide the space between the segments without holes and overlaps.
fn beside(lines: &Lines, now: &Centrelines, j: u32, y: DVec3, reach_beyond: f64) -> Option<f64> {
    let (slot, free) = (&lines.slots[j as usize], lines.joints[j as usize].free);
    let j = j as usize;
    let g0 = (y - xyz(&now.x[j])).dot(xyz(&now.tangent[j]));
    let g1 = (y - xyz(&now.x[j + 1])).dot(xyz(&now.tangent[j + 1]));
    let low = if free[0] { -reach_beyond } else { 0.0 };
    let high = if free[1] { reach_beyond } else { 0.0 };
    // Neighbours overlap by a hair, so that rounding leaves no hole; who is found twice is merged.
    let hair = 1e-6 * slot.length;
    if g0 < low - hair || g1 >= high + hair {
        return None;
    }
    let span = g0 - g1;
    if span > 0.0 { Some(g0 / span) } else { Some(0.5) }
}

/// Records found among some of the candidates.
struct Found {
    lines: Vec<LineFound>,
    points: Vec<PointFound>,
}

impl Found {
    fn new(penalty: &Penalty, lines: &Lines, now: &Centrelines, candidates: &[Candidate]) -> Self {
        let mut found = Found { lines: Vec::new(), points: crossings(penalty, lines, now, candidates) };
        for c in candidates {
            let (ca, cb) = (lines.chain_of(c.a), lines.chain_of(c.b));
            let same = ca == cb;
            if same || Lines::looks_first(ca, cb) {
                found.add_lines(penalty, lines, now, *c, same);
            }
            if same || Lines::looks_first(cb, ca) {
                let turned = Candidate { a: c.b, b: c.a, image: lines.images.negative(c.image) };
                found.add_lines(penalty, lines, now, turned, same);
            }
        }
        found
    }

    /// Line records of the nodes of segment `c.a` against segment `c.b`.
    fn add_lines(&mut self, penalty: &Penalty, lines: &Lines, now: &Centrelines, c: Candidate, half: bool) {
        for node in [c.a, c.a + 1] {
            let slot = &lines.slots[node as usize];
            // The second node is the first of the next segment, which is as close; but of one filament not all pairs count.
            if !slot.looks || node > c.a && slot.segment && !half {
                continue;
            }
            let y = xyz(&now.x[node as usize]) - now.shift[c.image as usize];
            let beyond = slot.spacing.max(lines.slots[c.b as usize].radius);
            let Some(mut t) = beside(lines, now, c.b, y, beyond) else { continue };
            t = refine_line(lines, now, c.b, y, t);
            let point = curve_of(lines, now, c.b).at(t);
            let normal = (y - xyz(&now.x[c.b as usize]) - to_vec(point.x)).normalize_or_zero();
            let sine = sine(xyz(&now.tangent[node as usize]), to_vec(point.d), normal);
            let reach = slot.radius + lines.slots[c.b as usize].radius;
            let crossing = sine > look_from(penalty, reach, slot.spacing);
            let record = LineRecord { node, segment: c.b, image: c.image, half, crossing };
            self.lines.push((record, t));
        }
    }
}

impl Builder {
    /// Makes the records of `self.candidates`.
    pub fn build(&mut self, penalty: &Penalty, lines: &Lines, now: &Centrelines) {
        let parts = parallel::chunks(self.candidates.len(), CHUNK, |range| Found::new(penalty, lines, now, &self.candidates[range]));
        self.lines.clear();
        self.points.clear();
        for part in parts {
            self.lines.extend(part.lines);
            self.points.extend(part.points);
        }
        self.lines.par_sort_by_key(|(r, _)| (r.node, r.image, r.segment));
        self.merge_lines(lines);
        self.points.par_sort_by_key(|(r, _)| (r.segments, r.image));
        self.merge_points(lines);
    }

    /// Keeps one of several records of a node at the same place of a filament.
    fn merge_lines(&mut self, lines: &Lines) {
        let of_one_node = self.lines.par_chunk_by(|(a, _), (b, _)| a.node == b.node);
        let parts: Vec<_> = of_one_node
            .fold(Vec::new, |mut kept: Vec<LineFound>, group| {
                let from = kept.len();
                for (record, t) in group {
                    let place = (record.segment, *t, record.image);
                    let same = |(r, t): &LineFound| distance_along(lines, (r.segment, *t, r.image), place).is_some_and(|d| d.abs() < SAME);
                    if !kept[from..].iter().any(same) {
                        kept.push((*record, *t));
                    }
                }
                kept
            })
            .collect();
        self.lines = parts.concat();
    }

    /// Keeps one of several records of the same crossing.
    fn merge_points(&mut self, lines: &Lines) {
        let found = std::mem::take(&mut self.points);
        let index = CrossingIndex::new(found.iter().map(|(r, _)| r));
        let of = |i: usize| (&found[i].0, &found[i].1);
        let first = |k: usize| index.nearest(lines, of(k), SAME, |i| (i < k).then(|| of(i))).is_none();
        self.points = (0..found.len()).into_par_iter().filter(|k| first(*k)).map(|k| found[k]).collect();
    }

    /// What the new line records remember: of an old one at the same place, whatever the order of these, slip and offset.
    pub fn line_states(&self, lines: &Lines, old: &[LineRecord], was: &[LineState]) -> Vec<LineState> {
        let mut order: Vec<_> = (0..).zip(old).map(|(k, r)| (r.node, r.image, r.segment, k as u32)).collect();
        order.par_sort_unstable();
        let state = |from: &[(u32, Image, u32, u32)], (record, t): &LineFound| {
            let (mut state, mut nearest) = (LineState::at(*t), 0.5);
            for (_, image, segment, k) in from.iter().take_while(|(node, ..)| *node == record.node) {
                let was = &was[*k as usize];
                if let Some(d) = distance_along(lines, (*segment, was.t, *image), (record.segment, *t, record.image))
                    && d.abs() < nearest
                {
                    nearest = d.abs();
                    state = LineState { t: *t, ..*was };
                }
            }
            state
        };
        let of = |range: std::ops::Range<usize>| {
            let new = &self.lines[range];
            let mut from = order.partition_point(|(node, ..)| *node < new[0].0.node);
            let of = |new: &LineFound| {
                from += order[from..].iter().take_while(|(node, ..)| *node < new.0.node).count();
                state(&order[from..], new)
            };
            new.iter().map(of).collect::<Vec<_>>()
        };
        parallel::chunks(self.lines.len(), CHUNK, of).concat()
    }

    /// Hands slip and offset of the old point records to the new ones at the same place.
    pub fn inherit_points(&mut self, lines: &Lines, old: &[PointRecord], was: &[PointState]) {
        let index = CrossingIndex::new(old.iter());
        self.points.par_iter_mut().for_each(|(record, state)| {
            if let Some((k, turned)) = index.nearest(lines, (record, state), 0.75, |k| Some((&old[k], &was[k]))) {
                let was = &was[k];
                *state = PointState { t: state.t, slip: if turned { -was.slip } else { was.slip }, ..*was };
            }
        });
    }
}

/// Two records of one node or crossing closer than this, in segments, are the same one.
const SAME: f64 = 0.25;

/// Finds point records by either segment.
struct CrossingIndex(Vec<(u32, usize)>);

impl CrossingIndex {
    fn new<'a>(records: impl Iterator<Item = &'a PointRecord>) -> Self {
        let mut order: Vec<(u32, usize)> = records.enumerate().flat_map(|(k, r)| [(r.segments[0], k), (r.segments[1], k)]).collect();
        order.par_sort_unstable();
        CrossingIndex(order)
    }

    /// The nearest record closer than `limit`, and whether its sides are the other way round.
    fn nearest<'a>(
        &self,
        lines: &Lines,
        (record, state): (&PointRecord, &PointState),
        limit: f64,
        get: impl Fn(usize) -> Option<(&'a PointRecord, &'a PointState)>,
    ) -> Option<(usize, bool)> {
        let here = record.segments[0];
        let [next, previous] = lines.links[here as usize].map(|l| l.map(|(s, _)| s));
        let (mut best, mut nearest) = (None, limit);
        for place in [Some(here), next, previous].into_iter().flatten() {
            let begin = self.0.partition_point(|(s, _)| *s < place);
            for (_, k) in self.0[begin..].iter().take_while(|(s, _)| *s == place) {
                let Some((old, was)) = get(*k) else { continue };
                let back = PointRecord { segments: [old.segments[1], old.segments[0]], image: lines.images.negative(old.image) };
                let was_back = PointState { t: [was.t[1], was.t[0]], ..*was };
                for (old, was, turned) in [(old, was, false), (&back, &was_back, true)] {
                    let d = crossing_distance(lines, (old, was), (record, state));
                    if d < nearest {
                        (best, nearest) = (Some((*k, turned)), d);
                    }
                }
            }
        }
        best
    }
}

/// How far a crossing has moved along both filaments; infinite if it is another one.
fn crossing_distance(lines: &Lines, old: (&PointRecord, &PointState), new: (&PointRecord, &PointState)) -> f64 {
    let zero = lines.images.zero();
    let segment = |r: &PointRecord, s: &PointState, k: usize| (r.segments[k], s.t[k], zero);
    // Along the first filament, the image step found there must be taken out of the second one.
    let (from, to) = (segment(old.0, old.1, 0), segment(new.0, new.1, 0));
    let mut best = f64::INFINITY;
    let mut consider = |step: super::images::Image, d: f64| {
        let Some(image) = lines.images.sum(old.0.image, lines.images.negative(step)) else { return };
        let was = (old.0.segments[1], old.1.t[1], image);
        if let Some(e) = distance_along(lines, was, (new.0.segments[1], new.1.t[1], new.0.image)) {
            best = f64::min(best, d.abs() + e.abs());
        }
    };
    if from.0 == to.0 {
        consider(zero, to.1 - from.1);
    }
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        if let Some((next, step)) = lines.links[from.0 as usize][side]
            && next == to.0
        {
            consider(step, sign + to.1 - from.1);
        }
    }
    best
}

pub(super) fn look_from(penalty: &Penalty, reach: f64, sampling: f64) -> f64 {
    LOOK_FROM * penalty.window[0] * reach / sampling.max(penalty.point_length())
}

pub(super) fn sine(a: DVec3, b: DVec3, normal: DVec3) -> f64 {
    a.cross(b).dot(normal).abs() / (a.length_squared() * b.length_squared()).sqrt()
}

pub(super) fn to_vec(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// The centreline of segment `j` relative to its first node.
pub fn curve_of(lines: &Lines, now: &Centrelines, j: u32) -> Segment<f64> {
    let j = j as usize;
    let h = now.tangent[j][3];
    Segment::new(
        (xyz(&now.x[j + 1]) - xyz(&now.x[j])).into(),
        (xyz(&now.tangent[j]) * h).into(),
        (xyz(&now.tangent[j + 1]) * h).into(),
        Range::new(|_| lines.joints[j].free),
    )
}

/// Closest point of segment `j` to `y`, from a start nearby.
fn refine_line(lines: &Lines, now: &Centrelines, j: u32, y: DVec3, start: f64) -> f64 {
    let curve = curve_of(lines, now, j);
    let y: V3<f64> = (y - xyz(&now.x[j as usize])).into();
    let mut t = start;
    for _ in 0..6 {
        let p = curve.at(t);
        let d = y - p.x;
        let metric = p.d.dot(p.d);
        let slope = (metric - d.dot(p.dd)).max(0.25 * metric);
        let step = (d.dot(p.d) / slope).clamp(-0.5, 0.5);
        t = (t + step).clamp(-2.0, 3.0);
        if step.abs() < FOUND {
            break;
        }
    }
    t
}
