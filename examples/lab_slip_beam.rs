//! `lab.slip_beam`: a tow as one beam whose filaments stick together until they slip, as a plugin.
//!
//! As long as its filaments stick a tow bends like one solid bar (EI_stuck); when they slide each
//! bends for itself (EI_free, the sum of the filaments). In between friction carries a moment of at most
//! M_s: with the curvature k and the part of it p that has slipped, M = EI_free k + (EI_stuck - EI_free)(k - p)
//! and |(EI_stuck - EI_free)(k - p)| <= M_s (K. O. Papailiou, *IEEE Trans. Power Delivery* 12 (1997)
//! 1576-1588, for cables). A step from outside is brought back to the limit along the moment (radial return).
//! What slips, M_s |dp| per length, goes to the ledger as friction.
//!
//! Two first-party beams in parallel make the element: one with EI_free and everything else, and one
//! of the difference, with the mean curvature of the element only, whose stress-free shape slips.
//!
//! ```sh
//! cargo run --example lab_slip_beam -- examples/scenes/lab_slip_beam.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{BendingStiffness, Moment as MomentUnit};
use braid_ecs::systems::beam::Beam;
use std::collections::BTreeMap;
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more kind of element.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the slipping beam.
pub fn plugin(sim: &mut Simulation) {
    sim.add_element::<SlipBeam, 2>();
    sim.add_installer("lab.slip_beam", install);
}

/// State of one beam.
#[derive(Component, Clone, Debug, Serialize, Deserialize)]
pub struct SlipBeam {
    /// The filaments, each for itself.
    free: Beam,
    /// What they carry more as long as they stick; its `phi0` is what has slipped (radian).
    stuck: Beam,
    /// (EI_stuck - EI_free) / L (force x length).
    difference: f64,
    /// M_s (force x length).
    slip_moment: f64,
    /// Friction since it was last booked (force x length).
    taken: f64,
}

/// One entry of `elements: { "lab.slip_beam": [...] }`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SlipBeamSpec {
    /// Nodes in order; one beam between each and the next.
    nodes: Vec<NodeId>,
    /// Name of the section, with the bending stiffness EI_free, the same about both axes.
    section: String,
    /// EI_stuck (force x length^2), above EI_free.
    stuck: BendingStiffness,
    /// Largest moment that friction carries, M_s (force x length).
    slip_moment: MomentUnit,
}

/// First-party beams along some nodes of a model, without putting them into it.
fn beams(nodes: &[NodeId], section: Section, build: &Build<'_>) -> Result<Vec<(Beam, [NodeId; 2])>, SpecError> {
    let mut scratch = Model::new("scratch");
    scratch.nodes.clone_from(&build.model.nodes);
    let chain = Chain { nodes: nodes.to_vec(), section, natural: NaturalShape::AsBuilt, orientation: None, closed: false };
    let (materials, sections) = (BTreeMap::new(), BTreeMap::new());
    Beam::along(&chain, &mut Build { model: &mut scratch, materials: &materials, sections: &sections })?;
    Ok(scratch.elements::<Beam, 2>().to_vec())
}

impl Element<2> for SlipBeam {
    const NAME: &'static str = "lab.slip_beam";
    const ABOUT: &'static str = "two-node beam of filaments that stick together up to a moment and then slip";
    type Force = Wrench;
    type Spec = SlipBeamSpec;

    fn read(spec: SlipBeamSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        if spec.nodes.len() < 2 {
            return Err(SpecError::new("nodes", format!("a beam joins at least two nodes, {} given", spec.nodes.len())));
        }
        build.check_nodes("nodes", &spec.nodes)?;
        let section = build.section("section", &spec.section)?;
        if section.ei[0] != section.ei[1] {
            return Err(SpecError::new(
                "section",
                "filaments slip alike in all directions only with equal bending stiffnesses about both axes",
            ));
        }
        let more = spec.stuck.0 - section.ei[0];
        if more <= 0.0 {
            return Err(SpecError::new(
                "stuck",
                format!("stuck filaments must be stiffer than free ones: {} is not above {}", spec.stuck.0, section.ei[0]),
            ));
        }
        if spec.slip_moment.0 <= 0.0 {
            return Err(SpecError::new("slip_moment", format!("slip_moment must be above zero, {} given", spec.slip_moment.0)));
        }
        let free = beams(&spec.nodes, section, build)?;
        let stuck = beams(&spec.nodes, Section { ea: 0.0, ei: [more; 2], gj: 0.0, ga: f64::INFINITY, mass: 0.0, inertia: 0.0 }, build)?;
        for ((free, nodes), (mut stuck, _)) in free.into_iter().zip(stuck) {
            // Only the mean curvature sticks and slips.
            stuck.stiffness[1] = [0.0; 6];
            stuck.stiffest = [more, 0.0, 0.0];
            let difference = more / free.rest_length;
            build.model.add_element(SlipBeam { free, stuck, difference, slip_moment: spec.slip_moment.0, taken: 0.0 }, nodes);
        }
        Ok(())
    }

    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [Wrench; 2] {
        let turned = nodes[0].q.inverse() * nodes[1].q;
        // The shorter way round: q and -q are the same rotation.
        let phi = if turned.w < 0.0 { -turned } else { turned }.to_scaled_axis();
        // The direction of the beam in the initial shape: twist about it neither sticks nor slips.
        let chord = self.free.c0;
        let bent = phi - chord * phi.dot(chord);
        let moment = (bent - self.stuck.phi0) * self.difference;
        let beyond = moment.length() - self.slip_moment;
        if beyond > 0.0 {
            let slip = beyond / self.difference;
            self.stuck.phi0 += moment.normalize() * slip;
            self.taken += self.slip_moment * slip;
        }
        let (a, b) = (self.free.internal_force(nodes), self.stuck.internal_force(nodes));
        [0, 1].map(|k| Wrench { force: a[k].force + b[k].force, moment: a[k].moment + b[k].moment })
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        self.free.strain_energy(nodes) + self.stuck.strain_energy(nodes)
    }

    fn stiffness_bound(&self, nodes: [NodeState; 2], masses: [NodeMass; 2]) -> [StiffnessBound; 2] {
        let (a, b) = (self.free.stiffness_bound(nodes, masses), self.stuck.stiffness_bound(nodes, masses));
        [0, 1].map(|k| StiffnessBound { translation: a[k].translation + b[k].translation, rotation: a[k].rotation + b[k].rotation })
    }

    fn mass(&self) -> [NodeMass; 2] {
        self.free.mass()
    }

    fn inertia_length(&self) -> f64 {
        self.free.inertia_length()
    }

    fn section_force(&self, nodes: [NodeState; 2]) -> SectionForce {
        let (a, b) = (self.free.section_force(nodes), self.stuck.section_force(nodes));
        // Exact where both bend about one axis, else an upper bound.
        SectionForce { bending: a.bending + b.bending, ..a }
    }
}

fn install(cx: &mut Install<'_>) {
    if !cx.model.elements::<SlipBeam, 2>().is_empty() {
        cx.add_system(StepSet::Assembly, book_friction);
    }
}

/// What slipping has taken goes to the ledger.
fn book_friction(mut ledger: ResMut<EnergyLedger>, mut beams: Query<&mut SlipBeam>) {
    for beam in columns(&mut beams).bypass_change_detection() {
        ledger.friction += std::mem::take(&mut beam.taken);
    }
}
