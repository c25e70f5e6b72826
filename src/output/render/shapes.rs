//! Rays against capsules and convex solids.
use glam::DVec3;

/// A straight piece of a tube: a cylinder between two half spheres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Capsule {
    pub a: DVec3,
    pub b: DVec3,
    /// Unit tangents of the smooth curve at both ends, for shading only.
    pub ta: DVec3,
    pub tb: DVec3,
    pub radius: f64,
    /// Index of the tube.
    pub tube: u32,
}

/// First crossing of the sphere around `centre`, seen from outside.
fn sphere(origin: DVec3, direction: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let oc = origin - centre;
    let b = oc.dot(direction);
    let h = b * b - (oc.length_squared() - radius * radius);
    (h > 0.0).then(|| -b - h.sqrt()).filter(|t| *t > 0.0)
}

impl Capsule {
    /// Distance along the ray (unit direction) to the surface, from outside.
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let ba = self.b - self.a;
        let oa = origin - self.a;
        let (baba, bard, baoa) = (ba.length_squared(), ba.dot(direction), ba.dot(oa));
        let a = baba - bard * bard;
        // Nearly along the axis, or no length: only the half spheres can be hit first.
        if a > 1e-12 * baba {
            let b = baba * oa.dot(direction) - baoa * bard;
            let c = baba * (oa.length_squared() - self.radius * self.radius) - baoa * baoa;
            let h = b * b - a * c;
            if h < 0.0 {
                return None;
            }
            let t = (-b - h.sqrt()) / a;
            let y = baoa + t * bard;
            if y > 0.0 && y < baba {
                return (t > 0.0).then_some(t);
            }
            return sphere(origin, direction, if y <= 0.0 { self.a } else { self.b }, self.radius);
        }
        let ends = [sphere(origin, direction, self.a, self.radius), sphere(origin, direction, self.b, self.radius)];
        ends.into_iter().flatten().min_by(f64::total_cmp)
    }

    /// Normal at a point of the surface, perpendicular to the smooth curve rather than to the
    /// straight piece, so that a polyline looks like a bent tube.
    pub fn normal(&self, point: DVec3) -> DVec3 {
        let ba = self.b - self.a;
        let s = ((point - self.a).dot(ba) / ba.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let n = point - (self.a + s * ba);
        if s > 0.0 && s < 1.0 {
            let t = self.ta.lerp(self.tb, s).normalize_or_zero();
            (n - n.dot(t) * t).normalize_or(n)
        } else {
            n.normalize_or(DVec3::Z)
        }
    }
}

/// The common part of half spaces n.x <= d, and of an endless round bar (point, axis, radius) if there is one.
#[derive(Clone, Debug, Default)]
pub(super) struct Convex {
    pub planes: Vec<(DVec3, f64)>,
    pub bar: Option<(DVec3, DVec3, f64)>,
}

