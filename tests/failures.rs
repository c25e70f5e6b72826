//! A run that goes wrong says where, keeps its last good state, and is tried again where its scene says so.
#[path = "support/program.rs"]
mod program;
use program::{Bench, assert_same, summary};
use serde_json::Value;

/// A bar that is pulled far beyond what it bears.
const PULLED: &str = r#"(
    units: Si,
    sections: { "s": Stiffness(ea: 1, mass: 1) },
    nodes: [[0, 0, 0], [1, 0, 0]],
    elements: { "truss": [(nodes: [0, 1], section: "s")] },
    filaments: [(nodes: [0, 1], radius: 0.01)],
    fixed: [(nodes: [0], dofs: [U])],
    loads: [(nodes: [1], force: [1, 0, 0])],
    damping: Mass(1),
    integration: (axial: Explicit),
    stop: (time: 20),
)"#;

/// A beam that a moment turns faster and faster.
const TURNED: &str = r#"(
    units: Si,
    sections: { "s": Stiffness(ea: 1000, ei: 1, gj: 1, mass: 1) },
    nodes: [[0, 0, 0], [1, 0, 0]],
    elements: { "beam": [(nodes: [0, 1], section: "s")] },
    fixed: [(nodes: [0], dofs: [U, R])],
    loads: [(nodes: [1], moment: [3, 0, 0], amplitude: "up")],
    amplitudes: { "up": SmoothStep(rise: 1) },
    damping: Mass(2),
    stop: (time: 5),
    integration: (axial: Explicit),
)"#;

fn bench(scene: &str) -> Bench {
    let bench = Bench::new();
    std::fs::write(bench.path("a.ron"), scene).expect("room");
    bench
}

fn json(bench: &Bench, path: &str) -> Value {
    serde_json::from_slice(&std::fs::read(bench.path(path)).unwrap_or_else(|e| panic!("{path}: {e}"))).expect("JSON")
}

#[test]
fn an_overstretched_bar_is_named_with_its_place_and_the_last_good_state() {
    let bench = bench(PULLED);
    let err = bench.expect(5, &["a.ron", "--out", "r", "--threads", "1"]).err;
    // Half of the mass at the end, and a load of one half in the first step: after dt = 0.9 the end has moved by dt^2 f/m (1/2) / (1 + ...).
    for part in [
        "numerical failure at t = 9e-1, step 1: truss 0 (nodes 0 and 1; tow 0, filament 0, node 0 of 2) is stretched by 66 % of its length",
        "Likely causes: a load",
        "watch: (strain: None)",
        "element      truss 0 (nodes 0, 1)",
        "last good    t 0.0000e0 step 0: checkpoints/good.ckpt, frames/last_good.vtp",
    ] {
        assert!(err.contains(part), "{part} is missing in\n{err}");
    }
    let report = json(&bench, "r/failure.json");
    assert_eq!((report["step"].as_u64(), report["system"].as_str()), (Some(1), Some("truss")));
    assert_eq!((report["elements"][0]["kind"].as_str(), report["elements"][0]["index"].as_u64()), (Some("truss"), Some(0)));
    assert_eq!(report["node"]["place"], "tow 0, filament 0, node 0 of 2");
    // N = EA strain.
    assert!((report["elements"][0]["axial"].as_f64().unwrap() - 0.6612244897959183).abs() < 1e-12, "{report}");
    assert_eq!(report["looks"].as_array().unwrap().len(), 2);
    assert_eq!(report["provenance"]["scene"], "a");
    assert!(bench.path("r").join(report["last_good"]["checkpoint"].as_str().unwrap()).exists());
    assert!(bench.path("r").join(report["last_good"]["frame"].as_str().unwrap()).exists());
    assert_eq!(summary(&bench.path("r"))["status"], "failed");
    assert_eq!(json(&bench, "r/status.json")["state"], "failed");
    // It fails again from there, at the same step.
    let again = bench.expect(5, &["resume", "r"]).err;
    assert!(again.contains("step 1: truss 0"), "{again}");
    // What is meant can be allowed.
    bench.expect(0, &["a.ron", "--out", "meant", "--set", "watch.strain=None"]);
}

