//! Contacts and constraints at their edges, and rules that no model may break.
use super::{ended, ledger, load, started, states};
use braid_ecs::prelude::*;
use braid_ecs::run;

/// A filament slides along a floor that it touches without weight, at exactly its radius: no normal force, no friction, no
/// division by it; the filament keeps its speed.
#[test]
fn no_friction_without_a_normal_force() {
    let mut sim = ended(
        "sections: { \"s\": Stiffness(ea: 100, mass: 1) }, nodes: [[0, 0, 0.1], [1, 0, 0.1]],
        elements: { \"truss\": [(nodes: [0, 1], section: \"s\")] }, filaments: [(nodes: [0, 1], radius: 0.1)],
        surfaces: [(name: \"floor\", shape: Plane, friction: 0.5)], initial_velocity: [(nodes: [0, 1], velocity: [0.3, 0.4, 0])],
        integration: (axial: Explicit, dt: 0.001), stop: (steps: 2000)",
    );
    let e = ledger(&mut sim);
    for s in states(&mut sim) {
        // The bar between the nodes feels the rounding of their places.
        assert!((s.v - DVec3::new(0.3, 0.4, 0.0)).length() < 1e-12, "{}", s.v);
    }
    assert_eq!((e.friction, e.contact), (0.0, 0.0));
}

/// Two filaments 1e5 radii apart fly past each other: cells of the neighbour search are of the size of a filament, and still nothing is
/// found, nor slow, nor out of memory.
#[test]
fn a_gap_of_1e5_radii_is_no_contact() {
    let mut sim = ended(
        "sections: { \"s\": Stiffness(ea: 1, mass: 1) }, nodes: [[0, 0, 0], [1e-2, 0, 0], [0, 0, 1], [0, 1e-2, 1]],
        elements: { \"truss\": [(nodes: [0, 1], section: \"s\"), (nodes: [2, 3], section: \"s\")] },
        filaments: [(nodes: [0, 1], radius: 1e-5), (nodes: [2, 3], radius: 1e-5)], contact: (friction: 0.3),
        initial_velocity: [(nodes: [0, 1], velocity: [1, 0, 0])], integration: (axial: Explicit), stop: (time: 1)",
    );
    let e = ledger(&mut sim);
    let (s, time) = (states(&mut sim), sim.world.resource::<Clock>().time);
    assert_eq!((e.contact, e.friction), (0.0, 0.0));
    assert!((s[0].x.x - time).abs() < 1e-9 && s[2].x == DVec3::new(0.0, 0.0, 1.0), "{} {}", s[0].x, s[2].x);
}

/// Three parallel filaments are pressed together evenly, each by the two others: forces are in balance, and
/// the triangle stays even. No pair is preferred by the order in which contacts are summed.
#[test]
fn three_filaments_in_contact_share_the_force() {
    let (r, n) = (0.1, 3);
    let place = |i: usize, d: f64| {
        let a = std::f64::consts::TAU * i as f64 / n as f64;
        (d * a.cos(), d * a.sin())
    };
    let d = 2.0 * r / 3f64.sqrt() * 1.001;
    let nodes: String = (0..n).map(|i| place(i, d)).map(|(x, y)| format!("[{x:?}, {y:?}, 0], [{x:?}, {y:?}, 1],")).collect();
    let list = |f: fn(usize) -> String| (0..3).map(f).collect::<String>();
    let bars = list(|i| format!("(nodes: [{}, {}], section: \"s\"),", 2 * i, 2 * i + 1));
    let lines = list(|i| format!("(nodes: [{}, {}], radius: 0.1),", 2 * i, 2 * i + 1));
    let loads: String = (0..n)
        .map(|i| (i, place(i, -1.0)))
        .map(|(i, (x, y))| format!("(nodes: [{}, {}], force: [{x:?}, {y:?}, 0], amplitude: \"up\"),", 2 * i, 2 * i + 1))
        .collect();
    let mut sim = ended(&format!(
        "sections: {{ \"s\": Stiffness(ea: 100, mass: 1) }}, nodes: [{nodes}], elements: {{ \"truss\": [{bars}] }}, filaments: [{lines}],
        contact: (friction: 0.3, line_stiffness: 1e4), loads: [{loads}], amplitudes: {{ \"up\": SmoothStep(rise: 0.5) }},
        damping: Mass(20), integration: (axial: Explicit), stop: (time: 3)"
    ));
    sim.refresh_energies();
    let total = sim.world.resource::<ContactSummary>().total_force;
    let s = states(&mut sim);
    let side = |i: usize, j: usize| (s[2 * i].x - s[2 * j].x).length();
    let sides = [side(0, 1), side(1, 2), side(2, 0)];
    // Each filament feels 2 from outside, and from each neighbour 2 / sqrt(3): three such forces in all.
    println!("three filaments: forces add up to {total:.6}, sides {sides:?}");
    assert!((total / (6.0 / 3f64.sqrt()) - 1.0).abs() < 1e-3, "{total}");
    assert!(sides.iter().all(|a| (a - sides[0]).abs() < 1e-9 && *a < 0.2), "{sides:?}");
}

/// Position of the end of a mass that falls on a chain of ties of so many nodes, the mass at the far one.
fn tied(count: usize, light: f64, heavy: f64) -> DVec3 {
    // Node 0 is held; node 1 ends the bar; node 2 is tied to 1, node 3 to 2, ... and the last one is heavy.
    let nodes = format!("[0, 0, 0], {}", "[1, 0, 0],".repeat(count));
    let ties: String = (2..=count).map(|i| format!("(embedded: {i}, host: {}),", i - 1)).collect();
    let mut sim = ended(&format!(
        "sections: {{ \"s\": Stiffness(ea: 100, mass: {:?}) }}, nodes: [{nodes}], node_masses: [(nodes: [0, {count}], mass: {heavy:?})],
        elements: {{ \"truss\": [(nodes: [0, 1], section: \"s\")] }}, ties: [{ties}], fixed: [(nodes: [0], dofs: [U])],
        gravity: (acceleration: [0, -1, 0]), integration: (axial: Explicit, dt: 1e-4), stop: (time: 1)",
        2.0 * light
    ));
    let s = states(&mut sim);
    for other in &s[2..] {
        assert_eq!(other.x, s[1].x, "tied nodes move as one");
    }
    s[1].x
}

/// A tied node, and a chain of three ties, move as one node with the mass of all, though the host has a millionth of it.
#[test]
fn ties_carry_a_million_times_the_mass_of_their_host() {
    let one = tied(1, 1e-6, 1.0);
    for count in [2, 4] {
        let far = (tied(count, 1e-6, 1.0) - one).length();
        assert!(far < 1e-12, "{count} nodes: {far:e}");
    }
    assert!(one.y < -0.3 && one.y > -0.6, "it has fallen: {one}");
}

/// A periodic chain is drawn to twice its period: the dummy node carries EA (stretch - 1) of the period, and the image stays
/// where the period puts it.
#[test]
fn a_period_doubles_its_length() {
    let mut sim = ended(
        "sections: { \"s\": Stiffness(ea: 10, mass: 1) }, nodes: [[0, 0, 0], [0.5, 0, 0], [1, 0, 0]],
        elements: { \"truss\": [(nodes: [0, 1, 2], section: \"s\")] },
        periodic: (dummies: { \"period\": [1, 0, 0] }, pairs: [(node: 0, image: 2, dummies: [\"period\"])]),
        fixed: [(nodes: [0], dofs: [U]), (nodes: [\"period\"], dofs: [Uy, Uz])],
        prescribed: [(nodes: [\"period\"], ux: 1, amplitude: \"slowly\")], amplitudes: { \"slowly\": SmoothStep(rise: 5) },
        damping: Mass(5), integration: (axial: Explicit), stop: (time: 12), watch: (strain: None)",
    );
    let (s, e) = (states(&mut sim), ledger(&mut sim));
    assert!((s[2].x - s[0].x - DVec3::X * 2.0).length() < 1e-12 && (s[1].x.x - s[0].x.x - 1.0).abs() < 1e-6, "{} {}", s[1].x, s[2].x);
    // EA eps^2 L / 2 with eps = 1.
    assert!((e.strain / 5.0 - 1.0).abs() < 1e-5 && e.balance_error().abs() < 1e-3, "{e:?}");
}

/// Two crossed beams that fly onto each other, rub and part; every vector goes through `map`, and nodes are numbered by `order`.
fn crossed(map: &dyn Fn(DVec3) -> DVec3, shift: DVec3, order: &[usize]) -> Vec<NodeState> {
    let points: Vec<DVec3> = (0..10)
        .map(|i| {
            let s = f64::from(i % 5) * 0.25 - 0.5;
            if i < 5 { DVec3::new(s, 0.03, -0.051) } else { DVec3::new(0.02, s, 0.051) }
        })
        .collect();
    let text = |v: DVec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
    // The node of number `order[i]` stands at point i.
    let mut nodes = vec![String::new(); points.len()];
    for (i, p) in points.iter().enumerate() {
        nodes[order[i]] = text(map(*p) + shift);
    }
    let row = |from: usize| (from..from + 5).map(|i| order[i].to_string()).collect::<Vec<_>>().join(", ");
    let (a, b) = (row(0), row(5));
    let scene = format!(
        "sections: {{ \"s\": Stiffness(ea: 1000, ei: 1, gj: 1, mass: 1) }}, nodes: [{}],
        elements: {{ \"beam\": [(nodes: [{a}], section: \"s\"), (nodes: [{b}], section: \"s\")] }},
        filaments: [(nodes: [{a}], radius: 0.05), (nodes: [{b}], radius: 0.05)], contact: (friction: 0.3, stiffness: 1000),
        initial_velocity: [(nodes: [{a}], velocity: {}), (nodes: [{b}], velocity: {})],
        integration: (axial: Explicit, dt: 0.001), stop: (time: 0.3)",
        nodes.join(", "),
        text(map(DVec3::new(0.2, 0.1, 0.5))),
        text(map(DVec3::new(0.0, 0.0, -0.5))),
    );
    let loaded = load(&scene);
    let mut sim = started(&loaded.model);
    while sim.world.resource::<Clock>().time < 0.3 {
        run::step(&mut sim).expect("stable");
    }
    let s = states(&mut sim);
    order.iter().map(|i| s[*i]).collect()
}

/// What happens does not depend on where, in what direction, in which hand and by which numbers it is described.
#[test]
fn the_description_does_not_change_what_happens() {
    let straight: Vec<usize> = (0..10).collect();
    let same = |v: DVec3| v;
    let reference = crossed(&same, DVec3::ZERO, &straight);
    let bend = reference[2].v - reference[0].v;
    assert!(bend.length() > 0.05, "they have met: {bend}");
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, -2.0, 3.0).normalize(), 1.1);
    let turned = |v: DVec3| turn * v;
    let mirrored = |v: DVec3| DVec3::new(v.x, -v.y, v.z);
    let far = DVec3::new(1000.0, -500.0, 300.0);
    let shuffled = [7, 2, 9, 0, 4, 1, 8, 3, 6, 5];
    // Rounding of the positions (1e-13 at 1e3 lengths), made larger by the stiffness of the contact and by stick and slip.
    type Map<'a> = &'a dyn Fn(DVec3) -> DVec3;
    let cases: [(&str, Map<'_>, DVec3, &[usize], f64); 4] = [
        ("moved by 1e3 lengths", &same, far, &straight, 1e-9),
        ("turned", &turned, DVec3::ZERO, &straight, 1e-9),
        ("in a mirror", &mirrored, DVec3::ZERO, &straight, 1e-9),
        ("with other numbers", &same, DVec3::ZERO, &shuffled, 1e-9),
    ];
    for (name, map, shift, order, allowed) in cases {
        let other = crossed(map, shift, order);
        let off = |i: usize| (other[i].x - shift - map(reference[i].x)).length().max((other[i].v - map(reference[i].v)).length());
        let worst = (0..10).map(off).fold(0.0, f64::max);
        println!("{name}: positions and velocities differ by {worst:.1e}");
        assert!(worst < allowed, "{name}: {worst:e}");
    }
}
