//! The order of convergence: how fast an error falls as the mesh becomes finer.
//!
//! An error that goes with the size h of the elements as e = C h^p falls by the factor r^p when the mesh is made
//! r times finer, so that p = ln(e1 / e2) / ln r from two meshes (P. J. Roache, Verification and Validation
//! in Computational Science and Engineering, 1998, section 5.10). The errors here are those against the known answer,
//! not against the finest mesh, so that two meshes are enough.

/// Errors below this part of the reference say nothing about the mesh: rounding, the digits of the reference and
/// a state that counts as steady weigh as much.
pub const NEGLIGIBLE: f64 = 1e-7;

/// Order of convergence between two meshes, of which the second has `finer` times as many elements per length.
///
/// The errors have their signs; `scale` is what they are compared with, the size of the reference. None where the
/// finer mesh is not better, the error changes its sign, or is not above [`NEGLIGIBLE`].
pub fn order(coarse: f64, fine: f64, scale: f64, finer: f64) -> Option<f64> {
    let ratio = coarse / fine;
    let above = |e: f64| e.abs() > NEGLIGIBLE * scale.abs();
    (above(coarse) && above(fine) && ratio.is_finite() && ratio > 1.0 && finer > 1.0).then(|| ratio.ln() / finer.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_power_of_the_size_is_found() {
        for p in [1.0, 2.0, 4.0] {
            let e = |n: f64| -0.3 * n.powf(-p);
            let found = order(e(10.0), e(25.0), 1.0, 2.5).expect("two errors");
            assert!((found - p).abs() < 1e-12, "{found} instead of {p}");
        }
    }

    #[test]
    fn nothing_is_said_about_errors_that_do_not_fall() {
        assert_eq!(order(1e-3, 2e-3, 1.0, 2.0), None, "it grows");
        assert_eq!(order(1e-3, -1e-4, 1.0, 2.0), None, "it passes through zero");
        assert_eq!(order(4e-9, 1e-9, 1.0, 2.0), None, "it is nothing against the reference");
        assert!(order(4e-9, 1e-9, 1e-6, 2.0).is_some());
        for odd in [f64::NAN, f64::INFINITY, 0.0] {
            assert_eq!(order(odd, 1e-3, 1.0, 2.0), None);
            assert_eq!(order(1e-3, odd, 1.0, 2.0), None);
        }
        assert_eq!(order(2e-3, 1e-3, 1.0, 1.0), None, "the same mesh twice");
    }
}
