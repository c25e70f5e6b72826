//! A target penetration, turned into stiffness and a smaller time step.
//!
//! The force between filaments is not known before the run, so the stiffness follows what is seen: at
//! every look at the contacts, while the 99th percentile of the penetration is above the target, all
//! penalties are raised a little, and with them the time step falls as 1 / sqrt(stiffness), as far
//! as the scene lets it. Raising puts energy into the springs that touch; the ledger books it as
//! external work. The friction springs keep their force.
use super::kernel::Penalty;
use super::law::raised;
use super::monitor::summarise;
use super::records::*;
use super::spec::ContactSpec;
use crate::systems::energy::MonitorEvery;
use braid_ecs::prelude::*;

/// Largest factor on the stiffness at one look: the force of a contact jumps by this.
const AT_ONCE: f64 = 1.1;

/// The target, and how far the stiffness has been raised for it.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// 99th percentile of the penetration over the diameter that is aimed at.
    pub penetration: f64,
    /// Largest factor on the stiffness.
    pub most: f64,
    /// Factor on the stiffness so far.
    pub raised: f64,
}

/// Adds the system for scenes with a target.
pub fn install(cx: &mut Install<'_>, spec: &ContactSpec) {
    let Some(target) = &spec.penetration else { return };
    let slower = target.slower.0;
    cx.world.insert_resource(Target { penetration: target.target.0, most: slower * slower, raised: 1.0 });
    cx.remember_resource::<Target>();
    cx.add_system(StepSet::Monitor, stiffen);
}

fn stiffen(world: &mut World) {
    let target = *world.resource::<Target>();
    let seen = *world.resource::<ContactSummary>();
    let depth = 0.5 * seen.p99_penetration_to_radius;
    let fresh = world.resource::<Clock>().step.is_multiple_of(world.resource::<MonitorEvery>().0);
    let factor = (depth / target.penetration).min(AT_ONCE).min(target.most / target.raised);
    if !fresh || seen.active == 0 || factor <= 1.0 + 1e-9 {
        return;
    }
    let before = world.resource::<EnergyLedger>().contact;
    let mut penalty = world.resource_mut::<Penalty>();
    penalty.line_stiffness *= factor;
    penalty.point_stiffness *= factor;
    // The records must not take the change for one of weight; their friction keeps its force.
    for mut s in world.query::<&mut LineState>().iter_mut(world) {
        s.stiffness = raised(s.stiffness, factor);
        s.slip /= factor;
    }
    for mut s in world.query::<&mut PointState>().iter_mut(world) {
        s.stiffness = raised(s.stiffness, factor);
        s.slip /= factor;
    }
    crate::systems::surface::raise_stiffness(world, factor);
    summarise(world);
    let mut ledger = world.resource_mut::<EnergyLedger>();
    ledger.external_work += ledger.contact - before;
    world.resource_mut::<Target>().raised *= factor;
    world.resource_mut::<StiffnessChanged>().0 = true;
}
