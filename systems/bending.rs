//! Rotation-free bending: three consecutive nodes of a round, naturally straight filament.
//!
//! With unit vectors e1, e2 along the two segments of lengths l1, l2 and l = (l1 + l2)/2 the
//! curvature binormal is kb = 2 e1 x e2 / (1 + e1 . e2), |kb| = 2 tan(angle/2), and the energy
//! E = EI |kb|^2 / (2 l) (M. Bergou, M. Wardetzky, S. Robinson, B. Audoly, E. Grinspun, *ACM Trans.
//! Graph.* 27 (2008) 63, discrete elastic rods without twist). Exact in the limit of small elements for a straight
//! stress-free shape without torsional load; it is not valid for a curved stress-free shape, which
//! would need the twist, and the reader refuses that.
use braid_ecs::prelude::*;

/// Registers rotation-free bending.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<Bending, 3>();
}

/// State of one three-node bending element.
#[derive(Component, Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Bending {
    /// EI over the rest length of the node (force x length).
    pub stiffness: f64,
    /// Mean rest length of the two segments (length).
    pub length: f64,
}

/// One entry of `elements: { "bending": [...] }`.
#[derive(Deserialize, Clone, Debug)]
#[serde(deny_unknown_fields)]
pub struct BendingSpec {
    /// At least three nodes in order; one element around each inner node.
    pub nodes: Vec<NodeId>,
    /// Name of the section; its two bending stiffnesses must be equal.
    pub section: String,
    /// True if the chain is closed.
    #[serde(default)]
    pub closed: bool,
    /// Stress-free shape; only `Straight()` is valid unless the chain is built straight.
    #[serde(default)]
    pub natural: NaturalShape,
}

impl Element<3> for Bending {
    const NAME: &'static str = "bending";
    const ABOUT: &'static str = "three-node bending without rotations: round, naturally straight filaments without torsion";
    type Force = DVec3;
    type Spec = BendingSpec;

    fn read(spec: BendingSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        build.check_nodes("nodes", &spec.nodes)?;
        let section = build.section("section", &spec.section)?;
        Bending::along(&Chain { nodes: spec.nodes, section, natural: spec.natural, orientation: None, closed: spec.closed }, build)
    }

    fn along(chain: &Chain, build: &mut Build<'_>) -> Result<(), SpecError> {
        if chain.nodes.len() < 3 {
            return Err(SpecError::new("nodes", format!("bending needs at least three nodes, {} given", chain.nodes.len())));
        }
        if chain.section.ei[0] != chain.section.ei[1] {
            return Err(
                SpecError::new("section", "rotation-free bending needs equal bending stiffnesses about both axes").help("use `beam`")
            );
        }
        let n = chain.nodes.len();
        let mut triples: Vec<[NodeId; 3]> = chain.nodes.windows(3).map(|w| [w[0], w[1], w[2]]).collect();
        if chain.closed {
            triples.push([chain.nodes[n - 2], chain.nodes[n - 1], chain.nodes[0]]);
            triples.push([chain.nodes[n - 1], chain.nodes[0], chain.nodes[1]]);
        }
        let position = |id: NodeId| build.model.nodes[id.row()].position;
        let mut elements = Vec::new();
        for t in triples {
            let (d1, d2) = (position(t[1]) - position(t[0]), position(t[2]) - position(t[1]));
            let turn = d1.cross(d2).length() / (d1.length() * d2.length());
            if chain.natural == NaturalShape::AsBuilt && turn > 1e-6 {
                return Err(SpecError::new(
                    "natural",
                    format!("the chain turns by {:.3} degrees at node {}, but rotation-free bending is valid only for a straight stress-free shape", turn.asin().to_degrees(), t[1].0),
                )
                .help("use `beam` for a curved stress-free shape (leaving out the torsion changes the angle of a braid by 9 %), or natural: Straight()"));
            }
            let length = 0.5 * (d1.length() + d2.length());
            elements.push((Bending { stiffness: chain.section.ei[0] / length, length }, t));
        }
        for (e, t) in elements {
            build.model.add_element(e, t);
        }
        Ok(())
    }

    #[inline]
    fn internal_force(&mut self, nodes: [NodeState; 3]) -> [DVec3; 3] {
        alone(self, nodes)
    }

    #[inline]
    fn internal_forces(elements: &mut [Self], rows: &[Connectivity<3>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 3>]) {
        in_lanes(elements, rows, nodes, out);
    }

    fn strain_energy(&self, nodes: [NodeState; 3]) -> f64 {
        let (e1, e2) = ((nodes[1].x - nodes[0].x).normalize(), (nodes[2].x - nodes[1].x).normalize());
        // 1 - c from the difference keeps its digits for small angles.
        let one_minus_c = 0.5 * (e2 - e1).length_squared();
        0.5 * self.stiffness * 4.0 * one_minus_c / (2.0 - one_minus_c)
    }

    fn stiffness_bound(&self, nodes: [NodeState; 3], _masses: [NodeMass; 3]) -> [StiffnessBound; 3] {
        // K = (EI/l^3) g g^t with g = (1, -2, 1) for equal segments: row sums 4, 8, 4 times EI/l^3.
        let l = (nodes[1].x - nodes[0].x).length().min((nodes[2].x - nodes[1].x).length());
        let (e1, e2) = ((nodes[1].x - nodes[0].x).normalize(), (nodes[2].x - nodes[1].x).normalize());
        let steep = (2.0 / (1.0 + e1.dot(e2))).powi(2);
        let k = self.stiffness / (l * l) * steep;
        [4.0, 8.0, 4.0].map(|f| StiffnessBound { translation: f * k, rotation: 0.0 })
    }

    fn mass(&self) -> [NodeMass; 3] {
        [NodeMass::default(); 3]
    }

    fn section_force(&self, nodes: [NodeState; 3]) -> SectionForce {
        let (e1, e2) = ((nodes[1].x - nodes[0].x).normalize(), (nodes[2].x - nodes[1].x).normalize());
        SectionForce { bending: self.stiffness * 2.0 * e1.cross(e2).length() / (1.0 + e1.dot(e2)), ..Default::default() }
    }
}

impl LaneElement<3> for Bending {
    #[inline(always)]
    fn at_once<L: Lane>(elements: &[Self], rows: &[Connectivity<3>], nodes: impl NodeColumns, out: &mut [EndForces<Self, 3>]) {
        let one = L::splat(1.0);
        let [d1, d2] = [0, 1].map(|k| V3::<L>::gather(|l| nodes.x(rows[l].0[k + 1]) - nodes.x(rows[l].0[k])));
        let (l1, l2) = (one / d1.dot(d1).sqrt(), one / d2.dot(d2).sqrt());
        let (e1, e2) = (d1 * l1, d2 * l2);
        let c = e1.dot(e2);
        // |kb|^2 = 4 (1 - c) / (1 + c), so dE/dc = -4 EI/l / (1 + c)^2.
        let slope = L::from_fn(|l| -4.0 * elements[l].stiffness) / ((one + c) * (one + c));
        let g1 = (e2 - e1 * c) * (slope * l1);
        let g2 = (e1 - e2 * c) * (slope * l2);
        g1.each(|l, g| (out[l].0[0], out[l].0[1]) = (-g, g));
        g2.each(|l, g| {
            out[l].0[1] -= g;
            out[l].0[2] = g;
        });
    }
}
