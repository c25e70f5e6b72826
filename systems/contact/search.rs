//! Which segments may touch before the next list: parry's bounding volume tree and a skin.
//!
//! A list is made for a stretch of time, with a forecast: every node goes on with the mean velocity
//! that it had during the last list. Boxes enclose segments on their whole way, grown by half the
//! skin; the list stays complete while no node has left its forecast by more than half the skin
//! (Verlet 1967 with moving references). Neighbours move alike, so a forecast makes the list hardly
//! longer, and a braid that closes fast keeps it for tens of steps. A budget is paid with the
//! largest speed against the forecast in each step, and when it is used up the true distance
//! decides. Pairs across periodic faces come from a second traversal of the tree against itself,
//! shifted; the motion of the period counts like the motion of nodes.
//!
//! The distance of two segments is computed here with relative tolerances: the routine of parry
//! compares with absolute ones and fails for lengths given in metres.
use super::images::Image;
use super::lines::{Centrelines, Lines, xyz};
use bevy_ecs::prelude::*;
use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};

/// Two segments closer than the skin; the second one is shifted by the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Candidate {
    /// First segment.
    pub a: u32,
    /// Second segment.
    pub b: u32,
    /// Image by which the second segment is shifted.
    pub image: Image,
}

/// The tree, and how much of the skin is left.
#[derive(Resource, Default)]
pub struct Search {
    bvh: Bvh,
    workspace: BvhWorkspace,
    /// Distance beyond touching that the list covers (length).
    pub skin: f64,
    /// Times the list was made.
    pub rebuilds: u64,
    /// Times the true displacement was looked at.
    pub looks: u64,
    budget: f64,
    /// Time for which the list is made, and how much of it is over.
    horizon: f64,
    elapsed: f64,
    /// How far the boxes look ahead: the horizon, or nothing while nothing moves.
    ahead: f64,
    /// Positions when the list was made, and the forecast of their velocities, by slot.
    reference: Vec<DVec3>,
    forecast: Vec<DVec3>,
    reference_shift: Vec<DVec3>,
    forecast_shift: Vec<DVec3>,
    /// Positions half way through the horizon and at its end.
    middle: Vec<DVec3>,
    end: Vec<DVec3>,
    bulge: Vec<f64>,
    /// Segment of each leaf: leaves are numbered without gaps.
    leaves: Vec<u32>,
}

/// Lists made between two full rebuilds of the tree.
const REBUILD_TREE: u64 = 20;
/// Growth of the horizon when the forecast has held all the way through.
const STRETCH: f64 = 1.25;
/// Farthest forecast way of a node, in segments.
const FARTHEST: f64 = 0.25;

impl Search {
    /// A search with the given skin (length).
    pub fn new(skin: f64) -> Self {
        Search { skin, horizon: f64::INFINITY, ..Search::default() }
    }

    /// Makes the next step build a new list.
    pub fn invalidate(&mut self) {
        self.reference.clear();
    }

    /// Pays for the motion of one step; true if the list must be made again.
    pub fn outdated(&mut self, lines: &Lines, now: &Centrelines, dt: f64) -> bool {
        if self.reference.len() != lines.slots.len() {
            return true;
        }
        self.elapsed += dt;
        if self.elapsed > self.horizon {
            self.horizon = STRETCH * self.elapsed;
            return true;
        }
        let mut fastest = 0.0f64;
        for ((slot, v), forecast) in lines.slots.iter().zip(&now.v).zip(&self.forecast) {
            if slot.spacing > 0.0 {
                fastest = fastest.max((xyz(v) - *forecast).length_squared());
            }
        }
        self.budget -= dt * (fastest.sqrt() + 0.5 * farthest(&now.shift_rate, &self.forecast_shift, |_| DVec3::ZERO));
        if self.budget > 0.0 {
            return false;
        }
        self.looks += 1;
        let mut worst = 0.0f64;
        for (i, (slot, x)) in lines.slots.iter().zip(&now.x).enumerate() {
            if slot.spacing > 0.0 {
                worst = worst.max((xyz(x) - self.reference[i] - self.forecast[i] * self.elapsed).length_squared());
            }
        }
        let period = farthest(&now.shift, &self.reference_shift, |i| self.forecast_shift[i] * self.elapsed);
        self.budget = 0.5 * self.skin - worst.sqrt() - 0.5 * period;
        // A list that would be due again in the next step is made now. NaN ends up here, too.
        if self.budget.is_nan() || self.budget <= 0.02 * self.skin {
            self.horizon = self.elapsed;
            return true;
        }
        false
    }

