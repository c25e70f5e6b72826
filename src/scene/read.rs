//! From a file to a model: text, `--set`, schema, checks, model.
use super::error::{Category, Problem, SceneErrors, from_ron};
use super::schema::{Scene, VERSIONS};
use super::spans::{MAX_DEPTH, Path, Step, Tree, tree};
use super::units::UnitSystem;
use super::{build, ron_options, set};
use crate::model::Model;
use crate::registry::{Registry, nearest};
use serde::Deserialize;
use std::path::PathBuf;

/// Largest scene file that is read (bytes).
pub const MAX_BYTES: u64 = 64 << 20;

/// A scene that has been read and checked, with its model.
pub struct LoadedScene {
    /// The effective scene, automatic values resolved.
    pub scene: Scene,
    /// The model to be spawned.
    pub model: Model,
    /// The text after `--set`.
    pub text: String,
    /// The file.
    pub path: PathBuf,
}

impl LoadedScene {
    /// Name of the scene: the file without folder and ending.
    pub fn name(&self) -> String {
        self.path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned())
    }

    /// The effective scene as text, which reads back as the same scene.
    pub fn resolved(&self) -> String {
        resolved_text(&self.scene)
    }
}

pub(super) fn resolved_text(scene: &Scene) -> String {
    let pretty = ron::ser::PrettyConfig::new().compact_arrays(true);
    ron_options().to_string_pretty(scene, pretty).expect("a scene consists of plain data")
}

/// Reads, checks and builds a scene file.
///
/// # Errors
/// Everything that is wrong with the file, with its place.
pub fn load(path: impl AsRef<std::path::Path>, sets: &[(String, String)], registry: &Registry) -> Result<LoadedScene, SceneErrors> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let file_error = |e: std::io::Error| SceneErrors::plain(Category::File, &name, format!("cannot read the scene: {e}"), None);
    let about = std::fs::metadata(path).map_err(file_error)?;
    if about.is_dir() {
        return Err(SceneErrors::plain(Category::File, &name, "cannot read the scene: it is a folder", None));
    }
    if about.len() > MAX_BYTES {
        let help = format!("scenes are read up to {} MiB", MAX_BYTES >> 20);
        return Err(SceneErrors::plain(Category::Scene, &name, format!("the scene is too large: {} bytes", about.len()), Some(help)));
    }
    let bytes = std::fs::read(path).map_err(file_error)?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        SceneErrors::plain(Category::Scene, &name, format!("the scene is not UTF-8 text: byte {at} cannot be read"), None)
    })?;
    load_text(&name, text, sets, registry)
}

/// Like [`load`], from text; `name` stands for the file in messages.
///
/// # Errors
/// Everything that is wrong with the scene, with its place.
pub fn load_text(name: &str, text: String, sets: &[(String, String)], registry: &Registry) -> Result<LoadedScene, SceneErrors> {
    let mut edited = text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text);
    let original = edited.clone();
    for (path, value) in sets {
        edited = set::set(&edited, path, value)
            .map_err(|p| SceneErrors::place(Category::Usage, name, &edited, None, vec![with_known_paths(p, path, value, &original)]))?;
    }
    let tree = tree(&edited);
    let fail = |problems| Err(placed(name, &edited, &tree, sets, &original, problems));
    let mut scene = match parse(&edited, &tree) {
        Ok(scene) => scene,
        Err(problem) => return fail(vec![*problem]),
    };
    let root = tree.root.as_ref().expect("an empty scene was refused");
    match build::build(&mut scene, &edited, root, registry) {
        Ok(mut model) => {
            let path = PathBuf::from(name);
            model.name = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
            Ok(LoadedScene { scene, model, text: edited, path })
        }
        Err(problems) => fail(problems),
    }
}

