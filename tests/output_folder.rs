//! What a run leaves behind, from the frames to the summary.
use braid_ecs::output::summary::{Summary, state_hash};
use braid_ecs::output::{Outcome, Recorder, timing};
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Status};
use braid_ecs::scene::{LoadedScene, load_text};
use braid_ecs::systems::default_plugins;
use std::path::Path;

const STRIP: &str = r#"(
    units: MmNTonne,
    materials: {"steel": (young: "200 GPa", poisson: 0.3, density: "7.85 g/cm3")},
    polylines: [(name: "strip", points: [[0, 0, 0], [100, 0, 0]], subdivisions: 5, radius: "0.25 mm", material: "steel", model: Beams, start: Clamped)],
    loads: [(nodes: ["strip.0.end"], force: [0, 0.01, 0])],
    damping: Mass("30 1/s"),
    probes: {
        "tip": Displacement(node: "strip.0.end", component: Y),
        "root moment": ReactionMoment(node: "strip.0.start"),
        "fastest": Max(Velocity(node: "strip.0.end")),
    },
    stop: (time: "20 ms"),
    output: (frames: Count(4), history: Every("2.5 ms")),
)"#;

fn record(text: &str, folder: &Path) -> (LoadedScene, Simulation, Outcome) {
    let mut sim = Simulation::new(default_plugins);
    let loaded = load_text("strip.ron", text.into(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    timing::install(&mut sim);
    sim.build(&loaded.model).expect("a sound model");
    std::fs::create_dir_all(folder).unwrap();
    let mut recorder = Recorder::new(&loaded, &mut sim, folder, loaded.model.stop.time).unwrap();
    let interval = recorder.interval(1e-6);
    let status = run::run(&mut sim, &loaded.model, interval, &mut recorder).unwrap();
    assert_eq!(status, Status::Completed);
    assert!(recorder.error().is_none());
    let outcome = recorder.finish(&mut sim, "completed").unwrap();
    (loaded, sim, outcome)
}

#[test]
fn a_run_fills_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    let (loaded, mut sim, outcome) = record(STRIP, dir.path());
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));

    // The summary on disk is the one returned, and the hash is that of the state.
    let summary: Summary = serde_json::from_str(&read("summary.json")).unwrap();
    assert_eq!(summary.state_hash, state_hash(&mut sim.world));
    assert_eq!((summary.scene.as_str(), summary.status.as_str(), summary.nodes, summary.elements), ("strip", "completed", 6, 5));
    assert_eq!(summary.steps, sim.world.resource::<Clock>().step);
    assert!((summary.time.unwrap() - 2e-2).abs() < summary.dt.unwrap());
    assert_eq!(summary.probes, outcome.summary.probes);
    assert!((summary.share.values().sum::<f64>() - 1.0).abs() < 1e-9 && summary.share["ElementForces"] > 0.0);
    // A tip load of 0.01 N on EI = 613.6 N mm^2 bends upwards, and the largest speed is not the last one's lesser.
    let tip = summary.probes["tip"].unwrap();
    assert!(tip > 0.0 && tip < 20.0, "{tip}");
    let velocity = node_states(&mut sim.world)[5].v.length();
    assert!(summary.probes["fastest"].unwrap() >= velocity);

    // History: provenance, one row per 2.5 ms from 0 on, probes in columns of their own.
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(dir.path().join("history.csv")).unwrap();
    let header: Vec<String> = reader.headers().unwrap().iter().map(String::from).collect();
    let column = |name: &str| header.iter().position(|h| h == name).unwrap_or_else(|| panic!("{name} in {header:?}"));
    let (time, tip_column) = (column("time [s]"), column("tip [mm]"));
    column("root moment [N mm]");
    let rows: Vec<Vec<f64>> = reader.records().map(|r| r.unwrap().iter().map(|f| f.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 9);
    for (i, r) in rows.iter().enumerate() {
        assert!((r[time] - 2.5e-3 * i as f64).abs() < 2.0 * summary.dt.unwrap(), "row {i} at {}", r[time]);
    }
    assert_eq!(rows[8][tip_column], tip);
    assert!(read("history.csv").starts_with("# program: braid-ecs"));

    // Frames at the start, at every quarter, and none twice at the end.
    let frames = std::fs::read_dir(dir.path().join("frames")).unwrap().count();
    assert_eq!(frames, 5);
    assert_eq!(read("results.pvd").matches("<DataSet").count(), 5);
    for name in ["initial.png", "final.png", "history.svg", "frames/0000.vtp"] {
        assert!(dir.path().join(name).metadata().unwrap().len() > 500, "{name}");
    }
    // The resolved scene is a scene again, with the same model.
    let again = load_text("strip.ron", read("scene.resolved.ron"), &[], &Simulation::new(default_plugins).registry).unwrap();
    assert_eq!(again.model.nodes.len(), loaded.model.nodes.len());
    assert_eq!(again.model.filaments[0].radius, loaded.model.filaments[0].radius);
}

#[test]
fn outputs_that_are_not_wanted_are_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let quiet =
        STRIP.replace("frames: Count(4), history: Every(\"2.5 ms\")", "frames: Never, history: Never, pictures: false, plots: false");
    let (_, _, outcome) = record(&quiet, dir.path());
    let mut names: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["scene.resolved.ron", "summary.json"]);
    // Probes are read at the end all the same.
    assert!(outcome.summary.probes["tip"].unwrap() > 0.0);
}

#[test]
fn observing_does_not_change_the_result() {
    let dir = tempfile::tempdir().unwrap();
    let (_, _, often) = record(STRIP, &dir.path().join("a"));
    let seldom = STRIP.replace("frames: Count(4), history: Every(\"2.5 ms\")", "frames: Ends, history: Ends, pictures: false");
    let (_, _, seldom) = record(&seldom, &dir.path().join("b"));
    assert_eq!(often.summary.state_hash, seldom.summary.state_hash);
}

#[test]
fn a_folder_that_cannot_be_written_stops_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let mut sim = Simulation::new(default_plugins);
    let loaded = load_text("strip.ron", STRIP.into(), &[], &sim.registry).unwrap();
    sim.build(&loaded.model).unwrap();
    let mut recorder = Recorder::new(&loaded, &mut sim, dir.path(), loaded.model.stop.time).unwrap();
    // A file is in the place of the folder of the frames when the first frame comes.
    std::fs::remove_dir(dir.path().join("frames")).unwrap();
    std::fs::write(dir.path().join("frames"), "").unwrap();
    let interval = recorder.interval(1e-6);
    assert_eq!(run::run(&mut sim, &loaded.model, interval, &mut recorder).unwrap(), Status::Stopped);
    assert!(sim.world.resource::<Clock>().step < 5);
    let error = recorder.error().expect("the error is kept").to_string();
    assert!(error.contains("create the folder") && error.contains("frames"), "{error}");
}
