//! What a verification gives: a line per scene, mesh and quantity.
use super::Verified;
use super::order::order;
use super::page;
use crate::output::OutputError;
use crate::output::file::{holds_results, json, write_atomic};
use serde::Serialize;
use std::path::Path;

/// A quantity of a scene on one mesh, against its reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name of the scene.
    pub scene: String,
    /// Title of the scene.
    pub title: String,
    /// Factor on the mesh of the scene.
    pub mesh: f64,
    /// Elements of all kinds.
    pub elements: usize,
    /// Name of the quantity.
    pub quantity: String,
    /// The known answer, in the unit of the quantity.
    pub reference: f64,
    /// What came out.
    pub computed: Option<f64>,
    /// Computed less reference, over the size of the reference; as it is where the reference is zero.
    pub error: Option<f64>,
    /// Largest error allowed, over the same size.
    pub allowed: f64,
    /// True if the error is not larger.
    pub holds: bool,
    /// Order of convergence from the next coarser mesh to this one.
    pub order: Option<f64>,
    /// Steps of the run.
    pub steps: u64,
    /// Wall time of the run (s).
    pub seconds: f64,
}

impl Row {
    /// True for an answer that was missed. On a mesh coarser than that of the scene nothing was promised.
    pub fn missed(&self) -> bool {
        !self.holds && self.mesh >= 1.0
    }
}

/// A scene that could not be run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Broken {
    /// The file.
    pub scene: String,
    /// Factor on its mesh.
    pub mesh: f64,
    /// Why.
    pub message: String,
}

/// The lines of all scenes; those of one scene stand together, from the coarsest mesh to the finest.
pub fn rows(verified: &[Verified]) -> Vec<Row> {
    let mut rows: Vec<Row> = Vec::new();
    for v in verified {
        for r in &v.rows {
            let scale = if r.expected == 0.0 { 1.0 } else { r.expected.abs() };
            let error = r.found.map(|f| (f - r.expected) / scale);
            // What is zero is compared with what is allowed.
            let size = if r.expected == 0.0 { r.allowed } else { 1.0 };
            let before = rows.iter().rfind(|b| b.scene == v.scene && b.quantity == r.name && b.mesh < v.mesh);
            let order = before.and_then(|b| order(b.error?, error?, size, v.mesh / b.mesh));
            rows.push(Row {
                scene: v.scene.clone(),
                title: v.title.clone(),
                mesh: v.mesh,
                elements: v.elements,
                quantity: r.name.clone(),
                reference: r.expected,
                computed: r.found,
                error,
                allowed: r.allowed / scale,
                holds: r.holds(),
                order,
                steps: v.steps,
                seconds: v.seconds,
            });
        }
    }
    rows
}

/// Who has written a file, in the file itself.
pub(super) const AUTHOR: &str = "braid-ecs verify";

/// A finished verification.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    program: &'static str,
    /// Version of the program.
    pub version: &'static str,
    /// Architecture and system.
    pub target: String,
    /// The lines.
    pub rows: Vec<Row>,
    /// Scenes that could not be run.
    pub broken: Vec<Broken>,
}

impl Outcome {
    /// The outcome of this program on this machine.
    pub fn new(rows: Vec<Row>, broken: Vec<Broken>) -> Self {
        let target = format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS);
        Outcome { program: AUTHOR, version: env!("CARGO_PKG_VERSION"), target, rows, broken }
    }

    /// Refuses a folder with the results of a run or a study, or with files of these names that an
    /// earlier verification has not written.
    ///
    /// # Errors
    /// [`OutputError::Foreign`], and what the operating system says about the files.
    pub fn check_folder(folder: &Path) -> Result<(), OutputError> {
        if holds_results(folder) {
            return Err(OutputError::Foreign { path: folder.to_owned(), author: AUTHOR });
        }
        for name in ["verification.json", "verification.html"] {
            let path = folder.join(name);
            match std::fs::read_to_string(&path) {
                Ok(text) if text.contains(AUTHOR) => {}
                Err(e) if matches!(e.kind(), std::io::ErrorKind::NotFound | std::io::ErrorKind::NotADirectory) => {}
                Err(e) if e.kind() != std::io::ErrorKind::InvalidData => return Err(OutputError::io("read", &path, e)),
                _ => return Err(OutputError::Foreign { path, author: AUTHOR }),
            }
        }
        std::fs::create_dir_all(folder).map_err(|e| OutputError::io("create the folder", folder, e))
    }

    /// Writes `verification.json` and `verification.html`.
    ///
    /// # Errors
    /// Those of [`Outcome::check_folder`], and what the operating system says about the disk.
    pub fn write(&self, folder: &Path) -> Result<(), OutputError> {
        Outcome::check_folder(folder)?;
        write_atomic(&folder.join("verification.json"), &json(self))?;
        write_atomic(&folder.join("verification.html"), page::page(self).as_bytes())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::output::expected::Comparison;

    fn verified(mesh: f64, found: f64) -> Verified {
        let row = |name: &str, found, expected| Comparison { name: name.into(), found, expected, allowed: 0.02 };
        Verified {
            scene: "A".into(),
            title: "A beam".into(),
            mesh,
            elements: (10.0 * mesh) as usize,
            rows: vec![row("u <x>", Some(found), 2.0), row("none", None, 1.0), row("zero", Some(found - 2.0), 0.0)],
            steps: 7,
            seconds: 0.5,
        }
    }

    pub(in crate::verify) fn two_meshes() -> Vec<Row> {
        rows(&[verified(0.5, 2.4), verified(1.0, 2.1)])
    }

    #[test]
    fn errors_orders_and_misses() {
        let rows = two_meshes();
        assert_eq!(rows.len(), 6);
        assert!((rows[0].error.unwrap() - 0.2).abs() < 1e-12 && rows[0].allowed == 0.01 && rows[0].order.is_none());
        assert!((rows[3].order.unwrap() - 2.0).abs() < 1e-9 && (rows[5].order.unwrap() - 2.0).abs() < 1e-9);
        assert!(!rows[0].holds && !rows[0].missed(), "a coarse mesh promises nothing");
        assert!(rows[3].missed() && rows[4].missed() && rows[4].error.is_none() && rows[4].order.is_none());
    }

    #[test]
    fn only_its_own_files_are_written_over() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("a/b");
        let outcome = Outcome::new(two_meshes(), vec![Broken { scene: "b.ron".into(), mesh: 1.0, message: "why".into() }]);
        outcome.write(&folder).unwrap();
        outcome.write(&folder).expect("its own files");
        let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("verification.json")).unwrap()).unwrap();
        assert_eq!((json["rows"].as_array().unwrap().len(), json["broken"][0]["message"].as_str()), (6, Some("why")));
        for (name, content) in [("verification.json", &b"{}"[..]), ("verification.html", b"\xff\xfe"), ("summary.json", b"{}")] {
            let other = dir.path().join(name);
            std::fs::create_dir(&other).unwrap();
            std::fs::write(other.join(name), content).unwrap();
            let error = outcome.write(&other).unwrap_err();
            assert!(matches!(error, OutputError::Foreign { .. }), "{error}");
            assert_eq!(std::fs::read(other.join(name)).unwrap(), content, "a refusal changes nothing");
            assert_eq!(std::fs::read_dir(&other).unwrap().count(), 1);
        }
        std::fs::write(dir.path().join("file"), "").unwrap();
        assert!(outcome.write(&dir.path().join("file/x")).unwrap_err().to_string().contains("file/x"));
    }
}
