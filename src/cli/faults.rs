//! A disk that fails at two hundred places of a run: whatever it leaves, the run goes on from it to the same files, or says what is
//! wrong.
use super::message::Failure;
use super::{Cli, Command, resume, run};
use crate::output::disk::faults::{self, Fault};
use crate::output::summary::Summary;
use crate::systems::default_plugins;
use clap::Parser;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// A filament that swings, with every kind of output, long enough for several checkpoints.
const SCENE: &str = r#"(
    units: Consistent,
    materials: { "m": (young: 1000, poisson: 0.3, density: 1) },
    polylines: [(name: "f", points: [[0, 0, 0], [1, 0, 0]], subdivisions: 6, radius: 0.05, material: "m", model: Beams)],
    fixed: [(nodes: ["f.points[0]"], dofs: [U, R])],
    gravity: (acceleration: [0, 0, -1]),
    probes: { "lowest": Min(Displacement(node: "f.points[1]", component: Z)) },
    integration: (axial: Explicit, dt: 0.0005),
    stop: (steps: 2500),
    output: (frames: Count(4), history: Count(20), checkpoint: "4 ms", pictures: false),
)"#;

fn command(arguments: &[&str]) -> Result<(), Failure> {
    let cli = Cli::try_parse_from([&["braid-ecs"], arguments].concat()).expect("arguments");
    match (cli.command, cli.scene) {
        (Some(Command::Resume(args)), _) => resume::resume(&args, default_plugins),
        (None, Some(scene)) => run::run(&scene, &cli.run, default_plugins),
        _ => panic!("only runs"),
    }
}

/// The files of a run, without those that tell of the program and not of the run, and of the summary without what hangs on
/// the clock.
fn outputs(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for place in ["", "frames"] {
        let Ok(entries) = fs::read_dir(folder.join(place)) else { continue };
        for path in entries.map(|e| e.expect("an entry").path()).filter(|p| p.is_file()) {
            let name = path.strip_prefix(folder).expect("inside").display().to_string();
            if name == "summary.json" {
                let mut s = Summary::read(folder).expect("a summary");
                (s.threads, s.wall_s, s.cpu_s, s.element_steps_per_s) = (0, 0.0, None, None);
                s.share.clear();
                files.insert(name, serde_json::to_vec(&s).expect("numbers and texts"));
            } else if name != "status.json" {
                files.insert(name, fs::read(&path).expect("a file"));
            }
        }
    }
    files
}

#[test]
fn two_hundred_faults_of_the_disk_spoil_nothing() {
    let dir = tempfile::tempdir().expect("a folder");
    let scene = dir.path().join("swing.ron");
    fs::write(&scene, SCENE).expect("room");
    let scene = scene.display().to_string();
    let folder = |name: &str| dir.path().join(name);
    let start = |out: &Path| command(&[&scene, "--quiet", "--threads", "1", "--force", "--out", &out.display().to_string()]);
    faults::begin(&folder("whole"), Fault::Broken, i64::MAX);
    start(&folder("whole")).expect("a good disk");
    let operations = faults::end();
    assert!(operations > 100, "{operations} operations");
    let whole = outputs(&folder("whole"));
    assert!(whole.keys().any(|n| n == "summary.json") && whole.keys().any(|n| n.ends_with("0003.vtp")), "{:?}", whole.keys());

    let kinds = [Fault::Full, Fault::Broken, Fault::Short, Fault::Torn];
    let (mut stopped, mut begun_again) = (0, 0);
    for i in 0..200 {
        let (out, fault) = (folder(&format!("run{i}")), kinds[i as usize % 4]);
        let what = format!("{fault:?} at operation {} of {operations}", i * operations / 200);
        faults::begin(&out, fault, i * operations / 200);
        let done = start(&out);
        faults::end();
        if let Err(failure) = done {
            stopped += 1;
            assert_eq!(failure.exit_code(), 4, "{what}: {failure}");
            let text = failure.to_string();
            assert!(text.starts_with("error: cannot ") && text.contains("run"), "{what}: {text}");
            let resumed = command(&["resume", &out.display().to_string(), "--quiet", "--threads", "1"]);
            // Before its first checkpoint a run can only begin again.
            if let Err(failure) = resumed {
                begun_again += 1;
                assert_eq!(failure.exit_code(), 4, "{what}: {failure}");
                start(&out).unwrap_or_else(|e| panic!("{what}: {e}"));
            }
        }
        let left = outputs(&out);
        assert_eq!(left.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>(), "{what}: the files");
        for (name, bytes) in &whole {
            assert!(left[name] == *bytes, "{what}: {name} differs");
        }
        fs::remove_dir_all(&out).expect("a folder");
    }
    println!("200 faults in {operations} operations: {stopped} runs stopped, {begun_again} of them had to begin again");
    assert!(stopped > 100, "{stopped}");
}
