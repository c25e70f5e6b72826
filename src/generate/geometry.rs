//! The biaxial braid: geometry of its tows and the pattern of its crossings.
//!
//! Half of the tows (A, "+") wind with the hand of the braid, half (B, "-") against it. With n tows
//! each way, pitch p and azimuth measured with the hand, A_i is at 2 pi i / n + 2 pi z / p and B_j
//! at 2 pi j / n - 2 pi z / p. Crossing m of A_i lies at z = p m / (2 n), where it meets
//! B_(i + m). A is on top there if (2 i + m) mod 2k < k with k = 1 (diamond, 1/1), 2 (regular, 2/2)
//! or 3 (Hercules, 3/3); going once round adds 2 n, so the pattern closes if n is a multiple of k.
//!
//! The radius is R + a at a crossing on top and R - a below, with half a cosine in between. Moving by
//! h = p / n carries A_k into A_(k+1) and B_k into B_(k-1), pattern included: the smallest cell that
//! repeats by translation is one n-th of a turn long, and every tow leaves it where its successor
//! enters.
use super::braid::Cell;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A tow by direction and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TowId {
    /// True for the A tows, which wind with the hand of the braid.
    pub plus: bool,
    /// Number among the tows of its direction.
    pub index: usize,
}

/// A place where an A tow and a B tow cross.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Number of the A tow.
    pub plus: usize,
    /// Number of the B tow.
    pub minus: usize,
    /// Number of the crossing along both tows; it lies at z = pitch m / (2 n).
    pub m: usize,
    /// Height in the initial configuration (length).
    pub z: f64,
    /// Point on the mean cylinder in the initial configuration (length).
    pub point: DVec3,
    /// True if the A tow is on top, that is outside.
    pub plus_on_top: bool,
}

/// Centre lines of the tows of a braid as functions of z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BraidGeometry {
    /// Tows of one direction, n.
    pub per_direction: usize,
    /// Mean helix radius (length).
    pub radius: f64,
    /// Length of one turn (length).
    pub pitch: f64,
    /// Radial amplitude (length).
    pub undulation: f64,
    /// Crossings over and under in a row.
    pub float: usize,
    /// Periodic cell.
    pub cell: Cell,
    /// +1 for right-handed A tows, -1 for left-handed ones.
    pub hand: f64,
}

impl BraidGeometry {
    /// Height h of the periodic cell.
    pub fn cell_length(&self) -> f64 {
        match self.cell {
            Cell::SixthTurn => self.pitch / self.per_direction as f64,
            Cell::FullTurn => self.pitch,
        }
    }

    /// Crossings of one tow inside the cell.
    pub fn crossings_per_tow(&self) -> usize {
        match self.cell {
            Cell::SixthTurn => 2,
            Cell::FullTurn => 2 * self.per_direction,
        }
    }

    /// All tows, A first.
    pub fn tows(&self) -> impl Iterator<Item = TowId> {
        let n = self.per_direction;
        (0..2 * n).map(move |t| TowId { plus: t < n, index: t % n })
    }

    /// The tow that enters the cell where `tow` leaves it.
    pub fn successor(&self, tow: TowId) -> TowId {
        let n = self.per_direction;
        let index = match (self.cell, tow.plus) {
            (Cell::FullTurn, _) => tow.index,
            (Cell::SixthTurn, true) => (tow.index + 1) % n,
            (Cell::SixthTurn, false) => (tow.index + n - 1) % n,
        };
        TowId { index, ..tow }
    }

    /// Whether the tow is the outer one at its crossing `m`.
    pub fn on_top(&self, tow: TowId, m: i64) -> bool {
        let (i, k) = (tow.index as i64, self.float as i64);
        // With j = i + m the rule (i + j) mod 2k < k, written with the number of either tow.
        if tow.plus { (2 * i + m).rem_euclid(2 * k) < k } else { (2 * i - m).rem_euclid(2 * k) >= k }
    }

    /// Crossing `m` of A tow `plus`.
    pub fn crossing(&self, plus: usize, m: usize) -> Crossing {
        let n = self.per_direction;
        let z = self.pitch * m as f64 / (2 * n) as f64;
        let azimuth = self.azimuth(TowId { plus: true, index: plus }, z);
        Crossing {
            plus,
            minus: (plus + m) % n,
            m,
            z,
            point: DVec3::new(self.radius * azimuth.cos(), self.radius * azimuth.sin(), z),
            plus_on_top: self.on_top(TowId { plus: true, index: plus }, m as i64),
        }
    }

