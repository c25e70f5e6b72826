//! From a scene to a model: names to numbers, generators to nodes, and every check of the physics
//! that needs no run. Several problems are reported together.
mod check;
mod elements;
mod generators;
mod hints;
mod lints;
mod loads;
mod material;
mod refine;
mod run;
mod settings;
mod topology;

pub(super) use refine::number_at;

use super::error::Problem;
use super::schema::{NodeRef, Scene};
use super::spans::{Path, Value};
use crate::components::NodeId;
use crate::generate::BraidLayout;
use crate::measure::Probe;
use crate::model::{Material, Model, Section};
use crate::registry::{Build, Registry, SpecError};
use std::collections::BTreeMap;
use std::ops::Range;

/// Builds the model of a scene; automatic values of the scene are filled in.
pub(super) fn build(scene: &mut Scene, text: &str, root: &Value, registry: &Registry, memory: Option<u64>) -> Result<Built, Vec<Problem>> {
    let mut b = Builder {
        text,
        root,
        registry,
        model: Model::new(""),
        materials: BTreeMap::new(),
        sections: BTreeMap::new(),
        groups: BTreeMap::new(),
        sources: Vec::new(),
        braid: None,
        amplitudes: BTreeMap::new(),
        time_scale: None,
        problems: Vec::new(),
        claimed: 0,
        memory,
    };
    b.add_integration(scene);
    b.add_materials(scene);
    b.add_amplitudes(scene);
    b.add_nodes(scene);
    b.add_generators(scene);
    b.add_elements(scene);
    b.add_node_values(scene);
    b.add_filaments(scene);
    b.add_constraints(scene);
    b.add_loads(scene);
    if b.problems.is_empty() {
        b.add_period_load(scene);
    }
    b.add_run(scene);
    // What follows looks at the finished model; half a model would only give wrong messages.
    if b.problems.is_empty() {
        b.check_model(scene);
    }
    if b.problems.is_empty() {
        b.add_settings(scene);
    } else {
        b.check_syntax_of_settings(scene);
    }
    let probes = b.probes(scene);
    b.check_refine(scene);
    if !b.problems.is_empty() {
        return Err(b.problems);
    }
    let hints = b.hints(scene);
    Ok(Built { model: b.model, probes, hints })
}

/// A model with the probes of its scene.
pub(super) struct Built {
    pub model: Model,
    pub probes: Vec<(String, Probe)>,
    pub hints: Vec<Problem>,
}

/// The model under construction, with what names mean.
struct Builder<'a> {
    text: &'a str,
    root: &'a Value,
    registry: &'a Registry,
    model: Model,
    materials: BTreeMap<String, Material>,
    sections: BTreeMap<String, Section>,
    /// Names that stand for several nodes.
    groups: BTreeMap<String, Vec<NodeId>>,
    /// Where filaments come from: the entry of the scene and the filaments of the model it has made.
    sources: Vec<(Path, Range<usize>)>,
    /// The generated braid.
    braid: Option<BraidLayout>,
    amplitudes: BTreeMap<String, usize>,
    /// The time tF of a load along a period, and its dummy node.
    time_scale: Option<(f64, NodeId)>,
    problems: Vec<Problem>,
    /// Memory that the generated structures will take, and what there is where it is known (bytes).
    claimed: u64,
    memory: Option<u64>,
}

/// A path that is known to be well formed.
fn at(path: &str) -> Path {
    Path::parse(path).expect("paths in the program are well formed")
}

