//! Whole models against closed forms.
use braid_ecs::model::RotaryInertiaRule;
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Blind, Status};
use braid_ecs::systems::default_plugins;
use std::collections::BTreeMap;

fn build_chain(model: &mut Model, kind: &str, points: impl Iterator<Item = DVec3>, section: Section, natural: NaturalShape) -> Vec<NodeId> {
    let nodes: Vec<NodeId> = points.map(|p| model.add_node(p)).collect();
    let sim = Simulation::new(default_plugins);
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    let chain = Chain { nodes: nodes.clone(), section, natural, orientation: None, closed: false };
    let mut build = Build { model, materials: &materials, sections: &sections };
    (sim.registry.element(kind).expect("registered").along)(&chain, &mut build).expect("a valid chain");
    nodes
}

fn simulate(model: &Model) -> (Simulation, Status) {
    let mut sim = Simulation::new(default_plugins);
    sim.build(model).expect("a sound model");
    let status = run::run(&mut sim, model, f64::INFINITY, &mut Blind).expect("a stable run");
    (sim, status)
}

fn position(sim: &mut Simulation, node: NodeId) -> DVec3 {
    node_states(&mut sim.world)[sim.world.resource::<NodeRows>().of(node)].x
}

/// Tip of a cantilever of unit length and EI under a transverse dead force alpha EI / L^2, at rest.
fn cantilever(elements: usize, alpha: f64, axial: AxialScheme) -> DVec3 {
    cantilever_with(elements, alpha, axial, 0.0).0
}

/// Tip, and time step, with a least shear flexibility.
fn cantilever_with(elements: usize, alpha: f64, axial: AxialScheme, flexibility: f64) -> (DVec3, f64) {
    let mut m = Model::new("cantilever");
    m.integration.shear_flexibility = flexibility;
    let section = Section { ea: 1e6, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let nodes =
        build_chain(&mut m, "beam", (0..=elements).map(|i| DVec3::X * (i as f64 / elements as f64)), section, NaturalShape::AsBuilt);
    m.fix(nodes[0], &Dof::ALL);
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 4.0 });
    m.loads.push(NodalLoad { node: nodes[elements], force: DVec3::Y * alpha, moment: DVec3::ZERO, follower: false, amplitude: ramp });
    m.integration.axial = axial;
    m.integration.damping = Damping::Mass(4.0);
    m.stop.time = Some(20.0);
    let (mut sim, _) = simulate(&m);
    let ledger = *sim.world.resource::<EnergyLedger>();
    assert!(ledger.balance_error().abs() < 0.01, "{ledger:?}");
    (position(&mut sim, nodes[elements]), sim.world.resource::<Clock>().dt_limit)
}

#[test]
fn kinetic_damping_feeds_no_mode_however_fast() {
    // Starting from rest with a whole kick would amplify modes beyond two thirds of the limit at every peak.
    for axial in [AxialScheme::Implicit, AxialScheme::Explicit] {
        let mut m = Model::new("cantilever");
        let section = Section { ea: 1e3, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
        let points = (0..=20).map(|i| DVec3::X * (f64::from(i) / 20.0));
        let nodes = build_chain(&mut m, "beam", points, section, NaturalShape::AsBuilt);
        m.fix(nodes[0], &Dof::ALL);
        let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 0.5 });
        m.loads.push(NodalLoad { node: nodes[20], force: DVec3::Y * 0.01, moment: DVec3::ZERO, follower: false, amplitude: ramp });
        m.integration.axial = axial;
        m.integration.damping = Damping::Kinetic;
        m.integration.safety = 0.97;
        m.stop.time = Some(20.0);
        let (mut sim, _) = simulate(&m);
        let ledger = *sim.world.resource::<EnergyLedger>();
        assert!(ledger.kinetic < 1e-6 * ledger.strain, "{axial:?}: {ledger:?}");
        // P L^3 / 3 EI.
        let tip = position(&mut sim, nodes[20]).y;
        assert!((tip / (0.01 / 3.0) - 1.0).abs() < 1e-3, "{axial:?}: {tip}");
    }
}