    /// All crossings of the cell, tow by tow: each once, those on the faces at z = 0.
    pub fn crossings(&self) -> Vec<Crossing> {
        (0..self.per_direction).flat_map(|i| (0..self.crossings_per_tow()).map(move |m| self.crossing(i, m))).collect()
    }

    fn azimuth(&self, tow: TowId, z: f64) -> f64 {
        let turn = if tow.plus { z / self.pitch } else { -z / self.pitch };
        self.hand * TAU * (tow.index as f64 / self.per_direction as f64 + turn)
    }

    /// Radius of the centre line and its derivative by z.
    fn radial(&self, tow: TowId, z: f64) -> (f64, f64) {
        let per_length = 2.0 * self.per_direction as f64 / self.pitch;
        let m = (z * per_length).floor();
        let f = z * per_length - m;
        let sign = |m: i64| if self.on_top(tow, m) { 1.0 } else { -1.0 };
        let (here, next) = (sign(m as i64), sign(m as i64 + 1));
        let mean = 0.5 * (here + next);
        let half = 0.5 * (here - next);
        (self.radius + self.undulation * (mean + half * (PI * f).cos()), -self.undulation * half * PI * per_length * (PI * f).sin())
    }

    /// Point of the centre line at height z.
    pub fn centre(&self, tow: TowId, z: f64) -> DVec3 {
        let phi = self.azimuth(tow, z);
        let (rho, _) = self.radial(tow, z);
        DVec3::new(rho * phi.cos(), rho * phi.sin(), z)
    }

    /// Derivative of the centre line by z.
    pub fn slope(&self, tow: TowId, z: f64) -> DVec3 {
        let phi = self.azimuth(tow, z);
        let (rho, drho) = self.radial(tow, z);
        let dphi = self.hand * TAU / self.pitch * if tow.plus { 1.0 } else { -1.0 };
        DVec3::new(drho * phi.cos() - rho * dphi * phi.sin(), drho * phi.sin() + rho * dphi * phi.cos(), 1.0)
    }

    /// Axes of the section normal to the centre line: outward and sideways. They turn with the
    /// azimuth, so the section of a tow at the end of the cell is that of its successor at the start.
    pub fn section_axes(&self, tow: TowId, z: f64) -> [DVec3; 2] {
        let phi = self.azimuth(tow, z);
        let tangent = self.slope(tow, z).normalize();
        let radial = DVec3::new(phi.cos(), phi.sin(), 0.0);
        let outward = (radial - tangent * tangent.dot(radial)).normalize();
        [outward, tangent.cross(outward)]
    }

