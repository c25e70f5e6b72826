//! The program from outside, and what its output folders hold.
#![allow(dead_code)]
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A folder to run the program in.
pub struct Bench {
    pub dir: tempfile::TempDir,
}

/// Exit code and both outputs.
pub struct Done {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Bench {
    pub fn new() -> Self {
        Bench { dir: tempfile::tempdir().expect("a temporary folder") }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_braid-ecs"));
        command.args(arguments).current_dir(self.dir.path()).stdin(Stdio::null());
        command
    }

    pub fn start(&self, arguments: &[&str]) -> Child {
        self.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts")
    }

    pub fn run(&self, arguments: &[&str]) -> Done {
        done(self.start(arguments))
    }

    /// Runs and expects an exit code.
    pub fn expect(&self, code: i32, arguments: &[&str]) -> Done {
        let done = self.run(arguments);
        assert_eq!(done.code, Some(code), "{arguments:?}\n{}\n{}", done.out, done.err);
        done
    }
}

pub fn done(child: Child) -> Done {
    let o = child.wait_with_output().expect("the program ends");
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    Done { code: o.status.code(), out: text(&o.stdout), err: text(&o.stderr) }
}

/// The summary of an output folder.
pub fn summary(folder: &Path) -> serde_json::Value {
    let path = folder.join("summary.json");
    serde_json::from_slice(&std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))).expect("JSON")
}

/// All files that a run leaves behind, without those that tell of the program and not of the run; of the
/// summary without what hangs on the clock.
pub fn outputs(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(at) = folders.pop() {
        for entry in std::fs::read_dir(&at).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path.strip_prefix(folder).expect("inside").to_string_lossy().into_owned();
            if path.is_dir() && name != "checkpoints" {
                folders.push(path);
            } else if name == "summary.json" {
                let mut s = summary(folder);
                for key in ["threads", "wall_s", "cpu_s", "element_steps_per_s", "share"] {
                    assert!(s.as_object_mut().expect("an object").remove(key).is_some(), "{key}");
                }
                files.insert(name, s.to_string().into_bytes());
            } else if path.is_file() && name != "status.json" {
                files.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    files
}

/// Both folders hold the same files with the same bytes.
pub fn assert_same(a: &Path, b: &Path, what: &str) {
    let (a, b) = (outputs(a), outputs(b));
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{what}: the files");
    for (name, bytes) in &a {
        if name == "summary.json" {
            assert_eq!(String::from_utf8_lossy(bytes), String::from_utf8_lossy(&b[name]), "{what}");
        }
        assert!(*bytes == b[name], "{what}: {name} differs");
    }
}
