//! Polylines of filaments and tows, and the geometry of two of them.
use crate::generate::BraidLayout;
use crate::model::Model;
use crate::prelude::{NodeRows, World, node_states};
use glam::DVec3;

/// The current points of one filament of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Points in order (length).
    pub points: Vec<DVec3>,
    /// Contact radius (length).
    pub radius: f64,
}

impl Trace {
    /// The polyline's length.
    pub fn length(&self) -> f64 {
        polyline_length(&self.points)
    }
}

/// Sum of the lengths of the segments of a polyline.
pub fn polyline_length(points: &[DVec3]) -> f64 {
    points.windows(2).map(|w| w[0].distance(w[1])).sum()
}

/// Current points of all filaments of a model that was built into `world`.
pub fn traces(model: &Model, world: &mut World) -> Vec<Trace> {
    let states = node_states(world);
    let rows = world.resource::<NodeRows>();
    let at = |n: &crate::components::NodeId| states[rows.of(*n)].x;
    model.filaments.iter().map(|f| Trace { points: f.nodes.iter().map(at).collect(), radius: f.radius }).collect()
}

/// Points of all filaments of a model in its initial configuration.
pub fn initial_traces(model: &Model) -> Vec<Trace> {
    let at = |n: &crate::components::NodeId| model.nodes[n.row()].position;
    model.filaments.iter().map(|f| Trace { points: f.nodes.iter().map(at).collect(), radius: f.radius }).collect()
}

/// A tow with one more cell at either end: its predecessor moved down by the period, itself, and
/// its successor moved up.
#[derive(Clone, Debug, PartialEq)]
pub struct TowLine {
    /// Filaments: 3 x elements + 1 points each.
    pub filaments: Vec<Vec<DVec3>>,
    /// Radius of the filaments, to whose surface thickness is counted (length).
    pub radius: f64,
    /// Mean of the filaments, point by point.
    pub centre: Vec<DVec3>,
    /// Index of the first point inside the cell.
    pub start: usize,
}

impl TowLine {
    /// A tow from its filaments as they are, all with the same number of points.
    pub fn new(filaments: Vec<Vec<DVec3>>, radius: f64) -> Self {
        let count = filaments.iter().map(Vec::len).min().unwrap_or(0);
        let centre = (0..count).map(|i| filaments.iter().map(|f| f[i]).sum::<DVec3>() / filaments.len() as f64).collect();
        TowLine { filaments, radius, centre, start: 0 }
    }

    /// The tow with the given index of a braid, extended by one cell both ways.
    pub fn of_braid(layout: &BraidLayout, traces: &[Trace], period: DVec3, tow: usize) -> Self {
        let own = &layout.tows[tow];
        let before = layout.tows.iter().position(|t| t.successor == tow).expect("successors are a permutation");
        let (before, after) = (&layout.tows[before], &layout.tows[own.successor]);
        let filaments = (0..own.filaments.len())
            .map(|j| {
                let points = |t: &crate::generate::TowLayout| traces[t.filaments.start + j].points.as_slice();
                // The last point of every filament is the first one of its continuation.
                let inner = |p: &[DVec3], shift: DVec3| p[..p.len() - 1].iter().map(move |x| *x + shift).collect::<Vec<_>>();
                let mut line = inner(points(before), -period);
                line.extend_from_slice(&inner(points(own), DVec3::ZERO));
                line.extend(points(after).iter().map(|x| *x + period));
                line
            })
            .collect();
        let line = TowLine::new(filaments, layout.surface_radius);
        TowLine { start: traces[own.filaments.start].points.len() - 1, ..line }
    }
}

/// Where two polylines are nearest to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Nearest {
    /// Segment and fraction on either line.
    pub at: [(usize, f64); 2],
    /// The two points.
    pub points: [DVec3; 2],
    pub distance: f64,
}

/// Closest points of two polylines, by all pairs of segments in the index windows; the first pair
/// wins a tie.
pub(crate) fn nearest(a: &[DVec3], b: &[DVec3]) -> Option<Nearest> {
    let mut best: Option<Nearest> = None;
    for (i, p) in a.windows(2).enumerate() {
        for (j, q) in b.windows(2).enumerate() {
            let (s, t) = segment_parameters([p[0], p[1]], [q[0], q[1]]);
            let points = [p[0].lerp(p[1], s), q[0].lerp(q[1], t)];
            let distance = points[0].distance(points[1]);
            if best.is_none_or(|b| distance < b.distance) {
                best = Some(Nearest { at: [(i, s), (j, t)], points, distance });
            }
        }
    }
    best
}

/// Smallest distance of two segments (length).
pub fn segment_distance(p: [DVec3; 2], q: [DVec3; 2]) -> f64 {
    let (s, t) = segment_parameters(p, q);
    p[0].lerp(p[1], s).distance(q[0].lerp(q[1], t))
}

