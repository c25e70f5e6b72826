//! Where things stand in the text of a scene: a field path (`braid.tows`, `elements.truss[3].section`)
//! to its byte range.
//!
//! The reader of RON forgets positions once a value is read. Checks that come later, and `--set`,
//! need them again, so the text is tokenised once more into a tree of ranges. The tree knows nothing
//! of the schema and does not judge: text that is not RON gives a partial tree, and the message comes
//! from the reader.
use std::fmt;
use std::ops::Range;

/// Deepest nesting of brackets that is read; a scene needs fewer than ten.
pub const MAX_DEPTH: usize = 64;

/// One step of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// Field of a struct or key of a map.
    Key(String),
    /// Place in a list or tuple.
    Index(usize),
}

/// A path into a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Path(pub Vec<Step>);

impl Path {
    /// Reads `a.b[3].c`; a key with dots in it stands in quotes: `elements."lab.spring"[0]`.
    pub fn parse(text: &str) -> Option<Path> {
        let mut steps = Vec::new();
        let mut rest = text.trim();
        while !rest.is_empty() {
            if let Some(r) = rest.strip_prefix('[') {
                let (index, r) = r.split_once(']')?;
                steps.push(Step::Index(index.trim().parse().ok()?));
                rest = r;
            } else {
                if !steps.is_empty() {
                    rest = rest.strip_prefix('.')?;
                }
                let (key, r) = if let Some(r) = rest.strip_prefix('"') {
                    r.split_once('"')?
                } else {
                    rest.split_at(rest.find(['.', '[']).unwrap_or(rest.len()))
                };
                if key.is_empty() {
                    return None;
                }
                steps.push(Step::Key(key.to_string()));
                rest = r;
            }
        }
        Some(Path(steps))
    }

    /// This path with one more key.
    pub fn key(&self, key: &str) -> Path {
        let mut p = self.clone();
        p.0.push(Step::Key(key.to_string()));
        p
    }

    /// This path with one more index.
    pub fn index(&self, index: usize) -> Path {
        let mut p = self.clone();
        p.0.push(Step::Index(index));
        p
    }
}

impl fmt::Display for Path {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (i, s) in self.0.iter().enumerate() {
            let dot = if i > 0 { "." } else { "" };
            match s {
                Step::Index(n) => write!(f, "[{n}]")?,
                Step::Key(k) if k.contains(['.', '[', '"']) => write!(f, "{dot}\"{k}\"")?,
                Step::Key(k) => write!(f, "{dot}{k}")?,
            }
        }
        Ok(())
    }
}

/// How the items of a value are bracketed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bracket {
    /// A number, string, word: no items.
    None,
    /// A struct, tuple or enum variant with content.
    Round,
    /// A list.
    Square,
    /// A map.
    Curly,
}

/// One item of a bracketed value.
#[derive(Clone, Debug)]
pub struct Item {
    /// Field name or map key, if there is one.
    pub key: Option<String>,
    /// Where the key stands (empty range at the value without one).
    pub key_span: Range<usize>,
    /// The value.
    pub value: Value,
}

/// A value of the tree.
#[derive(Clone, Debug)]
pub struct Value {
    /// All of it, from the name of the variant to the closing bracket.
    pub span: Range<usize>,
    /// The struct or variant name in front of the bracket; of a bare word, the word.
    pub name: Option<Range<usize>>,
    /// Kind of brackets.
    pub bracket: Bracket,
    /// What stands between the brackets, or the empty range.
    pub inner: Range<usize>,
    /// The items.
    pub items: Vec<Item>,
    /// True if the closing bracket was found.
    pub closed: bool,
}

/// Tree of a whole text.
#[derive(Clone, Debug)]
pub struct Tree {
    /// The value of the file; `None` if there is nothing but blanks and comments.
    pub root: Option<Value>,
    /// Where nesting got too deep, if it did.
    pub too_deep: Option<usize>,
}

/// The tree of `text`.
pub fn tree(text: &str) -> Tree {
    let mut reader = Reader { text, at: 0, depth: 0, too_deep: None };
    reader.blanks();
    while reader.rest().starts_with("#!") {
        // An attribute such as #![enable(...)] ends at its closing bracket.
        let end = reader.rest().find(']').map_or(reader.text.len(), |i| reader.at + i + 1);
        reader.at = end;
        reader.blanks();
    }
    let root = if reader.at < text.len() { Some(reader.value()) } else { None };
    Tree { root, too_deep: reader.too_deep }
}

