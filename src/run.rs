//! The loop around the step: start, stop criteria, and what looks on.
use crate::components::{InitialPosition, Mass, Position};
use crate::ledger::EnergyLedger;
use crate::model::{Model, Steady};
use crate::simulation::{Failure, NodeRows, Simulation, SimulationError};
use crate::step::Clock;
use crate::systems::adaptive_damping::NaturalTime;
use crate::systems::axial_implicit::AxialChains;
use crate::systems::energy::LookNow;
use crate::systems::time_step::stable_limit;
use bevy_ecs::prelude::*;
use serde::{Deserialize, Serialize};

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Status {
    /// The steady-state criterion was met.
    Converged,
    /// End time or number of steps reached.
    Completed,
    /// Stopped from outside.
    Stopped,
}

impl Status {
    /// The word in `summary.json` for a run that has failed, which is no way to end.
    pub const FAILED: &'static str = "failed";

    /// The word for it in `summary.json`.
    pub fn word(self) -> &'static str {
        match self {
            Status::Converged => "converged",
            Status::Completed => "completed",
            Status::Stopped => "stopped",
        }
    }
}

/// Looks at a run from outside: outputs, progress bars, tests.
pub trait Observer {
    /// Called after the start, then after every sample interval and once at the end.
    ///
    /// # Errors
    /// Ends the run.
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError>;
    /// Called after the start and after every step, when the whole state can be saved; `ended` tells
    /// why this step is the last one, if the run has reached its end.
    ///
    /// # Errors
    /// Ends the run.
    fn step_done(&mut self, _sim: &mut Simulation, _ended: Option<Status>) -> Result<(), SimulationError> {
        Ok(())
    }
    /// True to stop the run after this step.
    fn stop_requested(&self) -> bool {
        false
    }
}

/// An observer that does nothing.
pub struct Blind;

impl Observer for Blind {
    fn sample(&mut self, _sim: &mut Simulation) -> Result<(), SimulationError> {
        Ok(())
    }
}

/// Finds the stable time step and makes the starting pass: all forces at t = 0 and the first half
/// kick, so that the velocities stand at the half step.
///
/// # Errors
/// A given time step above the limit; a model in which nothing limits the step and none is given.
pub fn start(sim: &mut Simulation, model: &Model) -> Result<(), SimulationError> {
    let (limit, by) = stable_limit(&mut sim.world);
    let dt = match model.integration.dt {
        Some(dt) if dt > limit => {
            return Err(SimulationError::Model(format!("the time step {dt:.6e} is above the stable limit {limit:.6e}, set by {by}")));
        }
        Some(dt) => dt,
        None if limit.is_finite() => {
            // How fast bars will turn is not known before they move.
            let chains = sim.world.get_resource::<AxialChains>().filter(|c| limit >= c.longest_step);
            model.integration.safety * chains.map_or(limit, |c| c.explicit_step)
        }
        None => {
            return Err(SimulationError::Model("nothing in the model limits the time step; give one with integration: (dt: ...)".into()));
        }
    };
    {
        let mut clock = sim.world.resource_mut::<Clock>();
        clock.dt_limit = limit;
        clock.limited_by = by;
        clock.dt_target = dt;
        clock.dt_next = 0.0;
    }
    step(sim)
}

/// Runs to the end of the model's stop criteria. `sample_interval` is the time between two looks of the observer.
///
/// # Errors
/// Numerical failure, or an error of the observer.
pub fn run(sim: &mut Simulation, model: &Model, sample_interval: f64, observer: &mut dyn Observer) -> Result<Status, SimulationError> {
    start(sim, model)?;
    continue_run(sim, model, sample_interval, observer)
}

/// Goes on from the current state to the end of the stop criteria; from a state that was saved
/// during a run, as that run would have.
///
/// # Errors
/// As [`run`].
pub fn continue_run(
    sim: &mut Simulation,
    model: &Model,
    sample_interval: f64,
    observer: &mut dyn Observer,
) -> Result<Status, SimulationError> {
    if begin(sim, model, sample_interval) {
        observer.sample(sim)?;
        observer.step_done(sim, None)?;
    }
    let status = go_on(sim, model, sample_interval, observer);
    sim.world.remove_resource::<RunState>();
    status
}

fn go_on(sim: &mut Simulation, model: &Model, sample_interval: f64, observer: &mut dyn Observer) -> Result<Status, SimulationError> {
    loop {
        let due = due(sim, model);
        step(sim)?;
        if due.sampling {
            observer.sample(sim)?;
        }
        let ended = ended(sim, model, due, sample_interval);
        observer.step_done(sim, ended)?;
        let status = ended.or_else(|| observer.stop_requested().then_some(Status::Stopped));
        if let Some(status) = status {
            if !due.sampling {
                sim.refresh_energies();
                observer.sample(sim)?;
            }
            return Ok(status);
        }
    }
}

/// Puts what the loop remembers into the world, if it is not there; true if it was not.
pub(crate) fn begin(sim: &mut Simulation, model: &Model, sample_interval: f64) -> bool {
    let fresh = !sim.world.contains_resource::<RunState>();
    if fresh {
        let state = RunState::new(sim, model, sample_interval);
        sim.world.insert_resource(state);
    }
    fresh
}

/// What the step about to be made has to look at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Due {
    /// It reaches a sample.
    sampling: bool,
    /// It reaches a look at the steady state.
    deciding: bool,
}

