//! From a file to a [`Study`]: text, schema, what can be said without its scenes.
use super::schema::{PartBy, Study, UncertaintySpec};
use crate::registry::nearest;
use crate::scene::error::{Category, Problem, SceneErrors, from_ron};
use crate::scene::ron_options;
use crate::scene::spans::{MAX_DEPTH, Path, Tree, tree};
use crate::scene::units::UnitSystem;
use crate::scene::{path_of, text_of};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// A study file that has been read.
#[derive(Clone, Debug)]
pub struct StudyFile {
    /// What it says.
    pub study: Study,
    /// Its text.
    pub text: String,
    /// The file.
    pub path: PathBuf,
    /// True if scenes may lie anywhere; else in the folder of the study, in the working folder, or below them.
    pub outside: bool,
}

impl StudyFile {
    /// Name of the study: the file without folder and ending.
    pub fn name(&self) -> String {
        self.path.file_stem().map_or("study".into(), |s| s.to_string_lossy().into_owned())
    }

    /// The file that a name in the study means.
    pub fn scene_path(&self, name: &str) -> PathBuf {
        self.path.parent().map_or_else(|| PathBuf::from(name), |folder| folder.join(name))
    }

    /// True if a scene lies where the study may reach: a file that a study names is quoted in messages.
    pub fn may_read(&self, scene: &std::path::Path) -> bool {
        let whole = |p: &std::path::Path| std::fs::canonicalize(if p.as_os_str().is_empty() { std::path::Path::new(".") } else { p }).ok();
        // A file that is not there has a message of its own.
        let Some(scene) = whole(scene) else { return true };
        let own = self.path.parent().and_then(whole);
        self.outside
            || [own, std::env::current_dir().ok().and_then(|d| whole(&d))].into_iter().flatten().any(|folder| scene.starts_with(folder))
    }

    /// Problems with their places in the file.
    pub fn errors(&self, problems: Vec<Problem>) -> SceneErrors {
        place(&self.path.display().to_string(), &self.text, &tree(&self.text), problems)
    }
}

/// Reads a study file and checks what can be checked without its scenes.
///
/// # Errors
/// Everything that is wrong with the file, with its place.
pub fn load(path: impl AsRef<std::path::Path>) -> Result<StudyFile, SceneErrors> {
    let path = path.as_ref();
    load_text(&path.display().to_string(), text_of(path, "study")?)
}

/// Like [`load`], from text; `name` stands for the file in messages, and its folder is where scenes are looked for.
///
/// # Errors
/// Everything that is wrong with the study, with its place.
pub fn load_text(name: &str, text: String) -> Result<StudyFile, SceneErrors> {
    let text = text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text);
    let tree = tree(&text);
    let study = parse(&text, &tree).map_err(|p| place(name, &text, &tree, vec![*p]))?;
    let problems = check(&study);
    if !problems.is_empty() {
        return Err(place(name, &text, &tree, problems));
    }
    Ok(StudyFile { study, text, path: PathBuf::from(name), outside: false })
}

fn place(name: &str, text: &str, tree: &Tree, problems: Vec<Problem>) -> SceneErrors {
    SceneErrors::place(Category::Scene, name, text, tree.root.as_ref(), problems)
}

fn parse(text: &str, tree: &Tree) -> Result<Study, Box<Problem>> {
    let Some(root) = &tree.root else {
        let problem = Problem::new(Path::default(), "the study is empty");
        return Err(Box::new(
            problem.help("the smallest study is (scene: \"a.ron\", rows: [(label: \"as it is\")], outcomes: [(name: \"tip\")])"),
        ));
    };
    if let Some(at) = tree.too_deep {
        let mut p = Problem::new(Path::default(), format!("the study is nested too deeply: more than {MAX_DEPTH} brackets"));
        p.span = Some(at..at + 1);
        return Err(Box::new(p));
    }
    // The reader would silently keep the last of two entries of one name.
    if let Some((path, span)) = root.repeated() {
        let mut problem = Problem::new(path, "an entry of this name is there already");
        problem.span = Some(span);
        return Err(Box::new(problem));
    }
    let whole = 0..text.len();
    let mut reader =
        ron::Deserializer::from_str_with_options(text, &ron_options()).map_err(|e| from_ron(e, text, whole.clone(), Some(root), None))?;
    let mut track = serde_path_to_error::Track::new();
    // Times are in seconds.
    let study = UnitSystem::Si.while_reading(|| Study::deserialize(serde_path_to_error::Deserializer::new(&mut reader, &mut track)));
    study
        .and_then(|study| reader.end().map(|()| study))
        .map_err(|e| Box::new(from_ron(reader.span_error(e), text, whole, Some(root), Some(path_of(&track.path())))))
}

