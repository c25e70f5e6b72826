//! Which pairs of segments come near each other on their forecast ways, four pairs at a time.
//!
//! The distance of two segments is computed here with relative tolerances: the routine of parry
//! compares with absolute ones and fails for lengths given in metres.
use super::search::Candidate;
use braid_ecs::prelude::*;

/// The way of a segment during a list: where it is half way, and how it gets there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Way {
    /// First node half way, and what surrounds the segment: radius, room and bulge (length).
    start: [f64; 4],
    /// From the first node to the second half way, and half the difference of their motion (length).
    chord: [f64; 4],
    /// Mean motion of both nodes until half way (length).
    motion: [f64; 4],
}

impl Way {
    /// Of the segment between two nodes that are at `x` now and have moved by `y` half way, with what surrounds it.
    pub fn new(x: [DVec3; 2], y: [DVec3; 2], around: f64) -> Self {
        let row = |v: DVec3, w: f64| [v.x, v.y, v.z, w];
        let [a, b] = [x[0] + y[0], x[1] + y[1]];
        Way { start: row(a, around), chord: row(b - a, 0.5 * (y[1] - y[0]).length()), motion: row(0.5 * (y[0] + y[1]), 0.0) }
    }
}

/// An image half way, and how it gets there.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImageWay {
    /// Vector half way (length).
    pub shift: DVec3,
    /// Motion until half way (length).
    pub motion: DVec3,
}

/// Those of the pairs whose segments come closer than what surrounds them: half way through, no farther apart than that
/// plus half of what they move against each other. Ways by slot, images by number.
pub fn near(ways: &[Way], images: &[ImageWay], pairs: &[Candidate]) -> Vec<Candidate> {
    let mut out = Vec::with_capacity(pairs.len() / 4);
    for group in lane::groups(pairs.len()) {
        let pairs = &pairs[group];
        if pairs.len() == f64x4::WIDTH {
            let inside = inside::<f64x4>(ways, images, pairs).to_array();
            out.extend(pairs.iter().zip(inside).filter(|(_, inside)| *inside > 0.0).map(|(c, _)| *c));
        } else if inside::<f64>(ways, images, pairs) > 0.0 {
            out.push(pairs[0]);
        }
    }
    out
}

/// Start with what surrounds it, chord with the spread, and motion of the ways of all lanes.
#[inline(always)]
fn side<'a, L: Lane>(way: impl Fn(usize) -> &'a Way) -> ((V3<L>, L), (V3<L>, L), V3<L>) {
    let split = |[x, y, z, w]: [L; 4]| (V3::new(x, y, z), w);
    (split(L::rows(|l| way(l).start)), split(L::rows(|l| way(l).chord)), split(L::rows(|l| way(l).motion)).0)
}

/// Square of the distance within which segments count as near, less that of theirs.
#[inline(always)]
fn inside<L: Lane>(ways: &[Way], images: &[ImageWay], pairs: &[Candidate]) -> L {
    let ((p, around_a), (u, spread_a), motion_a) = side::<L>(|l| &ways[pairs[l].a as usize]);
    let ((q, around_b), (v, spread_b), motion_b) = side::<L>(|l| &ways[pairs[l].b as usize]);
    let image = |l: usize| &images[pairs[l].image as usize];
    let moved = motion_a - motion_b - V3::gather(|l| image(l).motion);
    let approach = moved.dot(moved).sqrt() + spread_a + spread_b;
    let w = p - q - V3::gather(|l| image(l).shift);
    let (s, t) = closest_parameters(u, v, w);
    let apart = w + u * s - v * t;
    let reach = around_a + around_b + approach;
    reach * reach - apart.dot(apart)
}

/// Parameters of the closest points of two segments with these chords; `w` goes from the first node of the second one
/// to that of the first (C. Ericson, *Real-Time Collision Detection* (2005), section 5.1.9, with relative tolerances).
#[inline(always)]
pub fn closest_parameters<L: Lane>(u: V3<L>, v: V3<L>, w: V3<L>) -> (L, L) {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let (a, b, e, c, f) = (u.dot(u), u.dot(v), v.dot(v), u.dot(w), v.dot(w));
    let over = |x: L, y: L| L::pick(zero.less(y), x / y, zero);
    let den = a * e - b * b;
    let s = L::pick((L::splat(1e-12) * a * e).less(den), over(b * f - c * e, den).within(zero, one), zero);
    let t = over(b * s + f, e);
    let (below, above) = (t.less(zero), one.less(t));
    let s = L::pick(below, over(-c, a).within(zero, one), L::pick(above, over(b - c, a).within(zero, one), s));
    (s, t.within(zero, one))
}

/// Squared distance of two segments.
pub fn segment_distance_squared(p: DVec3, p2: DVec3, q: DVec3, q2: DVec3) -> f64 {
    let (s, t) = closest_parameters::<f64>((p2 - p).into(), (q2 - q).into(), (p - q).into());
    (p + (p2 - p) * s - q - (q2 - q) * t).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_pairs_at_once_are_as_near_as_each_alone() {
        let mut k = 0.0;
        let mut vector = |size: f64| {
            k += 1.0;
            size * DVec3::new(f64::sin(13.0 * k), f64::sin(21.0 * k), f64::sin(34.0 * k))
        };
        let ways: Vec<Way> = (0..40)
            .map(|_| {
                let (a, along) = (vector(1.0), vector(1.0));
                Way::new([a, a + along], [vector(0.1), vector(0.1)], 0.1)
            })
            .collect();
        let images = [ImageWay::default(), ImageWay { shift: vector(1.0), motion: vector(0.1) }];
        let pairs: Vec<Candidate> = (0..40u32).flat_map(|a| (0..a).map(move |b| Candidate { a, b, image: ((a + b) % 2) as u8 })).collect();
        let alone: Vec<Candidate> = pairs.iter().flat_map(|c| near(&ways, &images, std::slice::from_ref(c))).collect();
        assert!(alone.len() > 50 && alone.len() < pairs.len() - 50, "{} of {}", alone.len(), pairs.len());
        assert_eq!(near(&ways, &images, &pairs), alone);
    }
}
