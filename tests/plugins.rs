//! The plugins of the examples: known answers, messages with line and column, and what the program lists.
#[path = "support/program.rs"]
mod program;
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use braid_ecs::verify::verify;
use program::Bench;
use std::path::{Path, PathBuf};

#[path = "../examples/lab_coil.rs"]
mod lab_coil;
#[path = "../examples/lab_drag.rs"]
mod lab_drag;
#[path = "../examples/lab_mandrel.rs"]
mod lab_mandrel;
#[path = "../examples/lab_offset.rs"]
mod lab_offset;
#[path = "../examples/lab_plastic_truss.rs"]
mod lab_plastic_truss;
#[path = "../examples/lab_probe.rs"]
mod lab_probe;
#[path = "../examples/lab_pulse.rs"]
mod lab_pulse;
#[path = "../examples/lab_slip_beam.rs"]
mod lab_slip_beam;
#[path = "../examples/lab_spring.rs"]
mod lab_spring;

/// All first-party systems and all examples.
fn all(sim: &mut Simulation) {
    default_plugins(sim);
    lab_coil::plugin(sim);
    lab_drag::plugin(sim);
    lab_mandrel::plugin(sim);
    lab_offset::plugin(sim);
    lab_plastic_truss::plugin(sim);
    lab_probe::plugin(sim);
    lab_pulse::plugin(sim);
    lab_slip_beam::plugin(sim);
    lab_spring::plugin(sim);
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes").join(format!("{name}.ron"))
}

