//! Which segments may touch before the next list: parry's bounding volume tree and a skin.
//!
//! A list is made for a stretch of time, with a forecast: every node goes on with the mean velocity
//! that it had during the last list. Boxes enclose segments on their whole way, grown by half the
//! skin; the list stays complete while no node has left its forecast by more than its room, half the
//! skin (Verlet 1967 with moving references). Neighbours move alike, so a forecast makes the list
//! hardly longer, and a braid that closes fast keeps it for tens of steps. Single nodes that whip
//! about get more room of their own: one of them does not make the list of all others anew. Whether it
//! is complete for some more steps is seen whenever all records are looked at ([`super::inner`]). Pairs across periodic faces come from a second
//! traversal of the tree against itself, shifted; the motion of the period counts like that of nodes.
//! Boxes of long thin segments meet far more often than these come near each other: [`super::near`] decides.
use super::images::Image;
use super::lines::{Centrelines, Lines, xyz};
use super::near::{ImageWay, Way, near};
use braid_ecs::prelude::*;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode, BvhWorkspace};
use rayon::prelude::*;
use std::sync::Mutex;

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
#[derive(Resource, Default, Serialize, Deserialize)]
pub struct Search {
    #[serde(skip)]
    bvh: Bvh,
    #[serde(skip)]
    workspace: BvhWorkspace,
    /// Distance beyond touching that the list covers (length).
    pub skin: f64,
    /// Times the list was made.
    pub rebuilds: u64,
    /// How far each node may leave its forecast, by slot (length).
    room: Vec<f64>,
    /// Time for which the list is made, how much of it is gone, and whether the rest was too little.
    horizon: f64,
    elapsed: f64,
    over: bool,
    /// How far the boxes look ahead: the horizon, or nothing while nothing moves.
    ahead: f64,
    /// Positions when the list was made, and the forecast of their velocities, by slot.
    reference: Vec<DVec3>,
    forecast: Vec<DVec3>,
    reference_shift: Vec<DVec3>,
    forecast_shift: Vec<DVec3>,
    /// Positions at the end of the horizon.
    #[serde(skip)]
    end: Vec<DVec3>,
    #[serde(skip)]
    bulge: Vec<f64>,
    /// Ways of the segments, by slot.
    #[serde(skip)]
    ways: Vec<Way>,
    /// Segment of each leaf: leaves are numbered without gaps.
    #[serde(skip)]
    leaves: Vec<u32>,
}

/// Lists made between two full rebuilds of the tree.
const REBUILD_TREE: u64 = 20;
/// Growth of the horizon when the forecast has held all the way through.
const STRETCH: f64 = 1.25;
/// Farthest forecast way of a node, and its largest room, in segments.
const FARTHEST: f64 = 0.25;
/// Room over what the motion during the last list would have taken in the time of the next one.
const CARE: f64 = 1.5;
/// What is kept of a room from one list to the next.
const KEPT: f64 = 0.9;
/// Share of the nodes that get more room before all nodes get a shorter time.
const WHIPS: f64 = 0.02;
/// Speed over that of the fastest node below which the others do not matter for the time.
const SLOWEST: f64 = 0.01;
/// Nodes or pairs per parallel chunk.
const CHUNK: usize = 1024;

impl Search {
    /// A search with the given skin (length).
    pub fn new(skin: f64) -> Self {
        Search { skin, horizon: f64::INFINITY, ..Search::default() }
    }

    /// Makes the next step build a new list.
    pub fn invalidate(&mut self) {
        self.reference.clear();
    }

    /// Time that is left of what the list is made for.
    pub fn remaining(&self) -> f64 {
        self.horizon - self.elapsed
    }

    /// True if the list must be made again: `elapsed` has gone by since the last call, less than `least` is left of its
    /// time, or nodes that use another `share` of their room may leave it.
    pub fn outdated(&mut self, lines: &Lines, now: &Centrelines, elapsed: f64, least: f64, share: f64) -> bool {
        if self.reference.len() != lines.slots.len() {
            return true;
        }
        self.elapsed += elapsed;
        self.over = self.elapsed > 0.0 && self.remaining() < least;
        if self.over {
            return true;
        }
        let way = |i: usize| (xyz(&now.x[i]) - self.reference[i] - self.forecast[i] * self.elapsed).length_squared();
        let used = parallel::largest(self.room.len(), CHUNK, |i| way(i) / (self.room[i] * self.room[i])).sqrt();
        // NaN ends up here, too.
        let left = 1.0 - share - used - self.period_left(&now.shift, &self.reference_shift, self.elapsed);
        left.is_nan() || left <= 0.0
    }

