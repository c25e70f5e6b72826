//! Wall-clock time: `"10 min"`, `"2 h"`, `"0.5 s"`; plain numbers are seconds, whatever the scene's units.
use super::{Time, UnitSystem};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::time::Duration;

/// A wall-clock time above zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WallTime(pub Duration);

impl WallTime {
    /// Reads `"10 min"`.
    ///
    /// # Errors
    /// What is wrong with the text, and what would be right.
    pub fn parse(text: &str) -> Result<Self, String> {
        Self::of_seconds(UnitSystem::Si.while_reading(|| Time::parse(text))?.0, text)
    }

    fn of_seconds(seconds: f64, written: impl fmt::Display) -> Result<Self, String> {
        match Duration::try_from_secs_f64(seconds) {
            Ok(d) if d > Duration::ZERO => Ok(WallTime(d)),
            _ => Err(format!("a wall-clock time must be above zero and finite, not `{written}`; write for example \"10 min\"")),
        }
    }
}

impl fmt::Display for WallTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.as_secs_f64();
        let whole = |unit: f64| (seconds / unit).fract() == 0.0;
        match () {
            () if whole(3600.0) => write!(f, "{} h", seconds / 3600.0),
            () if whole(60.0) => write!(f, "{} min", seconds / 60.0),
            () => write!(f, "{seconds} s"),
        }
    }
}

impl Serialize for WallTime {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

struct WallTimeVisitor;

impl Visitor<'_> for WallTimeVisitor {
    type Value = WallTime;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a wall-clock time such as \"10 min\" (a plain number is seconds), or None")
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<WallTime, E> {
        WallTime::of_seconds(v, v).map_err(E::custom)
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<WallTime, E> {
        self.visit_f64(v as f64)
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<WallTime, E> {
        self.visit_f64(v as f64)
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<WallTime, E> {
        WallTime::parse(v).map_err(E::custom)
    }
}

impl<'de> Deserialize<'de> for WallTime {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WallTimeVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wall_clock_times_read_and_write() {
        let text = |t: &str| WallTime::parse(t).map(|w| (w.0.as_secs_f64(), w.to_string()));
        assert_eq!(text("10 min"), Ok((600.0, "10 min".into())));
        assert_eq!(text("1.5 h"), Ok((5400.0, "90 min".into())));
        assert_eq!(text("250 ms"), Ok((0.25, "0.25 s".into())));
        assert_eq!(text("7200"), Ok((7200.0, "2 h".into())));
        for wrong in ["0 s", "-3 s", "1e300 h", "10 mm", "soon", ""] {
            assert!(text(wrong).unwrap_err().contains("\""), "{wrong}");
        }
        // The units of the scene do not matter.
        assert_eq!(UnitSystem::Consistent.while_reading(|| WallTime::parse("2 s")), Ok(WallTime(Duration::from_secs(2))));
    }
}
