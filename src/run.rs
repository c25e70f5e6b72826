//! The loop around the step: start, stop criteria, and what looks on.
use crate::components::{InitialPosition, Mass, Position};
use crate::ledger::EnergyLedger;
use crate::model::{Model, Steady};
use crate::simulation::{Failure, NodeRows, Simulation, SimulationError};
use crate::step::Clock;
use crate::systems::energy::LookNow;
use crate::systems::time_step::stable_limit;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The steady-state criterion was met.
    Converged,
    /// End time or number of steps reached.
    Completed,
    /// Stopped from outside.
    Stopped,
}

/// Looks at a run from outside: outputs, progress bars, tests.
pub trait Observer {
    /// Called after the start, then after every sample interval and once at the end.
    ///
    /// # Errors
    /// Ends the run.
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError>;
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
        None if limit.is_finite() => model.integration.safety * limit,
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
    sim.step();
    check(sim)
}

/// Runs to the end of the model's stop criteria. `sample_interval` is the time between two looks of the observer.
///
/// # Errors
/// Numerical failure, or an error of the observer.
pub fn run(sim: &mut Simulation, model: &Model, sample_interval: f64, observer: &mut dyn Observer) -> Result<Status, SimulationError> {
    start(sim, model)?;
    continue_run(sim, model, sample_interval, observer)
}

/// Goes on from the current state to the end of the stop criteria.
///
/// # Errors
/// As [`run`].
pub fn continue_run(
    sim: &mut Simulation,
    model: &Model,
    sample_interval: f64,
    observer: &mut dyn Observer,
) -> Result<Status, SimulationError> {
    let stop = &model.stop;
    let mut steady = stop.steady.clone().map(|s| SteadyWatch::new(s, sim));
    let first = sim.world.resource::<Clock>().step;
    let mut next_sample = sim.world.resource::<Clock>().time + sample_interval;
    observer.sample(sim)?;
    loop {
        let (time, dt) = {
            let c = sim.world.resource::<Clock>();
            (c.time, c.dt_next)
        };
        // The look at the energies belongs to the step that reaches a sample or a decision.
        let sampling = time + dt >= next_sample || stop.time.is_some_and(|t| time + dt >= t);
        let deciding = steady.as_ref().is_some_and(|s| time + dt >= s.next);
        if sampling || deciding {
            sim.world.resource_mut::<LookNow>().0 = true;
        }
        sim.step();
        check(sim)?;
        let (time, step) = {
            let c = sim.world.resource::<Clock>();
            (c.time, c.step)
        };
        if sampling {
            observer.sample(sim)?;
            while next_sample <= time {
                next_sample += sample_interval;
            }
        }
        let status = if observer.stop_requested() {
            Some(Status::Stopped)
        } else if steady.as_mut().is_some_and(|s| s.reached(time, sim)) {
            Some(Status::Converged)
        } else if stop.time.is_some_and(|t| time >= t * (1.0 - 1e-12)) || stop.steps.is_some_and(|n| step - first >= n) {
            Some(Status::Completed)
        } else {
            None
        };
        if let Some(status) = status {
            if !sampling {
                sim.refresh_energies();
                observer.sample(sim)?;
            }
            return Ok(status);
        }
    }
}

fn check(sim: &Simulation) -> Result<(), SimulationError> {
    match &sim.world.resource::<Failure>().0 {
        None => Ok(()),
        Some(message) => {
            let c = sim.world.resource::<Clock>();
            Err(SimulationError::Numerical { time: c.time, step: c.step, message: message.clone() })
        }
    }
}

struct SteadyWatch {
    rule: Steady,
    next: f64,
    last: f64,
    quiet: u32,
}

impl SteadyWatch {
    fn new(rule: Steady, sim: &mut Simulation) -> Self {
        let time = sim.world.resource::<Clock>().time;
        let last = watched(&rule, sim);
        SteadyWatch { next: time + rule.interval, rule, last, quiet: 0 }
    }

    fn reached(&mut self, time: f64, sim: &mut Simulation) -> bool {
        if time < self.next {
            return false;
        }
        while self.next <= time {
            self.next += self.rule.interval;
        }
        let now = watched(&self.rule, sim);
        let change = (now - self.last).abs() / now.abs().max(f64::MIN_POSITIVE);
        self.last = now;
        let energy = sim.world.resource::<EnergyLedger>();
        let resting = energy.kinetic <= self.rule.kinetic_to_strain * energy.strain.abs();
        self.quiet = if change < self.rule.change && resting { self.quiet + 1 } else { 0 };
        self.quiet >= self.rule.repeats && time >= self.rule.earliest
    }
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