    /// How far nodes have left their forecast in `elapsed`, at most, in units of their room; `way` tells
    /// how far each has moved, in the order of [`Lines::rows`].
    pub fn farthest(&self, lines: &Lines, elapsed: f64, way: impl Fn(usize) -> DVec3 + Sync) -> f64 {
        if self.room.len() != lines.slots.len() {
            return f64::INFINITY;
        }
        let of = |k: usize| {
            let i = lines.row_slots[k] as usize;
            (way(k) - self.forecast[i] * elapsed).length_squared() / (self.room[i] * self.room[i])
        };
        parallel::largest(lines.row_slots.len(), CHUNK, of).sqrt()
    }

    /// How far the periods have left their forecast, in units of the least room.
    pub fn period_left(&self, shift: &[DVec3], reference: &[DVec3], elapsed: f64) -> f64 {
        farthest(shift, reference, |i| self.forecast_shift[i] * elapsed) / self.skin
    }

    /// How much closer two bodies can come in `time`, if each node uses `share` of its room.
    pub fn approach(&self, a: &[usize], b: &[usize], image: Image, time: f64, share: f64) -> f64 {
        let (mut fastest, mut room) = (0.0f64, 0.0f64);
        for &i in a {
            for &j in b {
                fastest = fastest.max((self.forecast[i] - self.forecast[j] - self.forecast_shift[image as usize]).length());
                // The period takes its share like a node.
                room = room.max(self.room[i] + self.room[j] + 0.5 * self.skin);
            }
        }
        let time = if time.is_finite() { time } else { 0.0 };
        fastest * time + share * room
    }

