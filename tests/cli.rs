//! The program from outside: exit codes, messages, what is written where.
use std::path::Path;
use std::process::{Command, Output};

const STRIP: &str = r#"(
    units: MmNTonne,
    materials: {"steel": (young: "200 GPa", poisson: 0.3, density: "7.85 g/cm3")},
    polylines: [(name: "strip", points: [[0, 0, 0], [100, 0, 0]], subdivisions: 5, radius: "0.25 mm", material: "steel", model: Beams, start: Clamped)],
    loads: [(nodes: ["strip.0.end"], force: [0, 0.01, 0])],
    probes: {"tip": Displacement(node: "strip.0.end", component: Y)},
    stop: (time: "5 ms"),
    output: (pictures: false),
)"#;

fn program(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_braid-ecs")).args(arguments).current_dir(folder).output().expect("the program starts")
}

/// Exit code, standard output, standard error.
fn parts(o: &Output) -> (i32, String, String) {
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (o.status.code().expect("no signal, so no panic in the terminal either"), text(&o.stdout), text(&o.stderr))
}

fn folder_with(scene: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("strip.ron"), scene).unwrap();
    dir
}

#[test]
fn a_run_prints_a_table_and_refuses_to_overwrite_its_results() {
    let dir = folder_with(STRIP);
    let (code, out, err) = parts(&program(dir.path(), &["strip.ron", "--threads", "1"]));
    assert_eq!(code, 0, "{err}");
    for part in ["completed at t = ", "1 thread", "the implicit axial scheme", "balance error", "tip", "results/strip"] {
        assert!(out.contains(part), "{part} is missing in\n{out}");
    }
    let summary = dir.path().join("results/strip/summary.json");
    let first = std::fs::read_to_string(&summary).unwrap();
    let (code, _, err) = parts(&program(dir.path(), &["strip.ron"]));
    assert_eq!(code, 4);
    assert!(err.contains("already holds") && err.contains("--out DIR") && err.contains("--force"), "{err}");
    assert_eq!(std::fs::read_to_string(&summary).unwrap(), first);
    let (code, out, err) = parts(&program(dir.path(), &["strip.ron", "--force", "--quiet", "--set", "output.frames=Never"]));
    assert_eq!((code, out.as_str(), err.as_str()), (0, "", ""), "quiet is silent");
    assert_eq!(std::fs::read_to_string(dir.path().join("results/strip.1/summary.json")).unwrap(), first);
    assert!(!dir.path().join("results/strip/frames").exists(), "--set was obeyed");
}

