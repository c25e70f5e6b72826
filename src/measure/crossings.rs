//! Angle and thickness of a braid at its crossings.
//!
//! The centre line of a tow is the mean of its filaments, continued through the periodic faces. A
//! crossing is where the centre lines of its two tows are nearest to each other, searched one
//! crossing spacing around its place in the pattern. Angle: between the straight lines fitted to the two
//! centre lines around the crossing, full angle between the tows. Thickness: from the innermost
//! to the outermost surface of the filaments of both tows, each filament counted once at its point
//! nearest to the crossing's axis. The axis passes through the crossing along the normal of the
//! mandrel face there, or radially.
use super::line::{Nearest, TowLine, Trace, fitted_direction, nearest, traces};
use super::reading::position;
use super::stats::Estimate;
use crate::generate::{BraidLayout, Crossing, TowId};
use crate::model::Model;
use crate::prelude::World;
use glam::DVec3;

/// From where heights are counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Heights {
    /// From the z axis, radially.
    #[default]
    Radial,
    /// From the faces of a prism along z, each an outward normal and its distance from the axis: the face
    /// on which a point lies is the one it is furthest outside of.
    Faces(Vec<(DVec3, f64)>),
}

impl Heights {
    /// The faces of a square prism of the given side, turned by `turn` about z (radian).
    pub fn square(side: f64, turn: f64) -> Self {
        Heights::regular_prism(4, 0.5 * side, turn)
    }

    /// The faces of a regular prism with `sides` faces at `distance` from the axis, the first one normal to
    /// the x axis turned by `turn` (radian).
    pub fn regular_prism(sides: usize, distance: f64, turn: f64) -> Self {
        let normal = |i: usize| {
            let phi = turn + std::f64::consts::TAU * i as f64 / sides as f64;
            DVec3::new(phi.cos(), phi.sin(), 0.0)
        };
        Heights::Faces((0..sides).map(|i| (normal(i), distance)).collect())
    }

    /// The outward direction at a point.
    pub fn direction(&self, point: DVec3) -> DVec3 {
        match self {
            Heights::Radial => DVec3::new(point.x, point.y, 0.0).normalize_or(DVec3::X),
            Heights::Faces(faces) => faces
                .iter()
                .copied()
                .reduce(|a, b| if b.0.dot(point) - b.1 > a.0.dot(point) - a.1 { b } else { a })
                .map_or(DVec3::X, |f| f.0),
        }
    }

    /// Height of a point above the face with the outward direction `direction`.
    fn height(&self, point: DVec3, direction: DVec3) -> f64 {
        match self {
            Heights::Radial => point.x.hypot(point.y),
            Heights::Faces(_) => point.dot(direction),
        }
    }
}

/// How crossings are measured.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossingOptions {
    /// Heights.
    pub heights: Heights,
    /// Half of the arc length over which lines are fitted to the centre lines (length).
    pub fit_half_window: f64,
}

impl CrossingOptions {
    /// Lines fitted over a twelfth of the braid's radius both ways (0.25 mm at 3 mm).
    pub fn for_braid(layout: &BraidLayout, heights: Heights) -> Self {
        CrossingOptions { heights, fit_half_window: layout.geometry.radius / 12.0 }
    }
}

/// One crossing as it is now.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossingMeasure {
    /// The crossing in the pattern.
    pub crossing: Crossing,
    /// Midpoint between the centre lines (length).
    pub point: DVec3,
    /// Full angle between the tows (radian).
    pub angle: f64,
    /// Outermost minus innermost surface (length).
    pub thickness: f64,
    /// Height of the A tow's centre line above that of the B tow (length).
    pub separation: f64,
}

impl CrossingMeasure {
    /// True if the tow on top is the one of the pattern.
    pub fn keeps_order(&self) -> bool {
        (self.separation > 0.0) == self.crossing.plus_on_top
    }
}

/// What is measured of a braid.
#[derive(Clone, Debug, PartialEq)]
pub struct BraidMeasures {
    /// Length of the cell (length).
    pub length: f64,
    /// Angle between the tows (radian).
    pub angle: Estimate,
    /// Thickness (length).
    pub thickness: Estimate,
    /// All crossings of the cell.
    pub crossings: Vec<CrossingMeasure>,
}

impl BraidMeasures {
    /// Crossings where the wrong tow is on top.
    pub fn order_changes(&self) -> usize {
        self.crossings.iter().filter(|c| !c.keeps_order()).count()
    }
}

