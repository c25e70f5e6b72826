//! `--set path=value`: edits the text of a scene before it is read, so that a value given on the
//! command line meets the same checks as one in the file.
use super::error::Problem;
use super::spans::{Bracket, Path, Step, Value, tree};
use crate::registry::nearest;
use std::ops::Range;

/// Replaces the value at `path`, or inserts the field where its group of fields is.
///
/// # Errors
/// A path that cannot be read, or that leads through something without fields.
pub fn set(text: &str, path: &str, value: &str) -> Result<String, Problem> {
    let wrong = |message: String| Problem::new(Path::default(), format!("--set {path}={value}: {message}"));
    let steps = Path::parse(path)
        .filter(|p| !p.0.is_empty())
        .ok_or_else(|| wrong(format!("`{path}` is not a path")).help("a path looks like tow.filaments or elements.truss[3].section"))?;
    let whole = tree(text);
    let root = whole.root.ok_or_else(|| wrong("the scene is empty".into()))?;
    let (mut at, found) = root.deepest(&steps);
    let rest = &steps.0[found..];
    if rest.is_empty() {
        return Ok(replace(text, at.span.clone(), &as_ron(value, Some(&text[at.span.clone()]))));
    }
    while at.wraps_one() && at.items[0].value.bracket != Bracket::None {
        at = &at.items[0].value;
    }
    let missing = || {
        let known = root.paths();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        no_such_path(path, value, &known)
    };
    let keys: Vec<&str> =
        rest.iter().map(|s| if let Step::Key(k) = s { Some(k.as_str()) } else { None }).collect::<Option<_>>().ok_or_else(missing)?;
    let named = at.items.iter().all(|i| i.key.is_some());
    let new = match at.bracket {
        Bracket::Round if named => {
            let inner = keys.iter().skip(1).rev().fold(as_ron(value, None), |v, k| format!("({k}: {v})"));
            format!("{}: {inner}", keys[0])
        }
        Bracket::Curly if keys.len() == 1 => format!("{:?}: {}", keys[0], as_ron(value, None)),
        _ => return Err(missing()),
    };
    let comma = if at.items.is_empty() { "" } else { ", " };
    Ok(replace(text, at.inner.start..at.inner.start, &format!("{new}{comma}")))
}

/// The error for a path that leads nowhere, with the nearest that lead somewhere.
pub fn no_such_path(path: &str, value: &str, known: &[&str]) -> Problem {
    let problem = Problem::new(Path::default(), format!("--set {path}={value}: there is no `{path}` in this scene"));
    let mut ranked: Vec<(usize, &str)> = known.iter().map(|k| (strsim::damerau_levenshtein(path, k), *k)).collect();
    ranked.sort();
    ranked.dedup();
    let near: Vec<String> = ranked.iter().take(5).map(|(_, k)| format!("`{k}`")).collect();
    let first = nearest(path, known).map_or(String::new(), |n| format!("did you mean `{n}`? "));
    if near.is_empty() { problem } else { problem.help(format!("{first}nearest: {}", near.join(", "))) }
}

/// The range that `--set path` has filled in the edited text, key included.
pub fn range_of(root: &Value, path: &str) -> Option<Range<usize>> {
    let steps = Path::parse(path)?;
    let last = steps.0.last()?.clone();
    let mut parent = steps;
    parent.0.pop();
    let item = root.find(&parent)?.child(&last)?;
    Some(item.key_span.start.min(item.value.span.start)..item.value.span.end)
}

fn replace(text: &str, range: Range<usize>, new: &str) -> String {
    format!("{}{new}{}", &text[..range.start], &text[range.end..])
}

/// The shell eats quotes: what is not RON, or a bare word in the place of a text, is put into quotes.
fn as_ron(value: &str, before: Option<&str>) -> String {
    let value = value.trim();
    let word = value.chars().all(|c| c.is_alphanumeric() || c == '_') && value.starts_with(|c: char| c.is_alphabetic());
    let quoted = word && value != "None" && before.is_some_and(|b| b.starts_with('"'));
    if !quoted && ron::value::RawValue::from_ron(value).is_ok() { value.to_string() } else { format!("{value:?}") }
}

#[cfg(test)]
mod tests {
    use super::set;

    #[test]
    fn values_are_replaced_or_inserted() {
        let text = "(tow: (filaments: 7, model: Beams), title: \"a\", maps: {\"x\": 1}, m: Some((a: 1)), e: ())";
        let done = |p, v| set(text, p, v).map_err(|e| e.help.unwrap_or(e.message));
        assert!(done("tow.filaments", "19").unwrap().contains("filaments: 19, model"));
        assert!(done("tow.model", "Trusses").unwrap().contains("model: Trusses)"));
        assert!(done("title", "word").unwrap().contains("title: \"word\""));
        assert!(done("load.force", "2 mN").unwrap().starts_with("(load: (force: \"2 mN\"), tow"));
        assert!(done("title", "None").unwrap().contains("title: None"), "what may be left out is left out");
        assert!(done("tow.radius", "2.5um").unwrap().contains("(radius: \"2.5um\", filaments"));
        assert!(done("maps.y", "2").unwrap().contains("{\"y\": 2, \"x\""));
        assert!(done("m.b", "2").unwrap().contains("Some((b: 2, a: 1))"));
        assert!(done("e.b", "2").unwrap().contains("e: (b: 2)"));
        assert!(done("tow.filaments.x", "2").unwrap_err().contains("`tow.filaments`"));
        assert!(done("tow..x", "2").unwrap_err().contains("a path looks like"));
        assert!(done("", "2").is_err() && done("tow[7]", "2").is_err());
    }
}
