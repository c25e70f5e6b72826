//! Mean values with confidence intervals.
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Mean of a sample with the half-width of its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean.
    pub mean: f64,
    /// Half-width t(0.975, n - 1) s / sqrt(n) after Student (1908); none for fewer than two values.
    pub ci95: Option<f64>,
    /// Number of values.
    pub n: usize,
}

impl Estimate {
    /// The estimate from a sample; the mean of an empty one is not a number.
    pub fn of(values: &[f64]) -> Self {
        let n = values.len();
        let mean = values.iter().sum::<f64>() / n as f64;
        let ci95 = (n > 1).then(|| {
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
            quantile(n) * (variance / n as f64).sqrt()
        });
        Estimate { mean, ci95, n }
    }

    /// The estimate of the same sample in another unit.
    pub fn scaled(self, factor: f64) -> Self {
        Estimate { mean: self.mean * factor, ci95: self.ci95.map(|c| c * factor.abs()), n: self.n }
    }
}

/// Student's t(0.975, n - 1): half the 95 % interval of the mean of `n` values over its standard error.
///
/// # Panics
/// For fewer than two values.
pub fn quantile(n: usize) -> f64 {
    StudentsT::new(0.0, 1.0, n as f64 - 1.0).expect("two values at least").inverse_cdf(0.975)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interval_of_six_values_uses_students_quantile() {
        // t(0.975, 5) = 2.570581836 and t(0.975, 11) = 2.200985160 (tables of Student's t).
        let six = Estimate::of(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!((six.mean, six.n), (3.5, 6));
        let expected = 2.570581836 * (3.5f64 / 6.0).sqrt();
        assert!((six.ci95.expect("six values") - expected).abs() < 1e-8);
        let twelve: Vec<f64> = (0..12).map(f64::from).collect();
        let expected = 2.200985160 * (13.0f64 / 12.0).sqrt();
        assert!((Estimate::of(&twelve).ci95.expect("twelve values") - expected).abs() < 1e-8);
    }

    #[test]
    fn equal_values_have_no_width_and_one_value_has_no_interval() {
        assert_eq!(Estimate::of(&[2.0, 2.0, 2.0]).ci95, Some(0.0));
        assert_eq!(Estimate::of(&[2.0]), Estimate { mean: 2.0, ci95: None, n: 1 });
        assert!(Estimate::of(&[]).mean.is_nan());
    }

    #[test]
    fn scaling_scales_mean_and_interval() {
        let a = Estimate::of(&[1.0, 4.0]);
        let b = Estimate::of(&[-2.0, -8.0]);
        assert_eq!(a.scaled(-2.0).mean, b.mean);
        assert!((a.scaled(-2.0).ci95.expect("two") - b.ci95.expect("two")).abs() < 1e-12);
    }
}
