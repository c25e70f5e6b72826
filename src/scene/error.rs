//! Errors of a scene: what is wrong, where in the file, what would be right.
use super::spans::{Path, Value};
use crate::registry::{SpecError, nearest};
use miette::{Diagnostic, LabeledSpan, NamedSource, Severity, SourceCode};
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// One thing that is wrong with a scene, before it is known in which file.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Path of the offending field (`materials.glass.poisson`); empty for the whole scene.
    pub path: Path,
    /// What is wrong, naming the object, the field and the offending word or value.
    pub message: String,
    /// What would be right.
    pub help: Option<String>,
    /// Byte range in the text, where it is known better than from the path.
    pub span: Option<Range<usize>>,
    /// True if it holds whatever else is wrong with the scene.
    pub stands_alone: bool,
}

impl Problem {
    /// A problem at `path`.
    pub fn new(path: Path, message: impl Into<String>) -> Self {
        Problem { path, message: message.into(), help: None, span: None, stands_alone: false }
    }

    /// Adds what would be right.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// An error of an entry of the scene that stands at `entry`.
    pub fn of_entry(entry: &Path, error: SpecError) -> Self {
        let mut path = entry.clone();
        path.0.extend(Path::parse(&error.path).unwrap_or_default().0);
        Problem { path, message: error.message, help: error.help, span: None, stands_alone: false }
    }
}

/// A problem with its place in a file.
#[derive(Clone, Debug)]
pub struct SceneError {
    /// What is wrong.
    pub message: String,
    /// What would be right.
    pub help: Option<String>,
    /// Path of the field.
    pub path: String,
    /// Byte range in the text of the scene.
    pub span: Option<Range<usize>>,
    file: String,
    source: Arc<NamedSource<String>>,
}

impl SceneError {
    /// Line and column (from 1) of the offending text; 1:1 if it has no place of its own.
    pub fn place(&self) -> (usize, usize) {
        line_and_column(self.source.inner(), self.span.as_ref().map_or(0, |s| s.start))
    }

    /// The file.
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The offending text.
    pub fn word(&self) -> &str {
        self.span.as_ref().map_or("", |s| &self.source.inner()[s.clone()])
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for SceneError {}

impl Diagnostic for SceneError {
    fn severity(&self) -> Option<Severity> {
        Some(Severity::Error)
    }
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|h| Box::new(h) as Box<dyn fmt::Display>)
    }
    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.span.as_ref().map(|_| &*self.source as &dyn SourceCode)
    }
    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.span.clone()?;
        let label = (!self.path.is_empty()).then(|| self.path.clone());
        Some(Box::new(std::iter::once(LabeledSpan::new(label, span.start, span.len().max(1)))))
    }
}

/// What kind of failure it is, for the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// The scene is invalid.
    Scene,
    /// The file cannot be read.
    File,
    /// What was given on the command line (`--set`) is wrong.
    Usage,
}

impl Category {
    /// The exit code of the program.
    pub fn exit_code(self) -> u8 {
        match self {
            Category::Usage => 2,
            Category::Scene => 3,
            Category::File => 4,
        }
    }
}

/// Everything that is wrong with a scene.
#[derive(Clone, Debug)]
pub struct SceneErrors {
    /// Kind of failure.
    pub category: Category,
    /// The errors, in the order of the file; at least one.
    pub errors: Vec<SceneError>,
}

/// Errors beyond this number are only counted.
const SHOWN: usize = 20;

impl SceneErrors {
    /// Places problems in the text with the help of its tree.
    pub fn place(category: Category, file: &str, text: &str, root: Option<&Value>, problems: Vec<Problem>) -> Self {
        let source = Arc::new(NamedSource::new(file, text.to_string()));
        let mut errors: Vec<SceneError> = problems
            .into_iter()
            .map(|p| {
                let span = p.span.or_else(|| {
                    let root = root?;
                    Some(root.deepest(&p.path).0.mark(text))
                });
                SceneError {
                    message: p.message,
                    help: p.help,
                    path: p.path.to_string(),
                    span,
                    file: file.to_string(),
                    source: source.clone(),
                }
            })
            .collect();
        errors.sort_by_key(|e| e.span.as_ref().map_or(0, |s| s.start));
        SceneErrors { category, errors }
    }

