//! The C1 centreline of a filament.
//!
//! On the segment between two nodes the centreline is the cubic Hermite curve through both nodes
//! with tangents from the non-uniform three-point difference of the node positions; with equal
//! segments this is the Catmull-Rom spline (Catmull and Rom 1974). Beyond a free end it goes on
//! straight; towards another segment the cubic goes on a little, for the moment until a contact
//! point is handed over.
use braid_ecs::prelude::{Lane, V3};

/// Values of the four Hermite functions: weights of first node, second node, first tangent and
/// second tangent (the tangents still to be multiplied by the segment length).
#[derive(Clone, Copy, Debug)]
pub struct Weights<L> {
    /// Weight of the first node.
    pub a: L,
    /// Weight of the second node.
    pub b: L,
    /// Weight of the first tangent x length.
    pub ta: L,
    /// Weight of the second tangent x length.
    pub tb: L,
}

/// How far the cubic goes on into the neighbouring segment.
const BEYOND: f64 = 0.25;

/// Interval of the parameter in which the cubic holds; it goes on straight outside.
#[derive(Clone, Copy, Debug)]
pub struct Range<L> {
    /// Lower end.
    pub low: L,
    /// Upper end.
    pub high: L,
}

impl<L: Lane> Range<L> {
    /// From what `free` says about lower and upper end of the segment in each lane.
    #[inline(always)]
    pub fn new(free: impl Fn(usize) -> [bool; 2]) -> Self {
        Range {
            low: L::from_fn(|l| if free(l)[0] { 0.0 } else { -BEYOND }),
            high: L::from_fn(|l| if free(l)[1] { 1.0 } else { 1.0 + BEYOND }),
        }
    }
}

/// Weights at parameter `t`.
#[inline(always)]
pub fn weights<L: Lane>(t: L, range: Range<L>) -> Weights<L> {
    let (one, two, three) = (L::splat(1.0), L::splat(2.0), L::splat(3.0));
    let s = t.within(range.low, range.high);
    let e = t - s;
    let s2 = s * s;
    let b = s2 * (three - two * s);
    let db = L::splat(6.0) * s * (one - s);
    let ta = s * (one - s) * (one - s);
    let dta = one - s * (L::splat(4.0) - three * s);
    let tb = s2 * (s - one);
    let dtb = s * (three * s - two);
    let b = b + db * e;
    Weights { a: one - b, b, ta: ta + dta * e, tb: tb + dtb * e }
}

/// A segment of centreline relative to its first node.
#[derive(Clone, Copy, Debug)]
pub struct Segment<L> {
    c1: V3<L>,
    c2: V3<L>,
    c3: V3<L>,
    /// Where the cubic holds.
    pub range: Range<L>,
}

/// Point and parameter derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Point<L> {
    /// Position relative to the first node of the segment.
    pub x: V3<L>,
    /// First derivative by the parameter.
    pub d: V3<L>,
    /// Second derivative by the parameter.
    pub dd: V3<L>,
}

impl<L: Lane> Segment<L> {
    /// From the chord and the two tangents already multiplied by the segment length.
    #[inline(always)]
    pub fn new(chord: V3<L>, ta: V3<L>, tb: V3<L>, range: Range<L>) -> Self {
        let (two, three) = (L::splat(2.0), L::splat(3.0));
        Segment { c1: ta, c2: chord * three - ta * two - tb, c3: ta + tb - chord * two, range }
    }

    /// The point at parameter `t`.
    #[inline(always)]
    pub fn at(&self, t: L) -> Point<L> {
        let (two, three, six) = (L::splat(2.0), L::splat(3.0), L::splat(6.0));
        let s = t.within(self.range.low, self.range.high);
        let e = t - s;
        let d = (self.c3 * (three * s) + self.c2 * two) * s + self.c1;
        let x = ((self.c3 * s + self.c2) * s + self.c1) * s + d * e;
        let dd = self.c3 * (six * s) + self.c2 * two;
        let outside = (e * e).upper(L::splat(0.0));
        let inside = outside.less(L::splat(f64::MIN_POSITIVE));
        Point { x, d, dd: V3::pick(inside, dd, V3::zero()) }
    }
}

