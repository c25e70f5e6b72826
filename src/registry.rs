//! What a binary knows: element kinds, settings, probes, measures, amplitudes and installers, in the order in which plugins added them.
use crate::amplitude::{Amplitude, Function};
use crate::element::Element;
use crate::generate::Generated;
use crate::measure::Quantity;
use crate::model::{Chain, Material, Model, Section};
use crate::simulation::Install;
use bevy_ecs::world::World;
use std::collections::BTreeMap;

/// What is wrong with an entry of a scene, relative to that entry.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct SpecError {
    /// Path of the offending field inside the entry (`nodes[1]`, `section`); empty for the whole entry.
    pub path: String,
    /// What is wrong, with the offending value.
    pub message: String,
    /// What would be right.
    pub help: Option<String>,
}

impl SpecError {
    /// An error at `path`.
    pub fn new(path: impl Into<String>, message: impl Into<String>) -> Self {
        SpecError { path: path.into(), message: message.into(), help: None }
    }

    /// Adds what would be right.
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// An unknown name with the valid ones and the nearest of them.
    pub fn unknown<'a>(path: impl Into<String>, what: &str, name: &str, known: impl IntoIterator<Item = &'a str>) -> Self {
        /// Names beyond this number are only counted.
        const SHOWN: usize = 24;
        let known: Vec<&str> = known.into_iter().collect();
        let more = if known.len() > SHOWN { format!(" and {} more", known.len() - SHOWN) } else { String::new() };
        let list = known[..known.len().min(SHOWN)].join(", ");
        let mut help = if known.is_empty() { format!("no {what} is defined") } else { format!("known: {list}{more}") };
        if let Some(near) = nearest(name, &known) {
            help = format!("did you mean `{near}`? {help}");
        }
        SpecError::new(path, format!("unknown {what} `{name}`")).help(help)
    }
}

/// The candidate nearest to `word` in spelling, if one is near enough to suggest.
pub fn nearest<'a>(word: &str, candidates: &[&'a str]) -> Option<&'a str> {
    candidates
        .iter()
        .map(|c| (strsim::damerau_levenshtein(&word.to_lowercase(), &c.to_lowercase()), *c))
        .min()
        .filter(|(d, c)| *d <= 1 + c.len().max(word.len()) / 3)
        .map(|(_, c)| c)
}

/// What element readers may use and fill.
pub struct Build<'a> {
    /// The model under construction.
    pub model: &'a mut Model,
    /// Materials by name.
    pub materials: &'a BTreeMap<String, Material>,
    /// Sections by name.
    pub sections: &'a BTreeMap<String, Section>,
}

impl Build<'_> {
    /// The section called `name`; errors name the field `path`.
    ///
    /// # Errors
    /// Unknown names, with the known ones.
    pub fn section(&self, path: &str, name: &str) -> Result<Section, SpecError> {
        self.sections.get(name).copied().ok_or_else(|| SpecError::unknown(path, "section", name, self.sections.keys().map(String::as_str)))
    }

    /// Checks that the nodes exist, differ from each other and are apart.
    ///
    /// # Errors
    /// Names the first offending node by its place in the list `path`.
    pub fn check_nodes(&self, path: &str, nodes: &[crate::components::NodeId]) -> Result<(), SpecError> {
        let count = self.model.nodes.len();
        for (i, n) in nodes.iter().enumerate() {
            if n.row() >= count {
                return Err(SpecError::new(format!("{path}[{i}]"), format!("node {} does not exist", n.0))
                    .help(format!("the scene has {count} nodes, numbered from 0")));
            }
            if self.model.nodes[n.row()].dummy {
                return Err(SpecError::new(format!("{path}[{i}]"), format!("node {} is a dummy node and cannot carry an element", n.0)));
            }
            if i > 0 {
                let before = nodes[i - 1];
                if before == *n {
                    return Err(SpecError::new(format!("{path}[{i}]"), format!("element joins node {} to itself", n.0)));
                }
                if self.model.nodes[before.row()].position == self.model.nodes[n.row()].position {
                    return Err(SpecError::new(
                        format!("{path}[{i}]"),
                        format!("zero-length element: nodes {} and {} are at the same point", before.0, n.0),
                    ));
                }
            }
        }
        Ok(())
    }
}

