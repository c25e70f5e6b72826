//! From a file to a model: text, `--set`, schema, checks, model.
use super::error::{Category, EXPECTED_TEXT, Problem, SceneError, SceneErrors, from_ron};
use super::faults::{blank_out, further};
use super::schema::{Scene, VERSIONS};
use super::spans::{Item, MAX_DEPTH, Path, Step, Tree, Value, tree};
use super::units::UnitSystem;
use super::{build, ron_options, set};
use crate::measure::Probe;
use crate::memory;
use crate::model::Model;
use crate::registry::{Registry, SpecError, nearest};
use crate::simulation::SimulationError;
use serde::Deserialize;
use std::ops::Range;
use std::path::PathBuf;

/// Largest scene file that is read (bytes).
pub const MAX_BYTES: u64 = 64 << 20;

/// A scene that has been read and checked, with its model.
pub struct LoadedScene {
    /// The effective scene, automatic values resolved.
    pub scene: Scene,
    /// The model to be spawned.
    pub model: Model,
    /// The probes, checked against the model.
    pub probes: Vec<(String, Probe)>,
    /// What is allowed but probably not meant.
    pub hints: Vec<SceneError>,
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

    /// An error that shows only when the model is spawned, with its place in the scene.
    pub fn explain(&self, error: &SimulationError) -> SceneErrors {
        let path = match error {
            SimulationError::NoMass { node } => format!("nodes[{node}]"),
            SimulationError::Model(m) if m.contains("time step") => "integration.dt".into(),
            SimulationError::Model(m) => {
                let about = [("surface", "surfaces"), ("overlap", "contact"), ("contact", "contact")];
                about.into_iter().find(|(word, _)| m.contains(word)).map_or(String::new(), |(_, key)| key.into())
            }
            SimulationError::Numerical { .. } => String::new(),
        };
        let problem = Problem::new(Path::parse(&path).unwrap_or_default(), error.to_string());
        let tree = tree(&self.text);
        SceneErrors::place(Category::Scene, &self.path.display().to_string(), &self.text, tree.root.as_ref(), vec![problem])
    }

    /// The values of the effective scene by their paths.
    pub fn words(&self) -> Words {
        let text = self.resolved();
        Words { tree: tree(&text), text }
    }

    /// The effective scene as text, which reads back as the same scene.
    pub fn resolved(&self) -> String {
        resolved_text(&self.scene)
    }
}

/// Values of a scene by their paths.
pub struct Words {
    text: String,
    tree: Tree,
}

impl Words {
    /// What stands at `path`: a number in the units of the scene, a word, or a group as it is written.
    pub fn at(&self, path: &str) -> Option<&str> {
        let found = self.tree.root.as_ref()?.find(&Path::parse(path)?)?;
        Some(self.text[found.span.clone()].trim())
    }
}

fn resolved_text(scene: &Scene) -> String {
    let pretty = ron::ser::PrettyConfig::new().compact_arrays(true);
    let mut text = ron_options().to_string_pretty(scene, pretty).expect("a scene consists of plain data");
    let end = text.rfind(')').expect("a scene is a struct");
    // Names with a prefix stand in quotes, as they do in scenes.
    let quoted = |key: &str| if key.contains('.') { format!("{key:?}") } else { key.to_string() };
    let settings: String = scene.settings.iter().map(|(key, value)| format!("    {}: {value},\n", quoted(key))).collect();
    text.insert_str(end, &settings);
    text
}

/// Reads, checks and builds a scene file.
///
/// # Errors
/// Everything that is wrong with the file, with its place.
pub fn load(path: impl AsRef<std::path::Path>, sets: &[(String, String)], registry: &Registry) -> Result<LoadedScene, SceneErrors> {
    let path = path.as_ref();
    let text = text_of(path, "scene")?;
    load_text(&path.display().to_string(), text, sets, registry)
}

/// The text of a file; `what` it is stands in messages.
pub(crate) fn text_of(path: &std::path::Path, what: &str) -> Result<String, SceneErrors> {
    let name = path.display().to_string();
    let file_error = |e: std::io::Error| SceneErrors::plain(Category::File, &name, format!("cannot read the {what}: {e}"), None);
    let about = std::fs::metadata(path).map_err(file_error)?;
    if about.is_dir() {
        return Err(SceneErrors::plain(Category::File, &name, format!("cannot read the {what}: it is a folder"), None));
    }
    if about.len() > MAX_BYTES {
        let help = format!("files are read up to {} MiB", MAX_BYTES >> 20);
        return Err(SceneErrors::plain(Category::Scene, &name, format!("the {what} is too large: {} bytes", about.len()), Some(help)));
    }
    let bytes = std::fs::read(path).map_err(file_error)?;
    String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        SceneErrors::plain(Category::Scene, &name, format!("the {what} is not UTF-8 text: byte {at} cannot be read"), None)
    })
}

