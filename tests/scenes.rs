//! Scenes from text to model and through a run.
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Blind, Status};
use braid_ecs::scene::{self, LoadedScene, error::SceneErrors};
use braid_ecs::systems::default_plugins;

fn load(text: &str, sets: &[(&str, &str)]) -> Result<LoadedScene, SceneErrors> {
    let sets: Vec<(String, String)> = sets.iter().map(|(p, v)| (p.to_string(), v.to_string())).collect();
    scene::load_text("test.ron", text.to_string(), &sets, &Simulation::new(default_plugins).registry)
}

fn run_scene(model: &Model) -> (Simulation, Status) {
    let mut sim = Simulation::new(default_plugins);
    sim.build(model).expect("a sound model");
    let status = run::run(&mut sim, model, f64::INFINITY, &mut Blind).expect("a stable run");
    (sim, status)
}

fn position(sim: &mut Simulation, node: NodeId) -> DVec3 {
    node_states(&mut sim.world)[sim.world.resource::<NodeRows>().of(node)].x
}

const PENDULUM: &str = r#"(
    units: Si,
    materials: { "steel": (E: "200 GPa", nu: 0.3, rho: "7850 kg/m^3") },
    sections: { "wire": Round(material: "steel", radius: "1 mm") },
    nodes: [[0, 0, 0], [1, 0, 0]],
    node_names: { "bob": 1 },
    node_masses: [(nodes: ["bob"], mass: "1 kg")],
    elements: { "truss": [(nodes: [0, 1], section: "wire")] },
    fixed: [(nodes: [0], dofs: [U])],
    gravity: (acceleration: [0, "-9.81 m/s^2", 0]),
    integration: (axial: Explicit),
    stop: (time: 0.1),
)"#;

#[test]
fn a_scene_of_nodes_and_trusses_runs() {
    let loaded = load(PENDULUM, &[]).expect("valid");
    assert_eq!(loaded.model.name, "test");
    let (mut sim, status) = run_scene(&loaded.model);
    assert_eq!(status, Status::Completed);
    // In the first tenth of a second a horizontal pendulum falls almost freely: 9.81 x 0.1^2 / 2, less
    // (wire mass 24.7 g, of which half is at the bob) nothing, since gravity acts on all masses alike.
    let fall = -position(&mut sim, NodeId(1)).y;
    assert!((fall - 0.04905).abs() < 2e-4, "{fall}");
}

#[test]
fn values_are_set_from_the_command_line() {
    let loaded =
        load(PENDULUM, &[("stop.time", "10 ms"), ("integration.safety", "0.5"), ("title", "pendulum"), ("gravity.acceleration[1]", "-1")])
            .expect("valid");
    assert_eq!(loaded.model.stop.time, Some(0.01));
    assert_eq!(loaded.model.integration.safety, 0.5);
    assert_eq!(loaded.scene.title, "pendulum");
    assert_eq!(loaded.model.body_force.map(|b| b.acceleration), Some(-DVec3::Y));
}

#[test]
fn paths_that_do_not_exist_name_the_nearest() {
    for (path, near) in [
        ("integration.safty", "integration.safety"),
        ("stop.tme", "stop.time"),
        ("materials.stel.E", "materials.steel.E"),
        ("output.checkpoin", "output.checkpoint"),
        ("dampin", "damping"),
        ("stop.time.x", "stop.time"),
    ] {
        let e = load(PENDULUM, &[(path, "1")]).map(|_| ()).expect_err(path);
        let text = e.to_string();
        assert_eq!(e.category.exit_code(), 2, "{text}");
        assert!(text.contains(&format!("--set {path}=1")) && text.contains(&format!("`{near}`")), "{path}: {text}");
    }
    let e = load(PENDULUM, &[("materials.steel.nu", "0.7")]).map(|_| ()).expect_err("out of range");
    assert_eq!(e.category.exit_code(), 3);
    assert!(e.to_string().contains("given by --set materials.steel.nu=0.7"), "{e}");
}

#[test]
fn the_resolved_scene_reads_back_as_itself() {
    for text in [PENDULUM, include_str!("../scenes/cantilever.ron")] {
        let first = load(text, &[]).expect("valid");
        let written = first.resolved();
        let second = load(&written, &[]).unwrap_or_else(|e| panic!("{e}\n{written}"));
        assert_eq!(second.resolved(), written);
        assert_eq!(format!("{:?}", second.model.nodes), format!("{:?}", first.model.nodes));
        assert_eq!(second.model.integration, first.model.integration);
        assert_eq!(second.model.stop, first.model.stop);
        assert_eq!(second.model.amplitudes, first.model.amplitudes);
    }
}

#[test]
fn the_cantilever_scene_ends_on_the_elastica() {
    let loaded = load(include_str!("../scenes/cantilever.ron"), &[]).expect("valid");
    let (mut sim, _) = run_scene(&loaded.model);
    let tip = position(&mut sim, loaded.model.node_names["strip.0.end"]);
    // Bisshopp and Drucker 1945; 20 elements are within 0.3 %.
    assert!(((1.0 - tip.x / 100.0) / 0.38762836 - 1.0).abs() < 3e-3 && (tip.y / 100.0 / 0.71379152 - 1.0).abs() < 3e-3, "{tip}");
}