/// Why a part of a scene could not be read.
#[derive(Debug)]
pub enum ReadError {
    /// The text is not what the element's specification asks for; the span is inside the text.
    Syntax(ron::error::SpannedError),
    /// Entry `index` was read but makes no sense.
    Entry {
        /// Index in the list.
        index: usize,
        /// What is wrong.
        error: SpecError,
    },
    /// The whole was read but makes no sense.
    Whole(SpecError),
}

/// Settings of a plugin: a top-level key of the scene, stored in the model for its installer
/// ([`Model::get`](crate::model::Model::get)). Register them with
/// [`Simulation::add_settings`](crate::simulation::Simulation::add_settings).
pub trait Settings: serde::de::DeserializeOwned + serde::Serialize + std::any::Any + Send + Sync {
    /// The key; names from outside carry a prefix.
    const KEY: &'static str;
    /// One sentence for `braid-ecs plugins` and messages.
    const ABOUT: &'static str;

    /// True for a generator: [`generate`](Self::generate) then runs where the generators of the scene do.
    const GENERATES: bool = false;

    /// Adds filaments with their nodes and elements, each structure with a name: `NAME` then stands for all its nodes in the
    /// scene, `NAME.0` for those of its first filament. [`polyline`](crate::generate::polyline) and its kin do the work.
    /// `seed` is that of the scene.
    ///
    /// # Errors
    /// What is wrong, naming the field.
    fn generate(&self, _seed: u64, _registry: &Registry, _build: &mut Build<'_>) -> Result<Vec<(String, Generated)>, SpecError> {
        Ok(Vec::new())
    }

    /// Checks the settings against the finished model, and may fill in what follows from it.
    ///
    /// # Errors
    /// What is wrong, naming the field.
    fn check(&mut self, build: &mut Build<'_>) -> Result<(), SpecError>;
}

/// One registered kind of settings.
#[derive(Clone, Copy)]
pub struct SettingsKind {
    /// Scene key.
    pub key: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Reads RON into the model; gives the settings back with all defaults filled in.
    pub read: fn(&str, &mut Build<'_>) -> Result<String, ReadError>,
    /// Reads RON and generates what it says, if these are settings of a generator.
    pub generate: Option<GenerateFn>,
}

/// Reads the RON of a generator and adds what it says to the model.
pub type GenerateFn = fn(&str, u64, &Registry, &mut Build<'_>) -> Result<Vec<(String, Generated)>, ReadError>;

fn generate<S: Settings>(text: &str, seed: u64, registry: &Registry, build: &mut Build<'_>) -> Result<Vec<(String, Generated)>, ReadError> {
    let settings: S = crate::scene::ron_options().from_str(text).map_err(ReadError::Syntax)?;
    settings.generate(seed, registry, build).map_err(ReadError::Whole)
}

fn read_settings<S: Settings>(text: &str, build: &mut Build<'_>) -> Result<String, ReadError> {
    let mut settings: S = crate::scene::ron_options().from_str(text).map_err(ReadError::Syntax)?;
    settings.check(build).map_err(ReadError::Whole)?;
    let resolved = crate::scene::ron_options().to_string(&settings).map_err(|e| ReadError::Whole(SpecError::new("", e.to_string())))?;
    build.model.insert(settings);
    Ok(resolved)
}

/// A probe of a plugin: a value of a scene's `probes`, written
/// `Custom(probe: "lab.drag", settings: (...))`; the implementing type is what `settings` reads.
/// Register it with [`Simulation::add_probe`](crate::simulation::Simulation::add_probe).
pub trait CustomProbe: serde::de::DeserializeOwned + Send + Sync + 'static {
    /// The name; names from outside carry a prefix (`lab.drag`).
    const NAME: &'static str;
    /// One sentence for `braid-ecs plugins` and messages.
    const ABOUT: &'static str;
    /// What the value is, for units in headers.
    const QUANTITY: Quantity;

    /// Checks the settings against the finished model, and may fill in what follows from it.
    ///
    /// # Errors
    /// What is wrong, naming the field inside `settings`.
    fn check(&mut self, model: &Model) -> Result<(), SpecError>;

    /// The value now; must not change anything.
    fn value(&self, world: &mut World) -> f64;
}

/// Reads the value of a checked probe.
pub type ReadProbe = std::sync::Arc<dyn Fn(&mut World) -> f64 + Send + Sync>;

/// One registered kind of probe.
#[derive(Clone, Copy)]
pub struct ProbeKind {
    /// Name in the scene.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// What its values are.
    pub quantity: Quantity,
    /// Reads the RON of its settings and checks them.
    pub read: fn(&str, &Model) -> Result<ReadProbe, ReadError>,
}

fn read_probe<P: CustomProbe>(text: &str, model: &Model) -> Result<ReadProbe, ReadError> {
    let mut probe: P = crate::scene::ron_options().from_str(text).map_err(ReadError::Syntax)?;
    probe.check(model).map_err(ReadError::Whole)?;
    Ok(std::sync::Arc::new(move |world: &mut World| probe.value(world)))
}

/// An amplitude of a plugin: a function of time for loads and prescribed motions, written
/// `Custom(amplitude: "lab.pulse", settings: (...))`; the implementing type is what `settings` reads.
/// Register it with [`Simulation::add_amplitude`](crate::simulation::Simulation::add_amplitude).
pub trait CustomAmplitude: serde::de::DeserializeOwned + Send + Sync + 'static {
    /// The name; names from outside carry a prefix (`lab.pulse`).
    const NAME: &'static str;
    /// One sentence for `braid-ecs plugins` and messages.
    const ABOUT: &'static str;

