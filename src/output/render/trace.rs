//! Rays, lamps and pixels.
use super::camera::{Bounds, Frame};
use super::shapes::{Capsule, Convex};
use super::{Image, PictureInput, Surface, colour};
use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode, TraversalAction};
use rayon::prelude::*;

/// Rays per pixel along one side of the pixel.
const GRID: u32 = 2;
/// Occlusion rays per hit.
const OCCLUSION: u32 = 2;
/// Part of the picture left free around the subject.
const MARGIN: f64 = 0.05;

struct Stage {
    capsules: Vec<Capsule>,
    bvh: Bvh,
    solids: Vec<Convex>,
    albedo: Vec<DVec3>,
    frame: Frame,
    lamp: DVec3,
    /// Length over which neighbours darken each other.
    reach: f64,
    /// Lift of secondary rays off the surface.
    lift: f64,
}

struct Hit {
    point: DVec3,
    normal: DVec3,
    albedo: DVec3,
}

pub(super) fn render(input: &PictureInput, width: u32, height: u32) -> Image {
    let frame = Frame::new(&input.view);
    let mut bounds = Bounds::EMPTY;
    let mut world = Bounds::EMPTY;
    for t in &input.tubes {
        for p in t.points.iter().filter(|p| p.is_finite()) {
            bounds.add(frame.project(*p), t.radius);
            world.add(*p, t.radius);
        }
    }
    if bounds.is_empty() {
        (bounds, world) = (Bounds { min: -DVec3::ONE, max: DVec3::ONE }, Bounds { min: -DVec3::ONE, max: DVec3::ONE });
    }
    let solids: Vec<Convex> = input.surfaces.iter().map(|s| solid(s, input, &world, &frame, &mut bounds)).collect();
    let size = bounds.max - bounds.min;
    let capsules = capsules(input);
    let boxes: Vec<Aabb> = capsules.iter().map(|c| Aabb::new(c.a.min(c.b) - c.radius, c.a.max(c.b) + c.radius)).collect();
    let stage = Stage {
        bvh: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
        albedo: input.tubes.iter().map(|t| linear(colour(t.colour)) * t.shade).collect(),
        lamp: (frame.eye * 0.62 + frame.up * 0.66 - frame.right * 0.42).normalize(),
        reach: 0.16 * size.x.min(size.y).max(0.1 * size.x.max(size.y)),
        lift: 1e-6 * size.max_element(),
        capsules,
        solids,
        frame,
    };
    let scale = (size.x / (f64::from(width) * (1.0 - 2.0 * MARGIN))).max(size.y / (f64::from(height) * (1.0 - 2.0 * MARGIN)));
    let centre = 0.5 * (bounds.min + bounds.max);
    let start = bounds.max.z + 0.1 * size.max_element();
    let mut pixels = vec![0u8; 3 * (width * height) as usize];
    pixels.par_chunks_mut(3 * width as usize).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let mut sum = DVec3::ZERO;
            for sub in 0..GRID * GRID {
                let cell = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
                let across = (x as f64 + cell(sub % GRID) - 0.5 * f64::from(width)) * scale + centre.x;
                let up = (0.5 * f64::from(height) - y as f64 - cell(sub / GRID)) * scale + centre.y;
                let origin = stage.frame.right * across + stage.frame.up * up + stage.frame.eye * start;
                let seed = hash((y as u32 * width + x as u32) * GRID * GRID + sub);
                // Encoded before averaging: bright edges against the white paper stay smooth.
                sum += encode(stage.shade(origin, -stage.frame.eye, seed));
            }
            let mean = sum / f64::from(GRID * GRID);
            for (byte, c) in pixel.iter_mut().zip(mean.to_array()) {
                *byte = (255.0 * c + 0.5) as u8;
            }
        }
    });
    Image { width, height, pixels }
}

