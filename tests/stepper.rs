//! The prompt of debug builds: it moves in time as a run does, and shows what is stored.
#![cfg(debug_assertions)]
#[path = "support/program.rs"]
mod program;
use braid_ecs::output::summary::state_hash;
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::stepper::{Reply, Session, run_script};
use braid_ecs::systems::default_plugins;
use program::{Bench, done};
use std::io::{Read, Write};
use std::path::Path;
use std::process::Stdio;

#[path = "../examples/lab_fault.rs"]
mod lab_fault;
#[path = "../examples/lab_plastic_truss.rs"]
mod lab_plastic_truss;
#[path = "../examples/lab_spring.rs"]
mod lab_spring;

/// All first-party systems and the plugins of this file.
fn all(sim: &mut Simulation) {
    default_plugins(sim);
    lab_fault::plugin(sim);
    lab_plastic_truss::plugin(sim);
    lab_spring::plugin(sim);
}

fn session_of(name: &str, text: String) -> Session {
    let sim = Simulation::new(all);
    let loaded = scene::load_text(name, text, &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    Session::new(sim, loaded, std::sync::Arc::default()).unwrap_or_else(|e| panic!("{}", e.1))
}

fn example(name: &str) -> Session {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes").join(format!("{name}.ron"));
    session_of(name, std::fs::read_to_string(path).expect("a scene of the examples"))
}

/// What the session says to a command.
fn say(session: &mut Session, line: &str) -> String {
    match session.execute(line) {
        Ok(Reply::Text(text)) => text,
        Ok(Reply::Quit) => "quit".into(),
        Err(e) => panic!("{line}: {e} {:?}", e.help),
    }
}

/// What the session says to a command that it refuses.
fn refused(session: &mut Session, line: &str) -> String {
    match session.execute(line) {
        Ok(reply) => panic!("{line} was done: {reply:?}"),
        Err(e) => format!("{e}; {}", e.help.as_deref().unwrap_or_default()),
    }
}

/// A little braid on its mandrel: contact, friction, ties, a periodic cell, implicit axial forces.
const BRAID: &str = r#"(
    units: MmNTonne,
    materials: { "glass": (young: "72 GPa", poisson: 0.23, density: "2.58 g/cm3") },
    braid: (tows: 4, angle: "55 deg", radius: "1 mm"),
    tow: (material: "glass", filament_radius: "10 um", filaments: 3, elements: 12, model: Embedded),
    contact: (friction: 0.2),
    load: (force: "1 mN", stroke: "0.5 mm"),
    stop: (steps: 500),
)"#;