/// Like [`load`], from text; `name` stands for the file in messages.
///
/// # Errors
/// Everything that is wrong with the scene, with its place.
pub fn load_text(name: &str, text: String, sets: &[(String, String)], registry: &Registry) -> Result<LoadedScene, SceneErrors> {
    load_text_within(memory::of_machine(), name, text, sets, registry)
}

/// Like [`load_text`], and refuses generated structures that would take a run to more than `memory` (bytes), where it is known.
///
/// # Errors
/// Everything that is wrong with the scene, with its place.
pub fn load_text_within(
    memory: Option<u64>,
    name: &str,
    text: String,
    sets: &[(String, String)],
    registry: &Registry,
) -> Result<LoadedScene, SceneErrors> {
    let original = text.strip_prefix('\u{feff}').map(str::to_string).unwrap_or(text);
    let mut sets = sets.to_vec();
    loop {
        let edited = edit(name, &original, &sets, registry)?;
        let tree = tree(&edited);
        let fail = |problems| Err(placed(name, &edited, &tree, &sets, (&original, registry), problems));
        let mut scene = match parse(&edited, &tree, registry) {
            Ok(scene) => scene,
            Err(problem) => {
                // The shell eats the quotes of `--set title="a"`.
                if problem.message == EXPECTED_TEXT
                    && let Some(at) = problem.span.as_ref().and_then(|s| set_at(&sets, &tree, s))
                    && !sets[at].1.starts_with('"')
                {
                    sets[at].1 = format!("{:?}", sets[at].1);
                    continue;
                }
                return fail(further(*problem, &edited, registry, memory));
            }
        };
        let root = tree.root.as_ref().expect("an empty scene was refused");
        return match build::build(&mut scene, &edited, root, registry, memory) {
            Ok(built) => {
                let (path, mut model) = (PathBuf::from(name), built.model);
                model.name = path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into_owned());
                let hints = SceneErrors::place(Category::Scene, name, &edited, Some(root), built.hints).errors;
                Ok(LoadedScene { scene, model, probes: built.probes, hints, text: edited, path })
            }
            Err(problems) => fail(problems),
        };
    }
}

fn edit(name: &str, original: &str, sets: &[(String, String)], registry: &Registry) -> Result<String, SceneErrors> {
    let mut edited = original.to_string();
    for (path, value) in sets {
        edited = set::set(&edited, path, value).map_err(|p| {
            let problem = with_known_paths(p, path, value, (original, registry));
            SceneErrors::place(Category::Usage, name, &edited, None, vec![problem])
        })?;
    }
    Ok(edited)
}

/// Which `--set` has written the range, if one has; the last one counts.
fn set_at(sets: &[(String, String)], tree: &Tree, at: &Range<usize>) -> Option<usize> {
    let root = tree.root.as_ref()?;
    sets.iter().rposition(|(path, _)| set::range_of(root, path).is_some_and(|r| r.start <= at.start && at.end <= r.end))
}