fn capsules(input: &PictureInput) -> Vec<Capsule> {
    let mut out = Vec::new();
    for (tube, t) in input.tubes.iter().enumerate() {
        let p = &t.points;
        let last = p.len().saturating_sub(1);
        let tangent = |i: usize| (p[(i + 1).min(last)] - p[i.saturating_sub(1)]).normalize_or_zero();
        for i in 0..last {
            if p[i].is_finite() && p[i + 1].is_finite() {
                out.push(Capsule { a: p[i], b: p[i + 1], ta: tangent(i), tb: tangent(i + 1), radius: t.radius, tube: tube as u32 });
            }
        }
    }
    out
}

/// Half spaces of a surface, cut to a little more than the filaments; grows the picture's bounds.
fn solid(surface: &Surface, input: &PictureInput, world: &Bounds, frame: &Frame, bounds: &mut Bounds) -> Convex {
    let cut = |axis: DVec3, overhang: f64| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (t, p) in input.tubes.iter().flat_map(|t| t.points.iter().map(move |p| (t, p))).filter(|(_, p)| p.is_finite()) {
            low = low.min(p.dot(axis) - t.radius);
            high = high.max(p.dot(axis) + t.radius);
        }
        if low > high {
            (low, high) = (-1.0, 1.0);
        }
        let more = overhang * (high - low).max(1e-3 * (world.max - world.min).length());
        (low - more, high + more)
    };
    match surface {
        Surface::Prism { axis, corners } => {
            let a = axis.normalize_or(DVec3::Z);
            let (low, high) = cut(a, 0.08);
            let centre = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
            let mut planes = vec![(a, high), (-a, -low)];
            for (i, p) in corners.iter().enumerate() {
                let edge = corners[(i + 1) % corners.len()] - *p;
                let n = edge.cross(a).normalize_or_zero();
                let n = if n.dot(*p - centre) < 0.0 { -n } else { n };
                planes.push((n, n.dot(*p)));
                let foot = *p - p.dot(a) * a;
                bounds.add(frame.project(foot + low * a), 0.0);
                bounds.add(frame.project(foot + high * a), 0.0);
            }
            Convex { planes, bar: None }
        }
        Surface::Cylinder { centre, axis, radius } => {
            let a = axis.normalize_or(DVec3::Z);
            let (low, high) = cut(a, 0.08);
            // Its ends are two circles.
            for end in [low, high] {
                let at = frame.project(*centre + (end - centre.dot(a)) * a);
                let half = |d: DVec3| radius * (1.0 - d.dot(a) * d.dot(a)).max(0.0).sqrt();
                let half = DVec3::new(half(frame.right), half(frame.up), half(frame.eye));
                bounds.add(at - half, 0.0);
                bounds.add(at + half, 0.0);
            }
            Convex { planes: vec![(a, high), (-a, -low)], bar: Some((*centre, a, *radius)) }
        }
        Surface::Plane { point, normal } => {
            let n = normal.normalize_or(DVec3::Z);
            let u = n.any_orthonormal_vector();
            let mut planes = vec![(n, n.dot(*point)), (-n, -n.dot(*point) + 0.004 * (world.max - world.min).length())];
            let sides = [u, n.cross(u)].map(|s| (s, cut(s, 0.12)));
            for (s, (low, high)) in sides {
                planes.extend([(s, high), (-s, -low)]);
            }
            for i in 0..4 {
                let pick = |k: usize| if i >> k & 1 == 0 { sides[k].1.0 } else { sides[k].1.1 };
                bounds.add(frame.project(n * n.dot(*point) + sides[0].0 * pick(0) + sides[1].0 * pick(1)), 0.0);
            }
            Convex { planes, bar: None }
        }
    }
}

/// Linear light from 8-bit sRGB (gamma 2.2).
fn linear(c: [u8; 3]) -> DVec3 {
    DVec3::from_array(c.map(|b| (f64::from(b) / 255.0).powf(2.2)))
}

fn encode(light: DVec3) -> DVec3 {
    DVec3::from_array(light.to_array().map(|l| l.clamp(0.0, 1.0).powf(1.0 / 2.2)))
}

