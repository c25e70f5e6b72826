//! How far a state is from equilibrium.
use super::lines::Lines;
use crate::components::*;
use crate::model::Model;
use crate::simulation::{NodeRows, Simulation};
use crate::step::Clock;
use crate::systems::constraint::Constraints;
use glam::DVec3;

/// Root mean square net force on what can move over that of the section forces; `None` where no
/// section carries a force.
pub fn force_residual(lines: &Lines, sim: &mut Simulation) -> Option<f64> {
    let scale = lines.results(&mut sim.world).typical_force;
    let (mut sum, mut count) = (0.0, 0usize);
    let mut nodes = sim.world.query_filtered::<(&Force, &InverseMass), bevy_ecs::query::Without<DummyNode>>();
    for (f, w) in nodes.iter(&sim.world) {
        if w.0 != DVec3::ZERO {
            // Only the directions in which the node moves on its own.
            sum += (f.0 * w.0.map(|w| if w > 0.0 { 1.0 } else { 0.0 })).length_squared();
            count += 1;
        }
    }
    (scale > 0.0 && count > 0).then(|| (sum / count as f64).sqrt() / scale)
}

/// Largest net force on a free direction of a dummy node over the loads on dummy nodes: how well the
/// tensions that cross the periodic faces balance the given force. `None` without such a load.
pub fn dummy_balance(model: &Model, sim: &mut Simulation) -> Option<f64> {
    let time = sim.world.resource::<Clock>().time;
    let loads = model.loads.iter().filter(|l| model.nodes[l.node.row()].dummy);
    let scale = loads.map(|l| (l.force * model.amplitudes[l.amplitude].at(time)).length()).fold(0.0, f64::max);
    let rows = sim.world.resource::<NodeRows>();
    let dummies: Vec<usize> = (0..model.nodes.len()).filter(|i| model.nodes[*i].dummy).map(|i| rows.of(NodeId(i as u32))).collect();
    let constraints = sim.world.get_resource::<Constraints>()?;
    let residual = (0..constraints.border_len())
        .filter(|j| dummies.contains(&constraints.border_dof(*j).0))
        .map(|j| constraints.border_residual[j].abs())
        .fold(0.0, f64::max);
    (scale > 0.0).then(|| residual / scale)
}