/// The scene in a text, without any check of its meaning.
pub(super) fn parse(text: &str, tree: &Tree, registry: &Registry) -> Result<Scene, Box<Problem>> {
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
    // The reader would silently keep the last of two entries of one name.
    if let Some((path, span)) = root.repeated() {
        let mut problem = Problem::new(path, "an entry of this name is there already");
        problem.span = Some(span);
        problem.stands_alone = true;
        return Err(Box::new(problem));
    }
    // A key in quotes can only be a section of a plugin.
    let foreign =
        |i: &&Item| text[i.key_span.clone()].starts_with('"') && i.key.as_deref().is_some_and(|k| registry.settings_of(k).is_none());
    if let Some(item) = root.items.iter().find(foreign) {
        let error =
            SpecError::unknown("", "section of a plugin", item.key.as_deref().unwrap_or_default(), registry.settings.iter().map(|k| k.key));
        let mut problem = Problem::of_entry(&Path::default(), error);
        problem.span = Some(item.key_span.clone());
        problem.stands_alone = true;
        return Err(Box::new(problem));
    }
    // Of two sections of one key the reader of the plugin would see only the first.
    let again = root.items.iter().enumerate().find(|(n, item)| {
        let settings = item.key.as_deref().is_some_and(|k| registry.settings_of(k).is_some());
        settings && root.items[..*n].iter().any(|before| before.key == item.key)
    });
    if let Some((_, item)) = again {
        let key = item.key.as_deref().unwrap_or_default();
        let mut problem = Problem::new(Path::default(), format!("section `{key}` is given twice"));
        problem.span = Some(item.key_span.clone());
        problem.stands_alone = true;
        return Err(Box::new(problem));
    }
    // Settings of plugins are read later, by their own readers.
    let own = without_settings(text, root, registry);
    let text = own.as_str();
    let mut reader =
        ron::Deserializer::from_str_with_options(text, &ron_options()).map_err(|e| from_ron(e, text, 0..text.len(), Some(root), None))?;
    let mut track = serde_path_to_error::Track::new();
    let scene = units.while_reading(|| Scene::deserialize(serde_path_to_error::Deserializer::new(&mut reader, &mut track)));
    let scene = match scene {
        Ok(scene) => reader.end().map(|()| scene),
        Err(e) => Err(e),
    };
    scene.map_err(|e| {
        let unknown = match &e {
            ron::Error::NoSuchStructField { found, outer, .. } if outer.as_deref() == Some("Scene") => Some(found.clone()),
            _ => None,
        };
        let path = path_of(&track.path());
        let mut problem = from_ron(reader.span_error(e), text, 0..text.len(), Some(root), Some(path));
        if problem.message.starts_with("field `units`") {
            problem.help = Some(format!("valid: {}", names.join(", ")));
        }
        // The reader knows the fields of the scene, but not the settings of plugins.
        if let (Some(word), Some(help)) = (&unknown, &mut problem.help) {
            let keys: Vec<&str> = registry.settings.iter().map(|k| k.key).collect();
            help.push_str(&keys.iter().map(|k| format!(", `{k}`")).collect::<String>());
            if let Some(near) = nearest(word, &keys).filter(|_| !help.starts_with("did you mean")) {
                *help = format!("did you mean `{near}`? {help}");
            }
        }
        Box::new(problem)
    })
}

/// The text with the settings of plugins blanked out.
fn without_settings(text: &str, root: &Value, registry: &Registry) -> String {
    let mut own = text.to_string();
    for item in root.items.iter().filter(|i| i.key.as_deref().is_some_and(|k| registry.settings_of(k).is_some())) {
        blank_out(&mut own, item.key_span.start..item.value.span.end);
    }
    own
}

/// The path at which a reader stood.
pub(crate) fn path_of(path: &serde_path_to_error::Path) -> Path {
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

/// The text of the file and what the program knows.
type Source<'a> = (&'a str, &'a Registry);

/// Places problems; those inside a value that `--set` has put there are reported as such.
fn placed(name: &str, text: &str, tree: &Tree, sets: &[(String, String)], source: Source<'_>, problems: Vec<Problem>) -> SceneErrors {
    let root = tree.root.as_ref();
    let mut category = Category::Scene;
    let problems = problems
        .into_iter()
        .map(|mut p| {
            let at = p.span.clone().or_else(|| root.map(|r| r.deepest(&p.path).0.mark(text)));
            let Some((path, value)) = at.and_then(|at| set_at(sets, tree, &at)).map(|i| &sets[i]) else { return p };
            if p.message.starts_with("unknown field") {
                category = Category::Usage;
                return with_known_paths(set::no_such_path(path, value, &[]), path, value, source).with_choices(p.help.take());
            }
            let given = format!("given by --set {path}={value}");
            p.help = Some(p.help.map_or(given.clone(), |h| format!("{h}\n{given}")));
            p
        })
        .collect();
    SceneErrors::place(category, name, text, root, problems)
}

/// Names the nearest paths of the scene as it was before the edit, defaults included.
fn with_known_paths(problem: Problem, path: &str, value: &str, (original, registry): Source<'_>) -> Problem {
    if !problem.message.contains("there is no") {
        return problem;
    }
    let before = tree(original);
    let mut known: Vec<String> = before.root.as_ref().map_or(Vec::new(), |r| r.paths());
    if let Ok(loaded) = load_text("", original.to_string(), &[], registry)
        && let Some(root) = tree(&loaded.resolved()).root
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
