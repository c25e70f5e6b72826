//! Units: every quantity of a scene is a plain number in the unit system of the scene, or a string
//! with a unit of its own (`"72 GPa"`, `"2.5 um"`, `"2.58 g/cm3"`).
//!
//! Quantities convert while they are being read, so that an error in one of them carries its line
//! and column. The unit system in force is held per thread by [`UnitSystem::while_reading`].
//! Conversion between decimal units shifts the exponent of the number as it is written, so
//! `"2.5 um"` is the same bits as `0.0025` in millimetres.
mod text;
mod vector;
mod wall;

pub use vector::{Point, Triple, list, list_option, lists};
pub use wall::WallTime;

use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::cell::Cell;
use std::fmt;
use text::{Dimension, number_length, parse_unit};

/// The consistent unit system that a scene is written and computed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UnitSystem {
    /// mm, tonne, s: forces in N, stresses in MPa, energies in mJ.
    MmNTonne,
    /// m, kg, s: forces in N, stresses in Pa, energies in J.
    Si,
    /// um, tonne, s: forces in mN, stresses in GPa, energies in nJ.
    UmMnTonne,
    /// Numbers without units; only angles may carry one.
    Consistent,
}

thread_local! {
    static CURRENT: Cell<UnitSystem> = const { Cell::new(UnitSystem::MmNTonne) };
}

/// Puts the previous unit system back, also when reading fails.
struct Restore(UnitSystem);

impl Drop for Restore {
    fn drop(&mut self) {
        CURRENT.set(self.0);
    }
}

impl UnitSystem {
    /// All systems by name.
    pub const ALL: [(&'static str, UnitSystem); 4] = [
        ("MmNTonne", UnitSystem::MmNTonne),
        ("Si", UnitSystem::Si),
        ("UmMnTonne", UnitSystem::UmMnTonne),
        ("Consistent", UnitSystem::Consistent),
    ];

    /// The system in force on this thread.
    pub fn current() -> Self {
        CURRENT.get()
    }

    /// Runs `read` with this system in force on this thread.
    pub fn while_reading<T>(self, read: impl FnOnce() -> T) -> T {
        let _restore = Restore(CURRENT.replace(self));
        read()
    }

    /// Powers of ten of the units of length, mass and time in SI, or `None` without units.
    fn decimals(self) -> Option<[i32; 3]> {
        match self {
            UnitSystem::MmNTonne => Some([-3, 3, 0]),
            UnitSystem::Si => Some([0, 0, 0]),
            UnitSystem::UmMnTonne => Some([-6, 3, 0]),
            UnitSystem::Consistent => None,
        }
    }

    /// Factor to SI of a quantity with these powers of length, mass and time, or `None` without units.
    pub fn si(self, powers: [i32; 3]) -> Option<f64> {
        let decimals = self.decimals()?;
        Some(10f64.powi((0..3).map(|i| decimals[i] * powers[i]).sum()))
    }

    fn names(self) -> [&'static str; 6] {
        match self {
            UnitSystem::MmNTonne => ["mm", "tonne", "s", "N", "MPa", "mJ"],
            UnitSystem::Si => ["m", "kg", "s", "N", "Pa", "J"],
            UnitSystem::UmMnTonne => ["um", "tonne", "s", "mN", "GPa", "nJ"],
            UnitSystem::Consistent => ["-"; 6],
        }
    }

    /// Unit of length, for headers; `-` without units.
    pub fn length(self) -> &'static str {
        self.names()[0]
    }
    /// Unit of mass.
    pub fn mass(self) -> &'static str {
        self.names()[1]
    }
    /// Unit of time.
    pub fn time(self) -> &'static str {
        self.names()[2]
    }
    /// Unit of force.
    pub fn force(self) -> &'static str {
        self.names()[3]
    }
    /// Unit of stress.
    pub fn stress(self) -> &'static str {
        self.names()[4]
    }
    /// Unit of energy.
    pub fn energy(self) -> &'static str {
        self.names()[5]
    }
    /// Unit of moment (force x length).
    pub fn moment(self) -> String {
        if self == UnitSystem::Consistent { "-".into() } else { format!("{} {}", self.force(), self.length()) }
    }
    /// Unit of velocity.
    pub fn velocity(self) -> String {
        if self == UnitSystem::Consistent { "-".into() } else { format!("{}/{}", self.length(), self.time()) }
    }
    /// Unit of frequencies, rates and angular velocities.
    pub fn rate(self) -> String {
        if self == UnitSystem::Consistent { "-".into() } else { format!("1/{}", self.time()) }
    }
}