/// What the next step has to look at. The look at the energies belongs to the step that reaches a sample or a decision.
pub(crate) fn due(sim: &mut Simulation, model: &Model) -> Due {
    let clock = sim.world.resource::<Clock>();
    let reached = clock.time + clock.dt_next;
    let state = sim.world.resource::<RunState>();
    let sampling = reached >= state.next_sample || model.stop.time.is_some_and(|t| reached >= t);
    let deciding = model.stop.steady.is_some() && state.steady.as_ref().is_some_and(|s| reached >= s.next);
    if sampling || deciding {
        sim.world.resource_mut::<LookNow>().0 = true;
    }
    Due { sampling, deciding }
}

/// Closes a step: the time of the next sample, and how the run has ended, if it has.
pub(crate) fn ended(sim: &mut Simulation, model: &Model, due: Due, sample_interval: f64) -> Option<Status> {
    let (time, step) = {
        let c = sim.world.resource::<Clock>();
        (c.time, c.step)
    };
    if due.sampling {
        let mut state = sim.world.resource_mut::<RunState>();
        while state.next_sample <= time {
            state.next_sample += sample_interval;
        }
    }
    let stop = &model.stop;
    if due.deciding && steady_state_reached(sim, model, time) {
        Some(Status::Converged)
    } else if stop.time.is_some_and(|t| time >= t * (1.0 - 1e-12))
        || stop.steps.is_some_and(|n| step - sim.world.resource::<RunState>().first >= n)
    {
        Some(Status::Completed)
    } else {
        None
    }
}

/// When the run will probably end (time): end time, steps, or the earliest steady state.
pub fn expected_duration(model: &Model, dt: f64) -> Option<f64> {
    let stop = &model.stop;
    let steady = stop.steady.as_ref().and_then(|s| s.interval.map(|i| s.earliest.max(f64::from(s.repeats + 1) * i)));
    let steps = stop.steps.map(|n| n as f64 * dt);
    [stop.time, steady, steps].into_iter().flatten().filter(|d| d.is_finite() && *d > 0.0).reduce(f64::min)
}

/// One time step.
///
/// # Errors
/// What a system has found broken, with time and step.
pub fn step(sim: &mut Simulation) -> Result<(), SimulationError> {
    sim.step();
    match &sim.world.resource::<Failure>().0 {
        None => Ok(()),
        Some(message) => {
            let c = sim.world.resource::<Clock>();
            Err(SimulationError::Numerical { time: c.time, step: c.step, message: message.clone() })
        }
    }
}

/// What the loop remembers from step to step.
#[derive(Resource, Clone, Debug, Serialize, Deserialize)]
pub struct RunState {
    /// Step with which the run began.
    first: u64,
    /// Time of the next sample.
    next_sample: f64,
    steady: Option<SteadyWatch>,
}

/// Watches a quantity until it stays as it is.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct SteadyWatch {
    next: f64,
    last: f64,
    quiet: u32,
}

impl RunState {
    fn new(sim: &mut Simulation, model: &Model, sample_interval: f64) -> Self {
        let Clock { time, step, .. } = *sim.world.resource::<Clock>();
        let steady =
            model.stop.steady.as_ref().map(|rule| SteadyWatch { next: time + interval(rule, sim), last: watched(rule, sim), quiet: 0 });
        RunState { first: step, next_sample: time + sample_interval, steady }
    }
}

fn steady_state_reached(sim: &mut Simulation, model: &Model, time: f64) -> bool {
    let Some(rule) = &model.stop.steady else { return false };
    let (now, interval) = (watched(rule, sim), interval(rule, sim));
    let energy = *sim.world.resource::<EnergyLedger>();
    let mut state = sim.world.resource_mut::<RunState>();
    let Some(watch) = &mut state.steady else { return false };
    while watch.next <= time {
        watch.next += interval;
    }
    let change = (now - watch.last).abs() / now.abs().max(f64::MIN_POSITIVE);
    watch.last = now;
    let resting = energy.kinetic <= rule.kinetic_to_strain * energy.strain.abs();
    watch.quiet = if change < rule.change && resting { watch.quiet + 1 } else { 0 };
    watch.quiet >= rule.repeats && time >= rule.earliest
}

/// Steps between two looks at the steady state while nothing is known of the natural time.
const UNKNOWN: f64 = 64.0;

/// Time between two looks at the steady state.
fn interval(rule: &Steady, sim: &Simulation) -> f64 {
    rule.interval.unwrap_or_else(|| {
        let clock = sim.world.resource::<Clock>();
        let found = sim.world.get_resource::<NaturalTime>().and_then(|t| t.found);
        // A look at every step would see no change.
        found.unwrap_or(0.0).max(UNKNOWN * clock.dt_target)
    })
}

/// The watched quantity: the length of a period vector, or the root mean square of all displacements.
fn watched(rule: &Steady, sim: &mut Simulation) -> f64 {
    if let Some(dummy) = rule.dummy {
        let row = sim.world.resource::<NodeRows>().of(dummy);
        let mut q = sim.world.query::<&Position>();
        return q.iter(&sim.world).nth(row).expect("dummy nodes have a row").0.length();
    }
    let mut q = sim.world.query::<(&Position, &InitialPosition, &Mass)>();
    let (mut sum, mut mass) = (0.0, 0.0);
    for (x, x0, m) in q.iter(&sim.world) {
        sum += m.0 * (x.0 - x0.0).length_squared();
        mass += m.0;
    }
    if mass > 0.0 { (sum / mass).sqrt() } else { 0.0 }
}
