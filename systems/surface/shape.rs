//! Shapes of rigid surfaces: distance, normal, and the edges that nodes alone would miss.
//!
//! Bars are cylinders in the wide sense: a plane figure along an axis. The figure is a half plane, a
//! circle, or a convex polygon with rounded corners, which is the polygon of the corner centres grown
//! by the edge radius. A frustum is a convex profile turned about its axis. Everything else is a solid
//! of parry ([`Body::Solid`]): a ball or a closed mesh of triangles. Filaments touch frustums and
//! solids with their nodes alone: their edges should be round on the scale of a segment.
use super::section::{Edge, Section, polygon_distance, size};
use super::spec::{ShapeSpec, SurfaceSpec};
use braid_ecs::prelude::*;
use glam::DVec2;
use parry3d_f64::shape::{SharedShape, TriMeshFlags};

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
                let [a, b] = [start_radius.0, end_radius.0];
                if !(a >= 0.0 && b >= 0.0 && a.max(b) > 0.0 && a.is_finite() && b.is_finite()) {
                    return Err(SpecError::new("shape.start_radius", format!("the radii {a} and {b} do not make a frustum")));
                }
                let l = size("shape.length", "the length", length.0)?;
                let mut profile = vec![DVec2::new(a, 0.0), DVec2::new(b, l), DVec2::new(-b, l), DVec2::new(-a, 0.0)];
                // A tip is one corner.
                profile.dedup_by(|p, q| p.distance(*q) == 0.0);
                if a == 0.0 {
                    profile.pop();
                }
                Ok(Body::Revolved(profile))
            }
            ShapeSpec::Sphere { radius } => Ok(Body::Solid(SharedShape::ball(size("shape.radius", "the radius", radius.0)?))),
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
}
