//! Specification of the biaxial braid; its geometry is in `geometry.rs`.
use super::geometry::BraidGeometry;
use super::tow::{finite, positive};
use crate::registry::SpecError;
use crate::scene::units::{Angle, Length};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// The order of the crossings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Pattern {
    /// 1/1: over one, under one.
    #[default]
    Diamond,
    /// 2/2: over two, under two.
    Regular,
    /// 3/3: over three, under three.
    Hercules,
}

impl Pattern {
    /// Crossings that a tow passes over before it passes under as many.
    pub fn float(self) -> usize {
        match self {
            Pattern::Diamond => 1,
            Pattern::Regular => 2,
            Pattern::Hercules => 3,
        }
    }
}

/// Length of the periodic cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cell {
    /// Pitch over the tows of one direction (a sixth of a turn for 12 tows): every tow continues in
    /// its neighbour.
    #[default]
    SixthTurn,
    /// One pitch: every tow continues in itself.
    FullTurn,
}

/// Sense in which the A tows wind about z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Hand {
    /// Counter-clockwise seen from the end that z points to: a right-handed helix.
    #[default]
    Right,
    /// The mirror image.
    Left,
}

/// A braid about the z axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BraidSpec {
    /// Tows, half of them each way (default 12).
    #[serde(default = "twelve")]
    pub tows: usize,
    /// Angle between tow and axis (default 55 degrees).
    #[serde(default = "fifty_five")]
    pub angle: Angle,
    /// Mean radius of the helices (length).
    pub radius: Length,
    /// Order of the crossings (default `Diamond`).
    #[serde(default)]
    pub pattern: Pattern,
    /// Periodic cell (default `SixthTurn`).
    #[serde(default)]
    pub cell: Cell,
    /// How far a tow is outside the mean radius where it is on top, and inside where it is not
    /// (length; default: the outer radius of a tow times its gap factor).
    #[serde(default)]
    pub undulation: Option<Length>,
    /// Sense of the A tows (default `Right`).
    #[serde(default)]
    pub hand: Hand,
}

fn twelve() -> usize {
    12
}
fn fifty_five() -> Angle {
    Angle(55f64.to_radians())
}

impl BraidSpec {
    /// A diamond braid of 12 tows at 55 degrees.
    pub fn new(radius: f64) -> Self {
        BraidSpec {
            tows: twelve(),
            angle: fifty_five(),
            radius: Length(radius),
            pattern: Pattern::default(),
            cell: Cell::default(),
            undulation: None,
            hand: Hand::default(),
        }
    }

    /// Checks the numbers and that the pattern closes; errors name the field after `prefix`.
    ///
    /// # Errors
    /// The first field that makes no sense.
    pub fn check(&self, prefix: &str) -> Result<(), SpecError> {
        if self.tows < 4 || !self.tows.is_multiple_of(2) {
            return Err(SpecError::new(format!("{prefix}.tows"), format!("{} tows cannot be braided", self.tows))
                .help("an even number, at least 4: half of the tows wind each way"));
        }
        positive(prefix, "radius", self.radius.0)?;
        if !(self.angle.0 > 0.0 && self.angle.0 < PI / 2.0) {
            return Err(SpecError::new(format!("{prefix}.angle"), format!("angle {} rad is not between 0 and 90 degrees", self.angle.0))
                .help("angle between tow and braid axis; 55 degrees is usual"));
        }
        if let Some(a) = self.undulation {
            finite(prefix, "undulation", a.0)?;
            if a.0 < 0.0 || a.0 >= self.radius.0 {
                return Err(SpecError::new(
                    format!("{prefix}.undulation"),
                    format!("undulation {} is not between 0 and the radius {}", a.0, self.radius.0),
                ));
            }
        }
        let (n, k) = (self.tows / 2, self.pattern.float());
        if !n.is_multiple_of(k) {
            return Err(SpecError::new(
                format!("{prefix}.pattern"),
                format!("pattern {:?} does not close on the tube: {n} tows each way are not a multiple of {k}", self.pattern),
            )
            .help(format!(
                "{:?} ({k}/{k}) needs a number of tows divisible by {}: {} or {} instead of {}",
                self.pattern,
                2 * k,
                2 * (n - n % k).max(k),
                2 * (n - n % k + k),
                self.tows
            )));
        }
        Ok(())
    }

    /// The geometry, with `clearance` as the undulation if none is given.
    pub fn geometry(&self, clearance: f64) -> BraidGeometry {
        BraidGeometry {
            per_direction: self.tows / 2,
            radius: self.radius.0,
            pitch: TAU * self.radius.0 / self.angle.0.tan(),
            undulation: self.undulation.map_or(clearance, |a| a.0),
            float: self.pattern.float(),
            cell: self.cell,
            hand: if self.hand == Hand::Right { 1.0 } else { -1.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_that_do_not_close_are_refused_with_the_rule() {
        let eight = |pattern| BraidSpec { tows: 16, pattern, ..BraidSpec::new(3.0) };
        let error = eight(Pattern::Hercules).check("braid").expect_err("8 is not a multiple of 3");
        assert_eq!(error.path, "braid.pattern");
        assert!(error.message.contains("8 tows each way are not a multiple of 3"), "{error}");
        assert!(error.help.expect("help").contains("divisible by 6: 12 or 18 instead of 16"));
        assert_eq!(eight(Pattern::Regular).check("braid"), Ok(()));
        let odd = BraidSpec { tows: 10, pattern: Pattern::Regular, ..BraidSpec::new(3.0) };
        assert!(odd.check("braid").is_err());
        for (wrong, field) in [
            (BraidSpec { tows: 7, ..BraidSpec::new(3.0) }, "braid.tows"),
            (BraidSpec::new(-3.0), "braid.radius"),
            (BraidSpec::new(f64::NAN), "braid.radius"),
            (BraidSpec { angle: Angle(1.6), ..BraidSpec::new(3.0) }, "braid.angle"),
            (BraidSpec { undulation: Some(Length(3.0)), ..BraidSpec::new(3.0) }, "braid.undulation"),
        ] {
            assert_eq!(wrong.check("braid").expect_err("wrong").path, field);
        }
    }
}