impl Value {
    /// The direct child for one step. Brackets of a newtype (`Some(...)`, `Round((...))`) are looked through.
    pub fn child(&self, step: &Step) -> Option<&Item> {
        let found = match step {
            Step::Key(k) => self.items.iter().find(|i| i.key.as_deref() == Some(k)),
            Step::Index(n) => {
                if self.bracket == Bracket::Curly || self.items.iter().any(|i| i.key.is_some()) {
                    None
                } else {
                    self.items.get(*n)
                }
            }
        };
        if let Some(item) = found
            && !(self.wraps_one() && matches!(step, Step::Index(0)) && !item.value.items.is_empty())
        {
            return Some(item);
        }
        if self.wraps_one() {
            return self.items[0].value.child(step).or(found);
        }
        found
    }

    /// True for a named or bare pair of round brackets around a single value.
    pub fn wraps_one(&self) -> bool {
        self.bracket == Bracket::Round && self.items.len() == 1 && self.items[0].key.is_none()
    }

    /// The value at the end of `path`.
    pub fn find(&self, path: &Path) -> Option<&Value> {
        path.0.iter().try_fold(self, |v, s| v.child(s).map(|i| &i.value))
    }

    /// The deepest item on the way to `path` (`None` at the root) and the number of steps that were found.
    pub fn deepest(&self, path: &Path) -> (&Value, usize) {
        let (mut v, mut n) = (self, 0);
        for s in &path.0 {
            match v.child(s) {
                Some(i) => v = &i.value,
                None => break,
            }
            n += 1;
        }
        (v, n)
    }

    /// A range worth underlining for this value: all of it if short, else its name or opening bracket.
    pub fn mark(&self, text: &str) -> Range<usize> {
        let whole = &text[self.span.clone()];
        if whole.len() <= 80 && !whole.contains('\n') {
            return self.span.clone();
        }
        match &self.name {
            Some(n) => n.clone(),
            None => self.span.start..self.inner.start.max(self.span.start + 1).min(text.len()),
        }
    }

    /// The smallest value around the byte `at`, with the path to it.
    pub fn around(&self, at: usize) -> (Path, &Value) {
        let (mut v, mut path) = (self, Path::default());
        while let Some((n, item)) = v.items.iter().enumerate().find(|(_, i)| i.value.span.start <= at && at < i.value.span.end) {
            if let Some(k) = &item.key {
                path.0.push(Step::Key(k.clone()));
            } else if !v.wraps_one() {
                path.0.push(Step::Index(n));
            }
            v = &item.value;
        }
        (path, v)
    }

    /// The first entry of a map whose name was there before, with the path to it.
    pub fn repeated(&self) -> Option<(Path, Range<usize>)> {
        fn walk(v: &Value, at: &Path) -> Option<(Path, Range<usize>)> {
            if v.bracket == Bracket::Curly {
                let mut seen = std::collections::BTreeSet::new();
                if let Some(again) = v.items.iter().find(|i| !seen.insert(&i.key)) {
                    return Some((at.key(again.key.as_deref().unwrap_or_default()), again.key_span.clone()));
                }
            }
            v.items.iter().enumerate().find_map(|(n, i)| match &i.key {
                Some(k) => walk(&i.value, &at.key(k)),
                None if v.wraps_one() => walk(&i.value, at),
                None => walk(&i.value, &at.index(n)),
            })
        }
        walk(self, &Path::default())
    }

    /// All paths below this value that end in a field or key.
    pub fn paths(&self) -> Vec<String> {
        fn walk(v: &Value, at: &Path, out: &mut Vec<String>) {
            for item in &v.items {
                match &item.key {
                    Some(k) => {
                        let p = at.key(k);
                        out.push(p.to_string());
                        walk(&item.value, &p, out);
                    }
                    None if v.wraps_one() => walk(&item.value, at, out),
                    None => {}
                }
            }
        }
        let mut out = Vec::new();
        walk(self, &Path::default(), &mut out);
        out
    }
}

