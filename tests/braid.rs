//! A braid with contact, pulled onto its mandrel: what must hold at the end, whatever the numbers are.
#[path = "support/bits.rs"]
mod bits;
#[path = "support/contact_rig.rs"]
mod contact_rig;
use bits::{bits, stepped};
use braid_ecs::generate::BraidLayout;
use braid_ecs::measure::{initial_traces, passages, position, traces};
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Blind, Status};
use braid_ecs::scene::{self, LoadedScene};
use braid_ecs::systems::constraint::Constraints;
use braid_ecs::systems::default_plugins;
use contact_rig::Noise;

/// The scene of the folder with a few values changed.
fn scene(sets: &[(&str, &str)]) -> LoadedScene {
    let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/embedded7.ron");
    let sets: Vec<(String, String)> = sets.iter().map(|(p, v)| (p.to_string(), v.to_string())).collect();
    scene::load(&file, &sets, &Simulation::new(default_plugins).registry).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_braid_pulled_onto_its_mandrel_is_in_balance_and_crosses_as_before() {
    let loaded = scene(&[("tow.filaments", "3"), ("tow.elements", "16")]);
    let model = &loaded.model;
    let layout = model.get::<BraidLayout>().expect("a braid");
    let mut sim = Simulation::new(default_plugins);
    sim.build(model).expect("a sound model");
    let period = position(&sim.world, layout.dummy);
    assert_eq!(passages(layout, &initial_traces(model), period), [], "the pattern is that of the layout");

    assert_eq!(run::run(&mut sim, model, f64::INFINITY, &mut Blind).expect("a stable run"), Status::Converged);
    let longer = position(&sim.world, layout.dummy);
    assert!(longer.z > 1.5 * period.z, "it has been pulled, {} to {}", period.z, longer.z);
    assert!(sim.world.resource::<ContactSummary>().active > 10, "it lies on the mandrel and on itself");
    assert_eq!(passages(layout, &traces(model, &mut sim.world), longer), [], "no filament has passed through another");

    let ledger = *sim.world.resource::<EnergyLedger>();
    assert!(ledger.balance_error().abs() < 0.01, "{ledger:?}");

    // The force on the dummy node is what the filaments carry through the face.
    let states = node_states(&mut sim.world);
    let images: Vec<usize> = model.periodic.iter().map(|p| sim.world.resource::<NodeRows>().of(p.image)).collect();
    let mut bars = sim.world.query::<(&AxialBar, &Tension)>();
    let crossing = |bar: &AxialBar| bar.rows.iter().any(|r| images.contains(&(*r as usize)));
    let pull = |(bar, tension): (&AxialBar, &Tension)| {
        let along = states[bar.rows[1] as usize].x - states[bar.rows[0] as usize].x;
        crossing(bar).then(|| tension.0 * along.z.abs() / along.length())
    };
    let carried: Vec<f64> = bars.iter(&sim.world).filter_map(pull).collect();
    assert_eq!(carried.len(), 36, "every filament runs through the face once");
    // The rest of the force still moves mass: by the criterion of rest the forces on the nodes are balanced to 0.1 % or so.
    let (carried, force) = (carried.iter().sum::<f64>(), 1e-3);
    assert!((carried / force - 1.0).abs() < 3e-3, "{carried} of {force}");
}

#[test]
fn threads_and_schedule_leave_the_bits_of_a_braid_alone() {
    let loaded = scene(&[]);
    let run = |threads: usize, seed: Option<u64>| {
        let mut sim = stepped(&loaded.model, threads, seed, 1500);
        assert!(sim.world.resource::<ContactSummary>().active > 20, "contacts are wanted");
        bits(&mut sim)
    };
    let reference = run(1, None);
    for (threads, seed) in [(2, None), (3, Some(7)), (2, Some(99))] {
        assert!(run(threads, seed) == reference, "{threads} threads, shuffle {seed:?}");
    }
}

#[test]
fn constraints_of_the_braid_are_adjoint() {
    let loaded = scene(&[]);
    let mut sim = Simulation::new(default_plugins);
    sim.build(&loaded.model).expect("a sound model");
    let constraints = sim.world.resource::<Constraints>().clone();
    let n = 6 * sim.world.resource::<NodeRows>().len();
    // f . (T v) = (T^t f) . v for the values of the independents.
    let mut noise = Noise(1);
    let mut numbers = || (0..n).map(|_| noise.next()).collect::<Vec<f64>>();
    let (f, mut v) = (numbers(), numbers());
    let (mut condensed, independent) = (f.clone(), v.clone());
    constraints.impose_on(&mut v);
    assert!(v != independent, "some degrees of freedom follow others");
    constraints.condense_on(&mut condensed);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (full, reduced) = (dot(&f, &v), dot(&condensed, &independent));
    assert!((full - reduced).abs() < 1e-12 * f.len() as f64, "{full} {reduced}");
}

/// A periodic lattice of bars left alone: its momentum stays, though one of its nodes exists only as
/// the image of another and the period moves, too.
#[test]
fn a_free_periodic_lattice_keeps_its_momentum() {
    const TEXT: &str = r#"(
        units: Consistent,
        sections: { "bar": Stiffness(ea: 100, mass: 1) },
        nodes: [[0, 0, 0], [0.4, 0.3, 0.1], [1, 0, 0], [0.5, 0.9, 0.2]],
        elements: { "truss": [(nodes: [0, 1, 2], section: "bar"), (nodes: [1, 3], section: "bar"), (nodes: [0, 3], section: "bar")] },
        periodic: ( dummies: { "a": [1, 0, 0] }, pairs: [(node: 0, image: 2, dummies: ["a"])] ),
        initial_velocity: [
            (nodes: [0], velocity: [0.3, 0.1, -0.2]), (nodes: [1], velocity: [-0.5, 0.7, 0.4]),
            (nodes: [3], velocity: [0.2, -0.9, 0.1]), (nodes: ["a"], velocity: [0.6, -0.4, 0.3]),
        ],
        integration: (axial: Explicit),
        stop: (steps: 500),
    )"#;
    let registry = Simulation::new(default_plugins).registry;
    let loaded = scene::load_text("lattice.ron", TEXT.into(), &[], &registry).unwrap_or_else(|e| panic!("{e}"));
    let mut sim = Simulation::new(default_plugins);
    sim.build(&loaded.model).expect("a sound model");
    run::start(&mut sim, &loaded.model).expect("a stable start");
    // The image takes its velocity from its node and the period at the start of a step.
    let momentum = |sim: &mut Simulation| {
        let rows: Vec<usize> = (0..5).map(|i| sim.world.resource::<NodeRows>().of(NodeId(i))).collect();
        let states = node_states(&mut sim.world);
        let mut masses = sim.world.query::<&Mass>();
        let mass: Vec<f64> = masses.iter(&sim.world).map(|m| m.0).collect();
        let v = |i: usize| if i == 2 { states[rows[0]].v + states[rows[4]].v } else { states[rows[i]].v };
        (0..4).map(|i| v(i) * mass[rows[i]]).sum::<DVec3>()
    };
    let before = momentum(&mut sim);
    for _ in 0..500 {
        sim.step();
    }
    let after = momentum(&mut sim);
    assert!(before.length() > 0.1 && (after - before).length() < 1e-12, "{before} {after}");
}