#[test]
fn a_least_shear_flexibility_lengthens_the_step_and_bends_by_the_known_share() {
    // GA = 12 EI / (s l^2) adds P L / GA to P L^3 / 3 EI: the share s / (4 N^2). The stiffness that limits the step falls to 1 / (1 + s).
    let s = 3.0;
    for n in [4, 8] {
        let (tip, _) = cantilever_with(n, 0.01, AxialScheme::Implicit, s);
        let (share, known) = (tip.y / (0.01 / 3.0) - 1.0, s / (4 * n * n) as f64);
        assert!((share / known - 1.0).abs() < 0.02, "{n} elements: {share} instead of {known}");
    }
    // On a mesh fine enough for bending to limit the step.
    let limit = |s| cantilever_with(32, 0.01, AxialScheme::Implicit, s).1;
    let (as_it_is, softer) = (limit(0.0), limit(1.0));
    assert!((softer / as_it_is / 2f64.sqrt() - 1.0).abs() < 0.01, "{as_it_is} and {softer}");
}

#[test]
fn the_implicit_scheme_damps_an_axial_mode_as_backward_euler_and_a_bending_mode_not() {
    // A mass m on a bar: x(n+1) (1 + a) - 2 x(n) + x(n-1) = 0 with a = EA dt^2 / (L m), hence x(n) = C r^n sin(n arctan sqrt a),
    // r = 1 / sqrt(1 + a).
    let section = Section { ea: 1.0, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    for dt in [0.05f64, 0.2, 1.0] {
        let place = |steps: u32| {
            let mut m = Model::new("mass on a bar");
            let nodes = build_chain(&mut m, "truss", [DVec3::ZERO, DVec3::X].into_iter(), section, NaturalShape::AsBuilt);
            m.fix(nodes[0], &[Dof::Ux, Dof::Uy, Dof::Uz]);
            m.fix(nodes[1], &[Dof::Uy, Dof::Uz]);
            m.nodes[nodes[1].row()].velocity = DVec3::X * 0.1;
            m.integration.axial = AxialScheme::Implicit;
            m.integration.dt = Some(dt);
            m.stop.time = Some((f64::from(steps) - 0.5) * dt);
            position(&mut simulate(&m).0, nodes[1]).x - 1.0
        };
        let a = 2.0 * dt * dt;
        let (r, angle) = ((1.0 + a).sqrt().recip(), a.sqrt().atan());
        let scale = place(1) / (r * angle.sin());
        for n in [2u32, 5, 20, 60] {
            let (x, known) = (place(n), scale * r.powi(n as i32) * (f64::from(n) * angle).sin());
            assert!((x - known).abs() < 1e-9 * scale.abs(), "dt {dt}, {n} steps: {x:e} instead of {known:e}");
        }
    }
    // Ten swings of a cantilever: the axial solve takes a share that goes with the square of the amplitude, for the shortening of
    // the bent beam rings along it, and nothing of the mode itself.
    let taken = |speed: f64| {
        let mut m = Model::new("cantilever");
        let stiff = Section { ea: 1e6, ..section };
        let nodes = build_chain(&mut m, "beam", (0..=20).map(|i| DVec3::X * (f64::from(i) / 20.0)), stiff, NaturalShape::AsBuilt);
        m.fix(nodes[0], &Dof::ALL);
        for (i, node) in nodes.iter().enumerate() {
            m.nodes[node.row()].velocity = DVec3::Y * (speed * (i as f64 / 20.0).powi(2));
        }
        m.integration.axial = AxialScheme::Implicit;
        // Central differences show an energy that swings with the square of the step, by 0.2 % at the default one.
        m.integration.safety = 0.3;
        m.stop.time = Some(10.0 * std::f64::consts::TAU / 3.516);
        let ledger = *simulate(&m).0.world.resource::<EnergyLedger>();
        let kept = (ledger.kinetic + ledger.strain) / ledger.initial;
        assert!((kept - 1.0).abs() < 3e-4, "{kept} of the energy is left: {ledger:?}");
        ledger.axial / ledger.initial
    };
    let (large, small) = (taken(0.02), taken(0.01));
    assert!(small.abs() < 3e-4 && (large / small - 4.0).abs() < 0.4, "{large:e} and {small:e}");
}

#[test]
fn cantilever_follows_the_elastica() {
    // Bisshopp and Drucker 1945 by elliptic integrals: alpha = 5: u/L = 0.38762836072, w/L = 0.71379152361.
    let (u, w) = (0.38762836072, 0.71379152361);
    for axial in [AxialScheme::Explicit, AxialScheme::Implicit] {
        let error = |n| {
            let tip = cantilever(n, 5.0, axial);
            ((1.0 - tip.x - u).abs() / u).max((tip.y - w).abs() / w)
        };
        let (coarse, fine) = (error(8), error(16));
        assert!(fine < 3e-3, "{axial:?}: {fine}");
        let order = (coarse / fine).log2();
        assert!(order > 1.6, "{axial:?}: order {order}, errors {coarse} {fine}");
    }
}

#[test]
fn end_moment_rolls_a_beam_into_a_circle() {
    let n = 10;
    let mut m = Model::new("roll-up");
    let section = Section { ea: 1e4, ei: [1.0, 1.0], gj: 1.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let nodes = build_chain(&mut m, "beam", (0..=n).map(|i| DVec3::X * (i as f64 / n as f64)), section, NaturalShape::AsBuilt);
    m.fix(nodes[0], &Dof::ALL);
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 4.0 });
    let moment = DVec3::Z * std::f64::consts::TAU;
    m.loads.push(NodalLoad { node: nodes[n], force: DVec3::ZERO, moment, follower: false, amplitude: ramp });
    m.integration.damping = Damping::Mass(6.0);
    m.stop.time = Some(20.0);
    let (mut sim, _) = simulate(&m);
    // Constant curvature is exact for this element: the polygon closes.
    assert!(position(&mut sim, nodes[n]).length() < 1e-4);
}

