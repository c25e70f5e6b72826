//! The same scene on a finer or coarser mesh.
use super::LoadedScene;
use super::build::number_at;
use super::error::{Category, Problem, SceneErrors};
use super::read::load_text;
use super::spans::{Path, tree};
use crate::registry::Registry;

/// How far from a whole number a product may be: decimal factors such as 0.1 are not exact.
const WHOLE: f64 = 1e-9;

impl LoadedScene {
    /// The scene with every number that its `refine` names multiplied by `factor`.
    ///
    /// # Errors
    /// A scene without `refine`, a product that is not a whole number above zero, and whatever is wrong
    /// with the scene on this mesh: a node that is not there any more, for instance.
    pub fn on_mesh(&self, factor: f64, registry: &Registry) -> Result<LoadedScene, SceneErrors> {
        let name = self.path.display().to_string();
        let tree = tree(&self.text);
        let root = tree.root.as_ref();
        let place = |problem| SceneErrors::place(Category::Usage, &name, &self.text, root, vec![problem]);
        if self.scene.refine.is_empty() {
            let problem = Problem::new(Path::default(), "the scene does not say how its mesh is refined");
            return Err(place(problem.help("for example refine: [\"polylines[0].subdivisions\"]")));
        }
        let root_value = root.expect("a scene that was read has a value");
        let mut numbers = Vec::new();
        for path in &self.scene.refine {
            numbers.push((path, number_at(root_value, &self.text, path).map_err(place)?));
        }
        let common = numbers.iter().fold(0, |g, (_, n)| gcd(g, *n));
        let mut sets = Vec::new();
        for (path, n) in numbers {
            let product = n as f64 * factor;
            let whole = product.round();
            if !(whole >= 1.0 && (product - whole).abs() <= WHOLE * product && whole < 1e9) {
                let at = Path::parse(path).unwrap_or_default();
                let message = format!("`{path}` is {n}, and {factor} times {n} is no whole number of elements");
                return Err(place(
                    Problem::new(at, message).help(format!("factors of --mesh that fit this scene: k / {common}, k = 1, 2, ...")),
                ));
            }
            sets.push((path.clone(), format!("{whole}")));
        }
        load_text(&name, self.text.clone(), &sets, registry)
    }
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
