//! Hints: what is allowed, but probably not meant.
use super::{Builder, at};
use crate::model::Damping;
use crate::scene::error::Problem;
use crate::scene::schema::{DampingSpec, Scene};

impl Builder<'_> {
    /// Names what is defined and not used, and settings that fight each other.
    pub(super) fn hints(&self, scene: &Scene) -> Vec<Problem> {
        let mut hints = self.implausible(scene);
        let hint = |path: &str, text: &str| Problem::new(at(path), text);
        let text =
            |key: &str| self.root.items.iter().find(|i| i.key.as_deref() == Some(key)).map_or("", |i| &self.text[i.value.span.clone()]);
        // Names stand in quotes wherever they are used; where they are defined, that is once.
        let used = |name: &str| self.text.matches(&format!("\"{name}\"")).count() > 1;
        let names = [
            ("materials", "material", scene.materials.keys().collect::<Vec<_>>()),
            ("sections", "section", scene.sections.keys().collect()),
            ("amplitudes", "amplitude", scene.amplitudes.keys().collect()),
        ];
        for (list, what, names) in names {
            hints.extend(names.iter().filter(|n| !used(n)).map(|n| Problem::new(at(list).key(n), format!("{what} `{n}` is not used"))));
        }
        let touching = self.model.filaments.iter().filter(|f| f.contact).count();
        if touching > 1 && text("contact").is_empty() {
            hints.push(hint("", &format!("the {touching} filaments do not feel each other: the scene has no `contact`")));
        }
        if touching == 0 && !(text("mandrel").is_empty() && text("surfaces").is_empty()) {
            hints.push(hint("surfaces", "nothing touches the rigid surfaces: the scene has no filaments"));
        }
        if scene.stop.steady.is_some() && self.model.integration.damping == Damping::None {
            hints.push(hint("stop", "a state of rest is waited for without damping; `damping: Adaptive` finds its own rate"));
        }
        if scene.load.is_none()
            && scene.damping == Some(DampingSpec::Kinetic)
            && scene.stop.time.is_some_and(|t| t.0 > 0.0)
            && scene.stop.steady.is_none()
        {
            hints.push(hint("damping", "kinetic damping finds states of rest: the course in time has no meaning"));
        }
        hints
    }
}