/// Measures the crossing of two tows, searched around the fractional point indices `expected` of the two
/// lines within `reach` points. `None` if a line is too short for that.
pub fn measure_crossing(
    crossing: Crossing,
    [plus, minus]: [&TowLine; 2],
    expected: [f64; 2],
    reach: f64,
    options: &CrossingOptions,
) -> Option<CrossingMeasure> {
    let window = |line: &TowLine, at: f64| {
        let first = (at - reach).floor().max(0.0) as usize;
        let last = ((at + reach).ceil().max(0.0) as usize).min(line.centre.len().saturating_sub(1));
        (first < last).then_some(first..last + 1)
    };
    let windows = [window(plus, expected[0])?, window(minus, expected[1])?];
    let Nearest { mut at, points, .. } = nearest(&plus.centre[windows[0].clone()], &minus.centre[windows[1].clone()])?;
    for (a, w) in at.iter_mut().zip(&windows) {
        a.0 += w.start;
    }
    let point = 0.5 * (points[0] + points[1]);
    let outward = options.heights.direction(point);
    let height = |p: DVec3| options.heights.height(p, outward);
    let directions = [(plus, at[0]), (minus, at[1])].map(|(line, at)| fitted_direction(&line.centre, at, options.fit_half_window));
    let (mut inner, mut outer) = (f64::INFINITY, f64::NEG_INFINITY);
    for (line, window) in [(plus, &windows[0]), (minus, &windows[1])] {
        for filament in &line.filaments {
            let h = height(nearest_to_axis(&filament[window.clone()], point, outward));
            inner = inner.min(h - line.radius);
            outer = outer.max(h + line.radius);
        }
    }
    Some(CrossingMeasure {
        crossing,
        point,
        angle: directions[0].angle_between(directions[1]),
        thickness: outer - inner,
        separation: height(points[0]) - height(points[1]),
    })
}

