//! Settings of plugins, probes and expected values.
use super::{Builder, at};
use crate::catalog::MEASURES;
use crate::measure::{Probe, ProbeSpec};
use crate::registry::{ReadError, SpecError};
use crate::scene::error::{Problem, from_ron};
use crate::scene::schema::Scene;
use crate::scene::spans::Path;

impl Builder<'_> {
    pub(super) fn add_settings(&mut self, scene: &mut Scene) {
        for kind in self.registry.settings.clone() {
            let path = Path::default().key(kind.key);
            let Some(value) = self.root.find(&path) else { continue };
            let (text, span) = (self.text, value.span.clone());
            let read = self.with_build(|b| scene.units.while_reading(|| (kind.read)(&text[span.clone()], b)));
            match read {
                Ok(resolved) => {
                    scene.settings.insert(kind.key.to_string(), resolved);
                }
                Err(ReadError::Syntax(e)) => self.problems.push(from_ron(e, text, span, Some(self.root), None)),
                Err(ReadError::Whole(error) | ReadError::Entry { error, .. }) => self.problems.push(Problem::of_entry(&path, error)),
            }
        }
    }

    /// Of a scene with other faults only the spelling of the settings can be told: their meaning hangs on the model.
    pub(super) fn check_syntax_of_settings(&mut self, scene: &Scene) {
        for kind in self.registry.settings.clone() {
            let Some(value) = self.root.find(&Path::default().key(kind.key)) else { continue };
            let (text, span) = (self.text, value.span.clone());
            if let Err(ReadError::Syntax(e)) = self.with_build(|b| scene.units.while_reading(|| (kind.read)(&text[span.clone()], b))) {
                self.problems.push(from_ron(e, text, span, Some(self.root), None));
            }
        }
    }

    /// The probes of the scene, and the checks of what is expected of them.
    pub(super) fn probes(&mut self, scene: &Scene) -> Vec<(String, Probe)> {
        let mut probes = Vec::new();
        for (name, spec) in &scene.probes {
            let path = at("probes").key(name);
            if let Some(problem) = scene.units.while_reading(|| self.misread_settings(&path, spec)) {
                self.problems.push(problem);
                continue;
            }
            let found = scene.units.while_reading(|| spec.resolve(&self.model, self.registry));
            probes.extend(self.noted(&path, found).map(|p| (name.clone(), p)));
        }
        for (name, expected) in &scene.expect {
            let path = at("expect").key(name);
            let measures = MEASURES.iter().map(|m| m.0).chain(self.registry.measures.iter().map(|m| m.name));
            let known = measures.chain(scene.probes.keys().map(String::as_str));
            if !known.clone().any(|k| k == name) {
                self.problems.push(Problem::of_entry(&path, SpecError::unknown("", "measure or probe", name, known)));
            }
            if expected.rel.is_none() && expected.abs.is_none() {
                self.problem(path, format!("how near `{name}` must be is missing: give `rel` or `abs`"));
            }
        }
        probes
    }

    /// What the reader says of the settings of a plugin's probe, with its place in the text.
    fn misread_settings(&self, path: &Path, spec: &ProbeSpec) -> Option<Problem> {
        let kind = self.registry.probe(spec.custom()?.0)?;
        let span = self.root.find(&path.key("settings"))?.span.clone();
        match (kind.read)(&self.text[span.clone()], &self.model) {
            Err(ReadError::Syntax(e)) => Some(from_ron(e, self.text, span, Some(self.root), None)),
            _ => None,
        }
    }
}