#[test]
fn implicit_bar_keeps_the_exact_stiffness() {
    let mut m = Model::new("bar");
    let section = Section { ea: 100.0, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let nodes = build_chain(&mut m, "truss", (0..=7).map(|i| DVec3::X * f64::from(i)), section, NaturalShape::AsBuilt);
    m.fix(nodes[0], &Dof::ALL[..3]);
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 20.0 });
    m.loads.push(NodalLoad { node: nodes[7], force: DVec3::X * 3.0, moment: DVec3::ZERO, follower: false, amplitude: ramp });
    m.integration.dt = Some(0.5);
    m.integration.damping = Damping::Mass(0.5);
    m.stop.time = Some(120.0);
    let (mut sim, _) = simulate(&m);
    let stretch = position(&mut sim, nodes[7]).x - 7.0;
    assert!((stretch - 0.21).abs() < 1e-8, "{stretch}");
    let ledger = *sim.world.resource::<EnergyLedger>();
    assert!(ledger.balance_error().abs() < 5e-3, "{ledger:?}");
}

/// A stretched chain that runs through a periodic face, closed by a dummy node under a force.
fn periodic_chain(axial: AxialScheme, loaded: f64) -> (f64, f64) {
    let n = 6;
    let mut m = Model::new("periodic chain");
    let section = Section { ea: 10.0, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let nodes = build_chain(&mut m, "truss", (0..=n).map(|i| DVec3::X * f64::from(i)), section, NaturalShape::AsBuilt);
    let dummy = m.add_node(DVec3::X * f64::from(n));
    m.nodes[dummy.row()].dummy = true;
    m.fix(dummy, &[Dof::Uy, Dof::Uz]);
    m.fix(nodes[0], &[Dof::Uy, Dof::Uz]);
    m.periodic.push(PeriodicPair { node: nodes[0], image: nodes[n as usize], dummies: vec![dummy] });
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 10.0 });
    m.loads.push(NodalLoad { node: dummy, force: DVec3::X * loaded, moment: DVec3::ZERO, follower: false, amplitude: ramp });
    m.integration.axial = axial;
    m.integration.damping = Damping::Mass(1.0);
    m.integration.dt = Some(0.05);
    m.stop.time = Some(60.0);
    let (mut sim, _) = simulate(&m);
    let ledger = *sim.world.resource::<EnergyLedger>();
    assert!(ledger.balance_error().abs() < 5e-3, "{ledger:?}");
    (position(&mut sim, dummy).x, position(&mut sim, nodes[n as usize]).x - position(&mut sim, nodes[0]).x)
}