    /// Arc length of a centre line through the cell; all tows of a pattern that closes have the same.
    pub fn arc_length(&self) -> f64 {
        // Simpson between crossings, where the integrand is smooth; 64 intervals are exact to rounding.
        let tow = TowId { plus: true, index: 0 };
        let spans = self.crossings_per_tow();
        let intervals = 64 * spans;
        let dz = self.cell_length() / intervals as f64;
        let mut sum = 0.0;
        for i in 0..=intervals {
            let weight = if i == 0 || i == intervals { 1.0 } else { 2.0 + 2.0 * (i % 2) as f64 };
            sum += weight * self.slope(tow, i as f64 * dz).length();
        }
        sum * dz / 3.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::Length;
    use super::super::braid::{BraidSpec, Pattern};
    use super::*;

    fn braid(pattern: Pattern) -> BraidGeometry {
        BraidSpec { pattern, undulation: Some(Length(0.031)), ..BraidSpec::new(3.0) }.geometry(0.0)
    }

    #[test]
    fn pitch_cell_and_arc_of_the_braid_on_three_millimetres() {
        let smooth = BraidSpec { undulation: Some(Length(0.0)), ..BraidSpec::new(3.0) }.geometry(0.0);
        assert!((smooth.pitch - 13.198601148166913).abs() < 1e-12);
        assert!((smooth.cell_length() - 2.1997668580278).abs() < 1e-12);
        // A smooth helix: arc = 2 pi R / (n sin(angle)), 23.0110588785 mm a turn.
        assert!((smooth.arc_length() - 23.0110588785 / 6.0).abs() < 1e-10);
        // The undulation lengthens it by about (a k)^2 / 4, k = 2 pi / arc, and the total is the
        // 3.836 mm of the braid model to a tenth of a percent.
        let arc = braid(Pattern::Diamond).arc_length();
        let longer = 0.25 * (0.031 * TAU / smooth.arc_length()).powi(2);
        assert!((arc / smooth.arc_length() - 1.0 - longer).abs() < 0.01 * longer, "{arc}");
        assert!((arc / 3.836 - 1.0).abs() < 1e-3, "{arc}");
    }

    #[test]
    fn crossings_follow_the_pattern() {
        for (pattern, bits) in [(Pattern::Diamond, 2730), (Pattern::Regular, 3276), (Pattern::Hercules, 3640)] {
            let mut g = braid(pattern);
            let sequence = (0..12).fold(0, |bits, m| 2 * bits + usize::from(g.crossing(0, m).plus_on_top));
            assert_eq!(sequence, bits, "{pattern:?}: over (1) and under (0) of tow 0 along one turn");
            assert_eq!(g.crossings().len(), 12);
            assert_eq!(g.crossings().iter().filter(|c| c.plus_on_top).count(), 6);
            let mut pairs: Vec<_> = g.crossings().iter().map(|c| (c.plus, c.minus)).collect();
            assert_eq!(&pairs[..3], &[(0, 0), (0, 1), (1, 1)], "A_k with B_k and with B_(k+1)");
            pairs.dedup();
            assert_eq!(pairs.len(), 12);
            g.cell = Cell::FullTurn;
            assert_eq!(g.crossings().len(), 72);
            for c in g.crossings() {
                let b = TowId { plus: false, index: c.minus };
                assert_ne!(c.plus_on_top, g.on_top(b, c.m as i64), "one of the two is on top");
                let a = TowId { plus: true, index: c.plus };
                assert!((g.centre(a, c.z).truncate().normalize() - g.centre(b, c.z).truncate().normalize()).length() < 1e-12);
                assert!((g.centre(a, c.z).distance(g.centre(b, c.z)) - 0.062).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn crossing_points_and_angle() {
        let g = braid(Pattern::Diamond);
        let expected = [
            (0, 0, [3.0, 0.0, 0.0]),
            (0, 1, [2.59807621135, 1.5, 1.09988342901]),
            (0, 2, [1.5, 2.59807621135, 2.19976685803]),
            (1, 0, [1.5, 2.59807621135, 0.0]),
            (1, 1, [0.0, 3.0, 1.09988342901]),
            (1, 2, [-1.5, 2.59807621135, 2.19976685803]),
        ];
        for (tow, m, p) in expected {
            assert!((g.crossing(tow, m).point - DVec3::from_array(p)).length() < 1e-10);
        }
        let smooth = BraidGeometry { undulation: 0.0, ..g };
        let [a, b] = [true, false].map(|plus| smooth.slope(TowId { plus, index: 0 }, 0.0));
        assert!((a.angle_between(b).to_degrees() - 110.0).abs() < 1e-9);
    }

    #[test]
    fn moving_by_one_cell_carries_every_tow_into_its_successor() {
        for pattern in [Pattern::Diamond, Pattern::Regular, Pattern::Hercules] {
            for cell in [Cell::SixthTurn, Cell::FullTurn] {
                let g = BraidGeometry { cell, ..braid(pattern) };
                let h = g.cell_length();
                for tow in g.tows() {
                    for i in 0..20 {
                        let z = -h + 3.0 * h * i as f64 / 20.0 + 0.013;
                        let (here, there) = (g.centre(g.successor(tow), z), g.centre(tow, z + h));
                        assert!((here + DVec3::Z * h - there).length() < 1e-12, "{pattern:?} {tow:?} {z}");
                        let (a, b) = (g.section_axes(g.successor(tow), z), g.section_axes(tow, z + h));
                        assert!((a[0] - b[0]).length() + (a[1] - b[1]).length() < 1e-11);
                    }
                }
            }
        }
    }

    #[test]
    fn slope_is_the_derivative_of_the_centre_line() {
        let g = braid(Pattern::Regular);
        for tow in g.tows() {
            for i in 0..17 {
                let z = 0.11 + 0.13 * i as f64;
                let step = 1e-6;
                let finite = (g.centre(tow, z + step) - g.centre(tow, z - step)) / (2.0 * step);
                assert!((finite - g.slope(tow, z)).length() < 1e-8);
            }
        }
    }

    #[test]
    fn left_hand_is_the_mirror_image() {
        let right = braid(Pattern::Diamond);
        let left = BraidGeometry { hand: -1.0, ..right };
        for tow in right.tows() {
            let (a, b) = (right.centre(tow, 0.7), left.centre(tow, 0.7));
            assert!((DVec3::new(a.x, -a.y, a.z) - b).length() < 1e-14);
        }
    }
}