struct Reader<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    too_deep: Option<usize>,
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '_' | '.' | '+' | '-' | '#')
}

impl<'a> Reader<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    /// Skips blanks and comments.
    fn blanks(&mut self) {
        loop {
            let rest = self.rest();
            let trimmed = rest.trim_start();
            self.at += rest.len() - trimmed.len();
            if trimmed.starts_with("//") {
                self.at += trimmed.find('\n').unwrap_or(trimmed.len());
            } else if trimmed.starts_with("/*") {
                let (mut depth, mut i) = (0usize, 0);
                loop {
                    let r = &trimmed[i..];
                    if r.starts_with("/*") {
                        depth += 1;
                        i += 2;
                    } else if r.starts_with("*/") {
                        depth -= 1;
                        i += 2;
                        if depth == 0 {
                            break;
                        }
                    } else if let Some(c) = r.chars().next() {
                        i += c.len_utf8();
                    } else {
                        break;
                    }
                }
                self.at += i;
            } else {
                return;
            }
        }
    }

    /// Skips a string, raw string or character; true if there was one.
    fn quoted(&mut self) -> bool {
        let rest = self.rest();
        let body = rest.strip_prefix('b').unwrap_or(rest);
        if let Some(raw) = body.strip_prefix('r') {
            let hashes = raw.len() - raw.trim_start_matches('#').len();
            if raw[hashes..].starts_with('"') {
                let end = format!("\"{}", "#".repeat(hashes));
                let from = self.at + (rest.len() - raw.len()) + hashes + 1;
                self.at = self.text[from..].find(&end).map_or(self.text.len(), |i| from + i + end.len());
                return true;
            }
        }
        let quote = match body.chars().next() {
            Some(q @ ('"' | '\'')) => q,
            _ => return false,
        };
        let from = self.at + (rest.len() - body.len()) + 1;
        let mut escaped = false;
        for (i, c) in self.text[from..].char_indices() {
            if escaped {
                escaped = false;
            } else if c == '\\' {
                escaped = true;
            } else if c == quote {
                self.at = from + i + 1;
                return true;
            }
        }
        self.at = self.text.len();
        true
    }

    fn value(&mut self) -> Value {
        let start = self.at;
        let mut name = None;
        if !self.quoted() {
            let len = self.rest().find(|c| !is_word(c)).unwrap_or(self.rest().len());
            if len > 0 {
                if self.peek().is_some_and(|c| c.is_alphabetic() || c == '_') {
                    name = Some(start..start + len);
                }
                self.at += len;
            }
        } else {
            return self.leaf(start, None);
        }
        let after_word = self.at;
        if name.is_some() {
            self.blanks();
        }
        let (bracket, close) = match self.peek() {
            Some('(') => (Bracket::Round, ')'),
            Some('[') if self.at == start => (Bracket::Square, ']'),
            Some('{') if self.at == start => (Bracket::Curly, '}'),
            _ => {
                self.at = after_word;
                if self.at == start {
                    // Not RON; step over the character so that reading ends.
                    self.at += self.peek().map_or(0, char::len_utf8);
                }
                return self.leaf(start, name);
            }
        };
        if self.depth >= MAX_DEPTH {
            self.too_deep.get_or_insert(self.at);
            self.at = self.text.len();
            return self.leaf(start, name);
        }
        self.at += 1;
        let inner = self.at;
        self.depth += 1;
        let (items, closed) = self.items(bracket, close);
        self.depth -= 1;
        let inner_end = if closed { self.at - close.len_utf8() } else { self.at };
        Value { span: start..self.at, name, bracket, inner: inner..inner_end, items, closed }
    }

    fn leaf(&self, start: usize, name: Option<Range<usize>>) -> Value {
        Value { span: start..self.at, name, bracket: Bracket::None, inner: self.at..self.at, items: Vec::new(), closed: true }
    }

    fn items(&mut self, bracket: Bracket, close: char) -> (Vec<Item>, bool) {
        let mut items = Vec::new();
        loop {
            self.blanks();
            match self.peek() {
                None => return (items, false),
                Some(c) if c == close => {
                    self.at += 1;
                    return (items, true);
                }
                Some(',') => {
                    self.at += 1;
                    continue;
                }
                Some(')' | ']' | '}') => return (items, false),
                _ => {}
            }
            let first = self.value();
            self.blanks();
            if bracket != Bracket::Square && self.peek() == Some(':') {
                let key_span = first.span.clone();
                let key = self.text[key_span.clone()].trim_start_matches("r#").trim_matches('"').to_string();
                self.at += 1;
                self.blanks();
                let value = if matches!(self.peek(), None | Some(',' | ')' | ']' | '}')) { self.leaf(self.at, None) } else { self.value() };
                items.push(Item { key: Some(key), key_span, value });
            } else {
                let at = first.span.start;
                items.push(Item { key: None, key_span: at..at, value: first });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r##"#![enable(implicit_some)]
// a comment with (brackets
Scene(
    title: "a ) tricky \" title", /* and /* nested */ comments */
    braid: (tows: 12, pattern: Diamond),
    sections: { "wire": Round(radius: r#"2.5 um"#), "lab.x": (1, 2) },
    elements: { "truss": [ (nodes: [0, 1], section: "wire"), (nodes: [1, 99]) ] },
    mandrel: Some(Square(side: 1.5)),
    equations: [(terms: [(1.0, 3, Ux)])],
    odd: -1.5e-3,
)
"##;

    fn at(path: &str) -> &'static str {
        let root = tree(TEXT).root.unwrap();
        let v = root.find(&Path::parse(path).unwrap()).unwrap_or_else(|| panic!("{path}"));
        &TEXT[v.span.clone()]
    }

    #[test]
    fn paths_lead_to_their_text() {
        assert_eq!(at("braid.tows"), "12");
        assert_eq!(at("title"), r#""a ) tricky \" title""#);
        assert_eq!(at("sections.wire.radius"), "r#\"2.5 um\"#");
        assert_eq!(at("sections.\"lab.x\"[1]"), "2");
        assert_eq!(at("elements.truss[1].nodes[1]"), "99");
        assert_eq!(at("elements.truss"), "[ (nodes: [0, 1], section: \"wire\"), (nodes: [1, 99]) ]");
        assert_eq!(at("mandrel.side"), "1.5");
        assert_eq!(at("equations[0].terms[0][1]"), "3");
        assert_eq!(at("odd"), "-1.5e-3");
    }

    #[test]
    fn what_is_not_there_gives_the_deepest_value_that_is() {
        let root = tree(TEXT).root.unwrap();
        let (v, n) = root.deepest(&Path::parse("braid.angle").unwrap());
        assert_eq!((&TEXT[v.span.clone()], n), ("(tows: 12, pattern: Diamond)", 1));
        assert!(root.find(&Path::parse("braid.angle").unwrap()).is_none());
        let (path, v) = root.around(TEXT.find("99").unwrap());
        assert_eq!((path.to_string().as_str(), &TEXT[v.span.clone()]), ("elements.truss[1].nodes[1]", "99"));
    }

    #[test]
    fn all_paths_are_listed() {
        let paths = tree(TEXT).root.unwrap().paths();
        assert!(paths.contains(&"sections.\"lab.x\"".to_string()) && paths.contains(&"mandrel.side".to_string()), "{paths:?}");
    }

    #[test]
    fn text_that_is_not_ron_ends() {
        for text in [
            "",
            "  // nothing",
            "(",
            "(a",
            "(a:",
            "(a: ,",
            "((((",
            "(a: ]",
            "\"open",
            "r#\"open",
            "(a: /* open",
            "#![",
            ")]}",
            "(a: \u{20ac}\u{20ac})",
            "[1 2 3",
        ] {
            let _ = tree(text);
        }
        assert!(tree("").root.is_none());
        let deep = "(".repeat(100_000);
        assert_eq!(tree(&deep).too_deep, Some(MAX_DEPTH));
    }

    #[test]
    fn paths_are_read_and_written() {
        for p in ["a", "a.b", "a[3].b[0][1]", "elements.\"lab.spring\"[0]"] {
            assert_eq!(Path::parse(p).unwrap().to_string(), p);
        }
        for p in ["a..b", ".", "a[", "a[x]", "a[1]b"] {
            assert_eq!(Path::parse(p), None, "{p}");
        }
    }
}
