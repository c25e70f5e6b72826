//! Amplitudes: how loads and prescribed motions grow in time.
use std::sync::Arc;

/// A function of time by which a load or a prescribed motion is multiplied.
#[derive(Clone, Debug, PartialEq)]
pub enum Amplitude {
    /// Always 1.
    Constant,
    /// 0 before, 1 after `rise`; in between the quintic s^3 (10 - 15 s + 6 s^2) with zero first
    /// and second derivatives at both ends.
    SmoothStep {
        /// Duration of the rise (time).
        rise: f64,
    },
    /// Linear from 0 to 1 over `rise`, then constant.
    Ramp {
        /// Duration of the rise (time).
        rise: f64,
    },
    /// Piecewise linear through (time, value), constant outside.
    Table(Vec<(f64, f64)>),
    /// sin(2 pi f t + phase).
    Sine {
        /// Frequency (1 / time).
        frequency: f64,
        /// Phase (radian).
        phase: f64,
    },
    /// A function of a plugin.
    Custom(Function),
}

/// A function of time of a plugin: its value at a time.
#[derive(Clone)]
pub struct Function(pub Arc<dyn Fn(f64) -> f64 + Send + Sync>);

impl PartialEq for Function {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl std::fmt::Debug for Function {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Function")
    }
}

impl Amplitude {
    /// When it has come to its last value, if it ever does (time); else zero.
    pub fn settled(&self) -> f64 {
        match self {
            Amplitude::SmoothStep { rise } | Amplitude::Ramp { rise } => rise.max(0.0),
            Amplitude::Table(points) => points.last().map_or(0.0, |p| p.0.max(0.0)),
            Amplitude::Constant | Amplitude::Sine { .. } | Amplitude::Custom(_) => 0.0,
        }
    }

    /// Value at time `t`.
    pub fn at(&self, t: f64) -> f64 {
        match self {
            Amplitude::Constant => 1.0,
            Amplitude::SmoothStep { rise } => {
                let s = if *rise > 0.0 { (t / rise).clamp(0.0, 1.0) } else { 1.0 };
                s * s * s * (10.0 + s * (6.0 * s - 15.0))
            }
            Amplitude::Ramp { rise } => {
                if *rise > 0.0 {
                    (t / rise).clamp(0.0, 1.0)
                } else {
                    1.0
                }
            }
            Amplitude::Table(points) => {
                let i = points.partition_point(|p| p.0 <= t);
                match (i.checked_sub(1).map(|j| points[j]), points.get(i)) {
                    (None, None) => 0.0,
                    (None, Some(b)) => b.1,
                    (Some(a), None) => a.1,
                    (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (t - a.0) / (b.0 - a.0),
                }
            }
            Amplitude::Sine { frequency, phase } => (std::f64::consts::TAU * frequency * t + phase).sin(),
            Amplitude::Custom(function) => (function.0)(t),
        }
    }
}
