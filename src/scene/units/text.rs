//! Units as text: `g/cm^3`, `N mm2`, `1/s`.

/// Exponents of length, mass, time and angle.
pub(super) type Dimension = [i32; 4];

/// A unit: factor x 10^decimal in SI.
#[derive(Clone, Copy)]
pub(super) struct Unit {
    pub dimension: Dimension,
    pub factor: f64,
    pub decimal: i32,
}

const PREFIXES: [(&str, i32); 12] = [
    ("k", 3),
    ("M", 6),
    ("G", 9),
    ("T", 12),
    ("m", -3),
    ("u", -6),
    ("\u{b5}", -6),
    ("\u{3bc}", -6),
    ("n", -9),
    ("c", -2),
    ("d", -1),
    ("p", -12),
];

/// Units that take a prefix.
const PREFIXED: [(&str, Dimension, i32); 9] = [
    ("m", [1, 0, 0, 0], 0),
    ("g", [0, 1, 0, 0], -3),
    ("s", [0, 0, 1, 0], 0),
    ("N", [1, 1, -2, 0], 0),
    ("Pa", [-1, 1, -2, 0], 0),
    ("J", [2, 1, -2, 0], 0),
    ("Hz", [0, 0, -1, 0], 0),
    ("tex", [-1, 1, 0, 0], -6),
    ("rad", [0, 0, 0, 1], 0),
];

/// Units without a prefix.
const PLAIN: [(&str, Dimension, f64, i32); 8] = [
    ("t", [0, 1, 0, 0], 1.0, 3),
    ("tonne", [0, 1, 0, 0], 1.0, 3),
    ("min", [0, 0, 1, 0], 60.0, 0),
    ("h", [0, 0, 1, 0], 3600.0, 0),
    ("deg", [0, 0, 0, 1], std::f64::consts::PI / 180.0, 0),
    ("\u{b0}", [0, 0, 0, 1], std::f64::consts::PI / 180.0, 0),
    ("rev", [0, 0, 0, 1], std::f64::consts::TAU, 0),
    ("%", [0, 0, 0, 0], 1.0, -2),
];

fn unit_named(name: &str) -> Option<Unit> {
    if let Some((_, dimension, factor, decimal)) = PLAIN.iter().find(|u| u.0 == name) {
        return Some(Unit { dimension: *dimension, factor: *factor, decimal: *decimal });
    }
    let prefixed = |word: &str, shift: i32| {
        let (_, dimension, decimal) = PREFIXED.iter().find(|u| u.0 == word)?;
        Some(Unit { dimension: *dimension, factor: 1.0, decimal: decimal + shift })
    };
    prefixed(name, 0)
        .or_else(|| PREFIXES.iter().find_map(|(prefix, shift)| name.strip_prefix(prefix).and_then(|rest| prefixed(rest, *shift))))
}

/// Reads `g/cm^3`, `N mm2`, `1/s`, `kg*m^2`.
pub(super) fn parse_unit(text: &str) -> Result<Unit, String> {
    let mut total = Unit { dimension: [0; 4], factor: 1.0, decimal: 0 };
    let mut sign = 1;
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(r) = rest.strip_prefix('/') {
            sign = -1;
            rest = r.trim_start();
        } else if let Some(r) = rest.strip_prefix(['*', '.', '\u{b7}']) {
            rest = r.trim_start();
        }
        let end = rest
            .find(|c: char| c.is_ascii_digit() || matches!(c, '/' | '*' | '.' | '^' | '-' | '\u{b7}') || c.is_whitespace())
            .unwrap_or(rest.len());
        let (name, mut after) = rest.split_at(end);
        let caret = after.strip_prefix('^');
        let digits = caret.unwrap_or(after);
        let len =
            digits.char_indices().take_while(|(i, c)| c.is_ascii_digit() || (*i == 0 && *c == '-')).map(|(i, _)| i + 1).last().unwrap_or(0);
        let power = if len == 0 {
            if caret.is_some() {
                return Err(format!("no power after `^` in the unit `{text}`"));
            }
            1
        } else {
            after = &digits[len..];
            digits[..len].parse::<i32>().ok().filter(|p| p.abs() <= 12).ok_or_else(|| format!("odd power in the unit `{text}`"))?
        };
        if name.is_empty() {
            // Only the one of `1/s` is a number in a unit.
            if power != 1 || len == 0 || caret.is_some() {
                return Err(format!("cannot read the unit `{text}`"));
            }
        } else {
            let unit = unit_named(name).ok_or_else(|| {
                format!("unknown unit `{name}`; known are m, g, s, N, Pa, J, Hz, tex, rad with prefixes (mm, kg, mN, GPa ...), t, tonne, min, h, deg, rev, %")
            })?;
            let p = power * sign;
            for (t, u) in total.dimension.iter_mut().zip(unit.dimension) {
                *t += p * u;
            }
            total.factor *= unit.factor.powi(p);
            total.decimal += p * unit.decimal;
        }
        // A blank or a product sign keeps the sign of a denominator: N/mm^2 s is N/(mm^2 s).
        rest = after.trim_start();
    }
    Ok(total)
}

/// Length of the number at the start of `text`.
pub(super) fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| from + bytes[from..].iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
    let sign = usize::from(matches!(bytes.first(), Some(b'+' | b'-')));
    let end = digits(sign);
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let from = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        if matches!(bytes.get(from), Some(b) if b.is_ascii_digit()) {
            return digits(from);
        }
    }
    end
}
