//! Figures of bars: the half plane, the circle, and convex polygons with sharp or rounded corners.
use super::spec::ShapeSpec;
use braid_ecs::prelude::*;
use glam::DVec2;

/// A corner of the figure: a circle of this radius about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Centre of the corner circle.
    pub centre: DVec2,
    /// Its radius (length).
    pub radius: f64,
    /// Directions along the two faces, towards and beyond the corner; the corner is what lies beyond
    /// both. `None` for a full circle.
    pub beyond: Option<[DVec2; 2]>,
    /// Angle by which the surface turns here (radian).
    pub turn: f64,
}

/// The figure across the axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Section {
    /// The half plane below x = 0 (normal along x).
    HalfPlane,
    /// A circle about the origin.
    Circle(f64),
    /// Corner centres, counter-clockwise, and the edge radius.
    Polygon(Vec<DVec2>, f64),
}

/// A size that is a positive number.
pub fn size(path: &str, what: &str, v: f64) -> Result<f64, SpecError> {
    if v > 0.0 && v.is_finite() { Ok(v) } else { Err(SpecError::new(path, format!("{what} must be a positive number, not {v}"))) }
}

impl Section {
    /// From a scene.
    ///
    /// # Errors
    /// Sizes that are not positive, polygons that are not convex, edge radii too large for the figure.
    pub fn new(spec: &ShapeSpec) -> Result<Section, SpecError> {
        match spec {
            ShapeSpec::Plane => Ok(Section::HalfPlane),
            ShapeSpec::Cylinder { radius } => Ok(Section::Circle(size("shape.radius", "the radius", radius.0)?)),
            ShapeSpec::Square { side, edge_radius } => {
                let h = 0.5 * size("shape.side", "the side", side.0)?;
                rounded(vec![DVec2::new(h, -h), DVec2::new(h, h), DVec2::new(-h, h), DVec2::new(-h, -h)], edge_radius.0)
            }
            ShapeSpec::Regular { sides, side, edge_radius } => {
                if *sides < 3 {
                    return Err(SpecError::new("shape.sides", format!("a polygon has at least 3 sides, not {sides}")));
                }
                let angle = std::f64::consts::TAU / f64::from(*sides);
                let outer = 0.5 * size("shape.side", "the side", side.0)? / (0.5 * angle).sin();
                // The first face looks along x, as that of a square.
                let corners = (0..*sides).map(|k| DVec2::from_angle(angle * (f64::from(k) - 0.5)) * outer).collect();
                rounded(corners, edge_radius.0)
            }
            ShapeSpec::Polygon { corners, edge_radius } => {
                let mut points: Vec<DVec2> = corners.iter().map(|c| DVec2::new(c[0].0, c[1].0)).collect();
                if points.len() < 3 || points.iter().any(|p| !p.is_finite()) {
                    return Err(SpecError::new("shape.corners", "a polygon needs at least three corners with finite coordinates"));
                }
                let n = points.len();
                let turn = |k: usize| (points[(k + 1) % n] - points[k]).perp_dot(points[(k + 2) % n] - points[(k + 1) % n]);
                let turns: Vec<f64> = (0..n).map(turn).collect();
                let size = points.iter().map(|p| p.distance_squared(points[0])).fold(0.0, f64::max);
                let flat = 1e-12 * size;
                if !(turns.iter().all(|t| *t > flat) || turns.iter().all(|t| *t < -flat)) {
                    let k = turns.iter().position(|t| t * turns[0] <= flat * flat).unwrap_or(0);
                    return Err(SpecError::new(format!("shape.corners[{}]", (k + 1) % n), "the polygon is not convex at this corner"));
                }
                if turns[0] < 0.0 {
                    points.reverse();
                }
                rounded(points, edge_radius.0)
            }
            ShapeSpec::Frustum { .. } | ShapeSpec::Sphere { .. } | ShapeSpec::Mesh { .. } => {
                Err(SpecError::new("shape", "this shape is no endless bar"))
            }
        }
    }

    /// Signed distance and outward normal.
    pub fn distance(&self, p: DVec2) -> (f64, DVec2) {
        match self {
            Section::HalfPlane => (p.x, DVec2::X),
            Section::Circle(r) => {
                let d = p.length();
                (d - r, if d > 0.0 { p / d } else { DVec2::X })
            }
            Section::Polygon(corners, radius) => {
                let (d, n) = polygon_distance(corners, p);
                (d - radius, n)
            }
        }
    }

