//! Shapes of rigid surfaces: distance, normal, and the edges that nodes alone would miss.
//!
//! Bars are cylinders in the wide sense: a plane figure along an axis. The figure is a half plane, a
//! circle, or a convex polygon with rounded corners, which is the polygon of the corner centres grown
//! by the edge radius. A frustum is a convex profile turned about its axis. Everything else is a solid
//! of parry ([`Body::Solid`]): a ball or a closed mesh of triangles. Filaments touch frustums and
//! solids with their nodes alone: their edges should be round on the scale of a segment.
use super::spec::{ShapeSpec, SurfaceSpec};
use braid_ecs::prelude::*;
use glam::DVec2;
use parry3d_f64::shape::{SharedShape, TriMeshFlags};

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

impl Section {
    /// From a scene.
    ///
    /// # Errors
    /// Sizes that are not positive, polygons that are not convex, edge radii too large for the figure.
    pub fn new(spec: &ShapeSpec) -> Result<Section, SpecError> {
        let size = |path: &str, what: &str, v: f64| {
            if v > 0.0 && v.is_finite() { Ok(v) } else { Err(SpecError::new(path, format!("{what} must be a positive number, not {v}"))) }
        };
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

fn polygon_distance(c: &[DVec2], p: DVec2) -> (f64, DVec2) {
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

/// What a surface is made of.
#[derive(Clone)]
pub enum Body {
    /// An endless bar with this figure as its cross-section.
    Bar(Section),
    /// A convex profile (distance from the axis, place on it), with its mirror image, about the axis.
    Revolved(Vec<DVec2>),
    /// Any closed shape of parry.
    Solid(SharedShape),
}

impl std::fmt::Debug for Body {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Body::Bar(section) => section.fmt(f),
            Body::Revolved(profile) => profile.fmt(f),
            Body::Solid(shape) => shape.shape_type().fmt(f),
        }
    }
}

impl Body {
    /// From a scene.
    ///
    /// # Errors
    /// As [`Section::new`]; meshes that are not closed.
    pub fn new(spec: &ShapeSpec) -> Result<Body, SpecError> {
        match spec {
            ShapeSpec::Frustum { start_radius, end_radius, length } => {
                let ([a, b], l) = ([start_radius.0, end_radius.0], length.0);
                if !(a >= 0.0 && b >= 0.0 && a.max(b) > 0.0 && a.is_finite() && b.is_finite()) {
                    return Err(SpecError::new("shape.start_radius", format!("the radii {a} and {b} do not make a frustum")));
                }
                if !(l > 0.0 && l.is_finite()) {
                    return Err(SpecError::new("shape.length", format!("the length must be a positive number, not {l}")));
                }
                let mut profile = vec![DVec2::new(a, 0.0), DVec2::new(b, l), DVec2::new(-b, l), DVec2::new(-a, 0.0)];
                // A tip is one corner.
                profile.dedup_by(|p, q| p.distance(*q) == 0.0);
                if a == 0.0 {
                    profile.pop();
                }
                Ok(Body::Revolved(profile))
            }
            ShapeSpec::Sphere { radius } if radius.0 > 0.0 && radius.0.is_finite() => Ok(Body::Solid(SharedShape::ball(radius.0))),
            ShapeSpec::Sphere { radius } => {
                Err(SpecError::new("shape.radius", format!("the radius must be a positive number, not {}", radius.0)))
            }
            ShapeSpec::Mesh { vertices, triangles } => mesh(vertices, triangles),
            _ => Section::new(spec).map(Body::Bar),
        }
    }
}

/// A closed mesh with its triangles counter-clockwise seen from outside.
fn mesh(vertices: &[[braid_ecs::scene::units::Length; 3]], triangles: &[[u32; 3]]) -> Result<Body, SpecError> {
    let points: Vec<DVec3> = vertices.iter().map(|v| DVec3::new(v[0].0, v[1].0, v[2].0)).collect();
    if let Some(k) = points.iter().position(|p| !p.is_finite()) {
        return Err(SpecError::new(format!("shape.vertices[{k}]"), "a coordinate is not a finite number"));
    }
    if let Some((k, t)) = triangles.iter().enumerate().find(|(_, t)| t.iter().any(|i| *i as usize >= points.len())) {
        let text = format!("triangle {t:?} uses a vertex that does not exist: there are {}, counted from 0", points.len());
        return Err(SpecError::new(format!("shape.triangles[{k}]"), text));
    }
    // Closed and of one sense: every side is met once in each direction.
    let mut sides = std::collections::BTreeMap::<(u32, u32), i32>::new();
    for t in triangles {
        for (i, j) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
            *sides.entry((i, j)).or_default() += 1;
        }
    }
    if let Some(((i, j), _)) = sides.iter().find(|((i, j), n)| **n != 1 || sides.get(&(*j, *i)) != Some(&1)) {
        let text = format!("the mesh is not closed, or its triangles do not run the same way round, at the side from vertex {i} to {j}");
        return Err(SpecError::new("shape.triangles", text).help("list the corners of every triangle counter-clockwise seen from outside"));
    }
    let volume: f64 = triangles.iter().map(|t| points[t[0] as usize].dot(points[t[1] as usize].cross(points[t[2] as usize]))).sum();
    if volume.is_nan() || volume <= 0.0 {
        return Err(SpecError::new("shape.triangles", "the triangles enclose no volume, or run clockwise seen from outside"));
    }
    let shape = SharedShape::trimesh_with_flags(points, triangles.to_vec(), TriMeshFlags::ORIENTED);
    shape.map(Body::Solid).map_err(|e| SpecError::new("shape.triangles", format!("this mesh cannot be used: {e}")))
}