impl Builder<'_> {
    fn problem(&mut self, path: Path, message: impl Into<String>) {
        self.problems.push(Problem::new(path, message));
    }

    /// Notes the problem of an entry and gives `None` for it.
    fn noted<T>(&mut self, entry: &Path, result: Result<T, SpecError>) -> Option<T> {
        result.map_err(|e| self.problems.push(Problem::of_entry(entry, e))).ok()
    }

    /// Hands the model to a reader of elements or a generator.
    fn with_build<T>(&mut self, f: impl FnOnce(&mut Build<'_>) -> T) -> T {
        f(&mut Build { model: &mut self.model, materials: &self.materials, sections: &self.sections })
    }

    /// Notes a value that is wrong whatever stands elsewhere in the scene.
    fn bad_value(&mut self, path: Path, message: impl Into<String>) {
        self.problems.push(Problem { stands_alone: true, ..Problem::new(path, message) });
    }

    /// Notes a value that is not above zero; true if it is.
    fn above_zero(&mut self, path: Path, what: &str, value: f64) -> bool {
        let good = value > 0.0;
        if !good {
            self.bad_value(path, format!("{what} must be above zero, not {value}"));
        }
        good
    }

    /// Notes a value below zero; true if there is none.
    fn not_negative(&mut self, path: Path, what: &str, value: f64) -> bool {
        let good = value >= 0.0;
        if !good {
            self.bad_value(path, format!("{what} must not be negative, {value} given"));
        }
        good
    }

    /// The nodes that a reference means.
    fn resolve(&self, reference: &NodeRef) -> Result<Vec<NodeId>, SpecError> {
        let count = self.model.nodes.len();
        match reference {
            NodeRef::Id(n) if (*n as usize) < count => Ok(vec![NodeId(*n)]),
            NodeRef::Id(n) => Err(SpecError::new("", format!("node {n} does not exist")).help(match count {
                0 => "the scene has no nodes".to_string(),
                _ => format!("the scene has {count} nodes, numbered from 0"),
            })),
            NodeRef::Name(name) => {
                if let Some(n) = self.model.node_names.get(name) {
                    return Ok(vec![*n]);
                }
                if let Some(group) = self.groups.get(name) {
                    return Ok(group.clone());
                }
                if name == "all" {
                    return Ok((0..count).filter(|i| !self.model.nodes[*i].dummy).map(|i| NodeId(i as u32)).collect());
                }
                if let Some((group, index)) = name.strip_suffix(']').and_then(|n| n.split_once('['))
                    && let (Some(nodes), Ok(index)) = (self.groups.get(group), index.trim().parse::<i64>())
                {
                    let place = if index < 0 { nodes.len() as i64 + index } else { index };
                    return match usize::try_from(place).ok().and_then(|i| nodes.get(i)) {
                        Some(n) => Ok(vec![*n]),
                        None => Err(SpecError::new("", format!("`{name}` does not exist: `{group}` has {} nodes", nodes.len()))),
                    };
                }
                if name.contains('*') {
                    return reference.resolve_all("", &self.model);
                }
                let known = self.model.node_names.keys().chain(self.groups.keys()).map(String::as_str);
                Err(SpecError::unknown("", "node", name, known))
            }
        }
    }

    /// The nodes of a list of references at `path`; problems are noted.
    fn nodes(&mut self, path: &Path, references: &[NodeRef]) -> Vec<NodeId> {
        if references.is_empty() {
            self.problem(path.clone(), "the list of nodes is empty");
        }
        let mut out = Vec::new();
        for (i, r) in references.iter().enumerate() {
            let found = self.resolve(r);
            out.extend(self.noted(&path.index(i), found).unwrap_or_default());
        }
        out
    }

    /// The one node that a reference at `path` means; problems are noted.
    fn node(&mut self, path: &Path, reference: &NodeRef) -> Option<NodeId> {
        let found = self.resolve(reference);
        match self.noted(path, found)?.as_slice() {
            [one] => Some(*one),
            several => {
                let n = several.len();
                self.problem(path.clone(), format!("one node is needed here, {n} are given"));
                None
            }
        }
    }

    /// What to call a node in a message.
    fn name_of(&self, node: NodeId) -> String {
        match self.model.node_names.iter().find(|(_, n)| **n == node) {
            Some((name, _)) => format!("{} (`{name}`)", node.0),
            None => node.0.to_string(),
        }
    }
}