/// The scene in a text, without any check of its meaning.
fn parse(text: &str, tree: &Tree) -> Result<Scene, Box<Problem>> {
    let Some(root) = &tree.root else {
        return Err(Box::new(
            Problem::new(Path::default(), "the scene is empty")
                .help("the smallest scene is (units: Si, nodes: [...], elements: {...}, stop: (time: 1))"),
        ));
    };
    if let Some(at) = tree.too_deep {
        let mut p = Problem::new(Path::default(), format!("the scene is nested too deeply: more than {MAX_DEPTH} brackets"));
        p.span = Some(at..at + 1);
        return Err(Box::new(p));
    }
    // The version comes first: another version may have other fields everywhere.
    let written = |key: &str| root.find(&Path::default().key(key)).map(|v| &text[v.span.clone()]);
    if let Some(v) = written("version")
        && let Ok(number) = v.parse::<u64>()
        && !VERSIONS.iter().any(|k| u64::from(*k) == number)
    {
        let known: Vec<String> = VERSIONS.iter().map(u32::to_string).collect();
        return Err(Box::new(
            Problem::new(Path::default().key("version"), format!("scene version {number} is not supported"))
                .help(format!("this program reads version {}", known.join(", "))),
        ));
    }
    // The unit system must be known before the first quantity is read.
    let names = UnitSystem::ALL.map(|u| u.0);
    let units = match written("units") {
        Some(word) => UnitSystem::ALL.iter().find(|u| u.0 == word).map(|u| u.1).ok_or_else(|| {
            let near = nearest(word, &names).map_or(String::new(), |n| format!("did you mean `{n}`? "));
            Problem::new(Path::default().key("units"), format!("unknown unit system `{word}`"))
                .help(format!("{near}valid: {}", names.join(", ")))
        })?,
        None => UnitSystem::MmNTonne,
    };
    let mut reader =
        ron::Deserializer::from_str_with_options(text, &ron_options()).map_err(|e| from_ron(e, text, 0..text.len(), Some(root), None))?;
    let mut track = serde_path_to_error::Track::new();
    let scene = units.while_reading(|| Scene::deserialize(serde_path_to_error::Deserializer::new(&mut reader, &mut track)));
    let scene = match scene {
        Ok(scene) => reader.end().map(|()| scene),
        Err(e) => Err(e),
    };
    scene.map_err(|e| {
        let path = path_of(&track.path());
        let mut problem = from_ron(reader.span_error(e), text, 0..text.len(), Some(root), Some(path));
        if problem.message.starts_with("field `units`") {
            problem.help = Some(format!("valid: {}", names.join(", ")));
        }
        Box::new(problem)
    })
}

fn path_of(path: &serde_path_to_error::Path) -> Path {
    use serde_path_to_error::Segment;
    let mut steps = Vec::new();
    for s in path.iter() {
        match s {
            Segment::Seq { index } => steps.push(Step::Index(*index)),
            Segment::Map { key } => steps.push(Step::Key(key.clone())),
            Segment::Enum { .. } => {}
            Segment::Unknown => break,
        }
    }
    Path(steps)
}

/// Places problems; those inside a value that `--set` has put there are reported as such.
fn placed(name: &str, text: &str, tree: &Tree, sets: &[(String, String)], original: &str, problems: Vec<Problem>) -> SceneErrors {
    let root = tree.root.as_ref();
    let mut category = Category::Scene;
    let problems = problems
        .into_iter()
        .map(|mut p| {
            let at = p.span.clone().or_else(|| root.map(|r| r.deepest(&p.path).0.mark(text)));
            let Some((path, value)) = at.and_then(|at| {
                sets.iter()
                    .rev()
                    .find(|(path, _)| root.and_then(|r| set::range_of(r, path)).is_some_and(|r| r.start <= at.start && at.end <= r.end))
            }) else {
                return p;
            };
            if p.message.starts_with("unknown field") {
                category = Category::Usage;
                return with_known_paths(set::no_such_path(path, value, &[]), path, value, original).with_choices(p.help.take());
            }
            let given = format!("given by --set {path}={value}");
            p.help = Some(p.help.map_or(given.clone(), |h| format!("{h}\n{given}")));
            p
        })
        .collect();
    SceneErrors::place(category, name, text, root, problems)
}

/// Names the nearest paths of the scene as it was before the edit, defaults included.
fn with_known_paths(problem: Problem, path: &str, value: &str, original: &str) -> Problem {
    if !problem.message.contains("there is no") {
        return problem;
    }
    let before = tree(original);
    let mut known: Vec<String> = before.root.as_ref().map_or(Vec::new(), |r| r.paths());
    if let Ok(scene) = parse(original, &before)
        && let Some(root) = tree(&resolved_text(&scene)).root
    {
        known.extend(root.paths());
    }
    known.sort();
    known.dedup();
    set::no_such_path(path, value, &known.iter().map(String::as_str).collect::<Vec<_>>())
}

impl Problem {
    fn with_choices(mut self, choices: Option<String>) -> Problem {
        self.help = match (self.help, choices) {
            (Some(a), Some(b)) => Some(format!("{a}\n{b}")),
            (a, b) => a.or(b),
        };
        self
    }
}
