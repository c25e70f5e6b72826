//! Whether filaments still cross in the order in which they were laid.
//!
//! Seen radially from the z axis two filaments cross where they have the same azimuth and height. Each
//! crossing counts orientation x order: +1 or -1 by the sense in which the first passes the
//! second, times +1 or -1 for outside or inside. As long as filaments do not pass through each other, the sum
//! over all crossings of a pair stays what it was, however wavy they get: new crossings come in
//! pairs of opposite orientation and equal order (the second Reidemeister move).
use super::line::{TowLine, Trace};
use crate::generate::{BraidLayout, Crossing, TowId};
use glam::{DQuat, DVec3};

/// Two filaments whose order is not that of the pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passage {
    /// The crossing in the pattern.
    pub crossing: Crossing,
    /// Filament of the A tow, by its number in the tow.
    pub plus: usize,
    /// Filament of the B tow, by its number in the tow.
    pub minus: usize,
    /// Sum of orientation x order now; the pattern has +1 or -1.
    pub sum: i32,
}

/// Sum of orientation x order over the crossings of two polylines seen from the z axis.
///
/// Regular structures cross exactly at common vertices, where rounding decides to which segments
/// the crossing belongs; so the second line is turned about the axis by a millionth of a radian
/// first, which moves crossings off the vertices and no filament past another.
pub fn signed_crossings(a: &[DVec3], b: &[DVec3]) -> i32 {
    let turn = DQuat::from_rotation_z(1e-6);
    let b: Vec<DVec3> = b.iter().map(|x| turn * *x).collect();
    let mut sum = 0;
    for p in a.windows(2) {
        let (low, high) = (p[0].z.min(p[1].z), p[0].z.max(p[1].z));
        for q in b.windows(2) {
            if q[0].z.max(q[1].z) < low || q[0].z.min(q[1].z) > high {
                continue;
            }
            sum += segments([p[0], p[1]], [q[0], q[1]]);
        }
    }
    sum
}

/// The same for two segments. With p(s) and q(t) at one height, the condition of one azimuth,
/// p_x q_y = p_y q_x, is quadratic in the one parameter that is left.
fn segments(p: [DVec3; 2], q: [DVec3; 2]) -> i32 {
    let (u, v) = (p[1] - p[0], q[1] - q[0]);
    if u.z.abs() > v.z.abs() {
        // Express the parameter of the steeper segment by the other one; swapping the two reverses
        // orientation and order, so the product stays.
        return segments(q, p);
    }
    if v.z == 0.0 {
        return 0;
    }
    let (t0, t1) = ((p[0].z - q[0].z) / v.z, u.z / v.z);
    let (q0, q1) = (q[0] + v * t0, v * t1);
    let cross = |a: DVec3, b: DVec3| a.x * b.y - a.y * b.x;
    let coefficients = [cross(p[0], q0), cross(p[0], q1) + cross(u, q0), cross(u, q1)];
    let mut sum = 0;
    for s in roots(coefficients).into_iter().flatten() {
        let t = t0 + t1 * s;
        // Half-open, so that a crossing at a common point of two segments counts once.
        if !(0.0..1.0).contains(&s) || !(0.0..1.0).contains(&t) {
            continue;
        }
        let (a, b) = (p[0] + u * s, q[0] + v * t);
        let radial = DVec3::new(a.x + b.x, a.y + b.y, 0.0);
        if a.x * b.x + a.y * b.y <= 0.0 {
            continue;
        }
        let orientation = if u.cross(v).dot(radial) > 0.0 { 1 } else { -1 };
        let order = if a.x.hypot(a.y) > b.x.hypot(b.y) { 1 } else { -1 };
        sum += orientation * order;
    }
    sum
}

/// Real roots of c0 + c1 s + c2 s^2, without cancellation.
fn roots([c, b, a]: [f64; 3]) -> [Option<f64>; 2] {
    let discriminant = b * b - 4.0 * a * c;
    if discriminant < 0.0 {
        return [None, None];
    }
    let w = -0.5 * (b + discriminant.sqrt().copysign(b));
    [(w != 0.0).then(|| c / w), (a != 0.0 && discriminant > 0.0).then(|| w / a)]
}

