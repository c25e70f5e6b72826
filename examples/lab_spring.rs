//! `lab.spring`: a nonlinear spring with a dashpot, as a plugin.
//!
//! With the elongation d = l - L of the rest length L and its rate, the force along the spring is
//! N = k d + k3 d^3 + c dd/dt and the strain energy E = k d^2 / 2 + k3 d^4 / 4 (the hardening Duffing
//! spring; A. H. Nayfeh, D. T. Mook, *Nonlinear Oscillations* (1979), section 4.1). What the dashpot takes goes to the energy ledger.
//!
//! ```sh
//! cargo run --example lab_spring -- examples/scenes/lab_spring.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{Length, Stiffness};
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more kind of element.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the spring.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<Spring, 2>();
    sim.add_installer("lab.spring", install);
}

/// State of one spring.
#[derive(Component, Clone, Debug, Serialize, Deserialize)]
pub struct Spring {
    /// Rest length L (length).
    rest_length: f64,
    /// Stiffness k (force / length).
    stiffness: f64,
    /// Cubic stiffness k3 (force / length^3).
    cubic: f64,
    /// Viscosity c of the dashpot (force x time / length).
    viscosity: f64,
    /// Mass of the whole spring (mass).
    mass: f64,
    /// Length and dashpot force of the step before, if there was one: the work between two steps is
    /// the mean force times the change of length.
    before: Option<(f64, f64)>,
    /// What the dashpot has taken since it was last booked (force x length).
    taken: f64,
}

/// One entry of `elements: { "lab.spring": [...] }`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpringSpec {
    /// Nodes in order; one spring between each and the next.
    nodes: Vec<NodeId>,
    /// Stiffness k (force / length).
    stiffness: Stiffness,
    /// Cubic stiffness k3 (force / length^3). Default 0.
    #[serde(default)]
    cubic: f64,
    /// Viscosity c (force x time / length). Default 0.
    #[serde(default)]
    viscosity: f64,
    /// Rest length (length). Default: the initial distance of the nodes.
    #[serde(default)]
    rest_length: Option<Length>,
}

impl Spring {
    fn new(rest_length: f64, stiffness: f64) -> Self {
        Spring { rest_length, stiffness, cubic: 0.0, viscosity: 0.0, mass: 0.0, before: None, taken: 0.0 }
    }

    /// Elastic force at the length `l` and its derivative.
    fn elastic(&self, l: f64) -> (f64, f64) {
        let d = l - self.rest_length;
        (self.stiffness * d + self.cubic * d * d * d, self.stiffness + 3.0 * self.cubic * d * d)
    }
}

impl Element<2> for Spring {
    const NAME: &'static str = "lab.spring";
    const ABOUT: &'static str = "nonlinear spring with a dashpot between two nodes";
    type Force = DVec3;
    type Spec = SpringSpec;

    fn read(spec: SpringSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        if spec.nodes.len() < 2 {
            return Err(SpecError::new("nodes", format!("a spring joins two nodes, {} given", spec.nodes.len())));
        }
        build.check_nodes("nodes", &spec.nodes)?;
        let stiffness = f64::from(spec.stiffness);
        if stiffness <= 0.0 {
            return Err(SpecError::new("stiffness", format!("stiffness must be above zero, {stiffness} given")));
        }
        let given = spec.rest_length.map(f64::from);
        for (name, value) in [("cubic", spec.cubic), ("viscosity", spec.viscosity), ("rest_length", given.unwrap_or(0.0))] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(SpecError::new(name, format!("{name} must not be negative, {value} given")));
            }
        }
        for pair in spec.nodes.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|n| build.model.nodes[n.row()].position);
            let spring = Spring::new(given.unwrap_or((b - a).length()), stiffness);
            build.model.add_element(Spring { cubic: spec.cubic, viscosity: spec.viscosity, ..spring }, [pair[0], pair[1]]);
        }
        Ok(())
    }

    /// Filaments of generators: a linear spring of stiffness EA / L from every node to the next.
    fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
        for pair in chain.segments() {
            let [a, b] = pair.map(|n| build.model.nodes[n.row()].position);
            let length = (b - a).length();
            let spring = Spring { mass: chain.section.mass * length, ..Spring::new(length, chain.section.ea / length) };
            build.model.add_element(spring, pair);
        }
        Ok(())
    }

    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        let d = nodes[1].x - nodes[0].x;
        let l = d.length();
        let e = d / l;
        let viscous = self.viscosity * e.dot(nodes[1].v - nodes[0].v);
        if let Some((length, force)) = self.before {
            self.taken += 0.5 * (force + viscous) * (l - length);
        }
        self.before = Some((l, viscous));
        let pull = e * (self.elastic(l).0 + viscous);
        [-pull, pull]
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let d2 = ((nodes[1].x - nodes[0].x).length() - self.rest_length).powi(2);
        0.5 * self.stiffness * d2 + 0.25 * self.cubic * d2 * d2
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], masses: [NodeMass; 2]) -> [StiffnessBound; 2] {
        let l = (nodes[1].x - nodes[0].x).length();
        let (pull, slope) = self.elastic(l);
        // Along the spring dN/dl, across it N/l, and the row sums of a spring between two nodes are twice that.
        let k = 2.0 * slope.max(pull / l);
        masses.map(|m| {
            // Velocities lag half a step: with the damping ratio xi the limit shrinks to
            // (2 / omega)(sqrt(1 + xi^2) - xi).
            let xi = if m.mass > 0.0 { self.viscosity / (k * m.mass).sqrt() } else { 0.0 };
            StiffnessBound { translation: k * ((1.0 + xi * xi).sqrt() + xi).powi(2), rotation: 0.0 }
        })
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 0.5 * self.mass, inertia: 0.0 }; 2]
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        SectionForce { axial: self.elastic((nodes[1].x - nodes[0].x).length()).0, ..Default::default() }
    }
}

fn install(cx: &mut Install<'_>) {
    if !cx.model.elements::<Spring, 2>().is_empty() {
        cx.add_system(StepSet::Assembly, book_dashpots);
    }
}

/// What the dashpots have taken goes to the ledger.
fn book_dashpots(mut ledger: ResMut<EnergyLedger>, mut springs: Query<&mut Spring>) {
    for spring in columns(&mut springs).bypass_change_detection() {
        ledger.damping += std::mem::take(&mut spring.taken);
    }
}
