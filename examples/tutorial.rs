//! The element of [`systems/TUTORIAL.md`](../systems/TUTORIAL.md): a fibre that gets stiffer as it is stretched.
//!
//! ```sh
//! cargo run --example tutorial -- examples/scenes/tutorial_braid.ron
//! ```
use braid_ecs::prelude::*;

fn main() -> std::process::ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the fibre.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<Fibre, 2>();
    sim.add_units::<Fibre>(&[("rest_length", "length"), ("ea", "force"), ("mass", "mass")]);
}

/// What one fibre remembers.
#[derive(Component, Clone, Debug, Serialize, Deserialize)]
pub struct Fibre {
    /// Rest length L (length).
    rest_length: f64,
    /// Axial stiffness EA at rest (force).
    ea: f64,
    /// Mass of the whole fibre (mass).
    mass: f64,
    /// How fast it stiffens: N = EA (e + stiffening e^2).
    stiffening: f64,
}

/// One entry of `elements: { "my.fibre": [...] }`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FibreSpec {
    nodes: Vec<NodeId>,
    section: String,
    #[serde(default)]
    stiffening: f64,
}

/// Stiffening of fibres along the filaments of generators, which know sections alone.
const STIFFENING: f64 = 20.0;

impl Fibre {
    fn between(pair: [NodeId; 2], section: &Section, stiffening: f64, build: &mut Build<'_>) {
        let [a, b] = pair.map(|n| build.model.nodes[n.row()].position);
        let rest_length = a.distance(b);
        build.model.add_element(Fibre { rest_length, ea: section.ea, mass: section.mass * rest_length, stiffening }, pair);
    }

    fn strain(&self, nodes: &[NodeState; 2]) -> f64 {
        nodes[0].x.distance(nodes[1].x) / self.rest_length - 1.0
    }

    fn tension(&self, strain: f64) -> f64 {
        self.ea * (strain + self.stiffening * strain * strain)
    }
}

impl Element<2> for Fibre {
    const NAME: &'static str = "my.fibre";
    const ABOUT: &'static str = "bar that gets stiffer as it is stretched";
    type Force = DVec3;
    type Spec = FibreSpec;

    fn read(spec: FibreSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        build.check_nodes("nodes", &spec.nodes)?;
        let section = build.section("section", &spec.section)?;
        if spec.stiffening < 0.0 {
            return Err(SpecError::new("stiffening", format!("stiffening must not be negative, {} given", spec.stiffening)));
        }
        for pair in spec.nodes.windows(2) {
            Fibre::between([pair[0], pair[1]], &section, spec.stiffening, build);
        }
        Ok(())
    }

    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        let along = (nodes[1].x - nodes[0].x).normalize();
        let pull = along * self.tension(self.strain(&nodes));
        [-pull, pull]
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let e = self.strain(&nodes);
        self.ea * self.rest_length * (0.5 * e * e + self.stiffening * e * e * e / 3.0)
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], _: [NodeMass; 2]) -> [StiffnessBound; 2] {
        let e = self.strain(&nodes);
        let along = self.ea * (1.0 + 2.0 * self.stiffening * e) / self.rest_length;
        let across = self.tension(e) / nodes[0].x.distance(nodes[1].x);
        [StiffnessBound { translation: 2.0 * along.max(across), rotation: 0.0 }; 2]
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 0.5 * self.mass, inertia: 0.0 }; 2]
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        SectionForce { axial: self.tension(self.strain(&nodes)), ..Default::default() }
    }

    fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
        for pair in chain.segments() {
            Fibre::between(pair, &chain.section, STIFFENING, build);
        }
        Ok(())
    }
}
