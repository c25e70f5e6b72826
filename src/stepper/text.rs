//! Numbers and lists as the prompt shows them.
use glam::DVec3;

/// Seven digits, without zeros at the end.
pub fn number(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return if v == 0.0 { "0".into() } else { v.to_string() };
    }
    let trimmed = |text: &str| if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text.into() };
    let scientific = format!("{v:.6e}");
    let (mantissa, exponent) = scientific.split_once('e').expect("the format has an exponent");
    match exponent.parse::<i32>().expect("an exponent is a number") {
        e @ -4..=6 => trimmed(&format!("{v:.*}", (6 - e) as usize)),
        e => format!("{}e{e}", trimmed(mantissa)),
    }
}

/// A number with its unit, if it has one.
pub fn quantity(v: f64, unit: &str) -> String {
    if unit.is_empty() || unit == "-" { number(v) } else { format!("{} {unit}", number(v)) }
}

/// A vector.
pub fn vector(v: DVec3) -> String {
    format!("({}, {}, {})", number(v.x), number(v.y), number(v.z))
}

/// A value as RON, its numbers shortened.
pub fn shortened(ron: &str) -> String {
    let one = |word: &str| match word.parse::<f64>() {
        Ok(v) if word.contains(['.', 'e', 'E', 'n', 'N']) => number(v),
        _ => word.to_string(),
    };
    let mut out = String::new();
    let mut rest = ron;
    while let Some(at) = rest.find(['(', ')', '[', ']', ',']) {
        out += &one(&rest[..at]);
        let mark = &rest[at..=at];
        out += mark;
        if mark == "," && !rest[at + 1..].is_empty() {
            out += " ";
        }
        rest = rest[at + 1..].trim_start();
    }
    out + &one(rest)
}

/// Rows of a table, the first column as wide as its widest entry.
pub fn table<A: AsRef<str>, B: AsRef<str>>(rows: &[(A, B)]) -> String {
    let width = rows.iter().map(|r| r.0.as_ref().chars().count()).max().unwrap_or(0);
    let lines: Vec<String> = rows.iter().map(|(a, b)| format!("  {:<width$}  {}", a.as_ref(), b.as_ref()).trim_end().to_string()).collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_seven_digits_and_no_tail() {
        let all = [0.0, 1.0, -0.25, 100.0, 1234567.8, 12345678.9, 1e-4, 1.23456789e-5, 1e300, -1.0 / 3.0].map(number);
        assert_eq!(all, ["0", "1", "-0.25", "100", "1234568", "1.234568e7", "0.0001", "1.234568e-5", "1e300", "-0.3333333"]);
        assert_eq!(number(f64::NAN), "NaN");
    }

    #[test]
    fn values_keep_their_brackets_and_words() {
        assert_eq!(shortened("(1.0,2.5,0.000000001)"), "(1, 2.5, 1e-9)");
        assert_eq!(shortened("None") + &shortened("inf") + &shortened("17"), "Noneinf17");
        assert_eq!(shortened("[(1.0,2.0),(3.0,4.0)]"), "[(1, 2), (3, 4)]");
    }
}