/// The path of a key.
pub(super) fn at(key: &str) -> Path {
    Path::default().key(key)
}

/// An unknown name, with the known ones.
pub(super) fn unknown(path: Path, what: &str, name: &str, known: &[&str]) -> Problem {
    let near = nearest(name, known).map_or(String::new(), |n| format!("did you mean `{n}`? "));
    let list = known.iter().map(|k| format!("`{k}`")).collect::<Vec<_>>().join(", ");
    let help = if known.is_empty() { "there are none".to_owned() } else { format!("{near}known: {list}") };
    Problem::new(path, format!("unknown {what} `{name}`")).help(help)
}

/// What is wrong with a study as such.
fn check(study: &Study) -> Vec<Problem> {
    let mut problems = Vec::new();
    if study.axes.is_empty() && study.rows.is_empty() {
        problems.push(Problem::new(Path::default(), "the study has no rows").help("give it `axes`, `rows`, or both"));
    }
    if study.outcomes.is_empty() {
        problems.push(Problem::new(at("outcomes"), "nothing is compared").help("name measures or probes: [(name: \"length\")]"));
    }
    for (i, axis) in study.axes.iter().enumerate() {
        if axis.points.is_empty() {
            problems.push(Problem::new(at("axes").index(i).key("points"), format!("axis `{}` has no points", axis.name)));
        }
        let labels =
            axis.points.iter().enumerate().map(|(j, p)| (at("axes").index(i).key("points").index(j).key("label"), p.label.as_str()));
        named_once(labels, "point", &mut problems);
    }
    named_once(study.axes.iter().enumerate().map(|(i, a)| (at("axes").index(i).key("name"), a.name.as_str())), "axis", &mut problems);
    named_once(study.rows.iter().enumerate().map(|(i, r)| (at("rows").index(i).key("label"), r.label.as_str())), "row", &mut problems);
    let outcomes = study.outcomes.iter().enumerate();
    named_once(outcomes.clone().map(|(i, o)| (at("outcomes").index(i).key("name"), o.name.as_str())), "outcome", &mut problems);
    for (i, o) in outcomes {
        let path = at("outcomes").index(i);
        if let super::ErrorSpec::Scaled(size) = o.error
            && !(size.is_finite() && size > 0.0)
        {
            problems.push(Problem::new(path.key("error"), format!("the size of an error must be positive, not {size}")));
        }
        if o.tolerance.0 <= 0.0 {
            problems.push(Problem::new(path.key("tolerance"), format!("a tolerance must be positive, not {}", o.tolerance.0)));
        }
    }
    if let Some(r) = &study.replicates {
        let path = at("replicates").key("seeds");
        if r.seeds.is_empty() {
            problems.push(Problem::new(path.clone(), "no seeds are given").help("one per repetition: [1, 2, 3]"));
        }
        let mut seen = BTreeSet::new();
        if let Some(i) = r.seeds.iter().position(|s| !seen.insert(s)) {
            problems.push(Problem::new(path.index(i), format!("seed {} is given twice: its runs would be equal to the bit", r.seeds[i])));
        }
    }
    if let Some(name) = &study.convergence {
        let axes: Vec<&str> = study.axes.iter().map(|a| a.name.as_str()).collect();
        if !axes.contains(&name.as_str()) {
            problems.push(unknown(at("convergence"), "axis", name, &axes));
        }
    }
    if study.max_parallel == Some(0) {
        problems.push(Problem::new(at("max_parallel"), "at least one row must run at a time"));
    }
    if let Some(labels) = &study.reference {
        check_labels(study, at("reference"), labels, true, &mut problems);
    }
    let names: Vec<&str> = study.outcomes.iter().map(|o| o.name.as_str()).collect();
    problems.extend(study.uncertainty.iter().flat_map(|u| check_uncertainty(study, u)));
    for (name, ratio) in &study.reference_uncertainty {
        let path = at("reference_uncertainty").key(name);
        if !names.contains(&name.as_str()) {
            problems.push(unknown(path, "outcome", name, &names));
        } else if !(ratio.0.is_finite() && ratio.0 >= 0.0) {
            problems.push(Problem::new(path, format!("an uncertainty must not be negative, and this is {}", ratio.0)));
        }
    }
    for (i, p) in study.published.iter().enumerate() {
        let path = at("published").index(i);
        check_labels(study, path.key("row"), &p.row, false, &mut problems);
        for (key, name) in p.values.keys().map(|n| ("values", n)).chain(p.errors.keys().map(|n| ("errors", n))) {
            if !names.contains(&name.as_str()) {
                problems.push(unknown(path.key(key).key(name), "outcome", name, &names));
            }
        }
    }
    problems
}

