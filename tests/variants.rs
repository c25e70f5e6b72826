//! Scenes at rest with other numbers: sizes from micrometres to kilometres, other stiffnesses, masses and loads, and nothing else changed. With
//! `damping: Adaptive` and `stop: (steady: ())` no time of the problem is given: rate, interval and end follow from the motion.
use braid_ecs::prelude::*;
use braid_ecs::run::Status;
use braid_ecs::scene::load_text;
use braid_ecs::systems::adaptive_damping::NaturalTime;
use braid_ecs::systems::default_plugins;
use braid_ecs::verify::verify;

/// How a scene comes to rest.
const REST: &str = "damping: Adaptive, stop: (steady: (change: 1e-7))";

/// What a scene expects and does not give.
fn holds(name: &str, text: &str) {
    let sim = Simulation::new(default_plugins);
    let loaded = load_text(name, format!("({text}, {REST})"), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    let outcome = verify(&loaded, sim).unwrap_or_else(|e| panic!("{name}: {e}"));
    for row in &outcome.rows {
        assert!(row.holds(), "{name}: {} is {:?} instead of {} +- {}", row.name, row.found, row.expected, row.allowed);
    }
    println!("{name}: {} steps", outcome.steps);
}

/// A cantilever under a dead load of EI / L^2 and of 10 EI / L^2 (K. E. Bisshopp and D. C. Drucker 1945).
#[test]
fn cantilevers_of_any_size_follow_the_elastica() {
    // Length, radius, Young's modulus, density.
    let rods = [
        ("a fibre of 0.3 mm", 3e-4, 2.5e-6, 72e9, 2580.0),
        ("a rod of 2 m", 2.0, 5e-3, 210e9, 7850.0),
        ("a mast of 1 km", 1e3, 1.5, 30e9, 2500.0),
        ("a soft heavy thread", 0.1, 1e-3, 1e6, 1e5),
    ];
    for (name, length, radius, young, density) in rods {
        let ei = young * std::f64::consts::PI / 4.0 * f64::powi(radius, 4);
        let force = ei / (length * length);
        let one = [0.056433236283, 0.3017207738];
        let ten = [0.55499559775, 0.81060902488];
        let expected = |k: &str, [u, w]: [f64; 2]| {
            format!(
                "\"u{k}\": (value: {:?}, rel: 0.002, source: \"elastica\"), \"w{k}\": (value: {:?}, rel: 0.002, source: \"elastica\"),",
                -u * length,
                w * length
            )
        };
        let rod = |k: &str, z: f64| {
            format!(
                "(name: \"{k}\", points: [[0, 0, {z:?}], [{length:?}, 0, {z:?}]], subdivisions: 20, radius: {radius:?}, material: \"m\", start: Clamped),"
            )
        };
        let load = |k: &str, f: f64| format!("(nodes: [\"{k}.0.end\"], force: [0, {f:?}, 0]),");
        let probe = |k: &str| {
            format!("\"u{k}\": Displacement(node: \"{k}.0.end\", component: X), \"w{k}\": Displacement(node: \"{k}.0.end\", component: Y),")
        };
        holds(
            name,
            &format!(
                "units: Si, materials: {{ \"m\": (young: {young:?}, poisson: 0.3, density: {density:?}) }}, polylines: [{}{}],
                loads: [{}{}], probes: {{ {}{} }}, expect: {{ {}{} }}",
                rod("one", 0.0),
                rod("ten", length),
                load("one", force),
                load("ten", 10.0 * force),
                probe("one"),
                probe("ten"),
                expected("one", one),
                expected("ten", ten)
            ),
        );
    }
}

/// Elastic catenaries between level supports: l / 2 = H L / 2 EA + (H / w) asinh(w L / 2 H) gives the pull H.
#[test]
fn cables_of_any_size_follow_the_catenary() {
    // Unstretched length, weight per length, EA, span.
    for (name, length, weight, ea, span) in
        [("a taut wire", 101.0, 5.0, 2e5, 100.0), ("a thread", 1.3, 0.02, 50.0, 1.0), ("a bridge", 2000.0, 5e4, 1e11, 1500.0)]
    {
        let half = |h: f64| h * length / (2.0 * ea) + h / weight * (weight * length / (2.0 * h)).asinh();
        let (mut low, mut high) = (1e-9 * weight * length, 1e3 * weight * length);
        for _ in 0..200 {
            let mid = f64::sqrt(low * high);
            if half(mid) < 0.5 * span { low = mid } else { high = mid }
        }
        let (pull, v) = (low, 0.5 * weight * length);
        let sag = weight * length * length / (8.0 * ea) + (pull.hypot(v) - pull) / weight;
        // It starts as a V of its unstretched length, and falls.
        let deep = (0.25 * (length * length - span * span)).sqrt();
        let mass = weight / 9.81;
        holds(
            name,
            &format!(
                "units: Consistent, sections: {{ \"s\": Stiffness(ea: {ea:?}, mass: {mass:?}) }}, nodes: [{}], elements: {{ \"truss\": [(nodes: [{}], section: \"s\")] }},
                fixed: [(nodes: [0, 40], dofs: [U])], gravity: (acceleration: [0, -9.81, 0]),
                probes: {{ \"pull\": Reaction(node: 40, component: X), \"weight\": Reaction(node: 0, component: Y), \"sag\": Position(node: 20, component: Y) }},
                expect: {{ \"pull\": (value: {pull:?}, rel: 0.001, source: \"catenary\"), \"weight\": (value: {v:?}, rel: 0.001, source: \"catenary\"),
                    \"sag\": (value: {:?}, rel: 0.001, source: \"catenary\") }}",
                (0..=40)
                    .map(|i| {
                        let s = f64::from(i) / 40.0;
                        format!("[{:?}, {:?}, 0],", s * span, -deep * (1.0 - (2.0 * s - 1.0).abs()))
                    })
                    .collect::<String>(),
                (0..=40).map(|i| format!("{i},")).collect::<String>(),
                -sag
            ),
        );
    }
}

/// Two crossed rods pressed together until each half is an elastica with (F / 2) (L / 2)^2 = EI; the contact is as stiff as its target asks for.
#[test]
fn crossed_rods_of_any_size_feel_the_same() {
    for (name, length, ei, radius, rise) in [("rods of 1 mm", 1e-3, 1e-9, 5e-6, 0.01), ("rods of 25 m", 25.0, 400.0, 0.05, 20.0)] {
        let (half, young) = (0.5 * length, 4.0 * ei / (std::f64::consts::PI * f64::powi(radius, 4)));
        let (force, closing, pull) = (2.0 * ei / (half * half), 2.0 * 0.3017207738 * half, 0.056433236283 * half);
        let density = 1.0 / (std::f64::consts::PI * radius * radius);
        holds(
            name,
            &format!(
                "units: Consistent, materials: {{ \"m\": (young: {young:?}, poisson: 0.3, density: {density:?}) }},
                polylines: [(name: \"a\", points: [[{:?}, 0, 0], [{half:?}, 0, 0]], subdivisions: 20, radius: {radius:?}, material: \"m\"),
                    (name: \"b\", points: [[0, {:?}, {:?}], [0, {half:?}, {:?}]], subdivisions: 20, radius: {radius:?}, material: \"m\")],
                fixed: [(nodes: [\"a\"], dofs: [Uy, Rx, Rz]), (nodes: [\"b\"], dofs: [Ux, Ry, Rz]), (nodes: [\"a.0[10]\"], dofs: [Ux]),
                    (nodes: [\"b.0[10]\"], dofs: [Uy]), (nodes: [\"a.0.start\", \"a.0.end\"], dofs: [Uz])],
                prescribed: [(nodes: [\"b.0.start\", \"b.0.end\"], uz: {:?}, amplitude: \"close\")],
                amplitudes: {{ \"close\": SmoothStep(rise: {rise:?}) }}, contact: (friction: 0, penetration: (target: 0.0002, slower: 8)),
                probes: {{ \"force\": ContactForce, \"pull\": Displacement(node: \"a.0.start\", component: X) }},
                expect: {{ \"force\": (value: {force:?}, rel: 0.005, source: \"elastica\"), \"pull\": (value: {pull:?}, rel: 0.005, source: \"elastica\") }}",
                -half,
                -half,
                2.0 * radius,
                2.0 * radius,
                -closing
            ),
        );
    }
}

/// Two masses on springs that a linear equation couples, u2 = r u1: u1 = r F / (k1 + r^2 k2).
#[test]
fn levers_of_any_ratio_come_to_rest() {
    for (m1, m2, k1, k2, r, f) in
        [(1.0, 2.0, 50.0, 10.0, -1.5, 3.0), (3.0, 0.7, 120.0, 35.0, -2.2, 1.7), (300.0, 70.0, 1e5, 35e3, 0.4, 17.0)]
    {
        let u1 = r * f / (k1 + r * r * k2);
        holds(
            "lever",
            &format!(
                "units: Consistent, sections: {{ \"a\": Stiffness(ea: {k1:?}, mass: 1e-3), \"b\": Stiffness(ea: {k2:?}, mass: 1e-3) }},
                nodes: [[0, 0, 0], [1, 0, 0], [3, 0, 0], [4, 0, 0]],
                elements: {{ \"truss\": [(nodes: [0, 1], section: \"a\"), (nodes: [2, 3], section: \"b\")] }},
                node_masses: [(nodes: [1], mass: {m1:?}), (nodes: [2], mass: {m2:?})],
                fixed: [(nodes: [0, 3], dofs: [U]), (nodes: [1, 2], dofs: [Uy, Uz])],
                equations: [(terms: [(1, 2, Ux), ({:?}, 1, Ux)])], loads: [(nodes: [2], force: [{f:?}, 0, 0])],
                probes: {{ \"u1\": Displacement(node: 1, component: X) }}, expect: {{ \"u1\": (value: {u1:?}, rel: 1e-6, source: \"statics\") }}",
                -r
            ),
        );
    }
}

/// The time that is found is that of the slowest mode, the rate 1.4 times its frequency, and a run waits for its loads.
#[test]
fn the_natural_time_is_that_of_the_slowest_mode() {
    let text = |more: &str| {
        format!(
            "(units: Consistent, sections: {{ \"s\": Stiffness(ea: 1e6, ei: 1, gj: 1, mass: 1) }},
            nodes: [[0, 0, 0], [0.125, 0, 0], [0.25, 0, 0], [0.375, 0, 0], [0.5, 0, 0], [0.625, 0, 0], [0.75, 0, 0], [0.875, 0, 0], [1, 0, 0]],
            elements: {{ \"beam\": [(nodes: [0, 1, 2, 3, 4, 5, 6, 7, 8], section: \"s\")] }}, fixed: [(nodes: [0], dofs: [All])],
            loads: [(nodes: [8], force: [0, 0.03, 0], amplitude: \"up\")], {more}, {REST})"
        )
    };
    let ended = |more: &str| {
        let mut sim = Simulation::new(default_plugins);
        let loaded = load_text("a.ron", text(more), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
        sim.build(&loaded.model).expect("a sound model");
        let status = braid_ecs::run::run(&mut sim, &loaded.model, f64::INFINITY, &mut braid_ecs::run::Blind).expect("it comes to rest");
        assert_eq!(status, Status::Converged);
        sim
    };
    let sim = ended("amplitudes: { \"up\": Constant }");
    let found = sim.world.resource::<NaturalTime>().found.expect("it has moved");
    // 3.516 sqrt(EI / m L^4); the lumped mass of the tip lowers it by 1 to 2 %.
    assert!((found * 3.516 - 1.0).abs() < 0.05, "1 / {} instead of 1 / 3.516", 1.0 / found);
    let late = ended("amplitudes: { \"up\": Table([(0, 0), (40, 0), (41, 1)]) }");
    assert!(late.world.resource::<Clock>().time > 41.0, "it has not waited for its load");
}
