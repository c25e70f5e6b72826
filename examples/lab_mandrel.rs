//! `lab.mandrel`: a round mandrel about the z axis that turns, as a contact surface of a plugin.
//!
//! A node that is inside by p is pushed out with N = k p, and dragged by Coulomb friction along its velocity relative to the
//! surface, which moves with w x r: f = -mu N v / max(|v|, v0). A filament that lies on it over the angle a and is held at one
//! end feels the belt friction T = T0 exp(mu a) (L. Euler, 1769).
//!
//! ```sh
//! cargo run --example lab_mandrel -- examples/scenes/lab_mandrel.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::{AngularVelocity as Turning, Length, Ratio, Stiffness, Velocity as Speed};
use std::process::ExitCode;

/// The command line of `braid-ecs` with a mandrel that turns.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the mandrel.
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<Mandrel>();
    sim.add_installer("lab.mandrel", install);
}

/// The section `"lab.mandrel": (...)` of a scene.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mandrel {
    /// Radius (length).
    radius: Length,
    /// Angular velocity about +z (radian / time).
    turns_with: Turning,
    /// Penalty stiffness k of a node (force / length).
    stiffness: Stiffness,
    /// Coefficient of friction mu. Default 0.2.
    #[serde(default = "usual")]
    friction: Ratio,
    /// Speed v0 below which friction grows with the speed (length / time).
    creep: Speed,
}

fn usual() -> Ratio {
    Ratio(0.2)
}

impl Settings for Mandrel {
    const KEY: &'static str = "lab.mandrel";
    const ABOUT: &'static str = "a round mandrel about the z axis that turns and drags nodes by friction";

    fn check(&mut self, _: &mut Build<'_>) -> Result<(), SpecError> {
        let positive = [("radius", self.radius.0), ("stiffness", self.stiffness.0), ("creep", self.creep.0)];
        if let Some((name, value)) = positive.into_iter().find(|(_, v)| *v <= 0.0) {
            return Err(SpecError::new(name, format!("{name} must be above zero, {value} given")));
        }
        if self.friction.0 < 0.0 {
            return Err(SpecError::new("friction", format!("friction must not be negative, {} given", self.friction.0)));
        }
        Ok(())
    }
}

/// The mandrel in the world.
#[derive(Resource, Clone, Copy)]
struct Turned {
    radius: f64,
    spin: DVec3,
    stiffness: f64,
    friction: f64,
    creep: f64,
}

/// What the mandrel does to a node.
struct Touch {
    normal: DVec3,
    penetration: f64,
    /// Velocity of the node relative to the surface, along it.
    slides: DVec3,
    /// Velocity of the surface.
    surface: DVec3,
}

impl Turned {
    fn touch(&self, x: DVec3, v: DVec3) -> Option<Touch> {
        let out = DVec3::new(x.x, x.y, 0.0);
        let penetration = self.radius - out.length();
        let normal = out.try_normalize().filter(|_| penetration > 0.0)?;
        let surface = self.spin.cross(out);
        let relative = v - surface;
        Some(Touch { normal, penetration, slides: relative - normal * relative.dot(normal), surface })
    }

    /// Friction force on a node and its largest slope over the relative velocity.
    fn friction(&self, touch: &Touch) -> (DVec3, f64) {
        let slope = self.friction * self.stiffness * touch.penetration / touch.slides.length().max(self.creep);
        (touch.slides * -slope, slope)
    }
}

fn install(cx: &mut Install<'_>) {
    let Some(m) = cx.model.get::<Mandrel>() else { return };
    let spin = DVec3::Z * m.turns_with.0;
    cx.world.insert_resource(Turned { radius: m.radius.0, spin, stiffness: m.stiffness.0, friction: m.friction.0, creep: m.creep.0 });
    cx.world.get_resource_or_init::<StiffnessSources>().0.push((Mandrel::KEY, bound));
    cx.add_system(StepSet::ContactForces, touch);
}

/// Adds the forces of the mandrel; its motor works, and friction takes.
fn touch(clock: Res<Clock>, mandrel: Res<Turned>, mut ledger: ResMut<EnergyLedger>, mut nodes: Query<(&mut Force, &Position, &Velocity)>) {
    let (mut f, x, v) = columns(&mut nodes);
    ledger.contact = 0.0;
    for ((f, x), v) in f.bypass_change_detection().iter_mut().zip(x).zip(v) {
        let Some(touch) = mandrel.touch(x.0, v.0) else { continue };
        let (friction, _) = mandrel.friction(&touch);
        f.0 += touch.normal * (mandrel.stiffness * touch.penetration) + friction;
        ledger.contact += 0.5 * mandrel.stiffness * touch.penetration * touch.penetration;
        ledger.external_work += friction.dot(touch.surface) * clock.dt;
        ledger.friction -= friction.dot(touch.slides) * clock.dt;
    }
}

/// Every node that is near may come to touch; friction counts as a dashpot that lags half a step does, c^2 / m.
fn bound(world: &mut World, out: &mut [StiffnessBound]) {
    let mandrel = *world.resource::<Turned>();
    for (row, (x, v, m)) in world.query::<(&Position, &Velocity, &Mass)>().iter(world).enumerate() {
        out[row].translation += mandrel.stiffness;
        if let Some(touch) = mandrel.touch(x.0, v.0).filter(|_| m.0 > 0.0) {
            out[row].translation += mandrel.friction(&touch).1.powi(2) / m.0;
        }
    }
}
