//! Only what a scene needs is scheduled and stored, and the order of the step is the documented one.
#[path = "support/bits.rs"]
mod bits;
use bits::{bits, stepped};
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::systems::default_plugins;
use std::collections::{BTreeMap, BTreeSet};

const SECTION: Section = Section { ea: 100.0, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.01 };

/// A straight filament of `n` elements: trusses, with beams tied into them if `embedded`.
fn filament(n: usize, embedded: bool) -> Model {
    let mut m = Model::new("filament");
    let registry = Simulation::new(default_plugins).registry;
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    let line = |m: &mut Model| -> Vec<NodeId> { (0..=n).map(|i| m.add_node(DVec3::X * i as f64)).collect() };
    let hosts = line(&mut m);
    let mut chain = Chain { nodes: hosts.clone(), section: SECTION, natural: NaturalShape::AsBuilt, orientation: None, closed: false };
    let mut build = Build { model: &mut m, materials: &materials, sections: &sections };
    (registry.element("truss").expect("registered").along)(&chain, &mut build).expect("valid");
    if embedded {
        chain.nodes = line(build.model);
        chain.section = Section { ea: 0.0, mass: 0.0, ..SECTION };
        (registry.element("beam").expect("registered").along)(&chain, &mut build).expect("valid");
        for (host, tied) in hosts.iter().zip(&chain.nodes) {
            m.ties.push(Tie { embedded: *tied, host: *host });
        }
    }
    m.fix(hosts[0], &[Dof::Ux, Dof::Uy, Dof::Uz]);
    if embedded {
        m.fix(chain.nodes[0], &[Dof::Rx, Dof::Ry, Dof::Rz]);
    }
    m.loads.push(NodalLoad { node: hosts[n], force: DVec3::Y * 0.01, moment: DVec3::ZERO, follower: false, amplitude: 0 });
    m.integration.axial = AxialScheme::Explicit;
    m
}

fn built(m: &Model) -> Simulation {
    let mut sim = Simulation::new(default_plugins);
    sim.build(m).expect("a sound model");
    sim
}

fn components(sim: &mut Simulation) -> BTreeSet<String> {
    let entity = sim.world.resource::<NodeEntities>().0[1];
    sim.world.inspect_entity(entity).expect("a node").map(|c| c.1.name().shortname().to_string()).collect()
}

fn set(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(|n| n.to_string()).collect()
}

#[test]
fn a_truss_scene_schedules_and_stores_trusses_only() {
    let mut sim = built(&filament(4, false));
    let expected = [
        "advance_clock",
        "advance_positions",
        "translational_forces<Truss, 2>",
        "clear_forces",
        "apply_loads",
        "gather_forces<Truss, 2>",
        "kick_velocities",
        "take_energies",
        "follow_limit",
    ];
    assert_eq!(sim.system_names(), expected);
    assert_eq!(components(&mut sim), set(&["Position", "InitialPosition", "Velocity", "Force", "Mass", "InverseMass"]));
}

#[test]
fn an_embedded_scene_adds_rotations_but_no_second_set_of_nodes() {
    let mut sim = built(&filament(4, true));
    let expected = [
        "advance_clock",
        "advance_positions",
        "advance_orientations",
        "translational_forces<Truss, 2>",
        "rotational_forces<Beam, 2>",
        "clear_forces",
        "clear_moments",
        "apply_loads_and_moments",
        "gather_forces<Truss, 2>",
        "gather_wrenches<Beam, 2>",
        "kick_velocities",
        "kick_spins",
        "take_energies",
        "follow_limit",
    ];
    let mut names = sim.system_names();
    // The two force passes write different columns: their order is free.
    names[3..5].sort_by_key(|n| n.contains("Beam"));
    assert_eq!(names, expected);
    assert_eq!(sim.world.resource::<NodeRows>().len(), 5, "tied nodes have no row of their own");
    let rotations = ["Orientation", "AngularVelocity", "Moment", "RotaryInertia", "InverseInertia"];
    let translations = ["Position", "InitialPosition", "Velocity", "Force", "Mass", "InverseMass"];
    assert_eq!(components(&mut sim), set(&[&translations[..], &rotations[..]].concat()));
}

#[test]
fn the_numbered_list_of_the_step_names_the_sets_in_their_order() {
    let text = include_str!("../src/step.rs");
    for (i, s) in StepSet::ORDER.iter().enumerate() {
        assert!(text.contains(&format!("//! {:>2} {s:?} ", i + 1)), "step.rs does not list {s:?} as number {}", i + 1);
    }
}

#[test]
fn any_schedule_and_any_thread_count_gives_the_same_bits() {
    let model = filament(3000, true);
    let run = |threads: usize, seed: Option<u64>| bits(&mut stepped(&model, threads, seed, 50));
    let reference = run(1, None);
    for threads in [2, 5] {
        assert!(reference == run(threads, None), "{threads} threads");
    }
    for seed in 1..6 {
        assert!(reference == run(1, Some(seed)), "seed {seed}");
    }
}

#[test]
fn an_embedded_cantilever_bends_like_the_beam_and_stretches_like_the_sum() {
    let at_rest = |force: DVec3, embedded: bool| {
        let mut m = filament(8, embedded);
        m.loads[0].force = force;
        m.integration.axial = AxialScheme::Implicit;
        m.integration.damping = Damping::Mass(0.05);
        m.stop.time = Some(1500.0);
        let mut sim = built(&m);
        run::run(&mut sim, &m, f64::INFINITY, &mut run::Blind).expect("a stable run");
        node_states(&mut sim.world)[8].x - DVec3::X * 8.0
    };
    // F L^3 / 3 EI in the linear limit, F L / EA.
    let bend = at_rest(DVec3::Y * 1e-4, true);
    assert!((bend.y - 1e-4 * 512.0 / 3.0).abs() < 2e-3 * bend.y, "{bend}");
    let stretch = at_rest(DVec3::X * 0.5, true);
    assert!((stretch.x - 0.5 * 8.0 / 100.0).abs() < 1e-6 * stretch.x, "{stretch}");
}
