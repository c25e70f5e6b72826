//! Amplitudes, supports, prescribed motions and loads.
use super::{Builder, at};
use crate::amplitude::Amplitude;
use crate::components::{NodalLoad, PrescribedMotion};
use crate::measure::inside_settings;
use crate::model::BodyForce;
use crate::registry::{ReadError, SpecError};
use crate::scene::error::{Problem, from_ron};
use crate::scene::schema::{AmplitudeSpec, Scene};
use crate::scene::spans::Path;
use glam::DVec3;

impl Builder<'_> {
    pub(super) fn add_amplitudes(&mut self, scene: &Scene) {
        for (name, spec) in &scene.amplitudes {
            let path = at("amplitudes").key(name);
            let amplitude = match spec {
                AmplitudeSpec::Constant => Amplitude::Constant,
                AmplitudeSpec::SmoothStep { rise } => {
                    self.above_zero(path.key("rise"), &format!("rise of amplitude `{name}`"), rise.0);
                    Amplitude::SmoothStep { rise: rise.0 }
                }
                AmplitudeSpec::Ramp { rise } => {
                    self.above_zero(path.key("rise"), &format!("rise of amplitude `{name}`"), rise.0);
                    Amplitude::Ramp { rise: rise.0 }
                }
                AmplitudeSpec::Table(points) => {
                    let points: Vec<(f64, f64)> = points.iter().map(|(t, v)| (t.0, v.0)).collect();
                    if points.is_empty() {
                        self.problem(path.clone(), format!("the table of amplitude `{name}` is empty"));
                    }
                    if let Some(i) = points.windows(2).position(|w| w[1].0 <= w[0].0) {
                        self.problem(
                            path.clone(),
                            format!("times in the table of amplitude `{name}` must rise: entry {} is not after entry {i}", i + 1),
                        );
                    }
                    Amplitude::Table(points)
                }
                AmplitudeSpec::Sine { frequency, phase } => Amplitude::Sine { frequency: frequency.0, phase: phase.0 },
                AmplitudeSpec::Custom { amplitude, settings } => match self.custom_amplitude(&path, amplitude, settings.get_ron(), scene) {
                    Ok(amplitude) => amplitude,
                    Err(problem) => {
                        self.problems.push(problem);
                        Amplitude::Constant
                    }
                },
            };
            let index = self.model.add_amplitude(amplitude);
            self.amplitudes.insert(name.clone(), index);
        }
    }

    /// The amplitude of a plugin, its settings read where they stand in the text.
    fn custom_amplitude(&self, path: &Path, name: &str, settings: &str, scene: &Scene) -> Result<Amplitude, Problem> {
        let kind = self.registry.amplitude(name).ok_or_else(|| {
            let known = self.registry.amplitudes.iter().map(|k| k.name);
            Problem::of_entry(path, SpecError::unknown("amplitude", "amplitude of a plugin", name, known))
        })?;
        let span = self.root.find(&path.key("settings")).map(|v| v.span.clone());
        let text = span.clone().map_or(settings, |s| &self.text[s]);
        scene.units.while_reading(|| (kind.read)(text)).map_err(|e| match (e, span) {
            (ReadError::Syntax(e), Some(span)) => from_ron(e, self.text, span, Some(self.root), None),
            (ReadError::Syntax(e), None) => Problem::new(path.clone(), e.to_string()),
            (ReadError::Whole(e) | ReadError::Entry { error: e, .. }, _) => {
                Problem::of_entry(path, SpecError { path: inside_settings(&e.path), ..e })
            }
        })
    }

    /// Index of the amplitude that the entry at `path` names; 0 is the constant.
    fn amplitude(&mut self, path: &Path, name: &Option<String>) -> usize {
        let Some(name) = name else { return 0 };
        let found = self.amplitudes.get(name).copied();
        let known = self.amplitudes.keys().map(String::as_str);
        let found = found.ok_or_else(|| SpecError::unknown("amplitude", "amplitude", name, known));
        self.noted(path, found).unwrap_or(0)
    }

    pub(super) fn add_loads(&mut self, scene: &Scene) {
        for (i, f) in scene.fixed.iter().enumerate() {
            let dofs: Vec<_> = f.dofs.iter().flat_map(|w| w.dofs()).copied().collect();
            if dofs.is_empty() {
                self.problem(at("fixed").index(i).key("dofs"), "the list of degrees of freedom is empty");
            }
            for node in self.nodes(&at("fixed").index(i).key("nodes"), &f.nodes) {
                self.model.fix(node, &dofs);
            }
        }
        for (i, p) in scene.prescribed.iter().enumerate() {
            let path = at("prescribed").index(i);
            let amplitude = self.amplitude(&path, &p.amplitude);
            if p.values().next().is_none() {
                self.problem(path.clone(), "nothing is prescribed: give at least one of ux, uy, uz, rx, ry, rz");
            }
            for node in self.nodes(&path.key("nodes"), &p.nodes) {
                let motions = p.values().map(|(dof, value)| PrescribedMotion { node, dof, value, amplitude });
                self.model.prescribed.extend(motions);
            }
        }
        for (i, l) in scene.loads.iter().enumerate() {
            let path = at("loads").index(i);
            let amplitude = self.amplitude(&path, &l.amplitude);
            let (force, moment) = (DVec3::from(l.force), DVec3::from(l.moment));
            for node in self.nodes(&path.key("nodes"), &l.nodes) {
                self.model.loads.push(NodalLoad { node, force, moment, follower: l.follower, amplitude });
            }
        }
        if let Some(g) = &scene.gravity {
            let amplitude = self.amplitude(&at("gravity"), &g.amplitude);
            self.model.body_force = Some(BodyForce { acceleration: DVec3::from(g.acceleration), amplitude });
        }
    }
}