/// Coefficients of the tangent at a node from three positions in a row, and the place of the first
/// of them relative to the node. `lengths` are those of the two segments before and the two after
/// it, zero where there is none. At a free end the parabola through the last three nodes counts,
/// or the chord if there are only two.
pub fn tangent_stencil(lengths: [f64; 4]) -> ([f64; 3], isize) {
    let [l2, l1, r1, r2] = lengths;
    if l1 > 0.0 && r1 > 0.0 {
        let sum = l1 + r1;
        return ([-r1 / (l1 * sum), (r1 - l1) / (l1 * r1), l1 / (r1 * sum)], -1);
    }
    // Slope of the parabola at its first point.
    let parabola = |h: f64, g: f64| [-(2.0 * h + g) / (h * (h + g)), (h + g) / (h * g), -h / (g * (h + g))];
    if r1 > 0.0 {
        return if r2 > 0.0 { (parabola(r1, r2), 0) } else { ([0.0, -1.0 / r1, 1.0 / r1], -1) };
    }
    if l1 > 0.0 {
        let p = parabola(l1, l2);
        return if l2 > 0.0 { ([-p[2], -p[1], -p[0]], -2) } else { ([-1.0 / l1, 1.0 / l1, 0.0], -1) };
    }
    ([0.0; 3], -1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const INSIDE: Range<f64> = Range { low: 0.0, high: 1.0 };

    #[test]
    fn equal_segments_give_catmull_rom() {
        assert_eq!(tangent_stencil([2.0; 4]), ([-0.25, 0.0, 0.25], -1));
        let p = [0.0, 1.0, 0.5, -2.0];
        let tangent = |i: usize| (p[i + 1] - p[i - 1]) / 2.0;
        for t in [0.0, 0.2, 0.7, 1.0] {
            let w = weights::<f64>(t, INSIDE);
            let here = w.a * p[1] + w.b * p[2] + w.ta * tangent(1) + w.tb * tangent(2);
            let (t2, t3) = (t * t, t * t * t);
            let known = 0.5
                * (2.0 * p[1]
                    + (p[2] - p[0]) * t
                    + (2.0 * p[0] - 5.0 * p[1] + 4.0 * p[2] - p[3]) * t2
                    + (3.0 * p[1] - p[0] - 3.0 * p[2] + p[3]) * t3);
            assert!((here - known).abs() < 1e-15, "{here} {known}");
        }
    }

    #[test]
    fn tangents_of_graded_nodes_are_exact_for_parabolas() {
        let x = [1.0, 1.5, 3.5, 4.0];
        let f = |x: f64| 2.0 * x * x - x + 4.0;
        let lengths = |i: isize| if (0..3).contains(&i) { x[i as usize + 1] - x[i as usize] } else { 0.0 };
        for i in 0..4isize {
            let (w, first) = tangent_stencil([lengths(i - 2), lengths(i - 1), lengths(i), lengths(i + 1)]);
            let slope: f64 = (0..3).map(|k| w[k] * f(x[(i + first) as usize + k])).sum();
            assert!((slope - (4.0 * x[i as usize] - 1.0)).abs() < 1e-12, "node {i}");
        }
    }

    #[test]
    fn weights_and_polynomial_agree_also_outside() {
        let v = |x: f64, y: f64, z: f64| V3::<f64>::new(x, y, z);
        let (chord, ta, tb) = (v(1.0, 0.2, 0.0), v(1.0, 0.5, -0.1), v(0.9, -0.3, 0.4));
        for (t, free) in [-0.5, -0.1, 0.0, 0.3, 1.0, 1.2, 1.4].into_iter().flat_map(|t| [(t, false), (t, true)]) {
            let range = Range::new(|_| [free; 2]);
            let s = Segment::new(chord, ta, tb, range);
            let w = weights(t, range);
            let p = chord * w.b + ta * w.ta + tb * w.tb;
            let q = s.at(t).x;
            assert!((p.x - q.x).abs() + (p.y - q.y).abs() + (p.z - q.z).abs() < 1e-14);
        }
    }
}
