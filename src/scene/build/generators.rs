//! Braid, bundles, strands, polylines, and the generators of plugins.
use super::{Builder, at};
use crate::components::NodeId;
use crate::generate::{self, Generated, PolylineSpec};
use crate::memory;
use crate::registry::{ReadError, SpecError};
use crate::scene::error::{Problem, from_ron};
use crate::scene::schema::Scene;
use crate::scene::spans::{Path, Step};
use std::collections::BTreeSet;

/// Most elements of one generated structure.
const LARGEST: u128 = 50_000_000;

/// Nodes up to which every node gets a name.
const NAMED: usize = 2000;

impl Builder<'_> {
    pub(super) fn add_generators(&mut self, scene: &Scene) {
        self.add_braid(scene);
        let (seed, registry) = (scene.seed, self.registry);
        for (i, spec) in scene.bundles.iter().enumerate() {
            if !self.affordable(&at("bundles").index(i), &[spec.filaments, spec.elements]) {
                continue;
            }
            let made = self.with_build(|b| generate::bundle(spec, seed, registry, b));
            self.generated(at("bundles").index(i), &spec.name, made);
        }
        for (i, spec) in scene.strands.iter().enumerate() {
            if !self.affordable(&at("strands").index(i), &[spec.wires, spec.elements]) {
                continue;
            }
            let made = self.with_build(|b| generate::strand(spec, registry, b));
            self.generated(at("strands").index(i), &spec.name, made);
        }
        for (i, spec) in scene.polylines.iter().enumerate() {
            if !self.affordable(&at("polylines").index(i), &[spec.points.len(), spec.subdivisions]) {
                continue;
            }
            let made = self.with_build(|b| generate::polyline(spec, registry, b));
            let first = made.as_ref().map_or(0, |g| g.filaments.start);
            let good = made.is_ok();
            self.generated(at("polylines").index(i), &spec.name, made);
            if good {
                self.name_corners(spec, first);
            }
        }
        for kind in registry.settings.iter() {
            let path = Path::default().key(kind.key);
            let (Some(generate), Some(value)) = (kind.generate, self.root.find(&path)) else { continue };
            let (text, span) = (self.text, value.span.clone());
            let made = self.with_build(|b| scene.units.while_reading(|| generate(&text[span.clone()], seed, registry, b)));
            match made {
                Ok(made) => made.into_iter().for_each(|(name, made)| self.generated(path.clone(), &name, Ok(made))),
                Err(ReadError::Syntax(e)) => self.problems.push(from_ron(e, text, span, Some(self.root), None)),
                Err(ReadError::Whole(error) | ReadError::Entry { error, .. }) => self.generated(path, "", Err(error)),
            }
        }
    }

    /// Names the nodes at the corners of a polyline, `NAME.points[1]`: names that stay where they are when
    /// the mesh becomes finer.
    fn name_corners(&mut self, spec: &PolylineSpec, filament: usize) {
        let nodes = &self.model.filaments[filament].nodes;
        let corners: Vec<NodeId> = nodes.iter().copied().step_by(spec.subdivisions).take(spec.points.len()).collect();
        if nodes.len() <= NAMED {
            let names = corners.iter().enumerate().map(|(k, n)| (format!("{}.points[{k}]", spec.name), *n));
            self.model.node_names.extend(names);
        }
        self.groups.insert(format!("{}.points", spec.name), corners);
    }

    fn add_braid(&mut self, scene: &Scene) {
        let (braid, tow) = match (&scene.braid, &scene.tow) {
            (Some(braid), Some(tow)) => (braid, tow),
            (None, None) => return,
            (Some(_), None) => {
                let help = "tow: (material: \"glass\", filament_radius: \"2.5 um\", filaments: 7)";
                self.problems.push(Problem::new(at("braid"), "a braid needs `tow`: what its tows are made of").help(help));
                return;
            }
            (None, Some(_)) => {
                self.problem(at("tow"), "`tow` belongs to a braid, and the scene has no `braid`");
                return;
            }
        };
        if !self.affordable(&at("tow"), &[braid.tows, tow.filaments, tow.elements]) {
            return;
        }
        let (seed, registry, first) = (scene.seed, self.registry, self.model.filaments.len());
        let made = self.with_build(|b| generate::braid(braid, tow, seed, registry, b));
        let Some(layout) = self.noted(&Path::default(), made) else { return };
        for t in &layout.tows {
            let name = format!("{}{}", if t.id.plus { "A" } else { "B" }, t.id.index);
            self.group_filaments(&name, t.filaments.clone());
        }
        self.sources.push((at("braid"), first..self.model.filaments.len()));
        self.braid = Some(layout);
    }

    /// Refuses structures that would fill the memory before anything else could be said about them.
    fn affordable(&mut self, path: &Path, numbers: &[usize]) -> bool {
        let elements = numbers.iter().fold(1u128, |n, k| n.saturating_mul(*k as u128));
        let product = || numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ");
        if elements > LARGEST {
            self.problem(path.clone(), format!("the structure is too large: {} elements, and {LARGEST} are the most", product()));
            return false;
        }
        self.claimed += elements as u64 * memory::PER_ELEMENT;
        let Some(machine) = self.memory.filter(|machine| self.claimed > *machine) else { return true };
        let (wanted, machine) = (memory::text(self.claimed), memory::text(machine));
        let text = format!(
            "the structure is too large for this machine: {} elements take the run to about {wanted} of memory, and {machine} are there",
            product()
        );
        self.problems.push(Problem::new(path.clone(), text).help("take fewer elements or filaments, or a machine with more memory"));
        false
    }

    /// Names the nodes of what the entry at `path` has made. Generators call their own entry by the
    /// singular (`bundle.radius`).
    fn generated(&mut self, path: Path, name: &str, made: Result<Generated, SpecError>) {
        match made {
            Ok(made) => {
                self.group_filaments(name, made.filaments.clone());
                self.sources.push((path, made.filaments));
            }
            Err(error) => {
                let mut own = Path::parse(&error.path).unwrap_or_default();
                let singular = matches!(own.0.first(), Some(Step::Key(k)) if ["bundle", "strand", "polyline"].contains(&k.as_str()));
                if singular {
                    own.0.remove(0);
                }
                self.problems.push(Problem::of_entry(&path, SpecError { path: own.to_string(), ..error }));
            }
        }
    }

    /// Names `name` (all nodes) and `name.3` (the nodes of filament 3); each node of a structure with few
    /// nodes also has a name of its own, `name.3[5]`.
    fn group_filaments(&mut self, name: &str, filaments: std::ops::Range<usize>) {
        let mut all: BTreeSet<NodeId> = BTreeSet::new();
        for (i, f) in filaments.enumerate() {
            let nodes = self.model.filaments[f].nodes.clone();
            all.extend(&nodes);
            if all.len() <= NAMED {
                let names = nodes.iter().enumerate().map(|(k, n)| (format!("{name}.{i}[{k}]"), *n));
                self.model.node_names.extend(names);
            }
            self.groups.insert(format!("{name}.{i}"), nodes);
        }
        self.groups.insert(name.to_string(), all.into_iter().collect());
    }
}
