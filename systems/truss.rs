//! Two-node truss: a bar that carries axial force only, in tension and compression, under
//! arbitrarily large displacements.
//!
//! With the current length l, the rest length L and the unit vector e from node 1 to node 2:
//! N = EA (l/L - 1) (engineering strain, moment of the reference section), internal force
//! dE/dx_2 = N e = -dE/dx_1, strain energy E = EA L (l/L - 1)^2 / 2.
//! Source: M. A. Crisfield, *Non-linear Finite Element Analysis of Solids and Structures*, vol. 1
//! (1991), chapter 3.
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{Force, Length};

/// Registers the truss.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<Truss, 2>();
}

/// State of one truss element.
#[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Truss {
    /// Rest length L (length).
    pub rest_length: f64,
    /// Axial stiffness EA (force); zero after the implicit scheme has taken it over.
    pub ea: f64,
    /// EA of the section, kept for output (force).
    pub full_ea: f64,
    /// Mass per unit rest length (mass / length).
    pub mass: f64,
    /// Damping force per rate of stretch, from the linear bulk viscosity (force x time / length).
    pub viscosity: f64,
}

/// One entry of `elements: { "truss": [...] }`.
#[derive(Deserialize, Clone, Debug)]
#[serde(deny_unknown_fields)]
pub struct TrussSpec {
    /// Nodes in order; one element between each and the next.
    pub nodes: Vec<NodeId>,
    /// Name of the section.
    pub section: String,
    /// Rest length of every element (length); by default the initial distance of its nodes.
    #[serde(default)]
    pub rest_length: Option<Length>,
    /// Initial tension (force), instead of a rest length.
    #[serde(default)]
    pub tension: Option<Force>,
}

impl Truss {
    fn new(rest_length: f64, section: &Section, bulk_viscosity: f64) -> Self {
        // f = b rho c A dl/dt, with rho A c = sqrt(mass EA): the linear bulk viscosity of explicit codes.
        let viscosity = bulk_viscosity * (section.mass * section.ea).sqrt();
        Truss { rest_length, ea: section.ea, full_ea: section.ea, mass: section.mass, viscosity }
    }
}

impl Element<2> for Truss {
    const NAME: &'static str = "truss";
    const ABOUT: &'static str = "two-node bar: axial force under large displacements, no bending";
    type Force = DVec3;
    type Spec = TrussSpec;

    fn read(spec: TrussSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        if spec.nodes.len() < 2 {
            return Err(SpecError::new("nodes", format!("a truss joins at least two nodes, {} given", spec.nodes.len())));
        }
        build.check_nodes("nodes", &spec.nodes)?;
        let section = build.section("section", &spec.section)?;
        if spec.rest_length.is_some() && spec.tension.is_some() {
            return Err(SpecError::new("tension", "give either `rest_length` or `tension`, not both"));
        }
        let (rest_length, tension) = (spec.rest_length.map(f64::from), spec.tension.map(f64::from));
        if let Some(l) = rest_length
            && !(l > 0.0 && l.is_finite())
        {
            return Err(SpecError::new("rest_length", format!("rest_length must be positive, {l} given")));
        }
        for pair in spec.nodes.windows(2) {
            let length = (build.model.nodes[pair[1].row()].position - build.model.nodes[pair[0].row()].position).length();
            let rest = match (rest_length, tension) {
                (Some(l), _) => l,
                (None, Some(n)) if n > -section.ea && n.is_finite() => length / (1.0 + n / section.ea),
                (None, Some(n)) => {
                    return Err(SpecError::new("tension", format!("tension {n} is not above -EA = {}", -section.ea)));
                }
                (None, None) => length,
            };
            let viscosity = build.model.integration.bulk_viscosity;
            build.model.add_element(Truss::new(rest, &section, viscosity), [pair[0], pair[1]]);
        }
        Ok(())
    }

    fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
        let viscosity = build.model.integration.bulk_viscosity;
        for pair in chain.segments() {
            let length = (build.model.nodes[pair[1].row()].position - build.model.nodes[pair[0].row()].position).length();
            build.model.add_element(Truss::new(length, &chain.section, viscosity), pair);
        }
        Ok(())
    }

    #[inline]
    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        alone(self, nodes)
    }

    #[inline]
    fn internal_forces(elements: &mut [Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        in_lanes(elements, rows, nodes, out);
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let strain = (nodes[1].x - nodes[0].x).length() / self.rest_length - 1.0;
        0.5 * self.ea * self.rest_length * strain * strain
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], _masses: [NodeMass; 2]) -> [StiffnessBound; 2] {
        // K = (EA/L) e e^T + (N/l)(I - e e^T) between the two nodes; K_e <= 2 max(...) I.
        let l = (nodes[1].x - nodes[0].x).length();
        let tension = (self.full_ea * (l / self.rest_length - 1.0)).max(0.0);
        let k = (self.ea / self.rest_length).max(tension / l);
        [StiffnessBound { translation: 2.0 * k, rotation: 0.0 }; 2]
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 0.5 * self.mass * self.rest_length, inertia: 0.0 }; 2]
    }

    fn axial_spring(&self) -> Option<AxialSpring> {
        (self.ea > 0.0).then_some(AxialSpring { rest_length: self.rest_length, ea: self.ea })
    }

    fn release_axial(&mut self) {
        self.ea = 0.0;
        self.viscosity = 0.0;
    }

    fn rests(&self) -> bool {
        self.ea == 0.0 && self.viscosity == 0.0
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        let l = (nodes[1].x - nodes[0].x).length();
        SectionForce { axial: self.full_ea * (l / self.rest_length - 1.0), ..Default::default() }
    }
}

impl LaneElement<2> for Truss {
    #[inline(always)]
    fn at_once<L: Lane>(bars: &[Self], rows: &[Connectivity<2>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 2>]) {
        let d = V3::<L>::gather(|l| nodes.x(rows[l].0[1]) - nodes.x(rows[l].0[0]));
        let [ea, rest_length, viscosity, _] = L::rows(|l| [bars[l].ea, bars[l].rest_length, bars[l].viscosity, 0.0]);
        let length = d.dot(d).sqrt();
        let e = d * (L::splat(1.0) / length);
        let mut n = ea * (length / rest_length - L::splat(1.0));
        if L::any(L::splat(0.0).less(viscosity)) {
            let v = V3::<L>::gather(|l| nodes.v(rows[l].0[1]) - nodes.v(rows[l].0[0]));
            n = n + viscosity * e.dot(v);
        }
        let pull = e * n;
        pull.each(|l, pull| out[l].0 = [-pull, pull]);
    }
}
