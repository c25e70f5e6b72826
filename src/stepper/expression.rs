//! Conditions and values: arithmetic and comparisons over [`Reading`]s, as in `speed > 2 && {node 3 v.x} < 0`.
use super::reading::Reading;
use crate::measure::Quantity;
use crate::registry::SpecError;
use crate::scene::LoadedScene;
use crate::simulation::Simulation;
use exmex::prelude::*;
use exmex::{BinOp, FloatOpsFactory, MakeOperators, MatchLiteral, Operator, literal_matcher_from_pattern};

/// Arithmetic, and comparisons that give 1 or 0.
#[derive(Clone, Debug)]
struct Operators;

impl MakeOperators<f64> for Operators {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        fn binary<'a>(sign: &'a str, prio: i64, apply: fn(f64, f64) -> f64) -> Operator<'a, f64> {
            Operator::make_bin(sign, BinOp { apply, prio, is_commutative: false })
        }
        let mut all = FloatOpsFactory::<f64>::make();
        all.extend([
            binary("<", -1, |a, b| f64::from(u8::from(a < b))),
            binary(">", -1, |a, b| f64::from(u8::from(a > b))),
            binary("<=", -1, |a, b| f64::from(u8::from(a <= b))),
            binary(">=", -1, |a, b| f64::from(u8::from(a >= b))),
            binary("==", -2, |a, b| f64::from(u8::from(a == b))),
            binary("!=", -2, |a, b| f64::from(u8::from(a != b))),
            binary("&&", -3, |a, b| f64::from(u8::from(a != 0.0 && b != 0.0))),
            binary("||", -4, |a, b| f64::from(u8::from(a != 0.0 || b != 0.0))),
        ]);
        all
    }
}

literal_matcher_from_pattern!(Numbers, r"^([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?");

/// An expression whose names are known to stand for something.
#[derive(Clone)]
pub struct Expression {
    /// As it was written.
    pub text: String,
    formula: FlatEx<f64, Operators, Numbers>,
    readings: Vec<Reading>,
}

impl Expression {
    /// Reads an expression.
    ///
    /// # Errors
    /// What cannot be read, or a name that stands for nothing.
    pub fn read(text: &str, scene: &LoadedScene, sim: &mut Simulation) -> Result<Self, SpecError> {
        let text = text.trim();
        if text.is_empty() {
            return Err(SpecError::new("", "an expression is missing").help("for example `speed > 2` or `{node 3 v.x}`"));
        }
        if text.matches('{').count() != text.matches('}').count() {
            return Err(SpecError::new("{", "a brace is not closed"));
        }
        let formula: FlatEx<f64, Operators, Numbers> =
            FlatEx::parse(text).map_err(|e| SpecError::new(text, format!("`{text}` cannot be read: {e}")))?;
        let readings = formula.var_names().iter().map(|name| Reading::of(name.trim(), scene, sim)).collect::<Result<_, _>>()?;
        Ok(Expression { text: text.into(), formula, readings })
    }

    /// The value now; comparisons give 1 where they hold and 0 where not.
    ///
    /// # Errors
    /// A field that is no number any more.
    pub fn value(&self, sim: &mut Simulation) -> Result<f64, String> {
        let values = self.readings.iter().map(|r| r.value(sim)).collect::<Result<Vec<f64>, _>>()?;
        self.formula.eval(&values).map_err(|e| e.to_string())
    }

    /// What the value is, if the expression is a single quantity.
    pub fn quantity(&self) -> Option<Quantity> {
        let alone = |name: &str| name.trim() == self.text.trim_matches(['{', '}']).trim();
        match (self.formula.var_names(), &self.readings[..]) {
            ([name], [reading]) if alone(name) => reading.quantity(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comparisons_bind_weaker_than_sums_and_stronger_than_and_and_or() {
        let value = |text: &str| {
            let formula: FlatEx<f64, Operators, Numbers> = FlatEx::parse(text).expect(text);
            formula.eval(&[]).expect(text)
        };
        assert_eq!(value("1 + 1e-3 * 2 > 1.0019 && 2 < 3"), 1.0);
        assert_eq!(value("1 > 2 || 2 >= 2"), 1.0);
        assert_eq!(value("1 < 2 && 3 < 2 || 0"), 0.0);
        assert_eq!(value("1 - 1 == 0 && 2 != 2"), 0.0);
        assert_eq!(value("max(2, 3) * 1.5E+2"), 450.0);
        assert_eq!(value("0.5 <= .5"), 1.0);
    }
}