/// The fingerprint after a run of the same scene with samples of its own.
fn hash_of_run(text: &str, steps: u64) -> String {
    let mut sim = Simulation::new(all);
    let mut model = scene::load_text("braid.ron", text.into(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}")).model;
    model.stop.steps = Some(steps);
    sim.build(&model).expect("a sound model");
    let dt = model.integration.dt.unwrap_or(1e-6);
    run::run(&mut sim, &model, 7.5 * dt, &mut run::Blind).expect("a stable run");
    state_hash(&mut sim.world)
}

#[test]
fn the_walk_through_finds_the_planted_fault() {
    let script = include_str!("../examples/scripts/find_fault.txt");
    let mut out = Vec::new();
    run_script(&mut example("lab_fault"), "find_fault.txt", script.as_bytes(), &mut out).unwrap_or_else(|e| panic!("{e}"));
    let transcript = String::from_utf8(out).expect("text");
    let page = include_str!("../src/stepper/README.md");
    let told = page.split("```console\n").nth(1).and_then(|t| t.split("```").next()).expect("the page has the transcript");
    assert_eq!(transcript, told, "\n{transcript}");
}

#[test]
fn steps_systems_and_the_way_back_give_the_bits_of_a_run() {
    let expected = hash_of_run(BRAID, 80);
    let mut session = session_of("braid.ron", BRAID.into());
    assert_eq!(say(&mut session, "step 80"), "");
    assert_eq!(say(&mut session, "hash"), expected);
    say(&mut session, "save there");
    // On, back by way of a saved state, and the last steps system by system.
    say(&mut session, "step 45");
    assert_ne!(say(&mut session, "hash"), expected);
    say(&mut session, "back 50");
    let systems = session.systems().len();
    say(&mut session, &format!("sys {}", 4 * systems + 3));
    assert!(session.prompt().contains("step 80 ") && !session.prompt().contains("advance_clock"), "{}", session.prompt());
    say(&mut session, "finish");
    assert_eq!(say(&mut session, "hash"), expected);
    assert!(say(&mut session, "diff there").starts_with("the same bits"));
    // From within a step to its beginning, and on again.
    for systems in [1, 5, systems - 1] {
        say(&mut session, &format!("sys {systems}"));
        say(&mut session, "back");
        assert_eq!(say(&mut session, "hash"), expected);
    }
    say(&mut session, "sys 5");
    say(&mut session, "back");
    assert_eq!(say(&mut session, "hash"), expected);
    say(&mut session, "back 80");
    say(&mut session, "continue until step=80");
    assert_eq!(say(&mut session, "hash"), expected);
    say(&mut session, "step");
    let differs = say(&mut session, "diff there");
    assert!(differs.contains("Position ") && differs.contains(" differ, first number "), "{differs}");
    say(&mut session, "restore there");
    assert_eq!(say(&mut session, "hash"), expected);
}

#[test]
fn looking_changes_nothing() {
    let mut session = session_of("braid.ron", BRAID.into());
    say(&mut session, "step 70");
    say(&mut session, "save before");
    for line in [
        "info time",
        "info dt",
        "info energy",
        "info systems",
        "info breaks",
        "info contacts",
        "info mesh",
        "info stored",
        "info memory",
        "print tow 1 fil 2 node 3",
        "print element 0",
        "print tie 0",
        "print dummy 0",
        "print EnergyLedger",
        "print Tension 0",
        "print Clock",
        "print kinetic",
        "top 3 speed",
        "top 3 force",
        "top 3 penetration",
        "top 3 strain",
        "top 3 curvature",
        "list near tow 0 fil 0 node 2",
        "watch penetration",
        "break if contacts > 1000",
        "help",
        "help print",
        "hash",
    ] {
        assert!(!say(&mut session, line).is_empty(), "{line}");
    }
    say(&mut session, "delete");
    let said = say(&mut session, "diff before");
    assert!(said.starts_with("the same bits"), "{said}");
}

#[test]
fn looking_at_contacts_that_carry_forces_changes_nothing_either() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/verification/CF07_crossed_rods_small.ron");
    let text = std::fs::read_to_string(path).expect("a verification scene");
    let (mut looked, mut blind) = (session_of("rods", text.clone()), session_of("rods", text));
    say(&mut looked, "watch contact_force by 1e9");
    say(&mut looked, "break if penetration > 1e9");
    for _ in 0..4 {
        say(&mut looked, "step 250");
        say(&mut blind, "step 250");
        for line in ["info contacts", "info energy", "print contact 0", "top 1 penetration", "list near node 1", "hash"] {
            assert!(!say(&mut looked, line).is_empty(), "{line}");
        }
        assert_eq!(say(&mut looked, "hash"), say(&mut blind, "hash"));
    }
    let touching = say(&mut looked, "print contacts > 0 && contact_force > 0");
    assert!(touching.ends_with(" = 1"), "{touching}");
}

#[test]
fn components_and_resources_are_shown_by_name_with_units() {
    let mut session = example("lab_spring");
    let spring = say(&mut session, "print element lab.spring 0");
    // The plugin has told nothing of its units; the engine knows those of nodes.
    for line in ["element lab.spring 0", "  Spring.rest_length  1", "  Spring.stiffness    100", "  Connectivity<2>     [0, 1]"] {
        assert!(spring.lines().any(|l| l.trim_end() == line), "{line}\n{spring}");
    }
    let node = say(&mut session, "print node 1");
    for part in
        ["Position         (1, 0, 0) m\n", "Force            (20, 0, 0) N\n", "Mass             1 kg\n", "InverseMass      (1, 0, 0) 1/kg"]
    {
        assert!(node.contains(part), "{part}\n{node}");
    }
    let clock = say(&mut session, "print Clock");
    assert!(clock.lines().any(|l| l.starts_with("  Clock.dt_next ") && l.ends_with(" s")), "{clock}");
    let stored = say(&mut session, "info stored");
    let listed = |name: &str, what: &str| stored.lines().any(|l| l.starts_with(&format!("  {name} ")) && l.ends_with(what));
    assert!(listed("Spring", "component, 1") && listed("Position", "component, 2") && listed("EnergyLedger", "resource"), "{stored}");
    // The same entity, found by its component.
    let found = say(&mut session, "print Spring 0");
    assert_eq!(found.lines().skip(1).collect::<Vec<_>>(), spring.lines().skip(1).collect::<Vec<_>>());
}