/// A surface at its place.
#[derive(Clone, Debug)]
pub struct Shape {
    /// What it is made of.
    pub body: Body,
    /// The edges of a bar.
    pub edges: Vec<Edge>,
    /// A point of the axis.
    pub origin: DVec3,
    /// First and second direction of the figure, and the axis.
    pub frame: DMat3,
}

impl Shape {
    /// From a scene.
    ///
    /// # Errors
    /// As [`Body::new`].
    pub fn new(spec: &SurfaceSpec) -> Result<Shape, SpecError> {
        let body = Body::new(&spec.shape)?;
        let axis = DVec3::from_array(spec.axis).normalize();
        let (u, v) = if axis == DVec3::Z {
            (DVec3::X, DVec3::Y)
        } else {
            let u = (DVec3::X - axis * axis.x)
                .try_normalize()
                .filter(|_| axis.x.abs() < 0.9)
                .unwrap_or(axis.cross(DVec3::X).normalize_or(DVec3::Y));
            (u, axis.cross(u))
        };
        let (sin, cos) = spec.turn.0.sin_cos();
        let (u, v) = (u * cos + v * sin, v * cos - u * sin);
        // The plane's normal is its axis, and the first direction of its figure.
        let plane = matches!(body, Body::Bar(Section::HalfPlane));
        let frame = if plane { DMat3::from_cols(axis, u, v) } else { DMat3::from_cols(u, v, axis) };
        let p = spec.position;
        let edges = if let Body::Bar(section) = &body { section.edges() } else { Vec::new() };
        Ok(Shape { edges, body, origin: DVec3::new(p.0[0].0, p.0[1].0, p.0[2].0), frame })
    }

    /// A place in the figure's plane.
    pub fn flat(&self, x: DVec3) -> DVec2 {
        let d = x - self.origin;
        DVec2::new(d.dot(self.frame.x_axis), d.dot(self.frame.y_axis))
    }

    /// A direction in the figure's plane.
    pub fn flat_direction(&self, d: DVec3) -> DVec2 {
        DVec2::new(d.dot(self.frame.x_axis), d.dot(self.frame.y_axis))
    }

    /// A direction of the figure's plane in space.
    pub fn lift(&self, d: DVec2) -> DVec3 {
        self.frame.x_axis * d.x + self.frame.y_axis * d.y
    }