#[test]
fn check_tells_sizes_and_time_step_and_writes_nothing() {
    let dir = folder_with(STRIP);
    let (code, out, err) = parts(&program(dir.path(), &["check", "strip.ron"]));
    assert_eq!(code, 0, "{err}");
    for part in ["6 (0 dummy", "5 beam", "limit", "by the implicit axial scheme", "steps", "about"] {
        assert!(out.contains(part), "{part} is missing in\n{out}");
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn every_kind_of_failure_has_its_exit_code() {
    let dir = folder_with(STRIP);
    let run = |arguments: &[&str]| parts(&program(dir.path(), arguments));
    // 2: usage.
    for wrong in [&[][..], &["strip.ron", "--speed", "9"], &["strip.ron", "--set", "x"], &["strip.ron", "--threads", "0"]] {
        let (code, _, err) = run(wrong);
        assert_eq!(code, 2, "{wrong:?}: {err}");
    }
    let (code, _, err) = run(&["strip.ron", "--set", "stop.tiem=1"]);
    assert_eq!(code, 2, "{err}");
    assert!(err.contains("stop.time"), "the nearest path is named: {err}");
    // 3: the scene is invalid; file, line, column and word are named.
    std::fs::write(dir.path().join("bad.ron"), STRIP.replace("model: Beams", "model: Baems")).unwrap();
    let (code, _, err) = run(&["bad.ron"]);
    assert_eq!(code, 3, "{err}");
    assert!(err.contains("bad.ron:4:") && err.contains("Baems") && err.contains("Beams"), "{err}");
    let (code, _, err) = run(&["strip.ron", "--set", "integration=(dt:1)"]);
    assert_eq!(code, 3, "{err}");
    assert!(err.contains("above the stable limit"), "{err}");
    assert!(!dir.path().join("results").exists(), "a scene that cannot start leaves nothing behind");
    // 4: files.
    let (code, _, err) = run(&["no/such.ron"]);
    assert_eq!(code, 4, "{err}");
    std::fs::write(dir.path().join("file"), "").unwrap();
    let (code, _, err) = run(&["strip.ron", "--out", "file/results"]);
    assert_eq!(code, 4, "{err}");
    assert!(err.contains("file/results"), "{err}");
}

#[test]
fn a_numerical_failure_keeps_what_was_computed() {
    // Nothing is wrong at the start; the first step meets the load.
    let loads = "amplitudes: {\"up\": Ramp(rise: \"5 ms\")}, loads: [(amplitude: \"up\",";
    let dir = folder_with(&STRIP.replace("0.01", "1e200").replace("loads: [(", loads));
    let (code, _, err) = parts(&program(dir.path(), &["strip.ron", "--out", "r"]));
    assert_eq!(code, 5, "{err}");
    for part in ["t = ", "step ", "node ", "cause", "what was computed is in r"] {
        assert!(err.contains(part), "{part} is missing in\n{err}");
    }
    let summary: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(dir.path().join("r/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["status"], "failed");
    assert!(dir.path().join("r/history.csv").exists());
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let dir = folder_with(STRIP);
    let hash = |threads: &str, out: &str| {
        let (code, _, err) = parts(&program(dir.path(), &["strip.ron", "--quiet", "--threads", threads, "--out", out]));
        assert_eq!(code, 0, "{err}");
        let summary: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(dir.path().join(out).join("summary.json")).unwrap()).unwrap();
        assert_eq!(summary["threads"].to_string(), threads);
        summary["state_hash"].as_str().unwrap().to_owned()
    };
    assert_eq!(hash("1", "a"), hash("3", "b"));
}

#[test]
fn a_verification_writes_its_table_and_plots_and_nothing_over_others() {
    let expect = r#"expect: {"tip": (value: 1, abs: 10)}, refine: ["polylines[0].subdivisions"],
    output: (pictures: false),"#;
    let dir = folder_with(&STRIP.replace("output: (pictures: false),", expect));
    let run = |arguments: &[&str]| parts(&program(dir.path(), arguments));
    let (code, out, err) = run(&["verify", "strip.ron", "--mesh", "1", "0.4", "2"]);
    assert_eq!(code, 0, "{err}");
    for part in ["order", "mesh", "0.4", "2 of 2 quantities", "results/verification/verification.html"] {
        assert!(out.contains(part), "{part} is missing in\n{out}");
    }
    let folder = dir.path().join("results/verification");
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("verification.json")).unwrap()).unwrap();
    let meshes: Vec<f64> = json["rows"].as_array().unwrap().iter().map(|r| r["mesh"].as_f64().unwrap()).collect();
    assert_eq!(meshes, [0.4, 1.0, 2.0]);
    assert!(json["rows"][2].as_object().unwrap().contains_key("order") && json["rows"][2]["elements"] == 10);
    assert!(std::fs::read_to_string(folder.join("verification.html")).unwrap().contains("order 2"));
    // It replaces its own files, and nothing else.
    let (code, out, err) = run(&["verify", "strip.ron", "--json"]);
    assert_eq!(code, 0, "{err}");
    assert_eq!(serde_json::from_str::<serde_json::Value>(&out).unwrap().as_array().unwrap().len(), 1);
    std::fs::write(folder.join("verification.html"), "mine").unwrap();
    let (code, _, err) = run(&["verify", "strip.ron"]);
    assert!(code == 4 && err.contains("verification.html") && err.contains("--out DIR"), "{code} {err}");
    assert_eq!(std::fs::read_to_string(folder.join("verification.html")).unwrap(), "mine");
    // What makes no sense is refused before anything is run or written.
    for (arguments, part) in [
        (&["verify", "strip.ron", "--mesh", "0"][..], "a factor above zero"),
        (&["verify", "--mesh", "2", "strip.ron"], "names of scenes stand before --mesh"),
        (&["verify", "strip.ron", "--mesh", "0.5", "--out", "o"], "0.5 times 5 is no whole number"),
    ] {
        let (code, _, err) = run(arguments);
        assert!(code == 2 && err.contains(part), "{arguments:?}: {code} {err}");
    }
    std::fs::write(dir.path().join("plain.ron"), STRIP).unwrap();
    let (code, _, err) = run(&["verify", "plain.ron", "--mesh", "2"]);
    assert!(code == 2 && err.contains("`refine`"), "{code} {err}");
    // A miss is a miss on the mesh of the scene, not on a coarser one.
    std::fs::write(
        dir.path().join("far.ron"),
        STRIP.replace("output:", "expect: {\"tip\": (value: 1e3, rel: 0.1)}, refine: [\"polylines[0].subdivisions\"], output:"),
    )
    .unwrap();
    assert_eq!(run(&["verify", "far.ron", "--mesh", "0.2", "--out", "p"]).0, 0);
    assert_eq!(run(&["verify", "far.ron", "--out", "p"]).0, 6);
}

#[test]
fn a_closed_output_is_said_with_code_4() {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let output = Command::new(env!("CARGO_BIN_EXE_braid-ecs")).arg("plugins").stdout(writer).output().expect("it runs");
    assert_eq!(output.status.code(), Some(4));
    assert!(String::from_utf8_lossy(&output.stderr).contains("standard output was closed"), "{output:?}");
}