/// What is wrong with the parts of an uncertainty.
fn check_uncertainty(study: &Study, u: &UncertaintySpec) -> Vec<Problem> {
    let mut problems = Vec::new();
    let path = at("uncertainty");
    check_labels(study, path.key("base"), &u.base, false, &mut problems);
    let part = |i: usize| path.key("parts").index(i);
    named_once(u.parts.iter().enumerate().map(|(i, p)| (part(i).key("name"), p.name.as_str())), "part", &mut problems);
    if u.parts.is_empty() {
        problems.push(
            Problem::new(path.key("parts"), "the uncertainty has no parts").help("for example (name: \"mesh\", rows: [[\"61 elements\"]])"),
        );
    }
    for (i, p) in u.parts.iter().enumerate() {
        if p.rows.is_empty() && p.by != PartBy::Places {
            problems.push(Problem::new(part(i), format!("part `{}` has no rows to be found from", p.name)));
        } else if p.by == PartBy::Places && !p.rows.is_empty() {
            problems.push(Problem::new(part(i).key("rows"), "the places are those of the base: this part has no rows of its own"));
        }
        for (j, labels) in p.rows.iter().enumerate() {
            check_labels(study, part(i).key("rows").index(j), labels, false, &mut problems);
        }
    }
    problems
}

/// Names that are empty or there already.
fn named_once<'a>(names: impl Iterator<Item = (Path, &'a str)>, what: &str, problems: &mut Vec<Problem>) {
    let mut seen = BTreeSet::new();
    for (path, name) in names {
        if name.trim().is_empty() || name == "*" {
            problems.push(Problem::new(
                path,
                format!("`{name}` is no name for a{} {what}", if what.starts_with(['a', 'o']) { "n" } else { "" }),
            ));
        } else if !seen.insert(name) {
            problems.push(Problem::new(path, format!("{what} `{name}` is there already")));
        }
    }
}

/// Labels that mean a row: one per axis, or that of a row by itself.
fn check_labels(study: &Study, path: Path, labels: &[String], star: bool, problems: &mut Vec<Problem>) {
    let single: Vec<&str> = study.rows.iter().map(|r| r.label.as_str()).collect();
    if labels.len() == 1 && single.contains(&labels[0].as_str()) {
        return;
    }
    if labels.len() != study.axes.len() || labels.is_empty() {
        if let [one] = labels
            && !single.is_empty()
        {
            problems.push(unknown(path.index(0), "row", one, &single));
            return;
        }
        let rows = if single.is_empty() { String::new() } else { ", or the label of a row".to_owned() };
        let message = format!("{} labels are given, and there are {} axes", labels.len(), study.axes.len());
        problems.push(Problem::new(path, message).help(format!("a row is named by one label per axis{rows}")));
        return;
    }
    for (i, (label, axis)) in labels.iter().zip(&study.axes).enumerate() {
        let known: Vec<&str> = axis
            .points
            .iter()
            .map(|p| p.label.as_str())
            .chain((labels.len() == 1).then_some(&single[..]).into_iter().flatten().copied())
            .collect();
        if !(known.contains(&label.as_str()) || star && label == "*") {
            problems.push(unknown(path.index(i), &format!("point of axis `{}`", axis.name), label, &known));
        }
    }
}
