//! Elements: the raw text of each list goes to the kind of that name.
use super::{Builder, at};
use crate::registry::{ElementKind, ReadError, SpecError};
use crate::scene::error::{Problem, from_ron};
use crate::scene::faults::{MOST_FAULTS, blank_out};
use crate::scene::schema::Scene;
use crate::scene::spans::{Path, Value};

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
            self.read_elements(scene, &kind, &place, value);
        }
    }

    /// Reads a list of elements. Where an entry is wrong it is read again without it, so that the others are looked at, too; the
    /// elements that are then there twice are of no consequence, for the scene is refused.
    fn read_elements(&mut self, scene: &Scene, kind: &ElementKind, place: &Path, value: &Value) {
        let start = value.span.start;
        let mut list = self.text[value.span.clone()].to_string();
        let mut left: Vec<usize> = (0..value.items.len()).collect();
        for _ in 0..MOST_FAULTS {
            let Err(error) = self.with_build(|b| scene.units.while_reading(|| (kind.read)(&list, b))) else { return };
            let (problem, wrong) = match error {
                ReadError::Syntax(e) => {
                    let whole = format!("{}{list}{}", &self.text[..start], &self.text[value.span.end..]);
                    let problem = from_ron(e, &whole, value.span.clone(), Some(self.root), None);
                    let from = problem.span.as_ref().map_or(start, |s| s.start);
                    let wrong = left.iter().position(|i| value.items[*i].value.span.contains(&from));
                    (problem, wrong)
                }
                ReadError::Whole(error) => (Problem::of_entry(place, error), None),
                ReadError::Entry { index, error } => {
                    let Some(entry) = left.get(index) else { return };
                    (Problem::of_entry(&place.index(*entry), error), Some(index))
                }
            };
            self.problems.push(problem);
            let Some(wrong) = wrong else { return };
            let span = &value.items[left.remove(wrong)].value.span;
            blank_out(&mut list, span.start - start..span.end - start);
        }
    }
}