#[test]
fn values_of_expressions_are_those_of_the_scene() {
    let mut session = example("lab_spring");
    say(&mut session, "continue");
    assert!(session.prompt().contains("t 2"), "{}", session.prompt());
    let value = |session: &mut Session, text: &str| -> f64 {
        let said = say(session, &format!("print {text}"));
        said.rsplit(" = ").next().and_then(|v| v.split(' ').next()).and_then(|v| v.parse().ok()).unwrap_or_else(|| panic!("{said}"))
    };
    // The known answers of the scene, by its probes and in other ways.
    assert!((value(&mut session, "{elongation}") - 0.1).abs() < 1e-6);
    assert!((value(&mut session, "{node 1 x.x} - 1") - 0.1).abs() < 1e-6);
    assert!((value(&mut session, "{Displacement(node: 1, component: X)}") - 0.1).abs() < 1e-6);
    assert!((value(&mut session, "strain") - 0.75).abs() < 1e-5);
    assert!((value(&mut session, "{element 0 EndForces[1].force.x}") - 20.0).abs() < 1e-4);
    assert_eq!(value(&mut session, "{element 0 stiffness} == 100 && speed < 1e-3"), 1.0);
    assert!(say(&mut session, "print {elongation}").ends_with(" m"), "a single quantity has its unit");
}

#[test]
fn a_run_stops_where_it_is_told_to() {
    let mut session = example("lab_spring");
    assert_eq!(say(&mut session, "break kick_velocities"), "stop 1: before kick_velocities");
    assert_eq!(say(&mut session, "break t = 10 ms"), "stop 2: t = 0.01");
    assert_eq!(say(&mut session, "break if {elongation} > 0.05"), "stop 3: if {elongation} > 0.05");
    assert_eq!(say(&mut session, "continue"), "stop 1: before kick_velocities");
    assert!(session.prompt().ends_with("next kick_velocities > "), "{}", session.prompt());
    assert_eq!(say(&mut session, "finish"), "");
    assert_eq!(say(&mut session, "step"), "stop 1: before kick_velocities");
    say(&mut session, "delete 1");
    assert!(say(&mut session, "continue").starts_with("stop 2: t = 0.01"));
    let said = say(&mut session, "continue");
    assert_eq!(said, "stop 3: {elongation} > 0.05");
    assert!(say(&mut session, "print {elongation}").contains("= 0.05"));
    // It came true in this very step, and does so again after the way back.
    say(&mut session, "back 2");
    assert_eq!(say(&mut session, "step"), "");
    assert_eq!(say(&mut session, "step"), said);
    say(&mut session, "delete");
    assert_eq!(say(&mut session, "info breaks"), "none");
    let watch = say(&mut session, "watch {element 0 taken} by 1");
    assert!(watch.starts_with("stop 1: watch {element 0 taken} by 1, now "), "{watch}");
    // Nothing stops the run of the scene but its end.
    assert_eq!(say(&mut session, "continue"), "the run of the scene ends here: completed");
}

#[test]
fn what_is_set_marks_the_run_and_is_undone_by_going_back() {
    let mut session = example("lab_spring");
    say(&mut session, "step 10");
    let before = say(&mut session, "hash");
    assert_eq!(say(&mut session, "set node 1 Velocity.x 3.5"), "Velocity.x: 0.1995262 -> 3.5".replace("0.1995262", &first(&mut session)));
    assert!(session.prompt().contains("(modified)"), "{}", session.prompt());
    assert_eq!(say(&mut session, "print {node 1 v.x}"), "{node 1 v.x} = 3.5 m/s");
    say(&mut session, "set element 0 stiffness 250.0");
    assert_eq!(say(&mut session, "print {element 0 stiffness}"), "{element 0 stiffness} = 250");
    say(&mut session, "step 3");
    say(&mut session, "back 3");
    assert_eq!(say(&mut session, "print {element 0 stiffness}"), "{element 0 stiffness} = 250", "the change belongs to step 10");
    say(&mut session, "back");
    assert!(!session.prompt().contains("(modified)"), "{}", session.prompt());
    say(&mut session, "step");
    assert_eq!(say(&mut session, "hash"), before, "before the change the run is that of the scene");
    assert!(refused(&mut session, "set node 1 Mass 2").contains("follows from the scene"));
    assert!(refused(&mut session, "set node 1 Velocty.x 2").contains("did you mean `Velocity`?"));
    say(&mut session, "sys");
    assert!(refused(&mut session, "set Clock.time 0.0").contains("only between two steps"));
}

/// The velocity that the scene has at step 10, as the prompt writes it.
fn first(_: &mut Session) -> String {
    let mut other = example("lab_spring");
    say(&mut other, "step 10");
    say(&mut other, "print {node 1 v.x}").trim_start_matches("{node 1 v.x} = ").trim_end_matches(" m/s").to_string()
}

