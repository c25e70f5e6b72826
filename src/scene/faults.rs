//! More than one fault in a scene: the reader stops at the first, so what is wrong is left out of the text and the rest read again.
use super::build;
use super::error::Problem;
use super::read::parse;
use super::spans::{Bracket, Item, Value, tree};
use crate::registry::Registry;
use std::ops::Range;

/// Most faults that are looked for after the first one, and the largest text (bytes) in which more than one is: every one takes
/// another reading.
pub(super) const MOST_FAULTS: usize = 20;
const MOST_TEXT: usize = 1 << 20;

/// The first thing that the reader found wrong, and what else is: the field or entry in which it stands is left out, and the
/// rest is read again. Of the model that then comes out only what is wrong by itself is told.
pub(super) fn further(first: Problem, text: &str, registry: &Registry, memory: Option<u64>) -> Vec<Problem> {
    let (mut text, mut problems) = (text.to_string(), vec![first]);
    let mut fault = problems[0].span.clone().filter(|_| problems[0].stands_alone && text.len() <= MOST_TEXT);
    let mut left_out: Vec<usize> = Vec::new();
    for _ in 0..MOST_FAULTS {
        let Some(at) = fault.take() else { break };
        let whole = tree(&text);
        let Some(item) = whole.root.as_ref().and_then(|root| wrong_item(root, at.start)) else { break };
        left_out.push(item.start);
        blank_out(&mut text, item);
        let tree = tree(&text);
        match parse(&text, &tree, registry) {
            Ok(mut scene) => {
                let root = tree.root.as_ref().expect("a scene was read");
                let more = build::build(&mut scene, &text, root, registry, memory).err().unwrap_or_default();
                problems.extend(more.into_iter().filter(|p| p.stands_alone));
            }
            Err(problem) => {
                fault = problem.span.clone().filter(|_| problem.stands_alone);
                // What is missing where something was left out may be just that.
                let group = tree.root.as_ref().map_or(0..0, |root| root.deepest(&problem.path).0.span.clone());
                let consequence = problem.message.ends_with("is missing") && left_out.iter().any(|at| group.contains(at));
                if !consequence {
                    problems.push(*problem);
                }
            }
        }
    }
    problems
}

/// The smallest part of a scene around the byte `at` without which the rest can be read: a field, an entry of a map, or a group in a
/// list. Numbers of a list go with their list: points would have too few.
fn wrong_item(root: &Value, at: usize) -> Option<Range<usize>> {
    let all = |item: &Item| item.key_span.start.min(item.value.span.start)..item.value.span.end;
    let (mut value, mut found) = (root, None);
    while let Some(item) = value.items.iter().find(|i| all(i).contains(&at)) {
        let (keyed, listed) = (item.key.is_some(), value.bracket == Bracket::Square && item.value.bracket != Bracket::None);
        // Without its units no number of a scene has a meaning.
        if found.is_none() && item.key.as_deref() == Some("units") {
            return None;
        }
        if keyed || listed {
            found = Some(all(item));
        }
        if listed && item.value.bracket == Bracket::Square {
            break;
        }
        value = &item.value;
    }
    found
}

/// Blanks out a part of a text with the comma after it, so that everything else stays in its place.
pub(super) fn blank_out(text: &mut String, mut range: Range<usize>) {
    let after = &text[range.end..];
    let comma = after.len() - after.trim_start().len();
    if after[comma..].starts_with(',') {
        range.end += comma + 1;
    }
    let blank = |c: char| std::iter::repeat_n(if c == '\n' { '\n' } else { ' ' }, c.len_utf8());
    let blanks: String = text[range.clone()].chars().flat_map(blank).collect();
    text.replace_range(range, &blanks);
}
