//! Probes against statics: what a scene asks for by name is what the mechanics gives.
use braid_ecs::generate::*;
use braid_ecs::measure::*;
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Blind};
use braid_ecs::systems::default_plugins;
use std::collections::BTreeMap;

/// A bar or beam of length 4 along x, E = 1000, radius 0.1, clamped at the start.
fn cantilever(model: FilamentModel, force: DVec3, moment: DVec3) -> Model {
    let mut m = Model::new("cantilever");
    let materials = BTreeMap::from([("m".to_string(), Material { young: 1000.0, poisson: 0.25, density: 1.0 })]);
    let sections = BTreeMap::new();
    let spec = PolylineSpec {
        name: "arm".into(),
        model,
        start: EndCondition::Clamped,
        ..PolylineSpec::new(&[[0.0; 3], [4.0, 0.0, 0.0]], 4, 0.1, "m")
    };
    let registry = Simulation::new(default_plugins).registry;
    polyline(&spec, &registry, &mut Build { model: &mut m, materials: &materials, sections: &sections }).expect("valid");
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 2.0 });
    m.loads.push(NodalLoad { node: m.node_names["arm.0.end"], force, moment, follower: false, amplitude: ramp });
    m
}

fn at_rest(m: &mut Model, damping: f64, time: f64) -> Simulation {
    m.integration.damping = Damping::Mass(damping);
    m.stop.time = Some(time);
    let mut sim = Simulation::new(default_plugins);
    sim.build(m).expect("a sound model");
    run::run(&mut sim, m, f64::INFINITY, &mut Blind).expect("a stable run");
    sim
}

fn probe(text: &str, model: &Model, sim: &mut Simulation) -> f64 {
    let spec: ProbeSpec = braid_ecs::scene::ron_options().from_str(text).expect(text);
    spec.resolve(model, &sim.registry).expect(text).evaluate(&mut sim.world)
}

fn refused(text: &str, model: &Model) -> SpecError {
    let spec: ProbeSpec = braid_ecs::scene::ron_options().from_str(text).expect(text);
    spec.resolve(model, &Simulation::new(default_plugins).registry).expect_err(text)
}

