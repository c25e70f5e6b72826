//! `braid-ecs check`: what is implausible, with its place, and what a run would need.
#[path = "support/program.rs"]
mod program;
use braid_ecs::memory;
use program::Bench;

const ROPE: &str = r#"(
    units: MmNTonne,
    materials: {
        "glass": (young: 72e9, poisson: 0.5, density: "2.58 kg/m3"),
    },
    bundles: [(name: "b", radius: 2, length: 5, elements: 4, filaments: 1, material: "glass", start: Pinned, end: Pinned)],
    contact: (),
    stop: (time: 1e-6),
)"#;

#[test]
fn implausible_numbers_are_hinted_at_with_their_places() {
    let bench = Bench::new();
    std::fs::write(bench.path("a.ron"), ROPE).unwrap();
    let out = bench.expect(0, &["check", "a.ron"]).out;
    let expected = [
        "a.ron:4:26: hint: materials.glass.young: Young's modulus of material `glass` is 7.200e16 Pa, and fibres have 1e6 to 2e12; 1e-6 times that would be usual: is the unit right?",
        "a.ron:4:41: hint: materials.glass.poisson: Poisson's ratio of material `glass` is 0.5: it would be incompressible",
        "a.ron:4:55: hint: materials.glass.density: density of material `glass` is 2.580e0 kg/m3, and fibres have 5e2 to 2.5e4; 1e3 times that would be usual: is the unit right?",
        "a.ron:6:15: hint: bundles[0]: elements are shorter than their diameter: 1.250e0 against 4.000e0 mm",
        "help: a unit can stand with the number: \"72 GPa\", \"2.58 g/cm3\", \"2.5 um\"",
    ];
    for line in expected {
        assert!(out.contains(line), "{line} is missing in\n{out}");
    }
    // A run says that there are some.
    let err = bench.expect(0, &["a.ron", "--out", "r"]).err;
    assert!(err.contains("4 hints: braid-ecs check a.ron"), "{err}");
}

#[test]
fn a_braid_without_room_for_its_tows_jams() {
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/embedded7.ron").display().to_string();
    let bench = Bench::new();
    let sound = bench.expect(0, &["check", &scene]).out;
    assert!(!sound.contains("hint"), "{sound}");
    for row in ["time step", "steps", "duration", "memory"] {
        assert!(sound.contains(row), "{sound}");
    }
    // Tows of one direction stand 2 pi R cos(angle) / 6 apart.
    let sets =
        ["tow.filament_radius=0.09 mm", "tow.elements=5", "mandrel.shape=Square(side: \"0.1 mm\")", "contact.initial_overlap=Offset"];
    let sets = sets.iter().flat_map(|s| ["--set", s]);
    let tight = bench.expect(0, &["check", &scene].into_iter().chain(sets).collect::<Vec<_>>()).out;
    assert!(tight.contains("hint: braid: the braid jams") && tight.contains("(cover factor over 1)"), "{tight}");
}

#[test]
fn a_period_that_matches_only_some_nodes_is_hinted_at() {
    let scene = r#"(
        units: Consistent,
        sections: { "s": Stiffness(ea: 1, mass: 1) },
        nodes: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1.1, 0]],
        elements: { "truss": [(nodes: [0, 1], section: "s"), (nodes: [2, 3], section: "s"), (nodes: [0, 2], section: "s")] },
        periodic: (dummies: { "p": [1, 0, 0] }, matching: true),
        fixed: [(nodes: [0], dofs: [U])],
        integration: (axial: Explicit),
        stop: (time: 1),
    )"#;
    let bench = Bench::new();
    std::fs::write(bench.path("a.ron"), scene).unwrap();
    let out = bench.expect(0, &["check", "a.ron"]).out;
    assert!(out.contains("a.ron:6:19: hint: periodic: the period [1, 0, 0] matches only 1 of the 2 nodes of its far face"), "{out}");
}

#[test]
fn more_than_the_machine_has_is_refused_before_it_is_built() {
    let Some(machine) = memory::of_machine() else { return };
    let elements = machine / memory::PER_ELEMENT * 5 / 4 / 12;
    if elements * 12 > 50_000_000 {
        return;
    }
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/embedded7.ron").display().to_string();
    let bench = Bench::new();
    let sets = [format!("tow.elements={elements}"), "tow.filaments=1".into()];
    let err = bench.expect(3, &["check", &scene, "--set", &sets[0], "--set", &sets[1]]).err;
    let (wanted, there) = (memory::text(elements * 12 * memory::PER_ELEMENT), memory::text(machine));
    let message =
        format!("too large for this machine: 12 x 1 x {elements} elements take the run to about {wanted} of memory, and {there} are there");
    assert!(err.contains(&message), "{err}\n{message}");
}

#[test]
fn every_output_tells_what_made_it() {
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/two_filaments.ron").display().to_string();
    let bench = Bench::new();
    bench.expect(0, &[&scene, "--out", "r", "--set", "stop.time=0.1 ms", "--set", "seed=42"]);
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(bench.path("r/summary.json")).unwrap()).unwrap();
    let made = &json["provenance"];
    for key in ["program", "revision", "scene", "scene_hash", "units", "seed", "target", "features"] {
        assert!(made[key].as_str().is_some_and(|v| !v.is_empty()), "{key}: {made}");
    }
    assert_eq!((made["seed"].as_str(), made["scene"].as_str()), (Some("42"), Some("two_filaments")));
    assert!(json["threads"].as_u64() > Some(0));
    let hash = made["scene_hash"].as_str().unwrap();
    let holds = |file: &str, word: &str| {
        let bytes = std::fs::read(bench.path("r").join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(bytes.windows(word.len()).any(|w| w == word.as_bytes()), "{word} is missing in {file}");
    };
    for file in
        ["history.csv", "history.svg", "results.pvd", "contacts.pvd", "scene.resolved.ron", "status.json", "final.png", "initial.png"]
    {
        holds(file, hash);
    }
    // Values of frames are packed.
    for file in ["frames/0000.vtp", "frames/contacts_0000.vtp"] {
        holds(file, "Name=\"scene_hash\"");
        holds(file, "Name=\"revision\"");
    }
    holds("checkpoints/end.ckpt", braid_ecs::output::provenance::REVISION);
}