#[test]
fn what_is_misspelt_is_named_with_the_nearest_names() {
    let mut session = example("lab_spring");
    let near = |session: &mut Session, line: &str, word: &str| {
        let said = refused(session, line);
        assert!(said.contains(&format!("did you mean `{word}`?")), "{line}: {said}");
    };
    near(&mut session, "stpe 3", "step");
    near(&mut session, "break kick_velocites", "kick_velocities");
    near(&mut session, "info enregy", "energy");
    near(&mut session, "break if kinetc > 2", "kinetic");
    near(&mut session, "print element lab.sprnig 0", "lab.spring");
    near(&mut session, "print Clok", "Clock");
    near(&mut session, "top 3 sped", "speed");
    say(&mut session, "save here");
    near(&mut session, "restore her", "here");
}

#[test]
fn a_failed_run_can_be_looked_at_and_left_backwards() {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes/lab_fault.ron")).expect("a scene");
    let mut session = session_of("lab_fault", text.replace("stop: (time: 2)", "stop: (time: 2000)"));
    let said = say(&mut session, "continue");
    assert!(said.starts_with("failed in step ") && said.contains("node 0"), "{said}");
    assert!(refused(&mut session, "step").contains("`back` and `restore` go back"));
    assert!(!say(&mut session, "print node 0 x").is_empty());
    say(&mut session, "back 100");
    assert_eq!(say(&mut session, "step 20"), "");
}

#[test]
fn pictures_and_frames_are_written_and_nothing_is_overwritten() {
    let bench = Bench::new();
    let mut session = session_of("braid.ron", BRAID.into());
    let at = |name: &str| bench.path(name).display().to_string();
    assert!(refused(&mut session, &format!("plot {}", at("a.svg"))).contains("nothing is watched"));
    say(&mut session, "watch speed by 1e9");
    say(&mut session, "step 12");
    for (command, name) in [("plot", "a.svg"), ("render", "a.png"), ("frame", "a.vtp")] {
        say(&mut session, &format!("{command} {}", at(name)));
        assert!(std::fs::metadata(bench.path(name)).expect("written").len() > 500, "{name}");
        assert!(refused(&mut session, &format!("{command} {}", at(name))).contains("is there already"));
    }
    assert!(refused(&mut session, &format!("render {}", at("b.svg"))).contains(".png"));
}

#[test]
fn the_program_reads_scripts_and_pipes_and_names_the_place_of_an_error() {
    let bench = Bench::new();
    std::fs::write(bench.path("bar.ron"), BAR).expect("a file");
    std::fs::write(bench.path("good.txt"), "step 2\nprint step\n").expect("a file");
    std::fs::write(bench.path("bad.txt"), "step\n\nprnt step\n").expect("a file");
    let good = bench.expect(0, &["step", "bar.ron", "--script", "good.txt", "--threads", "1"]);
    assert!(good.out.starts_with("step 0  t 0 s  next advance_clock > step 2\nstep 2 "), "{}", good.out);
    assert!(good.out.contains("\nstep = 2\n"), "{}", good.out);
    let bad = bench.expect(2, &["step", "bar.ron", "--script", "bad.txt"]);
    assert!(bad.err.contains("bad.txt:3:1: unknown command `prnt`") && bad.err.contains("did you mean `print`?"), "{}", bad.err);
    bench.expect(4, &["step", "bar.ron", "--script", "none.txt"]);
    let mut child =
        bench.command(&["step", "bar.ron"]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    child.stdin.take().expect("a pipe").write_all(b"step 3\nprint step\nquit\n").expect("it reads");
    let piped = done(child);
    assert_eq!(piped.code, Some(0), "{}", piped.err);
    assert!(piped.out.contains("step = 3"), "{}", piped.out);
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_the_command_and_not_the_session() {
    let bench = Bench::new();
    std::fs::write(bench.path("bar.ron"), BAR).expect("a file");
    let mut child =
        bench.command(&["step", "bar.ron"]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    let mut input = child.stdin.take().expect("a pipe");
    input.write_all(b"continue\n").expect("it reads");
    // The prompt shows that the command has begun.
    let mut seen = [0; 10];
    child.stdout.as_mut().expect("a pipe").read_exact(&mut seen).expect("the prompt");
    let interrupt = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill is there");
    assert!(interrupt.success());
    input.write_all(b"print step > 0\nquit\n").expect("it still reads");
    drop(input);
    let done = done(child);
    assert_eq!(done.code, Some(0), "{}{}", done.out, done.err);
    assert!(done.out.contains("interrupted"), "{}", done.out);
}

/// A swinging bar that takes a very long time.
const BAR: &str = r#"(
    units: Si,
    sections: { "bar": Stiffness(ea: 1000, mass: 0.1) },
    nodes: [[0, 0, 0], [1, 0, 0]],
    elements: { "truss": [(nodes: [0, 1], section: "bar")] },
    fixed: [(nodes: [0], dofs: [U])],
    loads: [(nodes: [1], force: [1, 0, 0])],
    integration: (dt: "1 us"),
    stop: (time: 1e6),
)"#;
