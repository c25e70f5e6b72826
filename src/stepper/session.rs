//! A session: a simulation between or within its steps, and the ways to move it in time.
use super::drive::Driver;
use super::expression::Expression;
use super::past::Past;
use super::stops::{On, Stop};
use super::text::{number, quantity};
use crate::output::measured::unit;
use crate::registry::SpecError;
use crate::run::{self, Due};
use crate::scene::LoadedScene;
use crate::simulation::{Failure, Simulation, SimulationError};
use crate::step::Clock;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A state with a name.
pub(super) struct Snapshot {
    pub step: u64,
    pub state: Vec<u8>,
    pub modified: Option<u64>,
}

/// A simulation under the hands of a person.
pub struct Session {
    pub(super) sim: Simulation,
    pub(super) scene: LoadedScene,
    pub(super) driver: Driver,
    pub(super) past: Past,
    pub(super) stops: Vec<Stop>,
    pub(super) snapshots: BTreeMap<String, Snapshot>,
    /// Step from which on the run is not that of the scene any more, because somebody changed something.
    pub(super) modified: Option<u64>,
    /// Within a step: what it has to look at, and the steps that were complete before it.
    due: Option<(Due, u64)>,
    /// Step at which the run of the scene has ended, once that was said.
    ended: Option<u64>,
    interrupt: Arc<AtomicBool>,
}

/// Until when a run goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Until {
    /// So many steps.
    Steps(u64),
    /// The first step that ends at or after this time.
    Time(f64),
    /// This step.
    Step(u64),
    /// A stop, or the end.
    Stopped,
}

/// The session takes no samples; looks at a steady state come when they come in a run.
const NO_SAMPLES: f64 = f64::INFINITY;

impl Session {
    /// Builds and starts a scene; `interrupt` is set from anywhere to stop a run.
    ///
    /// # Errors
    /// A model that cannot be built or started, with its scene.
    pub fn new(mut sim: Simulation, scene: LoadedScene, interrupt: Arc<AtomicBool>) -> Result<Self, Box<(LoadedScene, SimulationError)>> {
        if let Err(e) = sim.build(&scene.model).and_then(|()| run::start(&mut sim, &scene.model)) {
            return Err(Box::new((scene, e)));
        }
        run::begin(&mut sim, &scene.model, NO_SAMPLES);
        let driver = Driver::new(&mut sim);
        driver.rewind(&mut sim, []);
        let mut session = Session {
            sim,
            scene,
            driver,
            past: Past::default(),
            stops: Vec::new(),
            snapshots: BTreeMap::new(),
            modified: None,
            due: None,
            ended: None,
            interrupt,
        };
        let state = session.sim.save_state().map_err(SimulationError::Model);
        match state {
            Ok(state) => session.past.keep(0, state, true),
            Err(e) => return Err(Box::new((session.scene, e))),
        }
        Ok(session)
    }

    /// Time and completed steps.
    pub(super) fn clock(&self) -> &Clock {
        self.sim.world.resource()
    }

    /// True between two steps.
    pub(super) fn between_steps(&self) -> bool {
        self.due.is_none()
    }

    /// The step that is complete, or the one that has begun.
    pub(super) fn step(&self) -> u64 {
        self.due.map_or(self.clock().step, |(_, complete)| complete + 1)
    }

    /// What has gone wrong in the run, if something has.
    pub(super) fn failure(&self) -> Option<&String> {
        self.sim.world.resource::<Failure>().0.as_ref()
    }

    /// Step, time and the next system.
    pub fn prompt(&self) -> String {
        let clock = self.clock();
        let next = self.driver.names().nth(self.driver.next(&self.sim)).unwrap_or_default();
        let modified = if self.modified.is_some() { " (modified)" } else { "" };
        format!("step {}  t {}  next {next}{modified} > ", clock.step, quantity(clock.time, self.scene.scene.units.time()))
    }

    /// Names of the systems in their order.
    pub fn systems(&self) -> Vec<String> {
        self.driver.names().map(str::to_string).collect()
    }

    pub(super) fn refuse_if_failed(&self) -> Result<(), SpecError> {
        match self.failure() {
            Some(message) => Err(SpecError::new("", format!("the run has failed: {message}")).help("`back` and `restore` go back")),
            None => Ok(()),
        }
    }

    /// Refuses what would leave half a step behind.
    pub(super) fn refuse_within_step(&self, what: &str) -> Result<(), SpecError> {
        if self.between_steps() {
            return Ok(());
        }
        Err(SpecError::new("", format!("{what} only between two steps"))
            .help("`finish` goes to the end of this one, `back` to its beginning"))
    }

    /// Runs systems one by one. What stopped it is said.
    pub(super) fn run_systems(&mut self, count: u64) -> Result<String, SpecError> {
        for _ in 0..count {
            self.refuse_if_failed()?;
            self.open_step();
            self.driver.one(&mut self.sim);
            if let Some(said) = self.close_if_done(true)? {
                return Ok(said);
            }
            if self.interrupted() {
                return Ok("interrupted".into());
            }
        }
        Ok(String::new())
    }

    /// Runs to the end of this step, unless a stop comes first.
    pub(super) fn finish_step(&mut self) -> Result<String, SpecError> {
        if self.between_steps() {
            return Err(SpecError::new("", "no step has begun").help("`sys` begins one, `step` makes a whole one"));
        }
        self.refuse_if_failed()?;
        self.driver.on(&mut self.sim);
        match self.close_if_done(true)? {
            Some(said) => Ok(said),
            None if self.between_steps() => Ok(String::new()),
            None => Ok(self.before_system()),
        }
    }

