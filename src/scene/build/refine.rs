//! What makes the mesh of a scene finer.
use super::{Builder, at};
use crate::registry::nearest;
use crate::scene::error::Problem;
use crate::scene::schema::Scene;
use crate::scene::spans::{Path, Value};

/// The whole number above zero that stands at a path of a scene; why there is none otherwise.
pub(in crate::scene) fn number_at(root: &Value, text: &str, path: &str) -> Result<u64, Problem> {
    let wrong = |message: String| Problem::new(Path::default(), message);
    let steps = Path::parse(path)
        .filter(|p| !p.0.is_empty())
        .ok_or_else(|| wrong(format!("`{path}` is not a path")).help("a path looks like polylines[0].subdivisions"))?;
    let Some(value) = root.find(&steps) else {
        let mut known = Vec::new();
        whole_numbers(root, text, &Path::default(), &mut known);
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        let near = nearest(path, &known).map_or(String::new(), |n| format!("did you mean `{n}`? "));
        let list = known.iter().take(12).map(|k| format!("`{k}`")).collect::<Vec<_>>().join(", ");
        return Err(
            wrong(format!("there is no `{path}` in this scene")).help(format!("{near}whole numbers that are written in it: {list}"))
        );
    };
    let written = &text[value.span.clone()];
    written.parse::<u64>().ok().filter(|n| *n > 0).ok_or_else(|| {
        wrong(format!("`{path}` is `{written}`, and only whole numbers above zero make a mesh finer"))
            .help("name the number of elements, as in polylines[0].subdivisions")
    })
}

/// The paths of all named values in `value` that are whole numbers above zero.
fn whole_numbers(value: &Value, text: &str, at: &Path, found: &mut Vec<String>) {
    for (i, item) in value.items.iter().enumerate() {
        let path = item.key.as_ref().map_or_else(|| at.index(i), |k| at.key(k));
        if item.key.is_some() && text[item.value.span.clone()].parse::<u64>().is_ok_and(|n| n > 0) {
            found.push(path.to_string());
        }
        whole_numbers(&item.value, text, &path, found);
    }
}

impl Builder<'_> {
    /// Every path of `refine` must lead to a whole number that stands in the scene, and only once.
    pub(super) fn check_refine(&mut self, scene: &Scene) {
        for (i, path) in scene.refine.iter().enumerate() {
            let place = at("refine").index(i);
            if let Err(problem) = number_at(self.root, self.text, path) {
                self.problems.push(Problem { path: place, ..problem });
            } else if scene.refine[..i].contains(path) {
                self.problem(place, format!("`{path}` is named twice"));
            }
        }
    }
}
