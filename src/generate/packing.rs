//! Where the filaments of a bundle sit in its cross-section.
//!
//! Hexagonal packing takes the `n` lattice sites nearest to the centre (1, 7, 19, 37, 61, 91 are
//! the full hexagons 1 + 6 + 12 + ...); ring packing puts 1 + 6 + 12 + ... filaments on concentric
//! circles, the last circle evenly filled by what is left. Both are centred on the mean of their
//! sites, so that the centre line of a bundle is the mean of its filaments.
//!
//! Order: hexagonal sites row by row, every second row backwards, so that consecutive filaments
//! are neighbours and the neighbours in the next row are about one row length away in memory;
//! rings from the inside out, each counter-clockwise.
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_3, TAU};

/// Arrangement of the filaments in the plane normal to the bundle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Packing {
    /// Sites of a hexagonal lattice nearest to the centre.
    #[default]
    Hexagonal,
    /// Concentric rings of 1, 6, 12, ... filaments.
    Ring,
}

impl Packing {
    /// Centres of `n` filaments whose nearest neighbours are `spacing` apart.
    pub fn sites(self, n: usize, spacing: f64) -> Vec<DVec2> {
        let mut sites = match self {
            Packing::Hexagonal => hexagonal(n),
            Packing::Ring => ring(n),
        };
        let centre = sites.iter().sum::<DVec2>() / n.max(1) as f64;
        for s in &mut sites {
            *s = (*s - centre) * spacing;
        }
        sites
    }
}

/// Largest distance of a site from the centre of the bundle.
pub fn outer_distance(sites: &[DVec2]) -> f64 {
    sites.iter().map(|s| s.length()).fold(0.0, f64::max)
}

/// Unit hexagonal lattice a (1, 0) + b (1/2, sqrt(3)/2): the `n` sites nearest to the origin, equal
/// distances by the angle of the site, then sorted in boustrophedon order.
fn hexagonal(n: usize) -> Vec<DVec2> {
    // A hexagon of k rings holds 1 + 3 k (k + 1) sites; its corners are k away, the middles of its
    // sides k sqrt(3)/2, so one ring more than needed by count and a sixth on top covers the disc.
    let mut k = 1i64;
    while 1 + 3 * k * (k + 1) < n as i64 {
        k += 1;
    }
    let reach = k + 2 + k / 6;
    let mut all: Vec<(i64, u64, i64, i64)> = Vec::new();
    for b in -reach..=reach {
        for a in -reach..=reach {
            // |site|^2 is the integer a^2 + a b + b^2: equal distances compare as equal.
            let d2 = a * a + a * b + b * b;
            let angle = site(a, b).to_angle().rem_euclid(TAU);
            all.push((d2, (angle * 1e9).round() as u64, a, b));
        }
    }
    all.sort_unstable();
    all.truncate(n);
    all.sort_unstable_by_key(|&(_, _, a, b)| (b, if b % 2 == 0 { a } else { -a }));
    all.into_iter().map(|(_, _, a, b)| site(a, b)).collect()
}

fn site(a: i64, b: i64) -> DVec2 {
    DVec2::new(a as f64 + 0.5 * b as f64, FRAC_PI_3.sin() * b as f64)
}

fn ring(n: usize) -> Vec<DVec2> {
    let mut sites = Vec::with_capacity(n);
    if n > 0 {
        sites.push(DVec2::ZERO);
    }
    let mut ring = 1;
    while sites.len() < n {
        let count = (6 * ring).min(n - sites.len());
        for i in 0..count {
            sites.push(DVec2::from_angle(TAU * i as f64 / count as f64) * ring as f64);
        }
        ring += 1;
    }
    sites
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nearest(sites: &[DVec2]) -> f64 {
        let mut d = f64::INFINITY;
        for (i, a) in sites.iter().enumerate() {
            for b in &sites[..i] {
                d = d.min(a.distance(*b));
            }
        }
        d
    }

    #[test]
    fn full_hexagons_reach_to_their_last_ring() {
        // Distances of the hexagonal lattice: 1, sqrt(3), 2, sqrt(7), 3 with 6, 6, 6, 12, 6 sites.
        for (n, outer) in [(1, 0.0), (7, 1.0), (13, 3.0f64.sqrt()), (19, 2.0), (31, 7.0f64.sqrt()), (37, 3.0)] {
            let sites = Packing::Hexagonal.sites(n, 1.0);
            assert_eq!(sites.len(), n);
            assert!((outer_distance(&sites) - outer).abs() < 1e-12, "{n}: {}", outer_distance(&sites));
        }
    }

    #[test]
    fn neighbours_are_never_nearer_than_the_spacing() {
        for n in 2..=130 {
            for packing in [Packing::Hexagonal, Packing::Ring] {
                let sites = packing.sites(n, 0.3);
                assert_eq!(sites.len(), n);
                assert!(nearest(&sites) > 0.3 * (1.0 - 1e-12), "{packing:?} {n}");
            }
        }
    }

    #[test]
    fn sites_are_centred_and_dense() {
        for n in [2, 3, 4, 7, 10, 19, 50, 100, 127] {
            let sites = Packing::Hexagonal.sites(n, 1.0);
            assert!(sites.iter().sum::<DVec2>().length() < 1e-12 * n as f64);
            // A disc of n lattice cells has the radius sqrt(n sqrt(3) / (2 pi)); sites stay within
            // half a spacing of it for a well-filled disc.
            let disc = (n as f64 * 3.0f64.sqrt() / TAU).sqrt();
            assert!(outer_distance(&sites) < disc + 0.5, "{n}");
        }
    }

    #[test]
    fn consecutive_filaments_of_a_full_hexagon_are_neighbours() {
        let sites = Packing::Hexagonal.sites(37, 1.0);
        let far = sites.windows(2).filter(|w| w[0].distance(w[1]) > 1.0 + 1e-9).count();
        assert_eq!(far, 0);
    }

    #[test]
    fn rings_hold_one_six_and_twelve() {
        let sites = Packing::Ring.sites(19, 2.0);
        for (range, radius) in [(0..1, 0.0), (1..7, 2.0), (7..19, 4.0)] {
            for s in &sites[range] {
                assert!((s.length() - radius).abs() < 1e-12);
            }
        }
    }
}