    /// Checks the settings.
    ///
    /// # Errors
    /// What is wrong, naming the field inside `settings`.
    fn check(&self) -> Result<(), SpecError>;

    /// The value at time `t`, the same whenever it is asked for.
    fn at(&self, t: f64) -> f64;
}

/// One registered kind of amplitude.
#[derive(Clone, Copy)]
pub struct AmplitudeKind {
    /// Name in the scene.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Reads the RON of its settings and checks them.
    pub read: fn(&str) -> Result<Amplitude, ReadError>,
}

fn read_amplitude<A: CustomAmplitude>(text: &str) -> Result<Amplitude, ReadError> {
    let amplitude: A = crate::scene::ron_options().from_str(text).map_err(ReadError::Syntax)?;
    amplitude.check().map_err(ReadError::Whole)?;
    Ok(Amplitude::Custom(Function(std::sync::Arc::new(move |t| amplitude.at(t)))))
}

/// A number about the whole model, taken at the end of a run, or `None` where it has no meaning.
pub type Measurement = fn(&Model, &mut World) -> Option<f64>;

/// One registered measure.
#[derive(Clone, Copy)]
pub struct MeasureKind {
    /// Name in summaries and in `expect`.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// What its values are.
    pub quantity: Quantity,
    /// Takes it.
    pub take: Measurement,
}

/// One registered kind of element.
#[derive(Clone, Copy)]
pub struct ElementKind {
    /// Scene key.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
    /// Nodes per element.
    pub nodes: usize,
    /// True if its nodes need rotations.
    pub rotations: bool,
    /// Reads the RON list of entries into the model.
    pub read: fn(&str, &mut Build<'_>) -> Result<(), ReadError>,
    /// Puts elements along a filament.
    pub along: fn(&Chain, &mut Build<'_>) -> Result<(), SpecError>,
    /// Number of elements of this kind in a model.
    pub count: fn(&Model) -> usize,
    /// Adds masses to the nodes, by node id, and notes the largest inertia length.
    pub(crate) add_mass: fn(&Model, &mut [(crate::element::NodeMass, f64)]),
    /// Spawns the elements and adds their systems.
    pub(crate) install: fn(&mut Install<'_>),
}

/// A function that adds systems, components and resources for a model, if the model needs them.
pub type Installer = fn(&mut Install<'_>);

/// Fields of a component with their dimensions in the words length, mass, time, force, stress and energy.
pub type FieldDimensions = &'static [(&'static str, &'static str)];

/// Everything that plugins have added.
#[derive(Default, Clone)]
pub struct Registry {
    /// Element kinds; this order is the order of assembly.
    pub elements: Vec<ElementKind>,
    /// Installers with the name of what they install.
    pub installers: Vec<(&'static str, Installer)>,
    /// Settings of plugins, in the order in which they are read.
    pub settings: Vec<SettingsKind>,
    /// Probes of plugins.
    pub probes: Vec<ProbeKind>,
    /// Measures of plugins, in the order in which they are taken.
    pub measures: Vec<MeasureKind>,
    /// Amplitudes of plugins.
    pub amplitudes: Vec<AmplitudeKind>,
    /// Dimensions of the fields of components, by the full name of the component; for who looks at them.
    pub units: BTreeMap<&'static str, FieldDimensions>,
}

impl Registry {
    /// The element kind called `name`.
    pub fn element(&self, name: &str) -> Option<&ElementKind> {
        self.elements.iter().find(|k| k.name == name)
    }

    /// The settings with the key `key`.
    pub fn settings_of(&self, key: &str) -> Option<&SettingsKind> {
        self.settings.iter().find(|k| k.key == key)
    }

    /// Adds settings.
    ///
    /// # Panics
    /// If the key is taken: two plugins claim the same scene key.
    pub fn add_settings<S: Settings>(&mut self) {
        assert!(self.settings_of(S::KEY).is_none(), "settings `{}` are registered twice", S::KEY);
        let generate = S::GENERATES.then_some(generate::<S> as GenerateFn);
        self.settings.push(SettingsKind { key: S::KEY, about: S::ABOUT, read: read_settings::<S>, generate });
    }

    /// The probe of a plugin called `name`.
    pub fn probe(&self, name: &str) -> Option<&ProbeKind> {
        self.probes.iter().find(|k| k.name == name)
    }

    /// Adds a probe.
    ///
    /// # Panics
    /// If the name is taken: two plugins claim the same name.
    pub fn add_probe<P: CustomProbe>(&mut self) {
        assert!(self.probe(P::NAME).is_none(), "probe `{}` is registered twice", P::NAME);
        self.probes.push(ProbeKind { name: P::NAME, about: P::ABOUT, quantity: P::QUANTITY, read: read_probe::<P> });
    }

    /// The amplitude of a plugin called `name`.
    pub fn amplitude(&self, name: &str) -> Option<&AmplitudeKind> {
        self.amplitudes.iter().find(|k| k.name == name)
    }

    /// Adds an amplitude.
    ///
    /// # Panics
    /// If the name is taken: two plugins claim the same name.
    pub fn add_amplitude<A: CustomAmplitude>(&mut self) {
        assert!(self.amplitude(A::NAME).is_none(), "amplitude `{}` is registered twice", A::NAME);
        self.amplitudes.push(AmplitudeKind { name: A::NAME, about: A::ABOUT, read: read_amplitude::<A> });
    }

    /// Adds a measure.
    ///
    /// # Panics
    /// If the name is taken, by a plugin or by a measure of the program.
    pub fn add_measure(&mut self, kind: MeasureKind) {
        let taken = self.measures.iter().map(|k| k.name).chain(crate::catalog::MEASURES.iter().map(|m| m.0)).any(|n| n == kind.name);
        assert!(!taken, "measure `{}` is registered twice", kind.name);
        self.measures.push(kind);
    }

    /// Adds an element kind.
    ///
    /// # Panics
    /// If the name is taken: two plugins claim the same scene key.
    pub fn add_element<E: Element<N>, const N: usize>(&mut self) {
        assert!(self.element(E::NAME).is_none(), "element `{}` is registered twice", E::NAME);
        self.units.insert(std::any::type_name::<crate::element::EndForces<E, N>>(), &[("force", "force"), ("moment", "force x length")]);
        self.elements.push(ElementKind {
            name: E::NAME,
            about: E::ABOUT,
            nodes: N,
            rotations: <E::Force as crate::element::NodeForce>::ROTATIONS,
            read: read_list::<E, N>,
            along: E::along,
            count: |m| m.elements::<E, N>().len(),
            add_mass: crate::assembly::add_mass::<E, N>,
            install: install::<E, N>,
        });
    }
}

fn install<E: Element<N>, const N: usize>(cx: &mut Install<'_>) {
    crate::assembly::install::<E, N>(cx);
    #[cfg(debug_assertions)]
    crate::stepper::inspect::know_element::<E, N>(cx.world);
}

fn read_list<E: Element<N>, const N: usize>(text: &str, build: &mut Build<'_>) -> Result<(), ReadError> {
    let specs: Vec<E::Spec> = crate::scene::ron_options().from_str(text).map_err(ReadError::Syntax)?;
    for (index, spec) in specs.into_iter().enumerate() {
        E::read(spec, build).map_err(|error| ReadError::Entry { index, error })?;
    }
    Ok(())
}
