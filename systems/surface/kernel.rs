//! Forces of surfaces on nodes and on segments over edges.
//!
//! Nodes stand for their share of length, as between filaments. Where a filament runs over an edge
//! that turns within less than a few segments, the nodes may miss it: there the point of the
//! centreline nearest to the edge touches it, too. The two do not exchange weight: the edge is a part of the
//! body, whatever the nodes beside it do, and a weight that changes with the place would make
//! energy out of nothing.
use super::records::*;
use super::section::Edge;
use super::shape::Shape;
use crate::systems::contact::law::{Law, Memory, Response, Touch, Zero, respond};
use crate::systems::contact::lines::{Centrelines, Lines, xyz};
use crate::systems::contact::{curve, list};
use braid_ecs::prelude::*;
use glam::DVec2;

/// A surface and its numbers.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name for probes and messages.
    pub name: String,
    /// Shape.
    pub shape: Shape,
    /// The law.
    pub law: Law,
    /// Normal stiffness per length (force / length^2).
    pub line_stiffness: f64,
    /// Normal stiffness over an edge (force / length).
    pub point_stiffness: f64,
    /// Factor on the offsets in this step.
    pub keep: f64,
    /// True if it holds filaments without penalty.
    pub kinematic: bool,
}

/// Everything about a record at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Touching {
    /// What the law gave.
    pub response: Response<f64>,
    /// Parameter on the segment (edges).
    pub t: f64,
    /// Penetration less the offset (length).
    pub penetration: f64,
    /// Offset of the penetration (length).
    pub offset: f64,
    /// Outward normal.
    pub normal: DVec3,
    /// Stiffness with weights (force / length).
    pub stiffness: f64,
    /// Velocity of that place (length / time).
    pub velocity: DVec3,
    /// Place on the centreline.
    pub place: DVec3,
}

/// Angle window between filament and edge, in diameters per segment: as between filaments.
const WINDOW: [f64; 2] = [0.10, 0.25];
/// Weight of the edge for a filament of radius `r` of which the tangent has the share `flat_share` in
/// the figure's plane, with sampling length `length`: none along the edge, and none where the
/// nodes see the rounding well.
fn edge_weight(edge: &Edge, flat_share: f64, r: f64, length: f64) -> f64 {
    let unit = 2.0 * r / length;
    let across = ((flat_share - WINDOW[0] * unit) / ((WINDOW[1] - WINDOW[0]) * unit)).clamp(0.0, 1.0);
    let arc = (r + edge.radius) * edge.turn;
    across * ((3.0 * length - arc) / (2.0 * length)).clamp(0.0, 1.0)
}

/// Share of a tangent that lies in the figure's plane: the sine of the angle with the axis.
fn flat_share(shape: &Shape, tangent: DVec3) -> f64 {
    let l = tangent.length();
    if l > 0.0 { shape.flat_direction(tangent).length() / l } else { 0.0 }
}

fn v3(v: DVec3) -> V3<f64> {
    v.into()
}

/// Force on a node.
pub fn node_contact(surface: &Surface, lines: &Lines, now: &Centrelines, record: &SurfaceRecord, state: &SurfaceState) -> Touching {
    let i = record.node as usize;
    let slot = &lines.slots[i];
    let (x, v) = (xyz(&now.x[i]), xyz(&now.v[i]));
    let (distance, normal) = surface.shape.distance(x);
    let overlap = slot.radius - distance;
    let offset = (state.offset * surface.keep).min(overlap.max(0.0));
    let stiffness = surface.line_stiffness * (slot.half[0] + slot.half[1]);
    let touch = Touch {
        stiffness,
        penetration: overlap - offset,
        reach: 2.0 * slot.radius,
        normal: v3(normal),
        velocity: v3(v),
        mass: now.v[i][3],
    };
    let response = respond(&surface.law, &touch, &Memory { slip: v3(state.slip), damper: state.damper });
    Touching { response, t: 0.0, penetration: touch.penetration, offset, normal, stiffness, velocity: v, place: x }
}

/// One Newton step towards the point of a segment nearest to an edge.
pub fn edge_step(lines: &Lines, now: &Centrelines, shape: &Shape, centre: DVec2, segment: u32, t: f64) -> f64 {
    let c = list::curve_of(lines, now, segment).at(t);
    let d = shape.flat(xyz(&now.x[segment as usize]) + c.x.lane(0)) - centre;
    let (d1, d2) = (shape.flat_direction(c.d.lane(0)), shape.flat_direction(c.dd.lane(0)));
    let metric = d1.length_squared();
    if metric <= 1e-12 * c.d.dot(c.d) {
        return t;
    }
    let slope = (metric + d.dot(d2)).max(0.25 * metric);
    let free = lines.joints[segment as usize].free;
    let (low, high) = (if free[0] { 0.0 } else { -2.0 }, if free[1] { 1.0 } else { 3.0 });
    (t - (d.dot(d1) / slope).clamp(-0.5, 0.5)).clamp(low, high)
}

