//! `lab.drag`: a fluid at rest that brakes nodes, as a plugin with a section of the scene of its own.
//!
//! Every node feels f = -1/2 rho C A |v| v (G. K. Batchelor, *An Introduction to Fluid Dynamics* (1967),
//! section 5.11). A mass m that falls under g comes to v = sqrt(2 m g / (rho C A)), and from rest its
//! velocity is v tanh(g t / v).
//!
//! ```sh
//! cargo run --example lab_drag -- examples/scenes/lab_drag.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{Area, Density, Ratio};
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more section of the scene.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the drag.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Drag>();
    sim.add_installer("lab.drag", install);
}

/// The section `"lab.drag": (...)` of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drag {
    /// Density of the fluid (mass / length^3).
    density: Density,
    /// Drag coefficient C. Default 0.47, a sphere.
    #[serde(default = "sphere")]
    coefficient: Ratio,
    /// Area A that a node shows to the fluid (length^2).
    area: Area,
    /// Nodes that feel it. Default: all.
    #[serde(default)]
    nodes: Option<Vec<NodeRef>>,
}

fn sphere() -> Ratio {
    Ratio(0.47)
}

impl Settings for Drag {
    const KEY: &'static str = "lab.drag";
    const ABOUT: &'static str = "drag of a fluid at rest on nodes, with the square of the velocity";

    fn check(&mut self, build: &mut Build<'_>) -> Result<(), SpecError> {
        for (name, value) in [("density", self.density.0), ("coefficient", self.coefficient.0), ("area", self.area.0)] {
            if value < 0.0 {
                return Err(SpecError::new(name, format!("{name} must not be negative, {value} given")));
            }
        }
        self.ids(build.model).map(|_| ())
    }
}

impl Drag {
    fn ids(&self, model: &Model) -> Result<Vec<NodeId>, SpecError> {
        let Some(list) = &self.nodes else {
            return Ok((0..model.nodes.len()).filter(|i| !model.nodes[*i].dummy).map(|i| NodeId(i as u32)).collect());
        };
        let mut ids = Vec::new();
        for (i, n) in list.iter().enumerate() {
            ids.extend(n.resolve_all(&format!("nodes[{i}]"), model)?);
        }
        Ok(ids)
    }
}

/// What the systems need: the rows of the nodes, in order and each once, and rho C A / 2.
#[derive(Resource)]
struct DragRows {
    rows: Vec<usize>,
    factor: f64,
}

fn install(cx: &mut Install<'_>) {
    let Some(drag) = cx.model.get::<Drag>() else { return };
    let ids = drag.ids(cx.model).expect("checked when the scene was read");
    let mut rows: Vec<usize> = ids.into_iter().map(|n| cx.row(n)).collect();
    rows.sort_unstable();
    rows.dedup();
    if rows.is_empty() {
        return;
    }
    cx.world.insert_resource(DragRows { rows, factor: 0.5 * drag.density.0 * drag.coefficient.0 * drag.area.0 });
    cx.world.get_resource_or_init::<StiffnessSources>().0.push((Drag::KEY, bound));
    cx.add_system(StepSet::Assembly, brake);
}

/// Adds the drag to the forces and its work to the ledger.
fn brake(clock: Res<Clock>, drag: Res<DragRows>, mut ledger: ResMut<EnergyLedger>, mut nodes: Query<(&mut Force, &Velocity)>) {
    let (mut f, v) = columns(&mut nodes);
    let f = f.bypass_change_detection();
    for &row in &drag.rows {
        let v = v[row].0;
        let force = v * (-drag.factor * v.length());
        f[row].0 += force;
        ledger.damping -= force.dot(v) * clock.dt;
    }
}

/// A force -c v with velocities that lag half a step is stable for dt < 2 m / c, as a spring of
/// stiffness c^2 / m is; the slope of the drag is c = rho C A |v|.
fn bound(world: &mut World, out: &mut [StiffnessBound]) {
    let mut query = world.query::<(&Velocity, &Mass)>();
    let slopes: Vec<(f64, f64)> = query.iter(world).map(|(v, m)| (v.0.length(), m.0)).collect();
    let drag = world.resource::<DragRows>();
    for &row in &drag.rows {
        let (speed, mass) = slopes[row];
        if mass > 0.0 {
            out[row].translation += (2.0 * drag.factor * speed).powi(2) / mass;
        }
    }
}