    /// Runs until something stops it. What did is said.
    pub(super) fn go(&mut self, until: Until) -> Result<String, SpecError> {
        let mut left = if let Until::Steps(n) = until { n } else { u64::MAX };
        let mut first = true;
        while left > 0 {
            self.refuse_if_failed()?;
            if !first && self.between_steps() && self.stops.iter().any(|s| matches!(s.on, On::System(0))) {
                return Ok(self.before_system());
            }
            first = false;
            self.open_step();
            self.driver.on(&mut self.sim);
            if let Some(said) = self.close_if_done(true)? {
                return Ok(said);
            }
            if !self.between_steps() {
                return Ok(self.before_system());
            }
            left -= 1;
            let clock = self.clock();
            let reached = match until {
                Until::Time(t) => clock.time >= t,
                Until::Step(n) => clock.step >= n,
                Until::Steps(_) | Until::Stopped => false,
            };
            if reached {
                break;
            }
            if self.interrupted() {
                return Ok("interrupted".into());
            }
        }
        Ok(String::new())
    }

    fn open_step(&mut self) {
        if self.due.is_none() {
            let complete = self.clock().step;
            self.due = Some((run::due(&mut self.sim, &self.scene.model), complete));
        }
    }

    /// After systems have run: closes the step if it is complete. Says what stops the run, if something does.
    fn close_if_done(&mut self, stopping: bool) -> Result<Option<String>, SpecError> {
        if let Some(message) = self.failure() {
            let clock = self.clock();
            return Ok(Some(format!("failed in step {}, t = {}: {message}", clock.step, number(clock.time))));
        }
        let Some((due, _)) = self.due.filter(|_| self.driver.next(&self.sim) == 0) else { return Ok(None) };
        self.due = None;
        let ended = run::ended(&mut self.sim, &self.scene.model, due, NO_SAMPLES);
        let step = self.clock().step;
        if self.past.wants(step) {
            let state = self.sim.save_state().map_err(|e| SpecError::new("", e))?;
            self.past.keep(step, state, false);
        }
        if !stopping {
            return Ok(None);
        }
        let mut said = self.reached_stops()?;
        if let Some(status) = ended.filter(|_| self.ended.is_none()) {
            self.ended = Some(step);
            said.push(format!("the run of the scene ends here: {}", status.word()));
        }
        Ok((!said.is_empty()).then(|| said.join("\n")))
    }

    /// What the stops say at the end of a step.
    fn reached_stops(&mut self) -> Result<Vec<String>, SpecError> {
        let mut said = Vec::new();
        let mut stops = std::mem::take(&mut self.stops);
        for stop in &mut stops {
            match stop.reached(&mut self.sim, &self.scene) {
                Ok(Some(text)) => said.push(text),
                Ok(None) => {}
                Err(message) => said.push(format!("stop {} is lost: {message}", stop.number)),
            }
        }
        self.stops = stops;
        Ok(said)
    }

    fn before_system(&self) -> String {
        let next = self.driver.next(&self.sim);
        let number = self.stops.iter().find(|s| matches!(s.on, On::System(n) if n == next)).map_or(0, |s| s.number);
        format!("stop {number}: before {}", self.driver.names().nth(next).unwrap_or_default())
    }

    fn interrupted(&self) -> bool {
        self.interrupt.swap(false, Ordering::Relaxed)
    }

    /// Goes back to the end of an earlier step, with the same bits as it had.
    pub(super) fn back_to(&mut self, step: u64) -> Result<String, SpecError> {
        let Some(saved) = self.past.before(step) else {
            return Err(SpecError::new("", format!("no state before step {step} is kept any more")));
        };
        let state = saved.state.clone();
        self.take_state(&state)?;
        self.past.cut(step);
        while self.clock().step < step {
            self.open_step();
            self.driver.on(&mut self.sim);
            if self.close_if_done(false)?.is_some() {
                break;
            }
            if self.interrupted() {
                self.arrive()?;
                return Ok(format!("interrupted on the way to step {step}"));
            }
        }
        self.arrive()?;
        Ok(String::new())
    }

    /// Puts a saved state in the place of the present one.
    pub(super) fn take_state(&mut self, state: &[u8]) -> Result<(), SpecError> {
        self.sim.restore_state(state).map_err(|e| SpecError::new("", e))?;
        self.sim.world.resource_mut::<Failure>().0 = None;
        self.due = None;
        self.driver.rewind(&mut self.sim, []);
        Ok(())
    }

    /// After a jump in time: the stops look at what they find.
    pub(super) fn arrive(&mut self) -> Result<(), SpecError> {
        let step = self.clock().step;
        self.modified = self.modified.filter(|m| *m <= step);
        self.ended = self.ended.filter(|e| *e <= step);
        let breaks: Vec<usize> = self.stops.iter().filter_map(|s| if let On::System(n) = s.on { Some(n) } else { None }).collect();
        self.driver.rewind(&mut self.sim, breaks);
        let mut stops = std::mem::take(&mut self.stops);
        let looked: Result<(), String> = stops.iter_mut().try_for_each(|s| s.look_again(&mut self.sim));
        self.stops = stops;
        looked.map_err(|e| SpecError::new("", e))
    }

    /// Reads an expression over this scene.
    pub(super) fn expression(&mut self, text: &str) -> Result<Expression, SpecError> {
        Expression::read(text, &self.scene, &mut self.sim)
    }

    /// A value with its unit where that is known.
    pub(super) fn with_unit(&self, e: &Expression, value: f64) -> String {
        quantity(value, &e.quantity().map_or(String::new(), |q| unit(q, self.scene.scene.units)))
    }
}