/// All pairs of filaments that no longer cross as the pattern has it.
pub fn passages(layout: &BraidLayout, traces: &[Trace], period: DVec3) -> Vec<Passage> {
    let lines: Vec<TowLine> = (0..layout.tows.len()).map(|t| TowLine::of_braid(layout, traces, period, t)).collect();
    let spacing = layout.elements as f64 / layout.geometry.crossings_per_tow() as f64;
    let g = &layout.geometry;
    let mut found = Vec::new();
    for c in &layout.crossings {
        let ids = [TowId { plus: true, index: c.plus }, TowId { plus: false, index: c.minus }];
        let [u, v] = ids.map(|id| g.slope(id, c.z));
        let orientation = if u.cross(v).dot(DVec3::new(c.point.x, c.point.y, 0.0)) > 0.0 { 1 } else { -1 };
        let expected = if c.plus_on_top { orientation } else { -orientation };
        let [a, b] = ids.map(|id| &lines[layout.tow(id)]);
        let window = |line: &TowLine| {
            let at = line.start as f64 + spacing * c.m as f64;
            (at - spacing).floor() as usize..((at + spacing).ceil() as usize + 1).min(line.centre.len())
        };
        let (wa, wb) = (window(a), window(b));
        for (plus, fa) in a.filaments.iter().enumerate() {
            for (minus, fb) in b.filaments.iter().enumerate() {
                let sum = signed_crossings(&fa[wa.clone()], &fb[wb.clone()]);
                if sum != expected {
                    found.push(Passage { crossing: *c, plus, minus, sum });
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn helix(rho: f64, sign: f64, wave: f64) -> Vec<DVec3> {
        (0..=80)
            .map(|i| {
                let z = 0.02 * f64::from(i) - 0.803;
                let phi = sign * z + wave * (20.0 * z).sin();
                DVec3::new(rho * phi.cos(), rho * phi.sin(), z)
            })
            .collect()
    }

    #[test]
    fn order_and_orientation_of_two_helices() {
        let (outer, inner) = (helix(1.1, 1.0, 0.0), helix(1.0, -1.0, 0.0));
        let sum = signed_crossings(&outer, &inner);
        assert_eq!(sum.abs(), 1);
        assert_eq!(signed_crossings(&inner, &outer), sum, "the same seen from either filament");
        // The outer one moved inside: it has passed through.
        assert_eq!(signed_crossings(&helix(0.9, 1.0, 0.0), &inner), -sum);
        let beside: Vec<DVec3> = helix(1.0, 1.0, 0.0).iter().map(|p| DQuat::from_rotation_z(0.2) * *p).collect();
        assert_eq!(signed_crossings(&outer, &beside), 0, "parallel filaments do not cross");
    }

    #[test]
    fn waves_add_pairs_of_crossings_that_cancel() {
        let inner = helix(1.0, -1.0, 0.0);
        let straight = signed_crossings(&helix(1.1, 1.0, 0.0), &inner);
        for wave in [0.01, 0.05, 0.15, 0.3] {
            assert_eq!(signed_crossings(&helix(1.1, 1.0, wave), &inner), straight, "wave {wave}");
        }
    }

    #[test]
    fn crossings_behind_the_axis_are_not_seen() {
        let a = [DVec3::new(1.0, -0.1, -0.1), DVec3::new(1.0, 0.1, 0.1)];
        let b = [DVec3::new(-1.0, -0.1, 0.1), DVec3::new(-1.0, 0.1, -0.1)];
        assert_eq!(signed_crossings(&a, &b), 0);
        let front = b.map(|p| DVec3::new(1.2, p.y, p.z));
        assert_eq!(signed_crossings(&a, &front).abs(), 1);
    }
}
