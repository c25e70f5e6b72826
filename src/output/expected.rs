//! Expected values of a scene against what came out.
use super::summary::Summary;
use crate::scene::schema::Scene;

/// One comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Measure or probe.
    pub name: String,
    /// What came out.
    pub found: Option<f64>,
    /// What was expected.
    pub expected: f64,
    /// Largest difference allowed.
    pub allowed: f64,
}

impl Comparison {
    /// True if the value is there and near enough.
    pub fn holds(&self) -> bool {
        self.found.is_some_and(|v| (v - self.expected).abs() <= self.allowed)
    }
}

/// Compares what the scene expects with the summary; where both `rel` and `abs` are given, the
/// wider one counts.
pub fn compare(scene: &Scene, summary: &Summary) -> Vec<Comparison> {
    let found = |name: &str| match summary.measures.get(name) {
        Some(m) => m.mean,
        None => summary.probes.get(name).copied().flatten(),
    };
    let compare = |(name, e): (&String, &crate::scene::schema::ExpectSpec)| {
        let relative = e.rel.map_or(0.0, |r| r.0 * e.value.0.abs());
        Comparison { name: name.clone(), found: found(name), expected: e.value.0, allowed: relative.max(e.abs.map_or(0.0, |a| a.0)) }
    };
    scene.expect.iter().map(compare).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_difference_counts_on_both_sides() {
        let c = |found, expected, allowed| Comparison { name: "a".into(), found, expected, allowed };
        assert!(c(Some(1.0), 1.0, 0.0).holds());
        assert!(c(Some(0.9), 1.0, 0.11).holds() && c(Some(1.1), 1.0, 0.11).holds());
        assert!(!c(Some(0.88), 1.0, 0.11).holds() && !c(Some(1.12), 1.0, 0.11).holds());
        assert!(!c(None, 1.0, 9.0).holds() && !c(Some(f64::NAN), 1.0, 9.0).holds());
    }
}