/// What one kind of quantity is, for reading and for messages.
struct Kind {
    name: &'static str,
    dimension: Dimension,
    example: &'static str,
}

impl Kind {
    /// Factor from the written plain number to the stored value: plain angles are in degrees.
    fn plain_factor(&self) -> f64 {
        if self.dimension == [0, 0, 0, 1] { std::f64::consts::PI / 180.0 } else { 1.0 }
    }

    fn finite(&self, value: f64, written: &str) -> Result<f64, String> {
        if value.is_finite() { Ok(value) } else { Err(format!("{} must be a finite number, not {written}", self.name)) }
    }

    fn of_number(&self, value: f64) -> Result<f64, String> {
        let written = if value.is_nan() {
            "NaN"
        } else if value > 0.0 {
            "infinite (too large for a number)"
        } else {
            "negative infinite (too large for a number)"
        };
        self.finite(value, written).map(|v| v * self.plain_factor())
    }

    fn of_text(&self, text: &str, system: UnitSystem) -> Result<f64, String> {
        let text = text.trim();
        let end = number_length(text);
        let (number, unit_text) = (&text[..end], text[end..].trim());
        let Ok(plain) = number.parse::<f64>() else {
            return Err(if ["nan", "inf", "+inf", "-inf", "infinity", "-infinity"].contains(&text.to_lowercase().as_str()) {
                format!("{} must be a finite number, not `{text}`", self.name)
            } else {
                format!("cannot read `{text}` as {}; write a number or {}", self.name, self.example)
            });
        };
        self.finite(plain, &format!("`{number}`"))?;
        if unit_text.is_empty() {
            return self.of_number(plain);
        }
        let unit = parse_unit(unit_text)?;
        // An angle has no dimension: rad may be written or left out of anything but an angle.
        let mechanical = |d: Dimension| [d[0], d[1], d[2]];
        let same = if self.dimension == [0, 0, 0, 1] {
            unit.dimension == self.dimension
        } else {
            mechanical(unit.dimension) == mechanical(self.dimension) && (unit.dimension[3] == 0 || unit.dimension[3] == self.dimension[3])
        };
        if !same {
            return Err(format!("`{unit_text}` is not a unit of {}; write for example {}", self.name, self.example));
        }
        let decimals = match (system.decimals(), mechanical(unit.dimension)) {
            (Some(d), _) => d,
            (None, [0, 0, 0]) => [0; 3],
            (None, _) => {
                return Err(format!(
                    "the unit `{unit_text}` needs a unit system: the scene says `units: Consistent`, so {} must be a plain number",
                    self.name
                ));
            }
        };
        let shift = unit.decimal - decimals.iter().zip(mechanical(self.dimension)).map(|(d, p)| d * p).sum::<i32>();
        // Shifting the written exponent rounds once, as if the number had been written in scene units.
        let (mantissa, exponent) = match number.find(['e', 'E']) {
            Some(i) => (&number[..i], number[i + 1..].parse::<i32>().unwrap_or(0)),
            None => (number, 0),
        };
        let value = format!("{mantissa}e{}", exponent.saturating_add(shift)).parse::<f64>().map_err(|e| e.to_string())? * unit.factor;
        self.finite(value, &format!("`{text}`"))
    }
}