    /// One error without a place in a text.
    pub fn plain(category: Category, file: &str, message: impl Into<String>, help: Option<String>) -> Self {
        let source = Arc::new(NamedSource::new(file, String::new()));
        let e = SceneError { message: message.into(), help, path: String::new(), span: None, file: file.to_string(), source };
        SceneErrors { category, errors: vec![e] }
    }
}

/// One line, `file:line:col: path: message`, and one for the help; `kind` (`hint: `) stands before the path.
impl SceneError {
    pub(crate) fn line(&self, kind: &str) -> String {
        let mut text = format!("{}:", self.file);
        if self.span.is_some() {
            let (line, column) = self.place();
            text += &format!("{line}:{column}:");
        }
        text += &format!(" {kind}");
        if !self.path.is_empty() {
            text += &format!("{}: ", self.path);
        }
        text += &self.message;
        if let Some(h) = &self.help {
            text += &format!("\n  help: {h}");
        }
        text
    }
}

/// Plain text, one error after the other.
impl fmt::Display for SceneErrors {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (i, e) in self.errors.iter().take(SHOWN).enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            f.write_str(&e.line(""))?;
        }
        if self.errors.len() > SHOWN {
            write!(f, "\nand {} more errors", self.errors.len() - SHOWN)?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneErrors {}

impl Diagnostic for SceneErrors {
    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        Some(Box::new(self.errors.iter().take(SHOWN).map(|e| e as &dyn Diagnostic)))
    }
}

/// Line and column, from 1, of a byte offset.
pub fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    let before = &text[..at];
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    (before.matches('\n').count() + 1, before[start..].chars().count() + 1)
}

/// Byte offset of a line and column as RON counts them.
fn offset(text: &str, place: ron::error::Position) -> usize {
    let mut start = 0;
    for _ in 1..place.line {
        match text[start..].find('\n') {
            Some(i) => start += i + 1,
            None => return text.len(),
        }
    }
    text[start..].char_indices().nth(place.col.saturating_sub(1)).map_or(text.len(), |(i, _)| start + i)
}

/// Message for a word or number where a text belongs.
pub(super) const EXPECTED_TEXT: &str = "expected a text in double quotes";