#[test]
fn period_of_a_chain_follows_its_force() {
    for axial in [AxialScheme::Explicit, AxialScheme::Implicit] {
        let (period, span) = periodic_chain(axial, 2.0);
        assert!((period - 6.0 * 1.2).abs() < 1e-6, "{axial:?}: {period}");
        assert!((span - period).abs() < 1e-12);
    }
}

#[test]
fn rotary_inertia_does_not_change_an_equilibrium() {
    let tip = |factor| {
        let mut m = Model::new("cantilever");
        let section = Section { ea: 1e3, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
        let nodes = build_chain(&mut m, "beam", (0..=6).map(|i| DVec3::X * (f64::from(i) / 6.0)), section, NaturalShape::AsBuilt);
        m.fix(nodes[0], &Dof::ALL);
        m.loads.push(NodalLoad { node: nodes[6], force: DVec3::Y * 2.0, moment: DVec3::ZERO, follower: false, amplitude: 0 });
        m.integration.rotary_inertia = RotaryInertiaRule::Scaled(factor);
        m.integration.damping = Damping::Mass(4.0);
        m.stop.time = Some(30.0);
        let (mut sim, _) = simulate(&m);
        position(&mut sim, nodes[6])
    };
    assert!((tip(0.2) - tip(1.0)).length() < 1e-9);
}

#[test]
fn lever_equation_divides_force_and_mass() {
    // u2 = r u1 with springs to ground, static force on mass 2: u1 = r F / (k1 + r^2 k2).
    let (r, k1, k2, f) = (-1.5, 50.0, 10.0, 3.0);
    let mut m = Model::new("lever");
    let bar = |k: f64| Section { ea: k, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let a = build_chain(&mut m, "truss", [DVec3::ZERO, DVec3::X].into_iter(), bar(k1), NaturalShape::AsBuilt);
    let b = build_chain(&mut m, "truss", [DVec3::Y, DVec3::Y + DVec3::X].into_iter(), bar(k2), NaturalShape::AsBuilt);
    for (n, dofs) in [(a[0], &Dof::ALL[..3]), (b[0], &Dof::ALL[..3]), (a[1], &Dof::ALL[1..3]), (b[1], &Dof::ALL[1..3])] {
        m.fix(n, dofs);
    }
    m.equations.push(Equation {
        terms: vec![Term { coefficient: 1.0, node: b[1], dof: Dof::Ux }, Term { coefficient: -r, node: a[1], dof: Dof::Ux }],
        constant: 0.0,
    });
    m.loads.push(NodalLoad { node: b[1], force: DVec3::X * f, moment: DVec3::ZERO, follower: false, amplitude: 0 });
    m.integration.damping = Damping::Mass(8.0);
    m.stop.time = Some(30.0);
    let (mut sim, _) = simulate(&m);
    let u1 = position(&mut sim, a[1]).x - 1.0;
    let expected = r * f / (k1 + r * r * k2);
    assert!((u1 - expected).abs() < 1e-8, "{u1} {expected}");
}

/// A bar pulled by a prescribed motion of its end: the work of the support is what the bar holds.
#[test]
fn a_prescribed_motion_does_the_work_that_the_bar_stores() {
    for axial in [AxialScheme::Explicit, AxialScheme::Implicit] {
        let mut m = Model::new("pulled bar");
        let section = Section { ea: 100.0, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
        let nodes = build_chain(&mut m, "truss", (0..=5).map(|i| DVec3::X * f64::from(i)), section, NaturalShape::AsBuilt);
        m.fix(nodes[0], &Dof::ALL[..3]);
        let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 20.0 });
        m.prescribed.push(PrescribedMotion { node: nodes[5], dof: Dof::Ux, value: 0.5, amplitude: ramp });
        m.integration.axial = axial;
        m.integration.dt = Some(0.05);
        m.stop.time = Some(25.0);
        let (mut sim, _) = simulate(&m);
        let ledger = *sim.world.resource::<EnergyLedger>();
        // EA u^2 / 2 L, and what the implicit scheme dissipates on the way: it acts like a viscosity EA dt / L.
        let stored = 0.5 * 100.0 * 0.25 / 5.0;
        assert!((ledger.external_work - ledger.axial - stored).abs() < 1e-3, "{axial:?} {ledger:?}");
        assert!((0.0..0.01 * stored).contains(&ledger.axial), "{axial:?} {ledger:?}");
        assert!(ledger.balance_error().abs() < 1e-3, "{axial:?} {ledger:?}");
        assert!((position(&mut sim, nodes[5]).x - 5.5).abs() < 1e-12);
    }
}

/// What moves from the start on has its kinetic energy already: nobody has put it in.
#[test]
fn a_motion_that_starts_with_a_speed_makes_no_energy() {
    let mut m = Model::new("towed mass");
    let section = Section { ea: 1e-3, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let nodes = build_chain(&mut m, "truss", (0..=2).map(|i| DVec3::X * f64::from(i)), section, NaturalShape::AsBuilt);
    let steady = m.add_amplitude(Amplitude::Table(vec![(0.0, 0.0), (10.0, 10.0)]));
    for node in &nodes {
        m.prescribed.push(PrescribedMotion { node: *node, dof: Dof::Ux, value: 0.5, amplitude: steady });
    }
    m.stop.time = Some(5.0);
    m.integration.dt = Some(0.05);
    let (sim, _) = simulate(&m);
    let ledger = sim.world.resource::<EnergyLedger>();
    assert!((ledger.kinetic - 0.25).abs() < 1e-9 && ledger.imbalance().abs() < 1e-9, "{ledger:?}");
}

/// A cantilever let go under a tip load swings with omega = 3.516 sqrt(EI / (m L^4)). When it has calmed down the
/// damping turns to 1.4 omega, and what takes mass damping many swings is over in one.
#[test]
fn adaptive_damping_finds_the_slowest_mode() {
    let run = |damping: Damping| {
        let mut m = Model::new("cantilever");
        let section = Section { ea: 1e6, ei: [1.0, 1.0], gj: 0.8, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
        let nodes = build_chain(&mut m, "beam", (0..=10).map(|i| DVec3::X * (0.1 * f64::from(i))), section, NaturalShape::AsBuilt);
        m.fix(nodes[0], &Dof::ALL);
        let at_once = m.add_amplitude(Amplitude::Ramp { rise: 0.0 });
        m.loads.push(NodalLoad { node: nodes[10], force: DVec3::Y * 0.03, moment: DVec3::ZERO, follower: false, amplitude: at_once });
        m.integration.damping = damping;
        m.stop.time = Some(28.0);
        let (mut sim, _) = simulate(&m);
        let ledger = *sim.world.resource::<EnergyLedger>();
        assert!(ledger.balance_error().abs() < 1e-3, "{ledger:?}");
        let rate = sim.world.get_resource::<braid_ecs::systems::adaptive_damping::Settling>().map(|s| s.now);
        (ledger.kinetic, position(&mut sim, nodes[10]).y, rate)
    };
    let (slow, _, none) = run(Damping::Mass(0.2));
    let (fast, tip, rate) = run(Damping::Adaptive(Some(0.2)));
    assert_eq!(none, None, "the damping costs nothing where it is not used");
    let omega = 3.516;
    let rate = rate.expect("it is used");
    assert!((rate / (1.4 * omega) - 1.0).abs() < 0.05, "{rate} instead of {}", 1.4 * omega);
    assert!(fast < 1e-6 * slow, "kinetic energy {fast:e}, with mass damping {slow:e}");
    assert!((tip / 0.01 - 1.0).abs() < 2e-3, "{tip}");
}
