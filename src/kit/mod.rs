//! A test kit for kinds of elements: what every kernel must hold, whatever it models.
//!
//! | number | what it is | allowed |
//! |---|---|---|
//! | `rigid motion force`, `energy` | of the stress-free element, moved far and turned by large rotations | rounding |
//! | `objectivity` | difference between the forces of a deformed element that is turned, and its turned forces | rounding |
//! | `force is gradient` | difference between the internal force and the central difference of the strain energy | 1e-5 of the largest force |
//! | `force balance`, `moment balance` | sum of the end forces, and of their moments about the origin | rounding |
//! | `time step`, `time step deformed` | stable step from `stiffness_bound` over 2 / omega_max of the element | 0.5 (at rest) to 1 |
//! | `determinism` | state components that differ between 1, 2 and 5 threads | 0 |
//!
//! omega_max is the largest frequency of the tangent stiffness (central differences of the internal
//! force) with the masses that the nodes have in the scene, by power iteration. Central differences of
//! time are stable below 2 / omega_max (T. Belytschko, W. K. Liu, B. Moran, *Nonlinear Finite Elements
//! for Continua and Structures* (2000), section 6.2), and a bound that gives less than half of it
//! wastes more than half of the steps. Nodes are at rest in all of this: give the specimen no viscosity,
//! which may shorten the step further.
//!
//! ```
//! use braid_ecs::kit::Specimen;
//! use braid_ecs::systems::{default_plugins, truss::Truss};
//!
//! let scene = r#"(
//!     units: Si,
//!     sections: {"bar": Stiffness(ea: 1000, mass: 0.1)},
//!     nodes: [[0, 0, 0], [0.5, 0.2, 0]],
//!     elements: {"truss": [(nodes: [0, 1], section: "bar")]},
//!     stop: (steps: 1),
//! )"#;
//! let report = Specimen::<Truss, 2>::of_scene(default_plugins, scene).unwrap().report();
//! assert!(report.holds(), "{report}");
//! ```
mod kernel;
mod threads;

use crate::components;
use crate::element::{Element, NodeForce, NodeMass, NodeState};
use crate::model::Model;
use crate::scene::error::SceneErrors;
use crate::scene::load_text;
use crate::simulation::{NodeRows, Plugin, Simulation, SimulationError};
use glam::DVec3;
use std::fmt;

/// Why no specimen could be taken.
#[derive(Debug, thiserror::Error)]
pub enum KitError {
    /// The scene is wrong.
    #[error("{0}")]
    Scene(#[from] SceneErrors),
    /// The model cannot be built or started.
    #[error("{0}")]
    Simulation(#[from] SimulationError),
    /// The scene has no element of this kind.
    #[error("the scene has no element of kind `{0}`")]
    Absent(&'static str),
    /// The element cannot be tested as it is.
    #[error("element `{kind}` cannot be tested: {why}")]
    Unfit {
        /// The kind.
        kind: &'static str,
        /// What is the matter.
        why: String,
    },
}

/// One number of a report with the values that are right.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What was looked at.
    pub name: &'static str,
    /// What came out.
    pub value: f64,
    /// Smallest value that is right.
    pub least: f64,
    /// Largest value that is right.
    pub most: f64,
    /// What is wrong with the element if the value is not right, and where.
    pub meaning: String,
}

impl Finding {
    /// True if the value is right; NaN is not.
    pub fn holds(&self) -> bool {
        self.value >= self.least && self.value <= self.most
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<21} {:>12.4e}  allowed {:.1e} to {:.1e}", self.name, self.value, self.least, self.most)?;
        if self.holds() { Ok(()) } else { write!(f, "  WRONG: {}", self.meaning) }
    }
}

/// All findings about one kind of element.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The kind.
    pub element: &'static str,
    /// The findings.
    pub findings: Vec<Finding>,
}

impl Report {
    /// True if every number is right.
    pub fn holds(&self) -> bool {
        self.findings.iter().all(Finding::holds)
    }

    /// The number called `name`.
    pub fn value(&self, name: &str) -> Option<f64> {
        self.findings.iter().find(|f| f.name == name).map(|f| f.value)
    }

