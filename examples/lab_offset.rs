//! `lab.offset`: a node on a rigid arm, as a plugin with a constraint of its own.
//!
//! The node at the end of an arm follows the node at its root, x = x_root + q r with r the arm at the start and q the rotation of
//! the root (*impose*). What acts on it goes to the root, f and r x f (*condense*), which is the transpose of that. Arms are
//! light: a mass at the end counts as m and m r^2 at the root, without the coupling between the two. Equilibria are right for any mass.
//!
//! ```sh
//! cargo run --example lab_offset -- examples/scenes/lab_offset.ron
//! ```
use braid_ecs::prelude::*;
use std::process::ExitCode;

/// The command line of `braid-ecs` with rigid arms.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the arms.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Offsets>();
    sim.add_installer("lab.offset", install);
}

/// The section `"lab.offset": (arms: [(node: "end", root: "tip")])` of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Offsets {
    /// The arms.
    arms: Vec<ArmSpec>,
}

/// One arm.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmSpec {
    /// The node at its end.
    node: NodeRef,
    /// The node that carries it.
    root: NodeRef,
}

impl Settings for Offsets {
    const KEY: &'static str = "lab.offset";
    const ABOUT: &'static str = "rigid arms: nodes that follow the motion and the rotation of others";

    fn check(&mut self, build: &mut Build<'_>) -> Result<(), SpecError> {
        for (i, arm) in self.arms.iter().enumerate() {
            let [node, root] = arm.ids(i, build.model)?;
            if node == root {
                return Err(SpecError::new(format!("arms[{i}].root"), "an arm does not end at its own root"));
            }
            let taken = self.arms[..i].iter().enumerate().any(|(k, other)| other.ids(k, build.model).is_ok_and(|o| o.contains(&node)))
                || self.arms[..i].iter().enumerate().any(|(k, other)| other.ids(k, build.model).is_ok_and(|o| o[0] == root));
            if taken {
                return Err(SpecError::new(format!("arms[{i}]"), "an arm neither begins nor ends at the end of another one"));
            }
        }
        Ok(())
    }
}

impl ArmSpec {
    fn ids(&self, i: usize, model: &Model) -> Result<[NodeId; 2], SpecError> {
        Ok([self.node.resolve(&format!("arms[{i}].node"), model)?, self.root.resolve(&format!("arms[{i}].root"), model)?])
    }
}

/// The arms by rows: end, root, and the arm at the start.
#[derive(Resource)]
struct Arms(Vec<(usize, usize, DVec3)>);

fn install(cx: &mut Install<'_>) {
    let Some(offsets) = cx.model.get::<Offsets>() else { return };
    if !cx.rotations() {
        cx.world.resource_mut::<Failure>().0 = Some("lab.offset: arms need nodes with rotations, as beams have them".into());
        return;
    }
    let mut arms = Vec::new();
    for (i, arm) in offsets.arms.iter().enumerate() {
        let [node, root] = arm.ids(i, cx.model).expect("checked when the scene was read");
        arms.push((cx.row(node), cx.row(root), cx.model.nodes[node.row()].position - cx.model.nodes[root.row()].position));
    }
    let mut masses = cx.world.query::<(&Mass, &RotaryInertia, &mut InverseMass, &mut InverseInertia)>();
    let mut nodes: Vec<_> = masses.iter_mut(cx.world).collect();
    // A root with several arms carries all of them.
    let mut carried = vec![[0.0; 2]; nodes.len()];
    for (end, root, arm) in &arms {
        let (mass, inertia) = (nodes[*end].0.0, nodes[*end].1.0);
        carried[*root][0] += mass;
        carried[*root][1] += inertia + mass * arm.length_squared();
        *nodes[*end].2 = InverseMass(DVec3::ZERO);
        *nodes[*end].3 = InverseInertia(DVec3::ZERO);
    }
    for (node, more) in nodes.iter_mut().zip(carried) {
        let with = |w: DVec3, more: f64| w.map(|w| if w > 0.0 { 1.0 / (1.0 / w + more) } else { 0.0 });
        node.2.0 = with(node.2.0, more[0]);
        node.3.0 = with(node.3.0, more[1]);
    }
    cx.world.insert_resource(Arms(arms));
    cx.add_constraint(impose, condense);
    cx.add_system(StepSet::Dynamics, follow);
}

type Nodes = (&'static mut Position, &'static mut Velocity, &'static mut Orientation, &'static mut AngularVelocity);

/// Ends of arms go where their roots take them; their velocities are those of the step just made, which loads do their work with.
fn impose(clock: Res<Clock>, arms: Res<Arms>, mut before: Local<Vec<DVec3>>, mut nodes: Query<Nodes>) {
    let (mut x, mut v, mut q, mut w) = columns(&mut nodes);
    before.clear();
    for (end, root, arm) in &arms.0 {
        // Kinematics has moved the end with its old velocity; take that back.
        before.push(x[*end].0 - v[*end].0 * clock.dt);
        x[*end].0 = x[*root].0 + q[*root].0 * *arm;
        q[*end] = q[*root];
        w[*end] = w[*root];
    }
    if clock.dt > 0.0 {
        for ((end, _, _), before) in arms.0.iter().zip(before.iter()) {
            v[*end].0 = (x[*end].0 - *before) / clock.dt;
        }
    }
}

/// Forces and moments at the ends go to the roots.
fn condense(arms: Res<Arms>, mut nodes: Query<(&Position, &mut Force, &mut Moment)>) {
    let (x, mut f, mut m) = columns(&mut nodes);
    for (end, root, _) in &arms.0 {
        let (force, moment) = (std::mem::take(&mut f[*end].0), std::mem::take(&mut m[*end].0));
        f[*root].0 += force;
        m[*root].0 += moment + (x[*end].0 - x[*root].0).cross(force);
    }
}

/// After the kick the ends have the velocities of their roots.
fn follow(arms: Res<Arms>, mut nodes: Query<(&Position, &mut Velocity, &mut AngularVelocity)>) {
    let (x, mut v, mut w) = columns(&mut nodes);
    for (end, root, _) in &arms.0 {
        v[*end].0 = v[*root].0 + w[*root].0.cross(x[*end].0 - x[*root].0);
        w[*end] = w[*root];
    }
}