/// Where a segment is over an edge.
pub struct EdgePlace<'a> {
    edge: &'a Edge,
    radius: f64,
    /// Parameter of the point.
    pub t: f64,
    /// Place on the centreline.
    pub place: DVec3,
    /// Overlap before any offset (length).
    pub overlap: f64,
    /// Outward normal.
    pub normal: DVec3,
    /// Weight, by angle and rounding.
    pub weight: f64,
}

impl EdgePlace<'_> {
    /// Overlap and normal if the point were at `place`.
    pub fn ahead(&self, surface: &Surface, place: DVec3) -> (f64, DVec3) {
        let mut d = surface.shape.flat(place) - self.edge.centre;
        let mut distance = d.length();
        if let Some([a, b]) = self.edge.beyond
            && d.dot(a) < 0.0
            && d.dot(b) < 0.0
        {
            // The centreline has got inside the body: out along the bisector.
            distance = 0.0;
            d = a + b;
        }
        (self.radius + self.edge.radius - distance, surface.shape.lift(d.normalize_or_zero()))
    }
}

/// Where the segment of a record is, at parameter `t`.
pub fn edge_place<'a>(surface: &'a Surface, lines: &Lines, now: &Centrelines, record: &EdgeRecord, t: f64) -> EdgePlace<'a> {
    let edge = &surface.shape.edges[record.edge as usize];
    let j = record.segment as usize;
    let p = list::curve_of(lines, now, record.segment).at(t);
    let place = xyz(&now.x[j]) + p.x.lane(0);
    let radius = lines.slots[j].radius;
    // On the extension of a segment nothing is known: wait for the move to the next one.
    let valid = (-0.05..1.05).contains(&t);
    let share = flat_share(&surface.shape, p.d.lane(0));
    let weight = if valid { edge_weight(edge, share, radius, lines.slots[j].length) } else { 0.0 };
    let mut at = EdgePlace { edge, radius, t, place, overlap: 0.0, normal: DVec3::ZERO, weight };
    (at.overlap, at.normal) = at.ahead(surface, place);
    at
}

/// Parameter of the point of a record's segment that is nearest to its edge, one step on from where it was, and the velocity of that point.
pub fn edge_motion(surface: &Surface, lines: &Lines, now: &Centrelines, record: &EdgeRecord, state: &EdgeState) -> (f64, DVec3) {
    let centre = surface.shape.edges[record.edge as usize].centre;
    let j = record.segment as usize;
    let t = edge_step(lines, now, &surface.shape, centre, record.segment, state.t);
    let w = curve::weights(t, curve::Range::new(|_| lines.joints[j].free));
    let turning = (xyz(&now.rate[j]) * w.ta + xyz(&now.rate[j + 1]) * w.tb) * now.tangent[j][3];
    (t, xyz(&now.v[j]) * w.a + xyz(&now.v[j + 1]) * w.b + turning)
}

/// Force of an edge on a segment.
pub fn edge_contact(surface: &Surface, lines: &Lines, now: &Centrelines, record: &EdgeRecord, state: &EdgeState) -> Touching {
    let j = record.segment as usize;
    let (t, velocity) = edge_motion(surface, lines, now, record, state);
    let EdgePlace { radius, place, overlap, normal, weight, .. } = edge_place(surface, lines, now, record, t);
    let stiffness = surface.point_stiffness * weight;
    let mut memory = Memory { slip: v3(state.slip), damper: state.damper };
    let before = Zero { offset: state.offset * surface.keep, stiffness: state.stiffness, overlap: state.overlap };
    let offset = before.follow(stiffness, overlap, velocity.dot(normal) * surface.law.dt, 2.0 * radius, &mut memory);
    let touch = Touch {
        stiffness,
        penetration: overlap - offset,
        reach: 2.0 * radius,
        normal: v3(normal),
        velocity: v3(velocity),
        mass: now.v[j][3] + (now.v[j + 1][3] - now.v[j][3]) * t.clamp(0.0, 1.0),
    };
    let response = respond(&surface.law, &touch, &memory);
    Touching { response, t, penetration: touch.penetration, offset, normal, stiffness, velocity, place }
}