    /// All pairs of segments closer than the skin, sorted; `excluded` says which may never touch.
    pub fn candidates(&mut self, lines: &Lines, now: &Centrelines, excluded: impl Fn(Candidate) -> bool + Sync, out: &mut Vec<Candidate>) {
        let fresh = self.leaves.is_empty() || self.rebuilds.is_multiple_of(REBUILD_TREE);
        if fresh {
            self.leaves.clear();
            self.leaves.extend(lines.segments());
        }
        self.make_forecast(lines, now);
        self.measure_bulges(lines, now);
        self.make_ways(lines, now);
        if fresh {
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

        let half = |image: usize| self.forecast_shift[image] * (0.5 * self.ahead);
        let images: Vec<ImageWay> = (0..now.shift.len()).map(|i| ImageWay { shift: now.shift[i] + half(i), motion: half(i) }).collect();
        let mut workspace = std::mem::take(&mut self.workspace);
        out.clear();
        let found = Mutex::new(std::mem::take(out));
        let look = |pairs: &[Candidate]| {
            let mut close = near(&self.ways, &images, pairs);
            close.retain(|c| !excluded(*c));
            found.lock().unwrap_or_else(|e| e.into_inner()).extend(close);
        };
        // While this thread walks the tree, others walk it for the images and look at the pairs that were found.
        rayon::scope(|scope| {
            let (look, this) = (&look, &*self);
            for image in lines.images.half() {
                scope.spawn(move |_| this.image_pairs(now, image).chunks(CHUNK).for_each(look));
            }
            let zero = lines.images.zero();
            let mut pairs = Vec::with_capacity(CHUNK);
            self.bvh.traverse_bvtt_single_tree::<false>(&mut workspace, &mut |a, b| {
                let (a, b) = (self.leaves[a as usize], self.leaves[b as usize]);
                pairs.push(Candidate { a: a.min(b), b: a.max(b), image: zero });
                if pairs.len() == CHUNK {
                    let full = std::mem::replace(&mut pairs, Vec::with_capacity(CHUNK));
                    scope.spawn(move |_| look(&full));
                }
            });
            look(&pairs);
        });
        self.workspace = workspace;
        *out = found.into_inner().unwrap_or_else(|e| e.into_inner());
        // In whatever order they were found.
        out.par_sort_unstable();
    }

    /// Pairs of segments whose boxes meet when the second one is shifted by an image.
    fn image_pairs(&self, now: &Centrelines, image: usize) -> Vec<Candidate> {
        if self.bvh.is_empty() {
            return Vec::new();
        }
        let root = self.bvh.root_aabb();
        let (from, to) = (now.shift[image], now.shift[image] + self.forecast_shift[image] * self.ahead);
        let (low, high) = (from.min(to), from.max(to));
        if (0..3).any(|k| root.maxs[k] < root.mins[k] + low[k] || root.maxs[k] + high[k] < root.mins[k]) {
            return Vec::new();
        }
        let overlap = |a: &BvhNode, b: &BvhNode| {
            let (am, ax, bm, bx) = (a.mins(), a.maxs(), b.mins() + low, b.maxs() + high);
            am.cmple(bx).all() && bm.cmple(ax).all()
        };
        let segments = |(a, b): (u32, u32)| Candidate { a: self.leaves[a as usize], b: self.leaves[b as usize], image: image as Image };
        self.bvh.leaf_pairs(&self.bvh, overlap).map(segments).collect()
    }

    /// Forecasts the motion until the next list, and limits the time that it is meant for.
    fn make_forecast(&mut self, lines: &Lines, now: &Centrelines) {
        let count = now.x.len();
        if self.reference.len() == count && self.elapsed > 0.0 {
            self.learn(lines, now);
        } else {
            self.forecast = now.v.iter().map(xyz).collect();
            self.forecast_shift.clone_from(&now.shift_rate);
            self.room = vec![0.5 * self.skin; count];
        }
        // The ghosts of free ends are nowhere.
        for (room, slot) in self.room.iter_mut().zip(&lines.slots) {
            if slot.spacing == 0.0 {
                *room = f64::INFINITY;
            }
        }
        self.reference.clear();
        self.reference.extend(now.x.iter().map(xyz));
        self.reference_shift.clone_from(&now.shift);
        self.elapsed = 0.0;

        // Nodes must not pass many segments of their neighbours while the list lasts. Single ones that whip about
        // do not shorten the time of the others: they are taken to stay with them, and get room for it.
        let moving: Vec<usize> = (0..now.x.len()).filter(|&i| lines.slots[i].spacing > 0.0).collect();
        let drift = moving.iter().map(|i| self.forecast[*i]).sum::<DVec3>() / moving.len().max(1) as f64;
        let speed: Vec<f64> = moving.iter().map(|i| (self.forecast[*i] - drift).length()).collect();
        let fastest = speed.iter().copied().fold(0.0, f64::max);
        let usual = all_but_few(speed.clone()).max(SLOWEST * fastest);
        let farthest = FARTHEST * lines.mean_length;
        self.horizon = self.horizon.min(farthest / usual);
        for (i, speed) in moving.into_iter().zip(speed).filter(|(_, speed)| speed * self.horizon > farthest) {
            self.forecast[i] = drift;
            self.room[i] = self.room[i].max((CARE * speed * self.horizon).min(farthest));
        }
        if !(self.horizon.is_finite() && fastest > 0.0) {
            // Nothing moves yet.
            self.horizon = f64::INFINITY;
            self.forecast.fill(DVec3::ZERO);
            self.forecast_shift.fill(DVec3::ZERO);
        }
        self.ahead = if self.horizon.is_finite() { self.horizon } else { 0.0 };
        self.end.clear();
        self.end.extend(self.reference.iter().zip(&self.forecast).map(|(x, v)| *x + *v * self.ahead));
    }

    /// Room, forecast and time from what happened since the last list.
    fn learn(&mut self, lines: &Lines, now: &Centrelines) {
        let (least, time) = (0.5 * self.skin, self.elapsed);
        let most = least.max(FARTHEST * lines.mean_length);
        let missed = |i: usize| (xyz(&now.x[i]) - self.reference[i]) / time - self.forecast[i];
        let rate: Vec<f64> = (0..now.x.len()).map(|i| if lines.slots[i].spacing > 0.0 { missed(i).length() } else { 0.0 }).collect();
        if self.over {
            self.horizon = STRETCH * self.horizon.max(time);
        } else {
            // It came too early: the time in which all but a few stay in the least room, and those in the most.
            let usual = all_but_few(rate.clone());
            let largest = rate.iter().copied().fold(0.0, f64::max);
            self.horizon = (least / (CARE * usual)).min(most / (CARE * largest)).max(time).min(self.horizon);
        }
        for (room, rate) in self.room.iter_mut().zip(&rate) {
            let wanted = CARE * rate * self.horizon;
            *room = if wanted.is_finite() { wanted.max(KEPT * room.min(most)).clamp(least, most) } else { least };
        }
        // A short time says little about the mean velocity.
        let trust = if self.horizon.is_finite() { (time / self.horizon).min(1.0) } else { 1.0 };
        for i in 0..rate.len() {
            let mean = (xyz(&now.x[i]) - self.reference[i]) / time;
            self.forecast[i] = self.forecast[i].lerp(mean, trust);
        }
        for i in 0..now.shift.len() {
            let mean = (now.shift[i] - self.reference_shift[i]) / time;
            self.forecast_shift[i] = self.forecast_shift[i].lerp(mean, trust);
        }
    }

    /// How far each centreline leaves its chord on the way: at most 4/27 of what the tangents differ from it.
    fn measure_bulges(&mut self, lines: &Lines, now: &Centrelines) {
        self.bulge.resize(lines.slots.len(), 0.0);
        let tangent = |x: &[DVec3], i: usize| {
            let s = &lines.stencils[i];
            let o = (i as isize + s.first) as usize;
            x[o] * s.tangent[0] + x[o + 1] * s.tangent[1] + x[o + 2] * s.tangent[2]
        };
        let Search { bulge, leaves, reference, end, .. } = self;
        parallel::picked1(bulge, leaves, CHUNK, |_, j, bulge| {
            let h = now.tangent[j][3];
            let bend = |x: &[DVec3]| {
                let chord = (x[j + 1] - x[j]) / h;
                (tangent(x, j) - chord).length() + (tangent(x, j + 1) - chord).length()
            };
            *bulge = 4.0 / 27.0 * h * bend(reference).max(bend(end));
        });
    }

    fn enclose(&self, now: &Centrelines, j: u32) -> Aabb {
        let j = j as usize;
        let (x, y) = (&self.reference, &self.end);
        let margin = DVec3::splat(now.x[j][3].max(now.x[j + 1][3]) + self.room_of(j) + self.bulge[j]);
        let low = x[j].min(x[j + 1]).min(y[j]).min(y[j + 1]);
        let high = x[j].max(x[j + 1]).max(y[j]).max(y[j + 1]);
        Aabb::new(low - margin, high + margin)
    }

    /// How far the nodes of a segment may leave their forecasts.
    fn room_of(&self, j: usize) -> f64 {
        self.room[j].max(self.room[j + 1])
    }

    fn make_ways(&mut self, lines: &Lines, now: &Centrelines) {
        self.ways.resize(lines.slots.len(), Way::default());
        let mut ways = std::mem::take(&mut self.ways);
        parallel::picked1(&mut ways, &self.leaves, CHUNK, |_, j, way| {
            let motion = [j, j + 1].map(|i| self.forecast[i] * (0.5 * self.ahead));
            let around = now.x[j][3] + self.room_of(j) + self.bulge[j];
            *way = Way::new([self.reference[j], self.reference[j + 1]], motion, around);
        });
        self.ways = ways;
    }
}

/// The largest but for the few that may whip about.
fn all_but_few(mut values: Vec<f64>) -> f64 {
    let few = (WHIPS * values.len() as f64) as usize;
    match values.len().checked_sub(1 + few) {
        Some(k) => *values.select_nth_unstable_by(k, f64::total_cmp).1,
        None => 0.0,
    }
}

/// Largest distance between two sets of vectors, the second one moved on.
fn farthest(a: &[DVec3], b: &[DVec3], moved: impl Fn(usize) -> DVec3) -> f64 {
    a.iter().zip(b).enumerate().fold(0.0f64, |m, (i, (a, b))| m.max((*a - *b - moved(i)).length_squared())).sqrt()
}