/// Parameters in [0, 1] of the closest points of two segments (Ericson 2005, Real-Time Collision
/// Detection, section 5.1.9), without absolute tolerances.
pub(crate) fn segment_parameters(p: [DVec3; 2], q: [DVec3; 2]) -> (f64, f64) {
    let (u, v, r) = (p[1] - p[0], q[1] - q[0], p[0] - q[0]);
    let (a, e, b, c, f) = (u.dot(u), v.dot(v), u.dot(v), u.dot(r), v.dot(r));
    let denominator = a * e - b * b;
    // Parallel segments have no unique closest points: start from the middle of the first one.
    let mut s = if denominator > 1e-14 * a * e { ((b * f - c * e) / denominator).clamp(0.0, 1.0) } else { 0.5 };
    let mut t = (b * s + f) / e;
    if !(0.0..=1.0).contains(&t) {
        t = t.clamp(0.0, 1.0);
        s = ((b * t - c) / a).clamp(0.0, 1.0);
    }
    (s, t)
}

/// Principal direction of the part of a polyline within `half_window` of arc length around a point
/// on it, pointing along the line: the straight line with the least mean squared distance.
pub(crate) fn fitted_direction(line: &[DVec3], at: (usize, f64), half_window: f64) -> DVec3 {
    let centre = line[at.0].lerp(line[at.0 + 1], at.1);
    let mut pieces: Vec<[DVec3; 2]> = Vec::new();
    let mut walk = |points: &mut dyn Iterator<Item = DVec3>, forward: bool| {
        let (mut from, mut left) = (centre, half_window);
        for to in points {
            let length = from.distance(to);
            let end = if length > left { from + (to - from) * (left / length) } else { to };
            pieces.push(if forward { [from, end] } else { [end, from] });
            left -= length;
            from = to;
            if left <= 0.0 {
                break;
            }
        }
    };
    walk(&mut line[..=at.0].iter().rev().copied(), false);
    walk(&mut line[at.0 + 1..].iter().copied(), true);
    // Second moments of the pieces about their common mean, each piece integrated exactly.
    let (mut total, mut mean) = (0.0, DVec3::ZERO);
    for [a, b] in &pieces {
        let l = a.distance(*b);
        total += l;
        mean += (*a + *b) * (0.5 * l);
    }
    mean /= total;
    let mut moment = [[0.0; 3]; 3];
    let mut along = DVec3::ZERO;
    for [a, b] in &pieces {
        let l = a.distance(*b);
        let (p, q) = (*a - mean, *b - mean);
        along += q - p;
        for i in 0..3 {
            for j in 0..3 {
                moment[i][j] += l / 6.0 * (2.0 * p[i] * p[j] + 2.0 * q[i] * q[j] + p[i] * q[j] + q[i] * p[j]);
            }
        }
    }
    // Power iteration: the piece is nearly straight, so the largest moment stands far out.
    let start = along.normalize_or(DVec3::Z);
    let mut d = start;
    for _ in 0..100 {
        let next = DVec3::from_array(std::array::from_fn(|i| DVec3::from_array(moment[i]).dot(d)));
        d = next.normalize_or(d);
    }
    if d.dot(start) < 0.0 { -d } else { d }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closest_points_of_segments() {
        let x = [DVec3::ZERO, DVec3::X];
        assert_eq!(segment_parameters(x, [DVec3::new(0.25, -1.0, 0.5), DVec3::new(0.25, 3.0, 0.5)]), (0.25, 0.25));
        // Beyond the end: clamped.
        assert_eq!(segment_parameters(x, [DVec3::new(3.0, 1.0, 0.0), DVec3::new(3.0, 2.0, 0.0)]), (1.0, 0.0));
        // Parallel, shifted: any pair at the common distance.
        let (s, t) = segment_parameters(x, [DVec3::new(0.5, 2.0, 0.0), DVec3::new(1.5, 2.0, 0.0)]);
        assert!((x[0].lerp(x[1], s).x - (0.5 + t)).abs() < 1e-15);
    }

    #[test]
    fn closest_points_do_not_depend_on_the_unit_of_length() {
        let p = [DVec3::new(0.1, 0.2, 0.3), DVec3::new(1.0, -0.5, 0.7)];
        let q = [DVec3::new(-0.3, 0.9, 0.1), DVec3::new(0.8, 0.4, -0.6)];
        let base = segment_parameters(p, q);
        for scale in [1e-9, 1e-3, 1e6] {
            let (s, t) = segment_parameters(p.map(|x| x * scale), q.map(|x| x * scale));
            assert!((s - base.0).abs() < 1e-12 && (t - base.1).abs() < 1e-12);
        }
    }

    #[test]
    fn direction_of_an_arc_is_its_tangent_in_the_middle() {
        // By symmetry the best line through a circular arc is parallel to the tangent at its middle.
        let arc: Vec<DVec3> = (0..=40).map(|i| DVec3::new((0.01 * i as f64).sin(), 1.0 - (0.01 * i as f64).cos(), 0.0)).collect();
        let d = fitted_direction(&arc, (20, 0.0), 0.15);
        assert!((d - DVec3::new(0.2f64.cos(), 0.2f64.sin(), 0.0)).length() < 1e-12);
        // A window in the middle of a segment, longer than the line: the whole line counts.
        let straight = [DVec3::ZERO, DVec3::X, DVec3::X * 3.0];
        assert!((fitted_direction(&straight, (1, 0.5), 10.0) - DVec3::X).length() < 1e-15);
    }
}