    /// What is wrong, one text for each number that is not right.
    pub fn errors(&self) -> Vec<String> {
        let say = |f: &Finding| format!("{}: {} is {:.4e}: {}", self.element, f.name, f.value, f.meaning);
        self.findings.iter().filter(|f| !f.holds()).map(say).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "element `{}`", self.element)?;
        self.findings.iter().try_for_each(|x| writeln!(f, "  {x}"))
    }
}

/// One element with its nodes, as a scene has built it. Its initial shape must be free of stress, and
/// deformations of the given size must be elastic.
#[derive(Clone, Debug)]
pub struct Specimen<E: Element<N>, const N: usize> {
    /// The element.
    pub element: E,
    /// Initial positions of its nodes (length).
    pub nodes: [DVec3; N],
    /// Masses of its nodes; an inertia of zero leaves rotations out of the time step.
    pub masses: [NodeMass; N],
    /// Largest displacement of a node over the size of the element, and largest rotation (radian), in
    /// the deformed shapes. Default 0.05; smaller for elements that yield.
    pub deformation: f64,
}

impl<E: Element<N>, const N: usize> Specimen<E, N> {
    /// The first element of the kind in a scene, with the masses that its nodes have there.
    ///
    /// # Errors
    /// A scene that is wrong or has no such element; nodes in one point or without mass.
    pub fn of_scene(plugins: impl Plugin, text: &str) -> Result<Self, KitError> {
        let mut sim = Simulation::new(plugins);
        let loaded = load_text("specimen.ron", text.to_string(), &[], &sim.registry)?;
        let Some((element, ids)) = loaded.model.elements::<E, N>().first().cloned() else { return Err(KitError::Absent(E::NAME)) };
        let nodes = ids.map(|n| loaded.model.nodes[n.row()].position);
        sim.build(&loaded.model)?;
        let mut query = sim.world.query::<(&components::Mass, Option<&components::RotaryInertia>)>();
        let all: Vec<NodeMass> = query.iter(&sim.world).map(|(m, j)| NodeMass { mass: m.0, inertia: j.map_or(0.0, |j| j.0) }).collect();
        let rows = sim.world.resource::<NodeRows>();
        let masses = ids.map(|n| all[rows.of(n)]);
        let specimen = Specimen { element, nodes, masses, deformation: 0.05 };
        specimen.check()?;
        Ok(specimen)
    }

    /// The same with deformed shapes of another size.
    pub fn deformed_by(mut self, deformation: f64) -> Self {
        self.deformation = deformation;
        self
    }

    fn check(&self) -> Result<(), KitError> {
        let unfit = |why: &str| Err(KitError::Unfit { kind: E::NAME, why: why.into() });
        if self.size() <= 0.0 {
            return unfit("its nodes are in one point");
        }
        if self.masses.iter().any(|m| m.mass <= 0.0) {
            return unfit("a node has no mass; give it one with node_masses");
        }
        Ok(())
    }

    /// Largest distance of two nodes (length).
    fn size(&self) -> f64 {
        let d = self.nodes.iter().flat_map(|a| self.nodes.iter().map(move |b| a.distance(*b)));
        d.fold(0.0, f64::max)
    }

    fn rest(&self) -> [NodeState; N] {
        self.nodes.map(NodeState::at)
    }

    /// Degrees of freedom of one node.
    const FREEDOMS: usize = if <E::Force as NodeForce>::ROTATIONS { 6 } else { 3 };

    /// Runs all checks.
    pub fn report(&self) -> Report {
        let mut findings = kernel::findings(self);
        findings.push(threads::finding(self));
        Report { element: E::NAME, findings }
    }

    /// A model of many such elements side by side, two on every set of nodes, in motion.
    fn crowd(&self, count: usize) -> Model {
        let mut model = Model::new("crowd");
        let pitch = 3.0 * self.size();
        for k in 0..count {
            let shift = DVec3::new((k % 32) as f64, (k / 32) as f64, 0.0) * pitch;
            let mut at = 0;
            let ids = self.nodes.map(|x| {
                let id = model.add_node(x + shift);
                let node = &mut model.nodes[id.row()];
                node.added_mass = self.masses[at].mass;
                node.added_inertia = self.masses[at].inertia;
                at += 1;
                id
            });
            model.add_element(self.element.clone(), ids);
            model.add_element(self.element.clone(), ids);
        }
        model.integration.axial = crate::model::AxialScheme::Explicit;
        model
    }
}