/// Point of a polyline nearest to the line through `point` along the unit vector `axis`.
fn nearest_to_axis(line: &[DVec3], point: DVec3, axis: DVec3) -> DVec3 {
    let across = |x: DVec3| x - axis * axis.dot(x);
    let (mut best, mut least) = (line[0], f64::INFINITY);
    for w in line.windows(2) {
        let (a, d) = (across(w[0] - point), across(w[1] - w[0]));
        let t = if d.length_squared() > 0.0 { (-a.dot(d) / d.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
        let distance = (a + d * t).length_squared();
        if distance < least {
            (best, least) = (w[0].lerp(w[1], t), distance);
        }
    }
    best
}

/// Measures a braid from the points of all filaments of its model and the current period vector.
pub fn measure_braid(layout: &BraidLayout, traces: &[Trace], period: DVec3, options: &CrossingOptions) -> BraidMeasures {
    let lines: Vec<TowLine> = (0..layout.tows.len()).map(|t| TowLine::of_braid(layout, traces, period, t)).collect();
    // Crossing m lies where both tows have covered the same share of the cell.
    let spacing = layout.elements as f64 / layout.geometry.crossings_per_tow() as f64;
    let crossings: Vec<CrossingMeasure> = layout
        .crossings
        .iter()
        .filter_map(|c| {
            let plus = &lines[layout.tow(TowId { plus: true, index: c.plus })];
            let minus = &lines[layout.tow(TowId { plus: false, index: c.minus })];
            let expected = [plus, minus].map(|l| l.start as f64 + spacing * c.m as f64);
            measure_crossing(*c, [plus, minus], expected, spacing, options)
        })
        .collect();
    let of = |value: fn(&CrossingMeasure) -> f64| Estimate::of(&crossings.iter().map(value).collect::<Vec<_>>());
    BraidMeasures { length: period.length(), angle: of(|c| c.angle), thickness: of(|c| c.thickness), crossings }
}

/// Measures the braid of a model that was built into `world`; `None` if the model has no braid.
pub fn braid_measures(model: &Model, world: &mut World, heights: Heights) -> Option<BraidMeasures> {
    let layout = model.get::<BraidLayout>()?;
    let period = position(world, layout.dummy);
    Some(measure_braid(layout, &traces(model, world), period, &CrossingOptions::for_braid(layout, heights)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn any_crossing() -> Crossing {
        Crossing { plus: 0, minus: 0, m: 0, z: 0.0, point: DVec3::ZERO, plus_on_top: true }
    }

    /// Straight tows of three filaments side by side at height x = `height`, in the plane of y and z
    /// at `angle` to z.
    fn straight_tow(height: f64, angle: f64, radius: f64, points: usize) -> TowLine {
        let along = DVec3::new(0.0, angle.sin(), angle.cos());
        let across = DVec3::new(0.0, angle.cos(), -angle.sin());
        let filament = |j: i32| {
            (0..points)
                .map(|i| {
                    DVec3::X * height + across * (2.0 * radius * f64::from(j)) + along * (0.1 * (i as f64 - 0.5 * (points - 1) as f64))
                })
                .collect()
        };
        TowLine::new((-1..=1).map(filament).collect(), radius)
    }

    #[test]
    fn straight_tows_on_a_flat_face_have_their_angle_and_thickness() {
        for (a, b) in [(0.3, -0.3), (0.6, -0.2), (0.95, -0.95), (0.1, 0.5)] {
            let options = CrossingOptions { heights: Heights::square(2.0, 0.0), fit_half_window: 0.25 };
            let (low, high) = (straight_tow(1.02, a, 0.02, 41), straight_tow(1.07, b, 0.03, 40));
            let found = measure_crossing(any_crossing(), [&low, &high], [20.0, 20.0], 10.0, &options).expect("lines cross");
            assert!((found.angle - (a - b).abs()).abs() < 1e-12);
            assert!((found.thickness - (0.05 + 0.02 + 0.03)).abs() < 1e-12);
            assert!((found.separation + 0.05).abs() < 1e-12);
            assert!(!found.keeps_order(), "the pattern has the first tow on top");
            assert!((found.point - DVec3::X * 1.045).length() < 1e-12);
        }
    }

    #[test]
    fn every_filament_counts_once_at_the_crossing() {
        let options = CrossingOptions { heights: Heights::square(2.0, 0.0), fit_half_window: 0.25 };
        let low = straight_tow(1.02, 0.5, 0.02, 41);
        let mut high = straight_tow(1.06, -0.5, 0.02, 41);
        // One filament rises far from the crossing: that does not count.
        high.filaments[2][5].x += 0.5;
        let far = measure_crossing(any_crossing(), [&low, &high], [20.0, 20.0], 18.0, &options).expect("lines cross");
        assert!((far.thickness - 0.08).abs() < 1e-12);
        // The same at the crossing does.
        for p in &mut high.filaments[2] {
            p.x += 0.01;
        }
        let here = measure_crossing(any_crossing(), [&low, &high], [20.0, 20.0], 5.0, &options).expect("lines cross");
        assert!((here.thickness - 0.09).abs() < 1e-12);
    }

    #[test]
    fn heights_follow_the_face_on_which_a_point_lies() {
        let square = Heights::square(2.0, 0.0);
        assert!((square.direction(DVec3::new(0.3, -1.2, 5.0)) + DVec3::Y).length() < 1e-15);
        assert_eq!(square.direction(DVec3::new(1.1, 1.0, 0.0)), DVec3::X);
        let turned = Heights::square(2.0, 0.5);
        assert!((turned.direction(DVec3::new(1.0, 0.5, 0.0)) - DVec3::new(0.5f64.cos(), 0.5f64.sin(), 0.0)).length() < 1e-15);
        assert_eq!(Heights::Radial.direction(DVec3::new(0.0, -2.0, 1.0)), -DVec3::Y);
    }

    #[test]
    fn curved_tows_have_radial_thickness() {
        // Two helices of opposite hand at radii 1 and 1.1 cross at (1.05, 0, 0) at twice the helix angle.
        let helix = |rho: f64, sign: f64| {
            (0..=60)
                .map(|i| {
                    let z = 0.01 * (f64::from(i) - 30.0);
                    DVec3::new(rho * (sign * z).cos(), rho * (sign * z).sin(), z)
                })
                .collect::<Vec<_>>()
        };
        let (a, b) = (TowLine::new(vec![helix(1.1, 1.0)], 0.02), TowLine::new(vec![helix(1.0, -1.0)], 0.03));
        let options = CrossingOptions { heights: Heights::Radial, fit_half_window: 0.02 };
        let found = measure_crossing(any_crossing(), [&a, &b], [30.0, 30.0], 20.0, &options).expect("lines cross");
        // The nearest points of two polylines are off the vertices by at most the sag of a chord.
        assert!((found.thickness - 0.15).abs() < 0.015f64.powi(2) / 8.0);
        assert!((found.angle - (1.1f64.atan() + 1.0f64.atan())).abs() < 1e-3);
        assert!(found.keeps_order());
    }
}
