//! A bar written as a plugin against the truss of the program: the same arithmetic, so the ratios tell what it costs to come
//! from outside.
//!
//! `lanes` computes four bars at a time as the truss does, `plain` has nothing but `internal_force`. Compare within a group:
//! `forces` is the loop over the elements alone, `step` a whole time step of 84 filaments with 91 bars each.
//! On a shared machine `RAYON_NUM_THREADS=1` gives steadier times.
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::systems::default_plugins;
use braid_ecs::systems::truss::Truss;
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use std::collections::BTreeMap;

const FILAMENTS: usize = 84;
const BARS: usize = 91;
/// Steps in a timed pass.
const STEPS: usize = 20;

/// What a bar is, with a kernel of its own for the two ways of writing it.
macro_rules! bar {
    ($name:ident, $key:literal, { $($kernel:tt)* }) => {
        /// A bar of a plugin.
        #[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
        struct $name {
            rest_length: f64,
            ea: f64,
            mass: f64,
            viscosity: f64,
        }

        impl Element<2> for $name {
            const NAME: &'static str = $key;
            const ABOUT: &'static str = "a bar of a plugin";
            type Force = DVec3;
            type Spec = ();

            fn read(_: (), _: &mut Build<'_>) -> Result<(), SpecError> {
                Err(SpecError::new("", "it follows filaments alone"))
            }

            fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
                for pair in chain.segments() {
                    let [a, b] = pair.map(|n| build.model.nodes[n.row()].position);
                    let Section { ea, mass, .. } = chain.section;
                    build.model.add_element($name { rest_length: a.distance(b), ea, mass, viscosity: 0.0 }, pair);
                }
                Ok(())
            }

            $($kernel)*

            fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
                let strain = (nodes[1].x - nodes[0].x).length() / self.rest_length - 1.0;
                0.5 * self.ea * self.rest_length * strain * strain
            }

            fn stiffness_bound(&self, nodes: [NodeState; 2], _: [NodeMass; 2]) -> [StiffnessBound; 2] {
                let l = (nodes[1].x - nodes[0].x).length();
                let tension = (self.ea * (l / self.rest_length - 1.0)).max(0.0);
                [StiffnessBound { translation: 2.0 * (self.ea / self.rest_length).max(tension / l), rotation: 0.0 }; 2]
            }

            fn mass(&self) -> [NodeMass; 2] {
                [NodeMass { mass: 0.5 * self.mass * self.rest_length, inertia: 0.0 }; 2]
            }
        }
    };
}

bar!(Plain, "bench.plain", {
    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        let (d, v) = (nodes[1].x - nodes[0].x, nodes[1].v - nodes[0].v);
        let length = d.length();
        let e = d * (1.0 / length);
        let pull = e * (self.ea * (length / self.rest_length - 1.0) + self.viscosity * e.dot(v));
        [-pull, pull]
    }
});

bar!(Lanes, "bench.lanes", {
    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        braid_ecs::element::alone(self, nodes)
    }

    fn internal_forces(elements: &mut [Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        braid_ecs::element::in_lanes(elements, rows, nodes, out);
    }
});

impl LaneElement<2> for Lanes {
    #[inline(always)]
    fn at_once<L: Lane>(bars: &[Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        let d = V3::<L>::gather(|l| nodes.x(rows[l].0[1]) - nodes.x(rows[l].0[0]));
        let v = V3::<L>::gather(|l| nodes.v(rows[l].0[1]) - nodes.v(rows[l].0[0]));
        let [ea, rest_length, viscosity, _] = L::rows(|l| [bars[l].ea, bars[l].rest_length, bars[l].viscosity, 0.0]);
        let length = d.dot(d).sqrt();
        let e = d * (L::splat(1.0) / length);
        let pull = e * (ea * (length / rest_length - L::splat(1.0)) + viscosity * e.dot(v));
        pull.each(|l, pull| out[l].0 = [-pull, pull]);
    }
}

fn plugin(sim: &mut Simulation) {
    sim.add_element::<Plain, 2>();
    sim.add_element::<Lanes, 2>();
}

/// Filaments of one kind of bar, held at one end and pulled at the other.
fn model<E: Element<2>>() -> Model {
    let mut model = Model::new("bars");
    let section = Section { ea: 40.0, ei: [0.0; 2], gj: 0.0, ga: f64::INFINITY, mass: 0.3, inertia: 0.0 };
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    for f in 0..FILAMENTS {
        let nodes: Vec<NodeId> = (0..=BARS).map(|i| model.add_node(DVec3::new(i as f64, f as f64, 0.1 * (i as f64).sin()))).collect();
        model.fix(nodes[0], &Dof::ALL[..3]);
        model.loads.push(NodalLoad { node: nodes[BARS], force: DVec3::X, moment: DVec3::ZERO, follower: false, amplitude: 0 });
        let chain = Chain { nodes, section, natural: NaturalShape::AsBuilt, orientation: None, closed: false };
        E::along(&chain, &mut Build { model: &mut model, materials: &materials, sections: &sections }).expect("a sound chain");
    }
    // All nodes move from the start: a wave that runs into rest is made of denormal numbers, which are slow.
    for (i, node) in model.nodes.iter_mut().enumerate() {
        let i = i as f64;
        node.velocity = DVec3::new(i.sin(), (2.0 * i).cos(), (3.0 * i).sin()) * 1e-3;
    }
    model.integration.axial = AxialScheme::Explicit;
    model
}

fn forces<E: Element<2>>(c: &mut Criterion) {
    let model = model::<E>();
    let mut bars: Vec<E> = model.elements::<E, 2>().iter().map(|e| e.0.clone()).collect();
    let rows: Vec<Connectivity<2>> = model.elements::<E, 2>().iter().map(|e| Connectivity(e.1.map(|n| n.0))).collect();
    let states: Vec<NodeState> = model.nodes.iter().map(|n| NodeState::at(n.position * 1.01)).collect();
    let mut out = vec![EndForces::<E, 2>::default(); bars.len()];
    let mut group = c.benchmark_group("forces");
    group.throughput(Throughput::Elements(bars.len() as u64));
    group.bench_function(E::NAME, |b| b.iter(|| E::internal_forces(&mut bars, &rows, &states[..], &mut out)));
    group.finish();
}

fn step<E: Element<2>>(c: &mut Criterion) {
    let model = model::<E>();
    let mut sim = Simulation::new((default_plugins, plugin));
    sim.build(&model).expect("a sound model");
    run::start(&mut sim, &model).expect("a stable start");
    let mut group = c.benchmark_group("step");
    group.throughput(Throughput::Elements((FILAMENTS * BARS * STEPS) as u64));
    group.bench_function(E::NAME, |b| b.iter_batched(|| (), |()| (0..STEPS).for_each(|_| sim.step()), BatchSize::PerIteration));
    group.finish();
}

criterion_group!(benches, forces::<Truss>, forces::<Lanes>, forces::<Plain>, step::<Truss>, step::<Lanes>, step::<Plain>);
criterion_main!(benches);
