//! Contact records: one entity each, in two pools whose rows are overwritten in place.
//!
//! - A *line record* is a node against the centreline of another filament: one per node and passage
//!   of a neighbour. Side by side filaments touch through these.
//! - A *point record* is the closest point of two centrelines. Crossing filaments touch through these.
//!
//! The first rows of a pool, as many as [`LiveRecords`] says, are in use; the rest wait. A record keeps its place on both filaments as a real number, so its
//! friction history survives when it slides over a node.
use super::images::Image;
use super::lines::Lines;
use braid_ecs::prelude::*;

/// A node and the segment of another filament that it is beside.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LineRecord {
    /// Slot of the node.
    pub node: u32,
    /// Slot of the segment.
    pub segment: u32,
    /// Image by which the segment is shifted.
    pub image: Image,
    /// True if the other filament's nodes look for this one as well: both count half.
    pub half: bool,
    /// True if a crossing was looked for when the list was made, so that the angle decides.
    pub crossing: bool,
}

/// What a line record remembers.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LineState {
    /// Parameter of the closest point on the segment.
    pub t: f64,
    /// Elastic slip of the friction spring (length).
    pub slip: DVec3,
    /// Force of the damper (force).
    pub damper: f64,
    /// Penetration that is left free of force (length).
    pub offset: f64,
    /// Stiffness of the step before, zero for a record just found; negative if it did not touch (force / length).
    pub stiffness: f64,
    /// Overlap of the step before; not a number for a record just found (length).
    pub overlap: f64,
    /// By how much it had grown in that step (length).
    pub growth: f64,
}

impl LineState {
    /// Of a record just found.
    pub fn at(t: f64) -> Self {
        LineState { t, slip: DVec3::ZERO, damper: 0.0, offset: 0.0, stiffness: 0.0, overlap: f64::NAN, growth: 0.0 }
    }
}

/// Force of a record on its first body, and where it acts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Action {
    /// Force on the first body (force).
    pub force: DVec3,
    /// Normal towards the first body; of an earlier step if the force is zero.
    pub normal: DVec3,
    /// Forces along the normal on the tangents of both bodies, from friction at the surface; of an earlier step if
    /// the force is zero.
    pub turn: [f64; 2],
    /// Parameters on both bodies; of an earlier step if the force is zero.
    pub t: [f64; 2],
}

/// Force of a line record on its node.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LineForce(pub Action);

/// Two segments of which the centrelines cross.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointRecord {
    /// Slots of both segments.
    pub segments: [u32; 2],
    /// Image by which the second segment is shifted.
    pub image: Image,
}

/// What a point record remembers.
#[derive(Component, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointState {
    /// Parameters of the closest points on both segments.
    pub t: [f64; 2],
    /// Elastic slip of the friction spring (length).
    pub slip: DVec3,
    /// Force of the damper (force).
    pub damper: f64,
    /// Penetration that is left free of force (length).
    pub offset: f64,
    /// Stiffness of the step before, zero for a record just found; negative if it did not touch (force / length).
    pub stiffness: f64,
    /// Overlap of the step before; not a number for a record just found (length).
    pub overlap: f64,
    /// By how much it had grown in that step (length).
    pub growth: f64,
}

impl PointState {
    /// Of a record just found.
    pub fn at(t: [f64; 2]) -> Self {
        PointState { t, slip: DVec3::ZERO, damper: 0.0, offset: 0.0, stiffness: 0.0, overlap: f64::NAN, growth: 0.0 }
    }
}

/// Force of a point record on its first segment.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PointForce(pub Action);

/// How many rows of the pools are in use, and how many of them, at the front, are near enough to
/// touch before the next look.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LiveRecords {
    /// Line records.
    pub lines: usize,
    /// Point records.
    pub points: usize,
    /// Near line records.
    pub near_lines: usize,
    /// Near point records.
    pub near_points: usize,
}

/// How far a parameter may leave [0, 1] before the record moves to the next segment.
pub const SLACK: f64 = 0.01;

/// True if a parameter has left its segment.
#[inline(always)]
pub fn strayed(t: f64) -> bool {
    !(-SLACK..=1.0 + SLACK).contains(&t)
}

/// Moves a point that has left its segment on to the segments before or after; returns the segment,
/// the parameter and the image step. At free ends it stays.
pub fn rehome(lines: &Lines, segment: u32, t: f64) -> (u32, f64, Image) {
    let (mut segment, mut t, mut image) = (segment, t, lines.images.zero());
    for _ in 0..4 {
        let side = if t < 0.0 {
            1
        } else if t >= 1.0 {
            0
        } else {
            break;
        };
        let Some((to, step)) = lines.links[segment as usize][side] else { break };
        let Some(sum) = lines.images.sum(image, step) else { break };
        let (from, into) = (lines.slots[segment as usize].length, lines.slots[to as usize].length);
        t = if side == 0 { (t - 1.0) * from / into } else { 1.0 + t * from / into };
        (segment, image) = (to, sum);
    }
    (segment, t, image)
}

impl LineRecord {
    /// Moves the record to the segment that its parameter belongs to.
    pub fn rehome(&mut self, lines: &Lines, t: &mut f64) {
        let (segment, parameter, step) = rehome(lines, self.segment, *t);
        if let Some(image) = lines.images.sum(self.image, step) {
            (self.segment, *t, self.image) = (segment, parameter, image);
        }
    }
}

impl PointRecord {
    /// Moves the record to the segments that its parameters belong to.
    pub fn rehome(&mut self, lines: &Lines, t: &mut [f64; 2]) {
        let (second, u, step) = rehome(lines, self.segments[1], t[1]);
        if let Some(image) = lines.images.sum(self.image, step) {
            (self.segments[1], t[1], self.image) = (second, u, image);
        }
        let (first, u, step) = rehome(lines, self.segments[0], t[0]);
        if let Some(image) = lines.images.sum(self.image, lines.images.negative(step)) {
            (self.segments[0], t[0], self.image) = (first, u, image);
        }
    }

    /// The same crossing with the lower segment first, so that it has one name; tells if the sides were exchanged.
    pub fn ordered(self, lines: &Lines) -> (Self, bool) {
        let exchanged = self.segments[0] > self.segments[1] || (self.segments[0] == self.segments[1] && self.image < lines.images.zero());
        if exchanged {
            (PointRecord { segments: [self.segments[1], self.segments[0]], image: lines.images.negative(self.image) }, true)
        } else {
            (self, false)
        }
    }
}

/// Distance along a chain, in segments, from one place (segment, parameter, image) to another that
/// is on the same or a neighbouring segment; `None` farther away.
pub fn distance_along(lines: &Lines, from: (u32, f64, Image), to: (u32, f64, Image)) -> Option<f64> {
    if from.0 == to.0 && from.2 == to.2 {
        return Some(to.1 - from.1);
    }
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        if let Some((segment, step)) = lines.links[from.0 as usize][side]
            && segment == to.0
            && lines.images.sum(from.2, step) == Some(to.2)
        {
            return Some(sign + to.1 - from.1);
        }
    }
    None
}