    /// Signed distance and outward normal.
    pub fn distance(&self, x: DVec3) -> (f64, DVec3) {
        match &self.body {
            Body::Bar(section) => {
                let (d, n) = section.distance(self.flat(x));
                (d, self.lift(n))
            }
            Body::Revolved(profile) => {
                let (flat, axis) = (self.flat(x), self.frame.z_axis);
                let away = flat.length();
                let (d, n) = polygon_distance(profile, DVec2::new(away, (x - self.origin).dot(axis)));
                let radial = if away > 0.0 { flat / away } else { DVec2::X };
                (d, self.lift(radial) * n.x + axis * n.y)
            }
            Body::Solid(shape) => {
                let local = self.frame.transpose() * (x - self.origin);
                let foot = shape.project_local_point(local, false);
                let away = local - foot.point;
                let d = away.length();
                let normal = self.frame * (away / d.max(f64::MIN_POSITIVE));
                if foot.is_inside { (-d, -normal) } else { (d, normal) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use braid_ecs::scene::units::{Angle, Length};

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
    fn the_normal_is_the_gradient_of_the_distance() {
        let corners = [[0.0, 0.0], [3.0, -0.5], [4.0, 2.0], [1.0, 3.0]].map(|c| c.map(Length)).to_vec();
        let mut spec = SurfaceSpec::new(ShapeSpec::Polygon { corners, edge_radius: Length(0.2) });
        spec.axis = [1.0, 2.0, -0.5];
        spec.turn = Angle(0.7);
        let shape = Shape::new(&spec).unwrap();
        for k in 0..200 {
            let x = DVec3::new((k as f64 * 1.7).sin() * 5.0, (k as f64 * 2.3).cos() * 5.0, (k as f64 * 0.9).sin() * 5.0);
            let (d, n) = shape.distance(x);
            if d > -0.2 {
                let h = 1e-6;
                let g = DVec3::from_array(std::array::from_fn(|a| {
                    (shape.distance(x + DVec3::AXES[a] * h).0 - shape.distance(x - DVec3::AXES[a] * h).0) / (2.0 * h)
                }));
                assert!((g - n).length() < 1e-5, "{x} {d} {g} {n}");
            }
        }
    }

    /// A cube with an edge of 2 about the origin.
    fn cube() -> ShapeSpec {
        let vertices = (0..8).map(|k| [0, 1, 2].map(|a| Length(if k >> a & 1 == 1 { 1.0 } else { -1.0 }))).collect();
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|f: &[u32; 4]| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).collect();
        ShapeSpec::Mesh { vertices, triangles }
    }

    #[test]
    fn solids_have_the_distances_of_the_bars_they_look_like() {
        let at = |shape: ShapeSpec| {
            let mut spec = SurfaceSpec::new(shape);
            spec.axis = [1.0, 2.0, -0.5];
            spec.turn = Angle(0.7);
            Shape::new(&spec).unwrap()
        };
        let (mesh, bar) = (at(cube()), at(ShapeSpec::Square { side: Length(2.0), edge_radius: Length(0.0) }));
        let (ball, cone) = (
            at(ShapeSpec::Sphere { radius: Length(1.5) }),
            at(ShapeSpec::Frustum { start_radius: Length(2.0), end_radius: Length(1.0), length: Length(4.0) }),
        );
        for k in 0..100 {
            let flat = DVec2::new((k as f64 * 1.7).sin() * 3.0, (k as f64 * 2.3).cos() * 3.0);
            let x = mesh.lift(flat) + mesh.frame.z_axis * 0.3;
            let ((d, n), (known, normal)) = (mesh.distance(x), bar.distance(x));
            if known > -0.6 && known.abs() > 1e-9 {
                assert!((d - known).abs() < 1e-9 && (n - normal).length() < 1e-6, "{flat}: {d} {known} {n} {normal}");
            }
            let (d, n) = ball.distance(x);
            assert!((d - (x.length() - 1.5)).abs() < 1e-12 && (n - x.normalize()).length() < 1e-9);
            // Beside its flank a frustum is a plane in every meridian.
            let (away, z) = (flat.length() + 1.0, 2.0);
            let x = cone.lift(flat.normalize() * away) + cone.frame.z_axis * z;
            let slant = DVec2::new(4.0, 1.0).normalize();
            let d = slant.dot(DVec2::new(away - 2.0, z));
            if (0.0..1.0).contains(&d) {
                assert!((cone.distance(x).0 - d).abs() < 1e-12, "{away} {} {d}", cone.distance(x).0);
                assert!((cone.distance(x).1.dot(cone.frame.z_axis) - slant.y).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn open_meshes_are_refused() {
        let ShapeSpec::Mesh { vertices, mut triangles } = cube() else { unreachable!() };
        triangles.pop();
        let e = Body::new(&ShapeSpec::Mesh { vertices: vertices.clone(), triangles: triangles.clone() }).unwrap_err();
        assert!(e.message.contains("not closed"), "{}", e.message);
        triangles.push([0, 1, 9]);
        assert_eq!(Body::new(&ShapeSpec::Mesh { vertices, triangles }).unwrap_err().path, "shape.triangles[11]");
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