#[test]
fn every_watch_has_its_message() {
    let two = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/two_filaments.ron").display().to_string();
    let bench = bench(TURNED);
    let cases: [(&str, &[&str], &str); 3] = [
        ("a.ron", &["watch.rotation=0.02"], "node 1 turns by 0.02 radian in one step"),
        (&two, &["watch.balance=1e-9", "integration.monitor_every=4"], "the energies do not balance"),
        (&two, &["watch.time_step=0.8", "contact.penetration=(target: 0.0005, slower: 3)"], "the time step has collapsed from"),
    ];
    for (i, (scene, sets, message)) in cases.into_iter().enumerate() {
        let mut all = vec![scene, "--out", ["r0", "r1", "r2"][i], "--set", "output.pictures=false"];
        sets.iter().for_each(|s| all.extend(["--set", s]));
        let err = bench.expect(5, &all).err;
        assert!(err.contains(message) && err.contains("Likely causes") && err.contains("None)"), "{message} is missing in\n{err}");
        assert!(err.contains("  before "), "{err}");
    }
    // The same scene without the limits runs to its end.
    bench.expect(0, &["a.ron", "--out", "r3"]);
}

#[test]
fn a_contact_that_gives_way_is_named_with_the_node_beside_it() {
    let two = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/two_filaments.ron").display().to_string();
    let bench = Bench::new();
    let sets = ["--set", "contact.stiffness=0.001", "--set", "output.pictures=false"];
    let err = bench.expect(5, &[&[two.as_str(), "--out", "r"][..], &sets].concat()).err;
    assert!(err.contains("filaments 0 and 1 press") && err.contains("contact      filaments 0 and 1: gap"), "{err}");
    let report = json(&bench, "r/failure.json");
    // The wires cross in the middle: node 2 of each.
    assert!(report["node"]["place"].as_str().unwrap().contains("node 2 of 5"), "{report}");
    assert_eq!(report["elements"].as_array().unwrap().len(), 2, "two beams meet there");
    let depths: Vec<f64> = report["looks"].as_array().unwrap().iter().map(|l| l["penetration"].as_f64().unwrap()).collect();
    assert!(depths.len() == 16 && depths.is_sorted() && depths[15] > 1.0, "{depths:?}");
}

#[test]
fn a_retry_goes_back_with_half_the_time_step_and_says_so() {
    let bench = bench(TURNED);
    let sets = ["--set", "watch.rotation=0.02", "--threads", "1"];
    let run = |code: i32, out: &str, retry: &str| {
        let retry = format!("watch.on_failure={retry}");
        bench.expect(code, &[&["a.ron", "--out", out, "--set", &retry][..], &sets].concat())
    };
    let done = run(0, "r", "Retry(4)");
    assert!(done.err.contains("back to step 0 with the safety factor 0.45 (try 1 of 4)"), "{}", done.err);
    let s = summary(&bench.path("r"));
    let retries = s["retries"].as_array().unwrap().clone();
    assert!(!retries.is_empty() && retries.len() <= 4, "{retries:?}");
    for (i, r) in retries.iter().enumerate() {
        assert_eq!(r["safety"].as_f64(), Some(0.9 * 0.5f64.powi(i as i32 + 1)));
        assert!(r["message"].as_str().unwrap().starts_with("node 1 turns by") && r["from_step"].as_u64() < r["step"].as_u64(), "{r}");
    }
    let (dt, limit) = (s["dt"].as_f64().unwrap(), s["dt_limit"]["value"].as_f64().unwrap());
    let safety = 0.9 * 0.5f64.powi(retries.len() as i32);
    assert!((dt / (safety * limit) - 1.0).abs() < 0.06, "{dt} {limit} {safety}");
    assert!(!bench.path("r/failure.json").exists(), "what came of the failure is gone");
    // It comes out the same every time.
    run(0, "again", "Retry(4)");
    assert_same(&bench.path("r"), &bench.path("again"), "again");
    // It runs on with the shorter step, and comes where a longer run comes.
    bench.expect(0, &["resume", "again", "--until", "8 s", "--threads", "1"]);
    bench.expect(0, &[&["a.ron", "--out", "long", "--set", "watch.on_failure=Retry(4)", "--set", "stop.time=8"][..], &sets].concat());
    assert_eq!(summary(&bench.path("again"))["state_hash"], summary(&bench.path("long"))["state_hash"]);
    // Too few tries: the run fails.
    let failed = run(5, "short", "Retry(1)");
    assert!(failed.err.contains("try 1 of 1") && failed.err.contains("error: numerical failure"), "{}", failed.err);
    assert_eq!(summary(&bench.path("short"))["retries"].as_array().unwrap().len(), 1);
    assert!(bench.path("short/failure.json").exists());
}