    /// All pairs of segments closer than the skin, sorted; `excluded` says which may never touch.
    pub fn candidates(&mut self, lines: &Lines, now: &Centrelines, excluded: impl Fn(Candidate) -> bool, out: &mut Vec<Candidate>) {
        out.clear();
        self.make_forecast(lines, now);
        self.measure_bulges(lines, now);
        let fresh = self.rebuilds.is_multiple_of(REBUILD_TREE);
        if fresh {
            self.leaves.clear();
            self.leaves.extend(lines.segments());
            let boxes = self.leaves.iter().enumerate().map(|(leaf, j)| (leaf, self.enclose(now, *j)));
            self.bvh = Bvh::from_iter(BvhBuildStrategy::Binned, boxes);
        } else {
            for leaf in 0..self.leaves.len() {
                let aabb = self.enclose(now, self.leaves[leaf]);
                self.bvh.insert_or_update_partially(aabb, leaf as u32, 0.0);
            }
            self.bvh.refit(&mut self.workspace);
        }
        self.rebuilds += 1;

        let zero = lines.images.zero();
        let mut workspace = std::mem::take(&mut self.workspace);
        self.bvh.traverse_bvtt_single_tree::<false>(&mut workspace, &mut |a, b| {
            let (a, b) = (self.leaves[a as usize], self.leaves[b as usize]);
            let c = Candidate { a: a.min(b), b: a.max(b), image: zero };
            if self.close(now, c) && !excluded(c) {
                out.push(c);
            }
        });
        self.workspace = workspace;
        if !self.bvh.is_empty() {
            let root = self.bvh.root_aabb();
            for image in lines.images.half() {
                let (from, to) = (now.shift[image], now.shift[image] + self.forecast_shift[image] * self.ahead);
                let (low, high) = (from.min(to), from.max(to));
                if (0..3).any(|k| root.maxs[k] < root.mins[k] + low[k] || root.maxs[k] + high[k] < root.mins[k]) {
                    continue;
                }
                let overlap = |a: &parry3d_f64::partitioning::BvhNode, b: &parry3d_f64::partitioning::BvhNode| {
                    let (am, ax, bm, bx) = (a.mins(), a.maxs(), b.mins() + low, b.maxs() + high);
                    am.cmple(bx).all() && bm.cmple(ax).all()
                };
                for (a, b) in self.bvh.leaf_pairs(&self.bvh, overlap) {
                    let (a, b) = (self.leaves[a as usize], self.leaves[b as usize]);
                    let c = Candidate { a, b, image: image as Image };
                    if self.close(now, c) && !excluded(c) {
                        out.push(c);
                    }
                }
            }
        }
        out.sort_unstable();
    }

    /// Forecasts the motion until the next list, and limits the time that it is meant for.
    fn make_forecast(&mut self, lines: &Lines, now: &Centrelines) {
        let known = self.reference.len() == now.x.len() && self.elapsed > 0.0;
        let mean = |now: DVec3, then: &[DVec3], i: usize, rate: DVec3| if known { (now - then[i]) / self.elapsed } else { rate };
        self.forecast = (0..now.x.len()).map(|i| mean(xyz(&now.x[i]), &self.reference, i, xyz(&now.v[i]))).collect();
        self.forecast_shift = (0..now.shift.len()).map(|i| mean(now.shift[i], &self.reference_shift, i, now.shift_rate[i])).collect();
        self.reference.clear();
        self.reference.extend(now.x.iter().map(xyz));
        self.reference_shift.clone_from(&now.shift);
        self.budget = 0.5 * self.skin;
        self.elapsed = 0.0;

        // Nodes must not pass many segments of their neighbours while the list lasts.
        let moving = || (0..now.x.len()).filter(|&i| lines.slots[i].spacing > 0.0);
        let drift = moving().map(|i| self.forecast[i]).sum::<DVec3>() / moving().count().max(1) as f64;
        let fastest = moving().map(|i| (self.forecast[i] - drift).length_squared()).fold(0.0, f64::max).sqrt();
        self.horizon = self.horizon.min(FARTHEST * lines.mean_length / fastest);
        if !(self.horizon.is_finite() && fastest > 0.0) {
            // Nothing moves yet.
            self.horizon = f64::INFINITY;
            self.forecast.fill(DVec3::ZERO);
            self.forecast_shift.fill(DVec3::ZERO);
        }
        self.ahead = if self.horizon.is_finite() { self.horizon } else { 0.0 };
        self.middle.clear();
        self.middle.extend(self.reference.iter().zip(&self.forecast).map(|(x, v)| *x + *v * (0.5 * self.ahead)));
        self.end.clear();
        self.end.extend(self.reference.iter().zip(&self.forecast).map(|(x, v)| *x + *v * self.ahead));
    }

