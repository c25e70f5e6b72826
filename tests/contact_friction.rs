//! Friction in whole runs: capstan, incline, belts on prisms.
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene::units::{Length, Ratio};
use braid_ecs::systems::default_plugins;
use braid_ecs::systems::surface::*;
use std::collections::BTreeMap;
use std::f64::consts::PI;

const EA: f64 = 1e4;

fn string(model: &mut Model, points: &[DVec3], radius: f64) -> Vec<NodeId> {
    let nodes: Vec<NodeId> = points.iter().map(|p| model.add_node(*p)).collect();
    let sim = Simulation::new(default_plugins);
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    let section = Section { ea: EA, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 1.0, inertia: 0.0 };
    let chain = Chain { nodes: nodes.clone(), section, natural: NaturalShape::AsBuilt, orientation: None, closed: false };
    let mut build = Build { model, materials: &materials, sections: &sections };
    (sim.registry.element("truss").unwrap().along)(&chain, &mut build).unwrap();
    model.filaments.push(Filament { nodes: nodes.clone(), radius, tow: 0, index: 0, closed: false, contact: true });
    nodes
}

fn states(sim: &mut Simulation, nodes: &[NodeId]) -> Vec<NodeState> {
    let all = node_states(&mut sim.world);
    nodes.iter().map(|n| all[sim.world.resource::<NodeRows>().of(*n)]).collect()
}

/// Tension over T1 at the pulled end of a string over a cylinder, half a turn, sliding.
fn capstan(elements: usize) -> f64 {
    let (big, r, tail) = (1.0, 0.02, 8);
    let length = PI * (big + r) / elements as f64;
    let mut m = Model::new("capstan");
    let mut points = Vec::new();
    for i in (1..=tail).rev() {
        points.push(DVec3::new(-(big + r), -(i as f64) * length, 0.0));
    }
    for i in 0..=elements {
        let a = PI * (1.0 - i as f64 / elements as f64);
        points.push(DVec3::new(a.cos(), a.sin(), 0.0) * (big + r));
    }
    for i in 1..=tail {
        points.push(DVec3::new(big + r, -(i as f64) * length, 0.0));
    }
    let nodes = string(&mut m, &points, r);
    let mut surface = SurfaceSpec::new(ShapeSpec::Cylinder { radius: Length(big) });
    surface.friction = Some(Ratio(0.3));
    m.insert(Surfaces(vec![surface]));
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 2.0 });
    let pull = m.add_amplitude(Amplitude::Table(vec![(2.5, 0.0), (3.5, 0.0005), (4.5, 0.002), (12.0, 0.017)]));
    m.loads.push(NodalLoad { node: nodes[0], force: DVec3::NEG_Y, moment: DVec3::ZERO, follower: false, amplitude: ramp });
    let last = *nodes.last().unwrap();
    m.prescribed.push(PrescribedMotion { node: last, dof: Dof::Uy, value: -1.0, amplitude: pull });
    m.fix(last, &[Dof::Ux]);
    m.fix(nodes[0], &[Dof::Ux]);
    for n in &nodes {
        m.fix(*n, &[Dof::Uz]);
    }
    m.stop.time = Some(12.0);
    let mut sim = Simulation::new(default_plugins);
    sim.build(&m).unwrap();
    let mut watch = Tensions { nodes: nodes.clone(), length, samples: Vec::new() };
    run::run(&mut sim, &m, 0.05, &mut watch).unwrap();
    let late: Vec<f64> = watch.samples.iter().filter(|s| s.0 > 8.0).map(|s| s.2 / s.1).collect();
    let mean = late.iter().sum::<f64>() / late.len() as f64;
    let spread = late.iter().fold(0.0f64, |m, v| m.max((v - mean).abs()));
    let clock = sim.world.resource::<Clock>();
    let ledger = sim.world.resource::<EnergyLedger>();
    println!(
        "{elements}: {mean:.5} +- {spread:.5}, error {:.2e}, steps {}, dt {:e} by {}, balance {:.2e} {ledger:?} {:?}",
        mean / (0.3 * PI).exp() - 1.0,
        clock.step,
        clock.dt,
        clock.limited_by,
        ledger.balance_error(),
        sim.world.resource::<ContactSummary>()
    );
    mean
}

struct Tensions {
    nodes: Vec<NodeId>,
    length: f64,
    samples: Vec<(f64, f64, f64)>,
}

impl run::Observer for Tensions {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), braid_ecs::simulation::SimulationError> {
        let s = states(sim, &self.nodes);
        let n = s.len();
        let tension = |i: usize| EA * ((s[i + 1].x - s[i].x).length() / self.length - 1.0);
        let time = sim.world.resource::<Clock>().time;
        self.samples.push((time, tension(1), tension(n - 3)));
        Ok(())
    }
}

#[test]
fn capstan_with_default_settings() {
    let known = (0.3 * PI).exp();
    for (elements, limit) in [(16, 0.05), (32, 0.02), (64, 0.01), (128, 0.005), (256, 0.001)] {
        let ratio = capstan(elements);
        assert!((ratio / known - 1.0).abs() < limit, "{elements} elements: {ratio} instead of {known}");
    }
}