/// Scrambles the bits of a number (the finaliser of MurmurHash3, Appleby).
fn hash(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x85eb_ca6b);
    x ^= x >> 13;
    x = x.wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

fn unit(x: u32) -> f64 {
    f64::from(x) / f64::from(u32::MAX)
}

/// Distance at which the ray enters the box of a node; `f64::MAX` if it does not.
fn enter(node: &BvhNode, origin: DVec3, inverse: DVec3) -> f64 {
    let (t1, t2) = ((node.mins() - origin) * inverse, (node.maxs() - origin) * inverse);
    let near = t1.min(t2).max_element().max(0.0);
    let far = t1.max(t2).min_element();
    if near <= far { near } else { f64::MAX }
}

impl Stage {
    fn first(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let inverse = direction.recip();
        let mut best = f64::MAX;
        let mut hit = None;
        if let Some((leaf, t)) =
            self.bvh.find_best(best, |n: &BvhNode, _| enter(n, origin, inverse), |i, _| self.capsules[i as usize].cast(origin, direction))
        {
            let c = &self.capsules[leaf as usize];
            let point = origin + t * direction;
            best = t;
            hit = Some(Hit { point, normal: c.normal(point), albedo: self.albedo[c.tube as usize] });
        }
        for s in &self.solids {
            if let Some((t, normal)) = s.cast(origin, direction).filter(|(t, _)| *t < best) {
                best = t;
                hit = Some(Hit { point: origin + t * direction, normal, albedo: DVec3::splat(0.42) });
            }
        }
        hit
    }

    /// True if anything lies within `reach` along the ray.
    fn blocked(&self, origin: DVec3, direction: DVec3, reach: f64) -> bool {
        if self.solids.iter().any(|s| s.cast(origin, direction).is_some_and(|(t, _)| t < reach)) {
            return true;
        }
        let inverse = direction.recip();
        let mut found = false;
        self.bvh.traverse(|node| {
            if enter(node, origin, inverse) >= reach {
                return TraversalAction::Prune;
            }
            if let Some(leaf) = node.leaf_data() {
                found = self.capsules[leaf as usize].cast(origin, direction).is_some_and(|t| t < reach);
            }
            if found { TraversalAction::EarlyExit } else { TraversalAction::Continue }
        });
        found
    }

    fn shade(&self, origin: DVec3, direction: DVec3, seed: u32) -> DVec3 {
        let Some(hit) = self.first(origin, direction) else { return DVec3::ONE };
        let start = hit.point + hit.normal * self.lift;
        let facing = hit.normal.dot(self.lamp);
        let lit = facing > 0.0 && !self.blocked(start, self.lamp, f64::MAX);
        let open = self.openness(start, hit.normal, seed);
        let sky = 0.5 + 0.5 * hit.normal.dot(self.frame.up);
        let diffuse = open * (0.36 + 0.30 * sky) + if lit { 0.80 * facing } else { 0.0 };
        let half = (self.lamp - direction).normalize();
        let gloss = if lit { 0.16 * hit.normal.dot(half).max(0.0).powi(40) } else { 0.0 };
        hit.albedo * diffuse + gloss
    }

    /// Part of the sky that a point sees within `reach`, cosine weighted.
    fn openness(&self, start: DVec3, normal: DVec3, seed: u32) -> f64 {
        let u = normal.any_orthonormal_vector();
        let v = normal.cross(u);
        let turn = unit(seed);
        let free = (0..OCCLUSION).filter(|k| {
            let angle = std::f64::consts::TAU * ((f64::from(*k) + turn) / f64::from(OCCLUSION));
            let height = (f64::from(*k) + unit(hash(seed ^ (k + 1)))) / f64::from(OCCLUSION);
            let (s, c) = angle.sin_cos();
            let flat = height.sqrt();
            let direction = flat * (c * u + s * v) + (1.0 - height).max(0.0).sqrt() * normal;
            !self.blocked(start, direction, self.reach)
        });
        free.count() as f64 / f64::from(OCCLUSION)
    }
}