struct QuantityVisitor<'a>(&'a Kind);

impl Visitor<'_> for QuantityVisitor<'_> {
    type Value = f64;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} (a number in scene units or a string such as {})", self.0.name, self.0.example)
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<f64, E> {
        self.0.of_number(v).map_err(E::custom)
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<f64, E> {
        self.visit_f64(v as f64)
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<f64, E> {
        self.visit_f64(v as f64)
    }
    fn visit_str<E: de::Error>(self, v: &str) -> Result<f64, E> {
        self.0.of_text(v, UnitSystem::current()).map_err(E::custom)
    }
}

/// The number in degrees that reads back as exactly these radians, if there is one.
fn degrees_of(radians: f64) -> Option<f64> {
    let factor = std::f64::consts::PI / 180.0;
    let near = radians / factor;
    let short = format!("{near:.14e}").parse::<f64>().unwrap_or(near);
    [short, near, near.next_up(), near.next_down()].into_iter().find(|d| d * factor == radians)
}

macro_rules! quantities {
    ($($(#[$doc:meta])* $name:ident, $words:literal, [$l:literal, $m:literal, $t:literal, $a:literal], $example:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(
            /// The value in scene units (angles in radian).
            pub f64,
        );

        impl $name {
            const KIND: Kind = Kind { name: $words, dimension: [$l, $m, $t, $a], example: $example };

            /// Reads a text as a scene does: a number, with or without a unit, in the unit system in force.
            ///
            /// # Errors
            /// What is wrong with the text, and what would be right.
            pub fn parse(text: &str) -> Result<Self, String> {
                Self::KIND.of_text(text, UnitSystem::current()).map($name)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(QuantityVisitor(&Self::KIND)).map($name)
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                if Self::KIND.dimension == [0, 0, 0, 1] {
                    return match degrees_of(self.0) {
                        Some(d) => serializer.serialize_f64(d),
                        None => serializer.serialize_str(&format!("{:e} rad", self.0)),
                    };
                }
                serializer.serialize_f64(self.0)
            }
        }

        impl From<$name> for f64 {
            fn from(q: $name) -> f64 {
                q.0
            }
        }
    )*};
}

quantities! {
    /// A number without unit (`"2 %"` is allowed).
    Ratio, "a ratio", [0, 0, 0, 0], "0.2 or \"20 %\"";
    /// Length.
    Length, "a length", [1, 0, 0, 0], "\"2.5 um\"";
    /// Area (length^2).
    Area, "an area", [2, 0, 0, 0], "\"19.6 um^2\"";
    /// Angle in radian; plain numbers in a scene are degrees.
    Angle, "an angle", [0, 0, 0, 1], "55 (degrees) or \"0.96 rad\"";
    /// Curvature or twist (radian / length).
    Curvature, "a curvature or twist", [-1, 0, 0, 1], "\"0.3 rad/mm\"";
    /// Time.
    Time, "a time", [0, 0, 1, 0], "\"10 ms\"";
    /// Rate or frequency (1 / time).
    Rate, "a rate", [0, 0, -1, 0], "\"120 1/s\" or \"50 Hz\"";
    /// Velocity (length / time).
    Velocity, "a velocity", [1, 0, -1, 0], "\"0.5 m/s\"";
    /// Angular velocity (radian / time).
    AngularVelocity, "an angular velocity", [0, 0, -1, 1], "\"10 rad/s\"";
    /// Acceleration (length / time^2).
    Acceleration, "an acceleration", [1, 0, -2, 0], "\"9.81 m/s^2\"";
    /// Mass.
    Mass, "a mass", [0, 1, 0, 0], "\"3 mg\"";
    /// Rotary inertia (mass x length^2).
    Inertia, "a rotary inertia", [2, 1, 0, 0], "\"1e-9 kg m^2\"";
    /// Mass per length.
    LinearDensity, "a mass per length", [-1, 1, 0, 0], "\"5.07e-8 kg/m\" or \"50 tex\"";
    /// Rotary inertia per length (mass x length).
    LinearInertia, "a rotary inertia per length", [1, 1, 0, 0], "\"1e-18 kg m\"";
    /// Density (mass / length^3).
    Density, "a density", [-3, 1, 0, 0], "\"2.58 g/cm3\"";
    /// Force.
    Force, "a force", [1, 1, -2, 0], "\"1 mN\"";
    /// Moment (force x length).
    Moment, "a moment", [2, 1, -2, 0], "\"0.5 N mm\"";
    /// Stress or modulus (force / length^2).
    Stress, "a stress", [-1, 1, -2, 0], "\"72 GPa\"";
    /// Stiffness of a spring (force / length).
    Stiffness, "a stiffness", [0, 1, -2, 0], "\"0.16 N/mm\"";
    /// Stiffness per length of a contact line (force / length^2).
    StiffnessPerLength, "a stiffness per length", [-1, 1, -2, 0], "\"10 N/mm/mm\"";
    /// Stiffness of a rotational spring (force x length per radian).
    RotationalStiffness, "a rotational stiffness", [2, 1, -2, -1], "\"0.5 N mm/rad\"";
    /// Bending or torsional stiffness EI, GJ (force x length^2).
    BendingStiffness, "a bending stiffness", [3, 1, -2, 0], "\"2.2e-6 N mm^2\"";
    /// Energy.
    Energy, "an energy", [2, 1, -2, 0], "\"1 nJ\"";
}

/// `#[serde(deserialize_with = "finite")]` for a plain number that must be finite.
///
/// # Errors
/// NaN and infinite numbers.
pub fn finite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ratio::deserialize(deserializer).map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read<T: de::DeserializeOwned>(system: UnitSystem, text: &str) -> Result<T, String> {
        system.while_reading(|| crate::scene::ron_options().from_str::<T>(text).map_err(|e| e.code.to_string()))
    }

    #[test]
    fn units_convert_to_the_system_of_the_scene() {
        use UnitSystem::*;
        assert_eq!(read::<Length>(MmNTonne, "\"2.5 um\""), Ok(Length(0.0025)));
        assert_eq!(read::<Length>(Si, "\"2.5um\""), Ok(Length(2.5e-6)));
        assert_eq!(read::<Length>(UmMnTonne, "\"2.5 \u{b5}m\""), Ok(Length(2.5)));
        assert_eq!(read::<Stress>(MmNTonne, "\"72 GPa\""), Ok(Stress(72000.0)));
        assert_eq!(read::<Stress>(UmMnTonne, "\"72 GPa\""), Ok(Stress(72.0)));
        assert_eq!(read::<Density>(MmNTonne, "\"2.58 g/cm3\""), Ok(Density(2.58e-9)));
        assert_eq!(read::<Density>(Si, "\"2.58 g/cm^3\""), Ok(Density(2580.0)));
        assert_eq!(read::<Force>(MmNTonne, "\"1 mN\""), Ok(Force(0.001)));
        assert_eq!(read::<Force>(UmMnTonne, "\"1e3 uN\""), Ok(Force(1.0)));
        assert_eq!(read::<BendingStiffness>(MmNTonne, "\"3 N mm^2\""), Ok(BendingStiffness(3.0)));
        assert_eq!(read::<BendingStiffness>(Si, "\"3 N*mm2\""), Ok(BendingStiffness(3e-6)));
        assert_eq!(read::<Rate>(Si, "\"120 1/min\""), Ok(Rate(2.0)));
        assert_eq!(read::<LinearDensity>(Si, "\"50 tex\""), Ok(LinearDensity(5e-5)));
        assert_eq!(read::<StiffnessPerLength>(MmNTonne, "\"10 N/mm/mm\""), Ok(StiffnessPerLength(10.0)));
        assert_eq!(read::<Ratio>(Si, "\"5 %\""), Ok(Ratio(0.05)));
        assert_eq!(read::<Time>(Consistent, "3"), Ok(Time(3.0)));
    }

    #[test]
    fn angles_are_degrees_unless_they_say_otherwise() {
        use UnitSystem::Consistent;
        assert_eq!(read::<Angle>(Consistent, "180"), Ok(Angle(std::f64::consts::PI)));
        assert_eq!(read::<Angle>(Consistent, "\"90 deg\""), Ok(Angle(std::f64::consts::FRAC_PI_2)));
        assert_eq!(read::<Angle>(Consistent, "\"0.5 rad\""), Ok(Angle(0.5)));
        assert_eq!(read::<AngularVelocity>(UnitSystem::Si, "\"10 1/s\""), Ok(AngularVelocity(10.0)));
        assert_eq!(read::<AngularVelocity>(UnitSystem::Si, "\"1 rev/min\""), Ok(AngularVelocity(std::f64::consts::TAU / 60.0)));
    }

    #[test]
    fn degrees_survive_writing_and_reading() {
        for i in 0..2000 {
            let text = format!("{:?}", i as f64 * 0.137 - 90.0);
            let a: Angle = read(UnitSystem::Si, &text).unwrap();
            let written = crate::scene::ron_options().to_string(&a).unwrap();
            assert_eq!(read::<Angle>(UnitSystem::Si, &written), Ok(a), "{text} became {written}");
        }
    }

    #[test]
    fn what_is_not_a_quantity_is_refused() {
        use UnitSystem::*;
        for (text, part) in [
            ("NaN", "finite"),
            ("inf", "finite"),
            ("-inf", "finite"),
            ("1e999", "finite"),
            ("\"nan\"", "finite"),
            ("\"NaN\"", "finite"),
            ("\"inf\"", "finite"),
            ("\"1e999\"", "finite"),
            ("\"1e999 mm\"", "finite"),
            ("\"1e308 km\"", "finite"),
            ("\"2 GPa\"", "not a unit of a length"),
            ("\"2 mmm\"", "unknown unit `mmm`"),
            ("\"two mm\"", "cannot read"),
            ("\"\"", "cannot read"),
            ("\"2 mm^\"", "power"),
            ("true", "a length"),
        ] {
            let e = read::<Length>(MmNTonne, text).unwrap_err();
            assert!(e.contains(part), "{text}: {e}");
        }
        assert!(read::<Length>(Consistent, "\"2 mm\"").unwrap_err().contains("Consistent"));
        assert!(read::<Angle>(Si, "\"2\u{b0}\"").is_ok());
        assert!(read::<Rate>(Si, "\"2 deg\"").is_err());
        assert!(read::<Stiffness>(Si, "\"2 N/mm/rad\"").is_err());
    }

    #[test]
    fn vectors_are_lists_of_three() {
        use UnitSystem::MmNTonne;
        let p: Point = read(MmNTonne, "[1, \"2 cm\", 3.5]").unwrap();
        assert_eq!(glam::DVec3::from(p), glam::DVec3::new(1.0, 20.0, 3.5));
        assert_eq!(crate::scene::ron_options().to_string(&p).unwrap(), "[1.0,20.0,3.5]");
        for (text, part) in [("[1, 2]", "2 given"), ("[1, 2, 3, 4]", "more given"), ("7", "a list of 3"), ("[1, 2, NaN]", "finite")] {
            let e = read::<Point>(MmNTonne, text).unwrap_err();
            assert!(e.contains(part), "{text}: {e}");
        }
    }

    #[test]
    fn optional_quantities_need_no_some() {
        #[derive(Deserialize)]
        struct S {
            #[serde(default)]
            a: Option<Length>,
            #[serde(default)]
            b: Option<Length>,
        }
        let s: S = read(UnitSystem::MmNTonne, "(a: \"1 cm\")").unwrap();
        assert_eq!((s.a, s.b), (Some(Length(10.0)), None));
    }
}