#[test]
fn bar_in_tension() {
    let ea = 1000.0 * std::f64::consts::PI * 0.01;
    let mut m = cantilever(FilamentModel::Trusses, DVec3::X * 0.5, DVec3::ZERO);
    m.integration.dt = Some(0.02);
    let mut sim = at_rest(&mut m, 3.0, 30.0);
    let stretch = 4.0 * 0.5 / ea;
    let mut expect = |text: &str, value: f64, tolerance: f64| {
        let found = probe(text, &m, &mut sim);
        assert!((found - value).abs() <= tolerance, "{text}: {found} instead of {value}");
    };
    expect(r#"Displacement(node: "arm.0.end", component: X)"#, stretch, 1e-9);
    expect(r#"Displacement(node: 2)"#, 0.5 * stretch, 1e-9);
    expect(r#"Position(node: 4, component: X)"#, 4.0 + stretch, 1e-9);
    expect(r#"Reaction(node: "arm.0.start", component: X)"#, -0.5, 1e-7);
    expect(r#"Reaction(node: "arm.0.end")"#, 0.0, 0.0);
    expect(r#"TotalReaction(nodes: ["arm.*.start"], component: X)"#, -0.5, 1e-7);
    expect(r#"SectionForce(kind: "truss", element: 2, term: N)"#, 0.5, 1e-7);
    expect(r#"Distance(nodes: [1, 3])"#, 2.0 + 0.5 * stretch, 1e-9);
    expect(r#"Angle(from: [0, 2], to: [3, 1])"#, std::f64::consts::PI, 1e-7);
    expect(r#"Velocity(node: 4)"#, 0.0, 1e-8);
    expect(r#"Energy(Strain)"#, 0.5 * 0.5 * stretch, 1e-8);
    expect(r#"Energy(ExternalWork)"#, 0.5 * stretch, 0.5 * stretch);
    expect("TimeStep", 0.02, 1e-15);
    expect("ContactForce", 0.0, 0.0);
}

#[test]
fn beam_under_transverse_load_and_moment() {
    // Small loads: closed forms of the linear beam, with the square of the slope as the error.
    let ei = 1000.0 * std::f64::consts::FRAC_PI_4 * 1e-4;
    let (p, c) = (1e-5, 2e-5);
    let mut m = cantilever(FilamentModel::Beams, DVec3::Y * p, DVec3::Z * c);
    m.integration.axial = AxialScheme::Explicit;
    let mut sim = at_rest(&mut m, 1.0, 120.0);
    let mut expect = |text: &str, value: f64, tolerance: f64| {
        let found = probe(text, &m, &mut sim);
        assert!((found - value).abs() <= tolerance * value.abs(), "{text}: {found} instead of {value}");
    };
    let slope = p * 16.0 / (2.0 * ei) + c * 4.0 / ei;
    assert!(slope < 5e-3);
    expect(r#"Rotation(node: 4, component: Z)"#, slope, 1e-3);
    expect(r#"Rotation(node: 4)"#, slope, 1e-3);
    expect(r#"Reaction(node: 0, component: Y)"#, -p, 1e-3);
    expect(r#"ReactionMoment(node: 0, component: Z)"#, -(4.0 * p + c), 1e-3);
    expect(r#"TotalReactionMoment(nodes: [0], component: Z)"#, -(4.0 * p + c), 1e-3);
    expect(r#"SectionForce(kind: "beam", element: 0, term: M)"#, 4.0 * p + c, 1e-3);
    expect(r#"SectionForce(kind: "beam", element: 3, term: V)"#, p, 1e-3);
}

#[test]
fn largest_and_smallest_samples_are_kept() {
    let m = cantilever(FilamentModel::Trusses, DVec3::X, DVec3::ZERO);
    let registry = Simulation::new(default_plugins).registry;
    let of = |text: &str| {
        let spec: ProbeSpec = braid_ecs::scene::ron_options().from_str(text).expect(text);
        let reduce = spec.resolve(&m, &registry).expect(text).reduce();
        [3.0, 7.0, -1.0, 2.0].into_iter().fold(None, |before, x| Some(reduce.fold(before, x)))
    };
    assert_eq!(of("TimeStep"), Some(2.0));
    assert_eq!(of("Max(TimeStep)"), Some(7.0));
    assert_eq!(of("Min(TimeStep)"), Some(-1.0));
}

#[test]
fn what_does_not_exist_is_refused_with_the_choices() {
    let trusses = cantilever(FilamentModel::Trusses, DVec3::X, DVec3::ZERO);
    let error = refused(r#"Position(node: "arm.0.ende")"#, &trusses);
    assert_eq!(error.message, "unknown node `arm.0.ende`");
    assert!(error.help.expect("help").starts_with("did you mean `arm.0.end`?"));
    assert_eq!(refused("Displacement(node: 5)", &trusses).help.expect("help"), "the scene has 5 nodes, numbered from 0");
    assert_eq!(refused("Rotation(node: 1)", &trusses).message, "the nodes of this model have no rotations");
    assert_eq!(refused(r#"SectionForce(kind: "truss", element: 4, term: N)"#, &trusses).path, "element");
    assert_eq!(refused(r#"SectionForce(kind: "tress", element: 0, term: N)"#, &trusses).path, "kind");
    assert_eq!(refused("DummyLength(node: 0)", &trusses).path, "node");
    assert_eq!(refused("Distance(nodes: [0, 1, 2])", &trusses).message, "two nodes are needed, 3 given");
    assert_eq!(refused(r#"TotalReaction(nodes: [0, "leg.*"])"#, &trusses).path, "nodes[1]");
    assert!(braid_ecs::scene::ron_options().from_str::<ProbeSpec>(r#"Position(knoten: 1)"#).is_err());
}

/// A free beam flies and turns: its momentum and moment of momentum stay, and a direction in its cross-section turns with it.
#[test]
fn momentum_and_direction_of_a_flying_beam() {
    let mut m = cantilever(FilamentModel::Beams, DVec3::ZERO, DVec3::ZERO);
    m.fixed.clear();
    let (spin, speed) = (0.2, DVec3::new(1.0, 2.0, 3.0));
    for n in &mut m.nodes {
        n.velocity = speed + DVec3::Z.cross(n.position - DVec3::X * 2.0) * spin;
        n.angular_velocity = DVec3::Z * spin;
    }
    let mut sim = Simulation::new(default_plugins);
    sim.build(&m).expect("a sound model");
    run::start(&mut sim, &m).expect("a stable step");
    let angular = r#"AngularMomentum(component: Z)"#;
    let (momentum, turning) = (probe("Momentum()", &m, &mut sim), probe(angular, &m, &mut sim));
    let mass = 4.0 * std::f64::consts::PI * 0.01;
    assert!((momentum / (mass * speed.length()) - 1.0).abs() < 1e-9, "{momentum}");
    // About the origin: that of the middle of mass, x cross v, and of the turning about it. Five lumps of m/8, m/4 ... at 2, 1 ... have 3/2 m,
    // and their scaled rotary inertia, mass times the square of the element length, has m.
    let own = turning - mass * 2.0 * speed.y;
    assert!((own / (2.5 * mass * spin) - 1.0).abs() < 1e-9, "{own}");
    for _ in 0..2000 {
        run::step(&mut sim).expect("stable");
    }
    let time = sim.world.resource::<Clock>().time;
    assert!((probe("Momentum()", &m, &mut sim) / momentum - 1.0).abs() < 1e-9);
    let kept = probe(angular, &m, &mut sim) / turning - 1.0;
    assert!(kept.abs() < 1e-6, "{kept:e}");
    let x = probe("Direction(node: 2, axis: [2, 0, 0], component: X)", &m, &mut sim);
    assert!((x - (spin * time).cos()).abs() < 1e-3, "{x} at {time}");
    assert_eq!(refused("Direction(node: 2, axis: [0, 0, 0], component: X)", &m).path, "axis");
}

#[test]
fn what_is_measured_has_a_unit() {
    let m = cantilever(FilamentModel::Beams, DVec3::X, DVec3::ZERO);
    let registry = Simulation::new(default_plugins).registry;
    for (text, quantity) in [
        ("Rotation(node: 1)", Quantity::Angle),
        ("ReactionMoment(node: 0)", Quantity::Moment),
        (r#"SectionForce(kind: "beam", element: 0, term: V)"#, Quantity::Force),
        (r#"SectionForce(kind: "beam", element: 0, term: T)"#, Quantity::Moment),
        ("Energy(Friction)", Quantity::Energy),
        ("Max(Velocity(node: 1))", Quantity::Velocity),
        ("MaxPenetration", Quantity::Number),
        ("Momentum(component: X)", Quantity::Momentum),
        ("AngularMomentum()", Quantity::AngularMomentum),
        ("Distance(nodes: [0, 1])", Quantity::Length),
    ] {
        let spec: ProbeSpec = braid_ecs::scene::ron_options().from_str(text).expect(text);
        assert_eq!(spec.resolve(&m, &registry).expect(text).quantity(), quantity, "{text}");
    }
}
