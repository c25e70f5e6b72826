//! `lab.pulse`: half a wave, once, as an amplitude of a plugin.
//!
//! A(t) = sin(pi t / T) from t = 0 to T, and 0 afterwards. A force F with it gives a free mass m the velocity
//! 2 F T / (pi m).
//!
//! ```sh
//! cargo run --example lab_pulse -- examples/scenes/lab_pulse.ron
//! ```
use braid_ecs::prelude::*;
use braid_ecs::scene::units::Time;
use std::process::ExitCode;

/// The command line of `braid-ecs` with one more amplitude.
#[allow(dead_code)]
fn main() -> ExitCode {
    braid_ecs::cli::main((braid_ecs::systems::default_plugins, plugin))
}

/// Registers the pulse.
pub fn plugin(sim: &mut Simulation) {
    sim.add_amplitude::<Pulse>();
}

/// `Custom(amplitude: "lab.pulse", settings: (duration: ...))`.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pulse {
    /// Duration T (time).
    duration: Time,
}

impl CustomAmplitude for Pulse {
    const NAME: &'static str = "lab.pulse";
    const ABOUT: &'static str = "half a sine wave, once";

    fn check(&self) -> Result<(), SpecError> {
        let duration = self.duration.0;
        if duration > 0.0 { Ok(()) } else { Err(SpecError::new("duration", format!("duration must be above zero, {duration} given"))) }
    }

    fn at(&self, t: f64) -> f64 {
        let part = t / self.duration.0;
        if (0.0..=1.0).contains(&part) { (std::f64::consts::PI * part).sin() } else { 0.0 }
    }
}
