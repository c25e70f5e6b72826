//! How far a state is from equilibrium.
use super::lines::Lines;
use crate::components::*;
use crate::ledger::ContactSummary;
use crate::model::Model;
use crate::simulation::{NodeRows, Simulation};
use crate::step::Clock;
use crate::systems::constraint::Constraints;
use glam::DVec3;

/// Root mean square net force on what can move over that of the section forces, or over the largest
/// contact force if that is larger; `None` where nothing carries a force.
pub fn force_residual(lines: &Lines, sim: &mut Simulation) -> Option<f64> {
    let contact = sim.world.get_resource::<ContactSummary>().map_or(0.0, |c| c.max_force);
    let scale = lines.results(&mut sim.world).typical_force.max(contact);
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
    let mut nodes = sim.world.query::<(&Force, &InverseMass)>();
    let net: Vec<(DVec3, DVec3)> = nodes.iter(&sim.world).map(|(f, w)| (f.0, w.0)).collect();
    let constraints = sim.world.get_resource::<Constraints>()?;
    // A dummy node that shares a dependent with a node that moves has an effective force; its own is kept apart.
    let on = |row: usize, axis: usize| match constraints.border_member(row, axis) {
        Some(j) => constraints.border_residual[j],
        None if net[row].1[axis] > 0.0 => net[row].0[axis],
        None => 0.0,
    };
    let residual =
        dummies.iter().flat_map(|row| (0..3).map(move |axis| (*row, axis))).map(|(row, axis)| on(row, axis).abs()).fold(0.0, f64::max);
    (scale > 0.0).then(|| residual / scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{self, Blind};
    use crate::scene;
    use crate::systems::default_plugins;

    /// An endless bar, pulled through its dummy node.
    const TEXT: &str = r#"(
        units: Consistent,
        sections: { "bar": Stiffness(ea: 100, mass: 1) },
        nodes: [[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        elements: { "truss": [(nodes: [0, 1, 2], section: "bar")] },
        filaments: [(nodes: [0, 1, 2], radius: 0.1)],
        periodic: ( dummies: { "p": [2, 0, 0] }, pairs: [(node: 0, image: 2, dummies: ["p"])] ),
        fixed: [(nodes: [0], dofs: [U]), (nodes: ["p"], dofs: [Uy, Uz]), (nodes: [1], dofs: [Uy, Uz])],
        loads: [(nodes: ["p"], force: [3, 0, 0])],
        integration: (axial: Explicit),
        damping: Mass(5),
        stop: (time: 30),
    )"#;

    #[test]
    fn a_load_that_nothing_carries_yet_is_all_residual() {
        let registry = Simulation::new(default_plugins).registry;
        let loaded = scene::load_text("bar.ron", TEXT.into(), &[], &registry).unwrap_or_else(|e| panic!("{e}"));
        let mut sim = Simulation::new(default_plugins);
        sim.build(&loaded.model).expect("a sound model");
        run::start(&mut sim, &loaded.model).expect("a stable start");
        let lines = Lines::of(&loaded.model, &mut sim);
        assert_eq!(dummy_balance(&loaded.model, &mut sim), Some(1.0));
        assert_eq!(force_residual(&lines, &mut sim), None, "no bar carries a force");
        run::continue_run(&mut sim, &loaded.model, f64::INFINITY, &mut Blind).expect("a stable run");
        let left = dummy_balance(&loaded.model, &mut sim).expect("a load");
        let residual = force_residual(&lines, &mut sim).expect("a tension");
        assert!(left < 1e-9 && residual < 1e-9, "{left} {residual}");
    }
}