    /// The corner circles.
    pub fn edges(&self) -> Vec<Edge> {
        match self {
            Section::HalfPlane => Vec::new(),
            Section::Circle(r) => vec![Edge { centre: DVec2::ZERO, radius: *r, beyond: None, turn: std::f64::consts::PI }],
            Section::Polygon(c, radius) => (0..c.len())
                .map(|k| {
                    let (before, after) = (c[(k + c.len() - 1) % c.len()], c[(k + 1) % c.len()]);
                    let beyond = [(c[k] - before).normalize(), (c[k] - after).normalize()];
                    let turn = beyond[0].perp_dot(-beyond[1]).atan2(beyond[0].dot(-beyond[1]));
                    Edge { centre: c[k], radius: *radius, beyond: Some(beyond), turn }
                })
                .collect(),
        }
    }
}

/// Moves the faces inwards by the edge radius.
fn rounded(corners: Vec<DVec2>, radius: f64) -> Result<Section, SpecError> {
    if !(radius >= 0.0 && radius.is_finite()) {
        return Err(SpecError::new("shape.edge_radius", format!("the edge radius cannot be {radius}")));
    }
    let n = corners.len();
    let inner: Vec<DVec2> = (0..n)
        .map(|k| {
            let (a, b) = ((corners[k] - corners[(k + n - 1) % n]).normalize(), (corners[(k + 1) % n] - corners[k]).normalize());
            // Inward along the bisector: both faces move by the radius.
            let inward = b - a;
            corners[k] + inward * (radius / a.perp_dot(b))
        })
        .collect();
    for k in 0..n {
        let (was, is) = (corners[(k + 1) % n] - corners[k], inner[(k + 1) % n] - inner[k]);
        if was.dot(is) <= 0.0 {
            return Err(SpecError::new("shape.edge_radius", format!("the edge radius {radius} is too large for the figure")));
        }
    }
    Ok(Section::Polygon(inner, radius))
}

/// Signed distance of a convex polygon (corners counter-clockwise), and outward normal.
pub fn polygon_distance(c: &[DVec2], p: DVec2) -> (f64, DVec2) {
    let n = c.len();
    let (mut inside, mut inside_normal) = (f64::NEG_INFINITY, DVec2::X);
    let (mut best, mut best_normal) = (f64::INFINITY, DVec2::X);
    for k in 0..n {
        let (a, b) = (c[k], c[(k + 1) % n]);
        let edge = b - a;
        let length = edge.length();
        let along = edge / length;
        let normal = DVec2::new(along.y, -along.x);
        let (height, place) = ((p - a).dot(normal), (p - a).dot(along));
        if height > inside {
            (inside, inside_normal) = (height, normal);
        }
        if height > 0.0 {
            let foot = a + along * place.clamp(0.0, length);
            let away = p - foot;
            let d = if (0.0..=length).contains(&place) { height } else { away.length() };
            if d < best {
                (best, best_normal) = (d, if (0.0..=length).contains(&place) { normal } else { away / d });
            }
        }
    }
    if inside <= 0.0 { (inside, inside_normal) } else { (best, best_normal) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use braid_ecs::scene::units::Length;

    fn square(edge_radius: f64) -> Section {
        Section::new(&ShapeSpec::Square { side: Length(2.0), edge_radius: Length(edge_radius) }).unwrap()
    }

    #[test]
    fn distance_of_a_square_is_known() {
        for radius in [0.0, 0.25] {
            let s = square(radius);
            assert!((s.distance(DVec2::new(1.5, 0.2)).0 - 0.5).abs() < 1e-15);
            assert!((s.distance(DVec2::new(0.9, 0.2)).0 + 0.1).abs() < 1e-15);
            let (d, n) = s.distance(DVec2::new(-2.0, 2.0));
            assert!((d - ((1.0 + radius) * 2f64.sqrt() - radius)).abs() < 1e-14, "{d}");
            assert!((n - DVec2::new(-1.0, 1.0).normalize()).length() < 1e-14);
        }
    }

    #[test]
    fn figures_that_make_no_sense_are_refused() {
        let path = |shape| Section::new(&shape).unwrap_err().path;
        assert_eq!(path(ShapeSpec::Cylinder { radius: Length(0.0) }), "shape.radius");
        assert_eq!(path(ShapeSpec::Square { side: Length(1.0), edge_radius: Length(0.6) }), "shape.edge_radius");
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]].map(|c| c.map(Length)).to_vec();
        assert_eq!(path(ShapeSpec::Polygon { corners, edge_radius: Length(0.0) }), "shape.corners[2]");
    }

    #[test]
    fn corners_turn_by_the_outer_angle() {
        let hexagon = Section::new(&ShapeSpec::Regular { sides: 6, side: Length(1.0), edge_radius: Length(0.0) }).unwrap();
        assert_eq!(hexagon.edges().len(), 6);
        assert!(hexagon.edges().iter().all(|e| (e.turn - std::f64::consts::FRAC_PI_3).abs() < 1e-12));
        assert!((hexagon.distance(DVec2::new(2.0, 0.0)).0 - (2.0 - 0.75f64.sqrt())).abs() < 1e-14);
    }
}
