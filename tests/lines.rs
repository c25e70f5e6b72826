//! The lines of a model: filaments first, then chains of bare elements; results at their points.
use braid_ecs::output::frame::frame;
use braid_ecs::output::lines::Lines;
use braid_ecs::output::vtp::{DataArray, Values};
use braid_ecs::prelude::*;
use braid_ecs::scene::load_text;
use braid_ecs::systems::default_plugins;

fn built(text: &str) -> (Model, Simulation) {
    let mut sim = Simulation::new(default_plugins);
    let loaded = load_text("lines.ron", text.into(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    sim.build(&loaded.model).expect("a sound model");
    (loaded.model, sim)
}

fn array<'a>(arrays: &'a [DataArray], name: &str) -> &'a [f32] {
    match &arrays.iter().find(|a| a.name == name).unwrap_or_else(|| panic!("no array {name}")).values {
        Values::F32(v) => v,
        other => panic!("{name} holds {other:?}"),
    }
}

/// Three bars in a row, of which the first two carry a filament; the bars are stretched by 0, 1 and 2 %.
const BARS: &str = r#"(
    units: Si,
    sections: {"s": Stiffness(ea: 100, ei: 0, gj: 0, mass: 1)},
    nodes: [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]],
    elements: {"truss": [(nodes: [0, 1], section: "s"), (nodes: [1, 2], section: "s"), (nodes: [2, 3], section: "s")]},
    filaments: [(nodes: [0, 1, 2], radius: 0.125, tow: 4)],
    integration: (axial: Explicit),
    stop: (steps: 1),
)"#;

#[test]
fn filaments_come_first_and_bare_elements_follow_as_chains() {
    let (model, mut sim) = built(BARS);
    let lines = Lines::of(&model, &mut sim);
    let rows: Vec<&[u32]> = lines.lines.iter().map(|l| &l.rows[..]).collect();
    assert_eq!(rows, [&[0, 1, 2][..], &[2, 3]]);
    assert_eq!((lines.lines[0].tow, lines.lines[0].radius, lines.lines[0].filament), (4, 0.125, Some(0)));
    assert_eq!((lines.lines[1].tow, lines.lines[1].filament), (5, None));
    assert!(lines.lines[1].radius > 0.0 && lines.lines[1].radius < 0.3);
    assert_eq!(lines.points(), 5);
}

#[test]
fn forces_of_the_two_segments_that_meet_are_averaged() {
    let (model, mut sim) = built(BARS);
    let lines = Lines::of(&model, &mut sim);
    let places = [0.0, 1.0, 2.01, 3.03].map(|x| Position(DVec3::X * x));
    let mut nodes = sim.world.query::<&mut Position>();
    nodes.iter_mut(&mut sim.world).zip(places).for_each(|(mut x, to)| *x = to);
    let results = lines.results(&mut sim.world);
    // N = EA x strain: 0, 1 and 2; the filament ends with its own last segment.
    let expected = [0.0, 0.5, 1.0, 2.0, 2.0];
    assert!(results.axial.iter().zip(expected).all(|(n, e)| (n - e).abs() < 1e-12), "{:?}", results.axial);
    assert!((results.typical_force - (5.0f64 / 3.0).sqrt()).abs() < 1e-12);
    let picture = frame(&lines, &mut sim.world, &[("program".into(), "test".into())]);
    assert_eq!(array(&picture.point_data, "axial_force"), [0.0, 0.5, 1.0, 2.0, 2.0]);
    assert!(picture.point_data.iter().all(|a| a.name != "tangent"), "bars have no rotations");
    assert_eq!((picture.points.len(), picture.lengths), (5, vec![3, 2]));
    assert_eq!(picture.points[3].x, 2.01);
}

#[test]
fn triads_turn_with_the_nodes() {
    let (model, mut sim) = built(
        r#"(
        units: Si,
        materials: {"m": (young: 1e6, poisson: 0.3, density: 1000)},
        polylines: [(name: "p", points: [[0, 0, 0], [0, 0, 2]], subdivisions: 2, radius: 0.01, material: "m", model: Beams, start: Clamped)],
        stop: (steps: 1),
    )"#,
    );
    let lines = Lines::of(&model, &mut sim);
    // Half a turn about y at the last node: its tangent z becomes -z, its normal stays across.
    let turned = DQuat::from_rotation_y(std::f64::consts::PI);
    let mut nodes = sim.world.query::<&mut Orientation>();
    nodes.iter_mut(&mut sim.world).last().unwrap().0 = turned;
    let picture = frame(&lines, &mut sim.world, &[]);
    let (t, n) = (array(&picture.point_data, "tangent"), array(&picture.point_data, "normal"));
    assert_eq!(&t[..3], [0.0, 0.0, 1.0]);
    assert!((t[8] + 1.0).abs() < 1e-6, "{t:?}");
    for (t, n) in t.as_chunks::<3>().0.iter().zip(n.as_chunks::<3>().0) {
        let (t, n) = (glam::Vec3::from_array(*t), glam::Vec3::from_array(*n));
        assert!(t.dot(n).abs() < 1e-6 && (n.length() - 1.0).abs() < 1e-6);
    }
    let q = array(&picture.point_data, "rotation");
    assert_eq!((q.len(), q[3]), (12, 1.0));
}
