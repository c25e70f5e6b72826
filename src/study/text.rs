//! Numbers and words for people.

/// Text for a page: `<`, `>`, `&` and quotes mean themselves.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '&' => out += "&amp;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

/// Five significant digits.
pub fn number(v: f64) -> String {
    digits(v, 5)
}

fn digits(v: f64, significant: i32) -> String {
    if v == 0.0 || !v.is_finite() {
        return v.to_string();
    }
    let size = v.abs().log10().floor() as i32;
    if (-4..6).contains(&size) {
        format!("{v:.*}", (significant - 1 - size).max(0) as usize)
    } else {
        format!("{v:.*e}", (significant - 1).max(0) as usize)
    }
}

/// A value and half the width of its interval, both with the digits that two of the width leave.
pub fn with_interval(value: Option<f64>, half: Option<f64>) -> String {
    let Some(v) = value else { return "–".into() };
    let Some(h) = half.filter(|h| h.is_finite()) else { return number(v) };
    let (size, place) = (v.abs().max(h).log10().floor(), h.log10().floor());
    // An interval of nothing, or one far smaller than the digits of a value, is written by itself.
    if h == 0.0 || !(-4.0..6.0).contains(&size) || size - place > 4.0 {
        return format!("{} ± {}", number(v), digits(h, 2));
    }
    let decimals = (1.0 - place).clamp(0.0, 12.0) as usize;
    format!("{v:.decimals$} ± {h:.decimals$}")
}

/// A fraction in percent, with three significant digits and at most two decimals.
pub fn percent(fraction: f64) -> String {
    let p = 100.0 * fraction;
    let decimals = match p.abs() {
        a if a < 0.005 && a > 0.0 => return "< 0.01 %".into(),
        a if a < 10.0 => 2,
        a if a < 100.0 => 1,
        _ => 0,
    };
    format!("{p:.decimals$} %")
}

/// A signed fraction in percent.
pub fn signed_percent(fraction: f64) -> String {
    let text = percent(fraction.abs());
    if fraction == 0.0 || text.starts_with('<') { text } else { format!("{}{text}", if fraction < 0.0 { '-' } else { '+' }) }
}

/// Seconds in words.
pub fn seconds(s: f64) -> String {
    match s {
        s if s < 10.0 => format!("{s:.2} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.1} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        assert_eq!(
            [3.6431234, 0.000123, 123456.0, 0.0, -71.379152, 2.5e7].map(number),
            ["3.6431", "0.00012300", "123456", "0", "-71.379", "2.5000e7"]
        );
        assert_eq!(with_interval(Some(36.0712), Some(0.5432)), "36.07 ± 0.54");
        assert_eq!(with_interval(Some(0.17212), Some(0.0162)), "0.172 ± 0.016");
        assert_eq!(with_interval(Some(1234.5), Some(250.0)), "1234 ± 250");
        assert_eq!(with_interval(Some(3.6436), None), "3.6436");
        assert_eq!(with_interval(Some(2.0), Some(0.0)), "2.0000 ± 0");
        assert_eq!(with_interval(Some(0.110885368), Some(4.7e-8)), "0.11089 ± 4.7e-8");
        assert_eq!(with_interval(None, Some(1.0)), "–");
        assert_eq!([0.137, 0.0033, 1.93, 0.0, 1e-6].map(percent), ["13.7 %", "0.33 %", "193 %", "0.00 %", "< 0.01 %"]);
        assert_eq!([-0.199, 0.0055].map(signed_percent), ["-19.9 %", "+0.55 %"]);
        assert_eq!([0.042, 29.2, 125.0, 9000.0].map(seconds), ["0.04 s", "29 s", "2.1 min", "2.5 h"]);
    }

    #[test]
    fn words_cannot_become_tags() {
        assert_eq!(escape("<a href=\"x\">'&"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;");
    }
}
