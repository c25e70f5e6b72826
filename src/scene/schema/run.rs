//! Damping, time integration, the end of the run, what is written and what is expected.
use super::NodeRef;
use crate::scene::units::*;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Damping.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub enum DampingSpec {
    /// No damping.
    None,
    /// Mass damping with alpha = 1/tF, for structures under `load`.
    Auto,
    /// Mass damping f = -alpha m v with the given alpha (1 / time).
    Mass(Rate),
    /// As the slowest mode of the motion needs it; with `load` as `Auto` until the motion has calmed down.
    Adaptive,
    /// All velocities set to zero at every peak of the kinetic energy.
    Kinetic,
}

/// How axial forces are integrated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub enum AxialSpec {
    /// Central differences: the axial wave limits the time step.
    Explicit,
    /// Tensions at the end of the step, from one linear solve per chain: no limit from the axial wave.
    #[default]
    Implicit,
}

/// Rotary inertia of the nodes of beams.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub enum RotaryInertiaSpec {
    /// Factor x nodal mass x (element length)^2: larger time steps, right for equilibria.
    Scaled(Ratio),
    /// That of the section: for torsional dynamics.
    Physical,
}

/// Time integration.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct IntegrationSpec {
    /// `Explicit` or `Implicit` axial forces. Default `Implicit`.
    pub axial: AxialSpec,
    /// Factor on the stable time step, above 0 and below 1. Default 0.9.
    pub safety: Ratio,
    /// Time step (time); refused above the stable limit. Default: safety x limit.
    pub dt: Option<Time>,
    /// Rotary inertia of beam nodes. Default `Scaled(1)`.
    pub rotary_inertia: RotaryInertiaSpec,
    /// Least shear flexibility 12 EI / (GA L^2) of beams. Default 0: that of the section.
    pub shear_flexibility: Ratio,
    /// Longest step of the implicit axial scheme over the stable step of the explicit one. Default 20.
    pub courant: Ratio,
    /// Linear bulk viscosity of explicit axial elements. Default 0; 0.06 is usual.
    pub bulk_viscosity: Ratio,
    /// Steps between two looks at energies, limits and finiteness. Default 64.
    pub monitor_every: u32,
}

impl Default for IntegrationSpec {
    fn default() -> Self {
        let d = crate::model::Integration::default();
        IntegrationSpec {
            axial: AxialSpec::Implicit,
            safety: Ratio(d.safety),
            dt: None,
            rotary_inertia: RotaryInertiaSpec::Scaled(Ratio(1.0)),
            shear_flexibility: Ratio(d.shear_flexibility),
            courant: Ratio(d.courant),
            bulk_viscosity: Ratio(d.bulk_viscosity),
            monitor_every: d.monitor_every,
        }
    }
}

/// Steady state: the watched length changes by less than `change` per `interval`, `repeats` times in a row.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct SteadySpec {
    /// Name of the dummy node whose period vector is watched. Default: the first one; without dummy nodes, the largest speed.
    #[serde(default)]
    pub watch: Option<NodeRef>,
    /// Time between two looks (time). Default tF (with `load`), or what adaptive damping finds.
    #[serde(default)]
    pub interval: Option<Time>,
    /// Largest relative change per interval. Default 2e-4.
    #[serde(default = "change")]
    pub change: Ratio,
    /// Looks in a row. Default 3.
    #[serde(default = "repeats")]
    pub repeats: u32,
    /// Not before this time (time). Default 12 tF (with `load`), the end of all rises where the interval is found, else 0.
    #[serde(default)]
    pub earliest: Option<Time>,
    /// Largest kinetic energy over strain energy. Default: not looked at; 1e-8 where the interval is found.
    #[serde(default)]
    pub kinetic_to_strain: Option<Ratio>,
}

fn change() -> Ratio {
    Ratio(2e-4)
}

fn repeats() -> u32 {
    3
}

impl Default for SteadySpec {
    fn default() -> Self {
        SteadySpec { watch: None, interval: None, change: change(), repeats: repeats(), earliest: None, kinetic_to_strain: None }
    }
}

/// When a run ends: whichever comes first.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct StopSpec {
    /// End time (time). Default 100 tF with `load` and no other criterion.
    pub time: Option<Time>,
    /// Number of steps.
    pub steps: Option<u64>,
    /// Steady state. Default with `load` and no other criterion.
    pub steady: Option<SteadySpec>,
}

/// What becomes of a run that has failed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub enum OnFailure {
    /// It ends; what was computed is kept.
    #[default]
    Stop,
    /// It goes back to its last good state with half the safety factor of the time step, at most so many times.
    Retry(u32),
}

/// What a sound run never shows, and what to do where it shows; `None` looks away.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct WatchSpec {
    /// Largest strain of an element with axial stiffness, in stretching and squeezing. Default 0.5.
    pub strain: Option<Ratio>,
    /// Largest rotation of a node in one step (radian). Default 0.5.
    pub rotation: Option<Ratio>,
    /// Largest share of the energy that is not accounted for. Default 0.5.
    pub balance: Option<Ratio>,
    /// Smallest time step over that of the settled run. Default 1e-3.
    pub time_step: Option<Ratio>,
    /// `Stop` or `Retry(n)`. Default `Stop`.
    pub on_failure: OnFailure,
}

impl Default for WatchSpec {
    fn default() -> Self {
        let crate::model::Watch { strain, rotation, balance, time_step } = crate::model::Watch::default();
        let some = |limit| Some(Ratio(limit));
        WatchSpec {
            strain: some(strain),
            rotation: some(rotation),
            balance: some(balance),
            time_step: some(time_step),
            on_failure: OnFailure::Stop,
        }
    }
}

/// How often something is written.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub enum Sampling {
    /// Never.
    Never,
    /// At the start and the end only.
    Ends,
    /// About this many times, evenly over the expected duration.
    Count(u32),
    /// Every so often (time).
    Every(Time),
    /// Every so many steps.
    Steps(u64),
}

/// What is written into the output folder.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputSpec {
    /// Frames for ParaView. Default `Count(20)`.
    pub frames: Sampling,
    /// Rows of `history.csv`. Default `Count(400)`.
    pub history: Sampling,
    /// Wall-clock time between checkpoints; `None` writes one only when the run is stopped. Default `"10 min"`.
    pub checkpoint: Option<WallTime>,
    /// `initial.png` and `final.png`. Default true.
    pub pictures: bool,
    /// SVG plots of the history. Default true.
    pub plots: bool,
}

impl Default for OutputSpec {
    fn default() -> Self {
        OutputSpec {
            frames: Sampling::Count(20),
            history: Sampling::Count(400),
            checkpoint: Some(WallTime(Duration::from_secs(600))),
            pictures: true,
            plots: true,
        }
    }
}

/// An expected value of a measure or probe.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectSpec {
    /// The value, in the unit in which the probe is reported.
    pub value: Ratio,
    /// Largest relative difference.
    #[serde(default)]
    pub rel: Option<Ratio>,
    /// Largest absolute difference.
    #[serde(default)]
    pub abs: Option<Ratio>,
    /// Where the value comes from.
    #[serde(default)]
    pub source: String,
}