impl Convex {
    /// Distance to the entry point and the normal there, from outside.
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<(f64, DVec3)> {
        let (mut enter, mut leave, mut normal) = (0.0f64, f64::INFINITY, None);
        if let Some((centre, axis, radius)) = self.bar {
            // Seen along the axis a ray is a line and the bar a circle.
            let across = |v: DVec3| v - axis * axis.dot(v);
            let (o, d) = (across(origin - centre), across(direction));
            let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - radius * radius);
            let root = b * b - a * c;
            if a > 0.0 && root > 0.0 {
                let t = (-b - root.sqrt()) / a;
                leave = (-b + root.sqrt()) / a;
                if t > 0.0 {
                    (enter, normal) = (t, Some((o + d * t) / radius));
                }
            } else if c > 0.0 {
                return None;
            }
        }
        for &(n, d) in &self.planes {
            let (gap, speed) = (n.dot(origin) - d, n.dot(direction));
            if speed < 0.0 {
                let t = -gap / speed;
                if t > enter {
                    (enter, normal) = (t, Some(n));
                }
            } else if speed > 0.0 {
                leave = leave.min(-gap / speed);
            } else if gap > 0.0 {
                return None;
            }
        }
        normal.filter(|_| enter < leave).map(|n| (enter, n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Distance of a point to a segment: the textbook definition of a capsule.
    fn distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
        let s = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        (p - a - s * (b - a)).length()
    }

    #[test]
    fn rays_meet_capsules_where_sphere_tracing_says() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
        let mut vector = |scale: f64| DVec3::from_array(std::array::from_fn(|_| scale * (rng.random::<f64>() - 0.5)));
        let (mut hits, mut misses) = (0, 0);
        for _ in 0..5000 {
            let (a, b, radius) = (vector(2.0), vector(2.0), 0.3);
            let capsule = Capsule { a, b, ta: DVec3::ZERO, tb: DVec3::ZERO, radius, tube: 0 };
            let origin = vector(1.0).normalize() * 10.0;
            let direction = (vector(3.0) - origin).normalize();
            // Sphere tracing: the distance to the surface is always a safe step.
            let (mut t, mut gap) = (0.0, 1.0);
            for _ in 0..2000 {
                gap = distance(origin + t * direction, a, b) - radius;
                if gap < 1e-12 || t > 30.0 {
                    break;
                }
                t += gap;
            }
            match capsule.cast(origin, direction) {
                Some(hit) => {
                    // Grazing rays converge slowly in the marching; 1e-6 is its error, not the formula's.
                    assert!((hit - t).abs() < 1e-6, "{hit} {t}");
                    assert!((distance(origin + hit * direction, a, b) - radius).abs() < 1e-9);
                    hits += 1;
                }
                None => {
                    assert!(gap > 1e-12 && t > 20.0, "missed a capsule at {t}");
                    misses += 1;
                }
            }
        }
        assert!(hits > 500 && misses > 500, "both cases are met: {hits} {misses}");
    }

    #[test]
    fn rays_along_the_axis_hit_the_end() {
        let c = Capsule { a: DVec3::ZERO, b: DVec3::Z, ta: DVec3::Z, tb: DVec3::Z, radius: 0.25, tube: 0 };
        assert!((c.cast(DVec3::Z * 5.0, -DVec3::Z).unwrap() - 3.75).abs() < 1e-12);
        assert_eq!(c.cast(DVec3::new(0.3, 0.0, 5.0), -DVec3::Z), None);
        assert_eq!(c.cast(DVec3::Z * 5.0, DVec3::Z), None, "behind the eye");
    }

    #[test]
    fn a_cube_is_entered_through_its_face() {
        let planes = [DVec3::X, DVec3::Y, DVec3::Z].iter().flat_map(|n| [(*n, 1.0), (-*n, 1.0)]).collect();
        let cube = Convex { planes, bar: None };
        assert_eq!(cube.cast(DVec3::new(0.5, 0.2, 5.0), -DVec3::Z), Some((4.0, DVec3::Z)));
        assert_eq!(cube.cast(DVec3::new(1.5, 0.2, 5.0), -DVec3::Z), None);
        assert_eq!(cube.cast(DVec3::new(0.0, 0.0, 5.0), DVec3::Z), None);
    }

    #[test]
    fn rays_meet_a_round_bar_on_its_side_and_on_its_ends() {
        let bar = Convex { planes: vec![(DVec3::Z, 2.0), (-DVec3::Z, 2.0)], bar: Some((DVec3::ZERO, DVec3::Z, 1.0)) };
        let (t, n) = bar.cast(DVec3::new(5.0, 0.5, 0.0), -DVec3::X).expect("its side");
        let place = DVec3::new(0.75f64.sqrt(), 0.5, 0.0);
        assert!((t - (5.0 - place.x)).abs() < 1e-12 && n.distance(place) < 1e-12, "{t} {n}");
        let (t, n) = bar.cast(DVec3::new(0.3, 0.0, 5.0), -DVec3::Z).expect("its end");
        assert!((t - 3.0).abs() < 1e-12 && n == DVec3::Z);
        for (from, to) in
            [(DVec3::new(5.0, 1.5, 0.0), -DVec3::X), (DVec3::new(1.5, 0.0, 5.0), -DVec3::Z), (DVec3::new(5.0, 0.0, 2.5), -DVec3::X)]
        {
            assert!(bar.cast(from, to).is_none(), "{from}");
        }
    }
}
