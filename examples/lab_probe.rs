//! A probe and a measure of one's own, as a plugin.
//!
//! The probe `lab.stretch` is the strain between two nodes, l / L - 1 with their initial distance L.
//! The measure `lab.gyration` is the radius of gyration of all masses about their centre,
//! sqrt(sum(m |x - c|^2) / sum(m)), which every run then reports at its end.
//!
//! ```sh
//! cargo run --example lab_probe -- examples/scenes/lab_probe.ron
//! ```
use braid_ecs::measure::position;
use braid_ecs::prelude::*;
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more probe and one more measure.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers both.
pub fn plugin(sim: &mut Simulation) {
    sim.add_probe::<Stretch>();
    sim.add_measure(MeasureKind {
        name: "lab.gyration",
        about: "radius of gyration of all masses about their centre",
        quantity: Quantity::Length,
        take: gyration,
    });
}

/// `Custom(probe: "lab.stretch", settings: (from: ..., to: ...))`.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stretch {
    /// First node.
    from: NodeRef,
    /// Second node.
    to: NodeRef,
    /// What `check` makes of them: the nodes and their initial distance.
    #[serde(skip)]
    resolved: Option<([NodeId; 2], f64)>,
}

impl CustomProbe for Stretch {
    const NAME: &'static str = "lab.stretch";
    const ABOUT: &'static str = "strain between two nodes: change of their distance over the initial one";
    const QUANTITY: Quantity = Quantity::Number;

    fn check(&mut self, model: &Model) -> Result<(), SpecError> {
        let ids = [self.from.resolve("from", model)?, self.to.resolve("to", model)?];
        let [a, b] = ids.map(|n| model.nodes[n.row()].position);
        if a == b {
            return Err(SpecError::new("to", "the two nodes are at the same point").help("a strain needs an initial distance"));
        }
        self.resolved = Some((ids, a.distance(b)));
        Ok(())
    }

    fn value(&self, world: &mut World) -> f64 {
        let ([a, b], length) = self.resolved.expect("probes are checked before they are read");
        position(world, a).distance(position(world, b)) / length - 1.0
    }
}

fn gyration(_: &Model, world: &mut World) -> Option<f64> {
    // Dummy nodes carry a period vector and no place.
    let mut query = world.query_filtered::<(&Position, &Mass), Without<DummyNode>>();
    let nodes: Vec<(DVec3, f64)> = query.iter(world).map(|(x, m)| (x.0, m.0)).collect();
    let mass: f64 = nodes.iter().map(|n| n.1).sum();
    let centre = nodes.iter().map(|(x, m)| *x * *m).sum::<DVec3>() / mass;
    (mass > 0.0).then(|| (nodes.iter().map(|(x, m)| m * x.distance_squared(centre)).sum::<f64>() / mass).sqrt())
}
