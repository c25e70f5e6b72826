//! Elements: the raw text of each list goes to the kind of that name.
use super::{Builder, at};
use crate::registry::{ReadError, SpecError};
use crate::scene::error::{Problem, from_ron};
use crate::scene::schema::Scene;

impl Builder<'_> {
    pub(super) fn add_elements(&mut self, scene: &Scene) {
        let path = at("elements");
        for name in scene.elements.keys() {
            let place = path.key(name);
            let Some(kind) = self.registry.element(name).copied() else {
                let names = self.registry.elements.iter().map(|k| k.name);
                let unknown = SpecError::unknown("", "kind of element", name, names);
                let mut problem = Problem::of_entry(&place, unknown);
                problem.span =
                    self.root.find(&path).and_then(|v| v.items.iter().find(|i| i.key.as_deref() == Some(name))).map(|i| i.key_span.clone());
                self.problems.push(problem);
                continue;
            };
            let value = self.root.find(&place).expect("a key that was read stands in the text");
            let (text, span) = (self.text, value.span.clone());
            let read = self.with_build(|b| scene.units.while_reading(|| (kind.read)(&text[span.clone()], b)));
            match read {
                Ok(()) => {}
                Err(ReadError::Syntax(e)) => {
                    let problem = from_ron(e, self.text, span, Some(self.root), None);
                    self.problems.push(problem);
                }
                Err(ReadError::Whole(error)) => self.problems.push(Problem::of_entry(&place, error)),
                Err(ReadError::Entry { index, error }) => self.problems.push(Problem::of_entry(&place.index(index), error)),
            }
        }
    }
}
