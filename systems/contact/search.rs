//! Which segments may touch before the next list: parry's bounding volume tree and a skin.
//!
//! Every segment's box grows by half the skin; the list stays complete while no node has moved
//! farther than half the skin relative to all the others (Verlet 1967), whatever all of them do
//! together. A budget is paid with the largest speed of each step, and when it is used up the true
//! displacement decides. Pairs across periodic faces come from a second traversal of the tree
//! against itself, shifted; the motion of the period counts like the motion of nodes.
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
    reference: Vec<DVec3>,
    reference_shift: Vec<DVec3>,
    drift: DVec3,
    bulge: Vec<f64>,
    /// Segment of each leaf: leaves are numbered without gaps.
    leaves: Vec<u32>,
}

/// Lists made between two full rebuilds of the tree.
const REBUILD_TREE: u64 = 20;

impl Search {
    /// A search with the given skin (length).
    pub fn new(skin: f64) -> Self {
        Search { skin, budget: -1.0, ..Search::default() }
    }

    /// Makes the next step build a new list.
    pub fn invalidate(&mut self) {
        self.budget = f64::NEG_INFINITY;
        self.reference.clear();
    }

    /// Pays for the motion of one step; true if the list must be made again.
    pub fn outdated(&mut self, lines: &Lines, now: &Centrelines, dt: f64) -> bool {
        if self.reference.len() != lines.slots.len() {
            return true;
        }
        let mut fastest = 0.0f64;
        for (slot, v) in lines.slots.iter().zip(&now.v) {
            if slot.spacing > 0.0 {
                fastest = fastest.max((xyz(v) - self.drift).length_squared());
            }
        }
        let period = now.shift_rate.iter().fold(0.0f64, |m, v| m.max(v.length_squared()));
        self.budget -= dt * (fastest.sqrt() + 0.5 * period.sqrt());
        if self.budget > 0.0 {
            return false;
        }
        self.looks += 1;
        let (mut mean, mut mean_v, mut count) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for ((slot, reference), (x, v)) in lines.slots.iter().zip(&self.reference).zip(now.x.iter().zip(&now.v)) {
            if slot.spacing > 0.0 {
                mean += xyz(x) - *reference;
                mean_v += xyz(v);
                count += 1.0;
            }
        }
        mean /= count;
        self.drift = mean_v / count;
        let mut farthest = 0.0f64;
        for ((slot, reference), x) in lines.slots.iter().zip(&self.reference).zip(&now.x) {
            if slot.spacing > 0.0 {
                farthest = farthest.max((xyz(x) - *reference - mean).length_squared());
            }
        }
        let period = now.shift.iter().zip(&self.reference_shift).fold(0.0f64, |m, (a, b)| m.max((*a - *b).length_squared()));
        let used = farthest.sqrt() + 0.5 * period.sqrt();
        self.budget = 0.5 * self.skin - used;
        // A list that would be due again in the next step is made now. NaN ends up here, too.
        self.budget.is_nan() || self.budget <= 0.02 * self.skin
    }

    /// All pairs of segments closer than the skin, sorted; `excluded` says which may never touch.
    pub fn candidates(&mut self, lines: &Lines, now: &Centrelines, excluded: impl Fn(Candidate) -> bool, out: &mut Vec<Candidate>) {
        out.clear();
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
                let t = now.shift[image];
                if (0..3).any(|k| root.maxs[k] < root.mins[k] + t[k] || root.maxs[k] + t[k] < root.mins[k]) {
                    continue;
                }
                let overlap = |a: &parry3d_f64::partitioning::BvhNode, b: &parry3d_f64::partitioning::BvhNode| {
                    let (am, ax, bm, bx) = (a.mins(), a.maxs(), b.mins() + t, b.maxs() + t);
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
        self.keep_reference(lines, now);
    }

    fn keep_reference(&mut self, lines: &Lines, now: &Centrelines) {
        self.reference.clear();
        self.reference.extend(now.x.iter().map(xyz));
        self.reference_shift.clone_from(&now.shift);
        self.budget = 0.5 * self.skin;
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        for (slot, v) in lines.slots.iter().zip(&now.v) {
            if slot.spacing > 0.0 {
                sum += xyz(v);
                count += 1.0;
            }
        }
        self.drift = sum / count;
    }

    /// How far each centreline leaves its chord: at most 4/27 of what the tangents differ from it.
    fn measure_bulges(&mut self, lines: &Lines, now: &Centrelines) {
        self.bulge.resize(lines.slots.len(), 0.0);
        for j in lines.segments() {
            let j = j as usize;
            let h = now.tangent[j][3];
            let chord = (xyz(&now.x[j + 1]) - xyz(&now.x[j])) / h;
            let bend = (xyz(&now.tangent[j]) - chord).length() + (xyz(&now.tangent[j + 1]) - chord).length();
            self.bulge[j] = 4.0 / 27.0 * h * bend;
        }
    }

    fn enclose(&self, now: &Centrelines, j: u32) -> Aabb {
        let j = j as usize;
        let (a, b) = (xyz(&now.x[j]), xyz(&now.x[j + 1]));
        let margin = DVec3::splat(now.x[j][3].max(now.x[j + 1][3]) + 0.5 * self.skin + self.bulge[j]);
        Aabb::new(a.min(b) - margin, a.max(b) + margin)
    }

    fn close(&self, now: &Centrelines, c: Candidate) -> bool {
        let (a, b, shift) = (c.a as usize, c.b as usize, now.shift[c.image as usize]);
        let reach = now.x[a][3] + now.x[b][3] + self.skin + self.bulge[a] + self.bulge[b];
        let d = segment_distance_squared(xyz(&now.x[a]), xyz(&now.x[a + 1]), xyz(&now.x[b]) + shift, xyz(&now.x[b + 1]) + shift);
        d < reach * reach
    }
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
