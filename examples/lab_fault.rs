//! `lab.foundation`: nodes on springs to where they began, with a fault planted for `braid-ecs step` to find.
//!
//! Every node feels f = -k (x - X). One sign below is wrong; [`src/stepper/README.md`](../src/stepper/README.md) finds it at
//! the prompt. A mass m under a constant force F should swing between 0 and 2 F / k.
//!
//! ```sh
//! cargo run --example lab_fault -- step examples/scenes/lab_fault.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::Stiffness;
use std::process::ExitCode;

/// The command line of `braid-ecs` with a force that is wrong.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the foundation.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Foundation>();
    sim.add_units::<Springs>(&[("stiffness", "force / length"), ("energy", "energy")]);
    sim.add_installer("lab.foundation", install);
}

/// The section `"lab.foundation": (...)` of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Foundation {
    /// Stiffness k of the spring of every node (force / length).
    stiffness: Stiffness,
}

impl Settings for Foundation {
    const KEY: &'static str = "lab.foundation";
    const ABOUT: &'static str = "springs that should pull every node back to where it began, with a planted fault";

    fn check(&mut self, _: &mut Build<'_>) -> Result<(), SpecError> {
        let k = self.stiffness.0;
        if k > 0.0 { Ok(()) } else { Err(SpecError::new("stiffness", format!("stiffness must be above zero, {k} given"))) }
    }
}

/// Stiffness of the springs, and the energy in them.
#[derive(Resource, Clone, Copy, Debug, Serialize, Deserialize)]
struct Springs {
    stiffness: f64,
    energy: f64,
}

fn install(cx: &mut Install<'_>) {
    let Some(foundation) = cx.model.get::<Foundation>() else { return };
    cx.world.insert_resource(Springs { stiffness: foundation.stiffness.0, energy: 0.0 });
    cx.remember_resource::<Springs>();
    cx.add_system(StepSet::Assembly, pull_back);
}

/// Adds the forces of the springs.
fn pull_back(mut springs: ResMut<Springs>, mut nodes: Query<(&mut Force, &Position, &InitialPosition)>) {
    let (mut f, x, start) = columns(&mut nodes);
    springs.energy = 0.0;
    for ((f, x), start) in f.bypass_change_detection().iter_mut().zip(x).zip(start) {
        let moved = x.0 - start.0;
        // The planted fault: it must be minus.
        f.0 += moved * springs.stiffness;
        springs.energy += 0.5 * springs.stiffness * moved.length_squared();
    }
}
