//! `lab.plastic_truss`: a bar of bilinear elasto-plastic material with isotropic hardening, as a plugin.
//!
//! Every bar remembers its plastic strain and how far it has hardened. With the engineering strain e,
//! the plastic strain p and the accumulated plastic strain a: N = EA (e - p), and it yields at
//! |N| = Ny + H a. The stress is returned to the yield surface in one step (J. C. Simo, T. J. R. Hughes,
//! *Computational Inelasticity* (1998), section 1.2, box 1.4). Plastic work is
//! L (Ny a + H a^2 / 2) and goes to the energy ledger.
//!
//! ```sh
//! cargo run --example lab_plastic_truss -- examples/scenes/lab_plastic_truss.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::Force as ForceUnit;
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more kind of element.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the plastic truss.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<PlasticTruss, 2>();
    sim.add_installer("lab.plastic_truss", install);
}

/// State of one bar; saved whole with every checkpoint, so that its history survives a stop.
#[derive(Component, Clone, Debug, Serialize, Deserialize)]
pub struct PlasticTruss {
    /// Rest length L (length).
    rest_length: f64,
    /// Axial stiffness EA (force).
    ea: f64,
    /// Force Ny at which the bar first yields (force).
    yield_force: f64,
    /// Hardening H (force).
    hardening: f64,
    /// Mass per rest length (mass / length).
    mass: f64,
    /// Plastic strain p.
    plastic: f64,
    /// Accumulated plastic strain a.
    accumulated: f64,
    /// Plastic work that has been booked (force x length).
    booked: f64,
}

/// One entry of `elements: { "lab.plastic_truss": [...] }`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlasticTrussSpec {
    /// Nodes in order; one bar between each and the next.
    nodes: Vec<NodeId>,
    /// Name of the section, which gives EA and the mass.
    section: String,
    /// Force at which a bar first yields (force).
    yield_force: ForceUnit,
    /// Slope H of the yield force over the accumulated plastic strain (force). Default 0.
    #[serde(default)]
    hardening: ForceUnit,
}

impl PlasticTruss {
    /// Elastic force at the length `l`.
    fn pull(&self, l: f64) -> f64 {
        self.ea * (l / self.rest_length - 1.0 - self.plastic)
    }

    /// Plastic work so far (force x length).
    fn plastic_work(&self) -> f64 {
        let a = self.accumulated;
        self.rest_length * a * (self.yield_force + 0.5 * self.hardening * a)
    }
}

impl Element<2> for PlasticTruss {
    const NAME: &'static str = "lab.plastic_truss";
    const ABOUT: &'static str = "two-node bar that yields, with isotropic hardening";
    type Force = DVec3;
    type Spec = PlasticTrussSpec;

    fn read(spec: PlasticTrussSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        build.check_nodes("nodes", &spec.nodes)?;
        if spec.nodes.len() < 2 {
            return Err(SpecError::new("nodes", format!("a bar joins two nodes, {} given", spec.nodes.len())));
        }
        let section = build.section("section", &spec.section)?;
        let (yield_force, hardening) = (f64::from(spec.yield_force), f64::from(spec.hardening));
        if yield_force <= 0.0 {
            return Err(SpecError::new("yield_force", format!("yield_force must be above zero, {yield_force} given")));
        }
        if hardening < 0.0 {
            return Err(SpecError::new("hardening", format!("hardening must not be negative, {hardening} given"))
                .help("a bar that softens has no unique answer"));
        }
        for pair in spec.nodes.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|n| build.model.nodes[n.row()].position);
            let bar = PlasticTruss {
                rest_length: (b - a).length(),
                ea: section.ea,
                yield_force,
                hardening,
                mass: section.mass,
                plastic: 0.0,
                accumulated: 0.0,
                booked: 0.0,
            };
            build.model.add_element(bar, [pair[0], pair[1]]);
        }
        Ok(())
    }

    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        let d = nodes[1].x - nodes[0].x;
        let l = d.length();
        let trial = self.pull(l);
        let beyond = trial.abs() - self.yield_force - self.hardening * self.accumulated;
        if beyond > 0.0 {
            let slip = beyond / (self.ea + self.hardening);
            self.plastic += slip * trial.signum();
            self.accumulated += slip;
        }
        let pull = d * (self.pull(l) / l);
        [-pull, pull]
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let pull = self.pull((nodes[1].x - nodes[0].x).length());
        0.5 * self.rest_length * pull * pull / self.ea
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], _masses: [NodeMass; 2]) -> [StiffnessBound; 2] {
        // Yielding only makes the bar softer along its axis; across it the stiffness is N / l.
        let l = (nodes[1].x - nodes[0].x).length();
        let k = (self.ea / self.rest_length).max(self.pull(l) / l);
        [StiffnessBound { translation: 2.0 * k, rotation: 0.0 }; 2]
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 0.5 * self.mass * self.rest_length, inertia: 0.0 }; 2]
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        SectionForce { axial: self.pull((nodes[1].x - nodes[0].x).length()), ..Default::default() }
    }
}

fn install(cx: &mut Install<'_>) {
    if !cx.model.elements::<PlasticTruss, 2>().is_empty() {
        cx.add_system(StepSet::Assembly, book_plastic_work);
    }
}

/// Plastic work goes to the ledger.
fn book_plastic_work(mut ledger: ResMut<EnergyLedger>, mut bars: Query<&mut PlasticTruss>) {
    for bar in columns(&mut bars).bypass_change_detection() {
        let work = bar.plastic_work();
        ledger.damping += work - bar.booked;
        bar.booked = work;
    }
}