    /// How far each centreline leaves its chord on the way: at most 4/27 of what the tangents differ from it.
    fn measure_bulges(&mut self, lines: &Lines, now: &Centrelines) {
        self.bulge.resize(lines.slots.len(), 0.0);
        let tangent = |x: &[DVec3], i: usize| {
            let s = &lines.slots[i];
            let o = (i as isize + s.first) as usize;
            x[o] * s.tangent[0] + x[o + 1] * s.tangent[1] + x[o + 2] * s.tangent[2]
        };
        for j in lines.segments() {
            let j = j as usize;
            let h = now.tangent[j][3];
            let bend = |x: &[DVec3]| {
                let chord = (x[j + 1] - x[j]) / h;
                (tangent(x, j) - chord).length() + (tangent(x, j + 1) - chord).length()
            };
            self.bulge[j] = 4.0 / 27.0 * h * bend(&self.reference).max(bend(&self.end));
        }
    }

    fn enclose(&self, now: &Centrelines, j: u32) -> Aabb {
        let j = j as usize;
        let (x, y) = (&self.reference, &self.end);
        let margin = DVec3::splat(now.x[j][3].max(now.x[j + 1][3]) + 0.5 * self.skin + self.bulge[j]);
        let low = x[j].min(x[j + 1]).min(y[j]).min(y[j + 1]);
        let high = x[j].max(x[j + 1]).max(y[j]).max(y[j + 1]);
        Aabb::new(low - margin, high + margin)
    }

    /// True if two segments come closer than the skin on their forecast ways: half way through, no
    /// farther apart than that plus half of what they move against each other.
    fn close(&self, now: &Centrelines, c: Candidate) -> bool {
        let (a, b, image) = (c.a as usize, c.b as usize, c.image as usize);
        let (x, y) = (&self.middle, |i: usize| self.middle[i] - self.reference[i]);
        let (mut shift, mut approach) = (now.shift[image], 0.0f64);
        if self.ahead > 0.0 {
            let half = self.forecast_shift[image] * (0.5 * self.ahead);
            shift += half;
            for (i, j) in [(a, b), (a, b + 1), (a + 1, b), (a + 1, b + 1)] {
                approach = approach.max((y(i) - y(j) - half).length_squared());
            }
        }
        let reach = now.x[a][3] + now.x[b][3] + self.skin + self.bulge[a] + self.bulge[b] + approach.sqrt();
        segment_distance_squared(x[a], x[a + 1], x[b] + shift, x[b + 1] + shift) < reach * reach
    }
}

/// Largest distance between two sets of vectors, the second one moved on.
fn farthest(a: &[DVec3], b: &[DVec3], moved: impl Fn(usize) -> DVec3) -> f64 {
    a.iter().zip(b).enumerate().fold(0.0f64, |m, (i, (a, b))| m.max((*a - *b - moved(i)).length_squared())).sqrt()
}

/// Parameters of the closest points of two segments.
pub fn closest_parameters(p: DVec3, p2: DVec3, q: DVec3, q2: DVec3) -> (f64, f64) {
    let (u, v, w) = (p2 - p, q2 - q, p - q);
    let (a, b, e, c, f) = (u.dot(u), u.dot(v), v.dot(v), u.dot(w), v.dot(w));
    let den = a * e - b * b;
    let mut s = if den > 1e-12 * a * e { ((b * f - c * e) / den).clamp(0.0, 1.0) } else { 0.0 };
    let mut t = if e > 0.0 { (b * s + f) / e } else { 0.0 };
    if t < 0.0 {
        t = 0.0;
        s = if a > 0.0 { (-c / a).clamp(0.0, 1.0) } else { 0.0 };
    } else if t > 1.0 {
        t = 1.0;
        s = if a > 0.0 { ((b - c) / a).clamp(0.0, 1.0) } else { 0.0 };
    }
    (s, t)
}

/// Squared distance of two segments (Ericson 2005, section 5.1.9, with relative tolerances).
pub fn segment_distance_squared(p: DVec3, p2: DVec3, q: DVec3, q2: DVec3) -> f64 {
    let (s, t) = closest_parameters(p, p2, q, q2);
    (p + (p2 - p) * s - q - (q2 - q) * t).length_squared()
}