/// Turns an error of the RON reader into a problem with a place. `part` is the range of the text that was read;
/// `path` is the path of the value that was being read, where it is known.
pub fn from_ron(error: ron::error::SpannedError, text: &str, part: Range<usize>, root: Option<&Value>, path: Option<Path>) -> Problem {
    use ron::Error as E;
    let read = &text[part.clone()];
    let (start, end) = (part.start + offset(read, error.span.start), part.start + offset(read, error.span.end));
    let mut span = start..end.max(start);
    // The reader marks from the blanks in front of a word to the character behind it.
    let marked = &text[span.clone()];
    if !marked.trim().is_empty() {
        span.start += marked.len() - marked.trim_start().len();
        span.end -= marked.len() - marked.trim_end().len();
    }
    let around = root.map(|r| r.around(span.start));
    let mut at = path.clone().or_else(|| around.as_ref().map(|(p, _)| p.clone())).unwrap_or_default();
    // Where the word stands is known from the tree: the reader's own mark is often one character.
    let word_of = |path: &Path| root.and_then(|r| r.find(path)).map(|v| v.mark(text));
    let near_word = |name: &str| {
        let from = text[..span.end.min(text.len())].rfind(name)?;
        Some(from..from + name.len())
    };
    let list = |names: &[&'static str]| names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ");
    let of = |outer: &Option<String>| outer.as_ref().map_or(String::new(), |o| format!(" of {}", spoken(o)));
    let suggest = |word: &str, names: &[&'static str], what: &str| {
        let near = nearest(word, names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
        if names.is_empty() { format!("there are no {what} here") } else { format!("{near}valid {what}: {}", list(names)) }
    };
    // The reader of a whole number stops at the point of `1.5` and misses a comma there.
    let fraction = root.map(|r| r.around(span.start).1.span.clone()).and_then(|place| {
        let word = &text[place.clone()];
        (word.contains('.') && word.parse::<f64>().is_ok()).then(|| (word.to_string(), place))
    });
    // Where brackets, commas or quotes are wrong, what follows cannot be told apart.
    let grammar = matches!(
        error.code,
        E::Eof
            | E::ExpectedArrayEnd
            | E::ExpectedMapColon
            | E::ExpectedMapEnd
            | E::ExpectedStringEnd
            | E::ExpectedStructLikeEnd
            | E::ExpectedRawValue
            | E::TrailingCharacters
            | E::UnclosedBlockComment
            | E::UnclosedLineComment
            | E::UnexpectedChar(_)
            | E::ExceededRecursionLimit
    ) || matches!(error.code, E::ExpectedComma) && fraction.is_none();
    let (message, help) = match error.code {
        E::NoSuchStructField { expected, found, outer } => {
            span = near_word(&found).unwrap_or(span);
            (format!("unknown field `{found}`{}", of(&outer)), Some(suggest(&found, expected, "fields")))
        }
        E::NoSuchEnumVariant { expected, found, outer } => {
            span = near_word(&found).unwrap_or(span);
            (format!("unknown choice `{found}`{}", of(&outer)), Some(suggest(&found, expected, "choices")))
        }
        E::MissingStructField { field, outer } => {
            // The reader stands at the closing bracket; the value begins where somebody will look.
            if let Some(v) = around.as_ref().map(|(_, v)| v).filter(|v| v.span.end > span.start) {
                span = v.mark(text);
            } else if let Some(s) = word_of(&at) {
                span = s;
            }
            (format!("field `{field}`{} is missing", of(&outer)), None)
        }
        E::DuplicateStructField { field, outer } => {
            span = near_word(field).unwrap_or(span);
            (format!("field `{field}`{} is given twice", of(&outer)), None)
        }
        E::Message(m) => {
            if let Some(s) = path.as_ref().and_then(word_of) {
                span = s;
            } else if let Some((p, v)) = root.map(|r| r.around(span.end.saturating_sub(1).max(part.start))) {
                span = v.mark(text);
                at = p;
            }
            (m, None)
        }
        E::InvalidValueForType { expected, found } => {
            if let Some(s) = path.as_ref().and_then(word_of) {
                span = s;
            }
            (format!("expected {expected}, found {found}"), None)
        }
        E::ExpectedString => (EXPECTED_TEXT.to_string(), None),
        E::ExpectedComma if fraction.is_some() => {
            let (word, place) = fraction.expect("just looked");
            span = place;
            (format!("expected a whole number, found `{word}`"), None)
        }
        E::ExpectedNamedStructLike(name) => {
            (format!("expected the fields of {}", spoken(name)), Some("a group of fields is written (field: value, ...)".to_string()))
        }
        E::ExpectedIdentifier => {
            ("expected the name of a choice".to_string(), Some("a choice is written Name, or Name(field: value, ...)".to_string()))
        }
        E::ExceededRecursionLimit => ("the scene is nested too deeply".to_string(), None),
        other => {
            let m = other.to_string();
            let m = m.chars().next().map_or(String::new(), |c| c.to_lowercase().collect::<String>() + &m[c.len_utf8()..]);
            let help = match other {
                E::ExpectedStructLike => Some("a group of fields is written (field: value, ...)".to_string()),
                E::ExpectedArray => Some("a list is written [first, second, ...]".to_string()),
                E::ExpectedMap => Some("named entries are written {\"name\": value, ...}".to_string()),
                E::ExpectedStringEnd => Some("the closing quote is missing".to_string()),
                E::Eof => Some("a closing bracket is missing".to_string()),
                _ => None,
            };
            (m, help)
        }
    };
    span.end = span.end.min(text.len());
    span.start = span.start.min(span.end);
    Problem { path: at, message, help, span: Some(span), stands_alone: !grammar }
}

/// `BraidSpec` becomes `braid`: what a reader of a scene calls the thing.
fn spoken(type_name: &str) -> String {
    let name = type_name.strip_suffix("Spec").unwrap_or(type_name);
    let mut out = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !out.is_empty() {
            out.push(' ');
        }
        out.extend(c.to_lowercase());
    }
    out
}