/// Every expectation of a scene holds, with this plugin alone.
fn known_answers(name: &str, plugin: fn(&mut Simulation)) {
    let sim = Simulation::new((default_plugins, plugin));
    let loaded = scene::load(file(name), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    let verified = verify(&loaded, sim).unwrap_or_else(|e| panic!("{e}"));
    assert!(!verified.rows.is_empty());
    for row in &verified.rows {
        assert!(row.holds(), "{name}: {row:?}");
    }
}

#[test]
fn a_spring_with_a_dashpot_comes_to_rest_where_it_must_and_takes_what_is_left() {
    known_answers("lab_spring", lab_spring::plugin);
}

#[test]
fn a_plastic_bar_keeps_its_plastic_strain_and_books_its_plastic_work() {
    known_answers("lab_plastic_truss", lab_plastic_truss::plugin);
}

#[test]
fn a_falling_node_reaches_its_terminal_velocity_and_a_free_one_does_not() {
    known_answers("lab_drag", lab_drag::plugin);
}

#[test]
fn a_rigid_arm_bends_and_twists_what_carries_it() {
    known_answers("lab_offset", lab_offset::plugin);
}

#[test]
fn a_probe_and_a_measure_of_a_plugin_are_sampled_and_expected() {
    known_answers("lab_probe", lab_probe::plugin);
}

#[test]
fn a_tow_slips_at_its_friction_moment_and_stays_bent_when_it_is_straightened() {
    known_answers("lab_slip_beam", lab_slip_beam::plugin);
}

#[test]
fn a_pulse_of_a_plugin_gives_a_mass_its_momentum() {
    known_answers("lab_pulse", lab_pulse::plugin);
}

#[test]
fn a_coil_of_a_plugin_is_as_soft_as_it_must_be() {
    known_answers("lab_coil", lab_coil::plugin);
}

#[test]
fn a_turning_mandrel_drags_a_filament_up_to_the_belt_friction() {
    known_answers("lab_mandrel", lab_mandrel::plugin);
}

/// A scene of the examples with one part replaced, and the first thing that the program says about it.
fn message(name: &str, from: &str, to: &str) -> String {
    let text = std::fs::read_to_string(file(name)).expect("a scene of the examples");
    assert!(text.contains(from), "{from}");
    let sim = Simulation::new(all);
    match scene::load_text("a.ron", text.replacen(from, to, 1), &[], &sim.registry) {
        Ok(_) => panic!("{to} was accepted"),
        Err(e) => e.to_string().split("\na.ron:").next().unwrap_or_default().to_owned(),
    }
}

#[test]
fn errors_inside_the_parts_of_plugins_have_line_and_column() {
    let mut wrong = Vec::new();
    let mut check = |found: String, expected: &str| {
        if found != expected {
            wrong.push(format!("expected\n{expected}\nfound\n{found}"));
        }
    };
    // Elements: a misspelt field, a wrong unit, a value out of range, a node that is not there, a name nobody has.
    check(
        message("lab_spring", "viscosity: 30", "viscosty: 30"),
        "a.ron:8:82: elements.\"lab.spring\"[0]: unknown field `viscosty` of spring\n  \
         help: did you mean `viscosity`? valid fields: `nodes`, `stiffness`, `cubic`, `viscosity`, `rest_length`",
    );
    check(
        message("lab_spring", "100 N/m", "100 kg"),
        "a.ron:8:59: elements.\"lab.spring\"[0].stiffness: `kg` is not a unit of a stiffness; write for example \"0.16 N/mm\"",
    );
    check(
        message("lab_spring", "viscosity: 30", "viscosity: -30"),
        "a.ron:8:93: elements.\"lab.spring\"[0].viscosity: viscosity must not be negative, -30 given",
    );
    check(
        message("lab_spring", "nodes: [0, 1], stiff", "nodes: [0, 7], stiff"),
        "a.ron:8:44: elements.\"lab.spring\"[0].nodes[1]: node 7 does not exist\n  help: the scene has 2 nodes, numbered from 0",
    );
    check(
        message("lab_spring", "\"lab.spring\": [(", "\"lab.sprnig\": [("),
        "a.ron:8:17: elements.\"lab.sprnig\": unknown kind of element `lab.sprnig`\n  \
         help: did you mean `lab.spring`? known: truss, beam, bending, lab.plastic_truss, lab.slip_beam, lab.spring",
    );
    // Sections of the scene.
    check(
        message("lab_drag", "area: \"20 cm^2\"", "aera: \"20 cm^2\""),
        "a.ron:9:41: \"lab.drag\": unknown field `aera` of drag\n  \
         help: did you mean `area`? valid fields: `density`, `coefficient`, `area`, `nodes`",
    );
    check(
        message("lab_drag", "nodes: [\"ball\"])", "nodes: [\"bal\"])"),
        "a.ron:9:66: \"lab.drag\".nodes[0]: unknown node `bal`\n  help: did you mean `ball`? known: ball, stone",
    );
    check(
        message("lab_drag", "\"lab.drag\"", "\"lab.darg\""),
        "a.ron:9:5: unknown section of a plugin `lab.darg`\n  help: did you mean `lab.drag`? known: contact, surfaces, mandrel, lab.coil, lab.drag, lab.mandrel, lab.offset",
    );
    check(
        message("lab_drag", "    stop:", "    \"lab.drag\": (density: 1, area: 1),\n    stop:"),
        "a.ron:11:5: section `lab.drag` is given twice",
    );
    // Probes.
    check(
        message("lab_probe", "(from: \"wall\"", "(frm: \"wall\""),
        "a.ron:15:60: probes.stretch.settings: unknown field `frm` of stretch\n  \
         help: did you mean `from`? valid fields: `from`, `to`",
    );
    check(
        message("lab_probe", "to: \"tip\"))),", "to: \"wall\"))),"),
        "a.ron:16:90: probes.largest stretch.settings.to: the two nodes are at the same point\n  help: a strain needs an initial distance",
    );
    check(
        message("lab_probe", "\"lab.stretch\"", "\"lab.strech\""),
        "a.ron:15:34: probes.stretch.probe: unknown probe of a plugin `lab.strech`\n  help: did you mean `lab.stretch`? known: lab.stretch",
    );
    check(
        message("lab_probe", "\"lab.gyration\"", "\"lab.gyraton\""),
        "a.ron:21:24: expect.\"lab.gyraton\": unknown measure or probe `lab.gyraton`\n  \
         help: did you mean `lab.gyration`? known: length, angle, thickness, lab.gyration, largest stretch, stretch",
    );
    // Amplitudes and generators.
    check(
        message("lab_pulse", "\"lab.pulse\"", "\"lab.puls\""),
        "a.ron:6:45: amplitudes.kick.amplitude: unknown amplitude of a plugin `lab.puls`\n  help: did you mean `lab.pulse`? known: lab.pulse",
    );
    check(
        message("lab_pulse", "(duration: \"200 ms\")", "(duration: \"200 mm\")"),
        "a.ron:6:79: amplitudes.kick.settings.duration: `mm` is not a unit of a time; write for example \"10 ms\"",
    );
    check(
        message("lab_pulse", "(duration: \"200 ms\")", "(duration: 0)"),
        "a.ron:6:79: amplitudes.kick.settings.duration: duration must be above zero, 0 given",
    );
    check(
        message("lab_coil", "turns: 3", "truns: 3"),
        "a.ron:7:18: \"lab.coil\": unknown field `truns` of coil\n  help: did you mean `turns`? valid fields: `turns`, `radius`, `pitch`, \
         `wire_radius`, `material`, `elements`, `model`",
    );
    check(
        message("lab_coil", "material: \"steel\", el", "material: \"stel\", el"),
        "a.ron:7:91: \"lab.coil\".material: unknown material `stel`\n  help: did you mean `steel`? known: steel",
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn a_scene_with_parts_of_plugins_is_written_back_as_the_same_scene() {
    for name in ["lab_spring", "lab_plastic_truss", "lab_slip_beam", "lab_drag", "lab_probe", "lab_pulse", "lab_coil", "lab_mandrel"] {
        let sim = Simulation::new(all);
        let first = scene::load(file(name), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}")).resolved();
        let again = scene::load_text("a.ron", first.clone(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}\n{first}")).resolved();
        assert_eq!(first, again);
    }
    let sim = Simulation::new(all);
    let set = [("\"lab.drag\".area".to_string(), "\"10 cm^2\"".to_string())];
    let loaded = scene::load(file("lab_drag"), &set, &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    assert!(loaded.resolved().contains("area:0.001"), "{}", loaded.resolved());
}

#[test]
fn the_history_of_an_element_survives_a_saved_state() {
    let load = || {
        let sim = Simulation::new(all);
        let loaded = scene::load(file("lab_plastic_truss"), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
        (sim, loaded.model)
    };
    let steps = |sim: &mut Simulation, n: usize| (0..n).for_each(|_| sim.step());
    let (mut whole, model) = load();
    whole.build(&model).expect("a sound model");
    run::start(&mut whole, &model).expect("a stable start");
    // The bar yields from step 500 to 1000.
    steps(&mut whole, 700);
    let saved = whole.save_state().expect("plain data");
    steps(&mut whole, 800);
    let (mut resumed, model) = load();
    resumed.build(&model).expect("a sound model");
    resumed.restore_state(&saved).expect("the same scene");
    steps(&mut resumed, 800);
    assert!(whole.save_state().expect("plain data") == resumed.save_state().expect("plain data"));
}

/// The braid at the end of `systems/README.md`, its filaments of this kind.
fn braid(model: &str) -> Vec<NodeState> {
    let page = include_str!("../systems/README.md");
    let scene = page.split("```ron").nth(1).and_then(|t| t.split("```").next()).expect("the page ends with a scene");
    let text = scene.replace("Custom(\"lab.spring\")", model);
    assert!(text.contains(&format!("model: {model}")), "{text}");
    let mut sim = Simulation::new(all);
    let loaded = scene::load_text("braid.ron", text, &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    sim.build(&loaded.model).expect("a sound model");
    run::run(&mut sim, &loaded.model, f64::INFINITY, &mut run::Blind).expect("a stable run");
    node_states(&mut sim.world)
}

#[test]
fn a_braid_of_linear_springs_moves_as_a_braid_of_trusses() {
    let (springs, trusses) = (braid("Custom(\"lab.spring\")"), braid("Trusses"));
    let moved = |s: &NodeState| s.v.length();
    assert!(springs.iter().map(moved).fold(0.0, f64::max) > 0.0, "the braid moves");
    for (a, b) in springs.iter().zip(&trusses) {
        assert!((a.x - b.x).length() < 1e-9, "{} {}", a.x, b.x);
    }
}

#[test]
fn the_program_lists_what_scenes_may_name() {
    let bench = Bench::new();
    let text = bench.expect(0, &["plugins"]).out;
    for line in [
        "elements",
        "  truss                two-node bar: axial force under large displacements, no bending",
        "settings",
        "  mandrel              the rigid bar inside a braid",
        "probes",
        "  Reaction             force with which the support holds a node",
        "measures",
        "  angle                braid angle at the crossings, in degrees, with a 95 % interval",
        "amplitudes",
        "  Ramp                 from 0 to 1 in a straight line",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
    let list: serde_json::Value = serde_json::from_str(&bench.expect(0, &["plugins", "--json"]).out).expect("JSON");
    let names = |group: &str| -> Vec<&str> {
        let of = |e: &&serde_json::Value| e["group"] == group;
        list.as_array().expect("a list").iter().filter(of).map(|e| e["name"].as_str().expect("a name")).collect()
    };
    assert_eq!(names("element"), ["truss", "beam", "bending"]);
    assert_eq!(names("settings"), ["contact", "surfaces", "mandrel"]);
    assert_eq!(names("measure"), ["length", "angle", "thickness"]);
    // The plugins of another binary are listed with the rest.
    let catalog = Simulation::new(all).registry.catalog();
    for name in ["lab.spring", "lab.plastic_truss", "lab.slip_beam", "lab.drag", "lab.stretch", "lab.gyration", "lab.pulse", "lab.coil"] {
        assert_eq!(catalog.iter().filter(|e| e.name == name).count(), 1, "{name}");
    }
}
