//! What a run stops at: systems, times, steps, conditions, and values that change.
use super::expression::Expression;
use super::text::{number, quantity};
use crate::output::measured::unit;
use crate::scene::LoadedScene;
use crate::simulation::Simulation;
use crate::step::Clock;

/// What a run stops at.
pub enum On {
    /// Before a system, by its place in the step.
    System(usize),
    /// At the end of the first step that reaches this time.
    Time(f64),
    /// At the end of this step.
    Step(u64),
    /// At the end of a step in which this comes true.
    If(Expression),
    /// At the end of a step in which this has changed by more than `by` since it was last looked at.
    Watch {
        /// What is watched.
        expression: Expression,
        /// Change that stops the run.
        by: f64,
    },
}

/// A stop with its number.
pub struct Stop {
    /// Number, for `delete`.
    pub number: u32,
    /// What it stops at.
    pub on: On,
    /// Value at the last look: of the time, the condition, or what is watched.
    last: f64,
    /// Values of a watch with their times, for `plot`.
    pub curve: Vec<(f64, f64)>,
}

/// Points of a curve from which on every other one is dropped.
const LONGEST: usize = 1 << 16;

impl Stop {
    /// A stop that looks from now on.
    ///
    /// # Errors
    /// An expression that has no value.
    pub fn new(number: u32, on: On, sim: &mut Simulation) -> Result<Self, String> {
        let mut stop = Stop { number, on, last: 0.0, curve: Vec::new() };
        stop.look_again(sim)?;
        Ok(stop)
    }

    /// Forgets what came after the present time and takes the present value.
    ///
    /// # Errors
    /// An expression that has no value.
    pub fn look_again(&mut self, sim: &mut Simulation) -> Result<(), String> {
        let time = sim.world.resource::<Clock>().time;
        self.last = match &self.on {
            On::System(_) => 0.0,
            On::Time(_) => time,
            On::Step(_) => 0.0,
            On::If(e) | On::Watch { expression: e, .. } => e.value(sim)?,
        };
        self.curve.retain(|p| p.0 < time);
        if let On::Watch { .. } = self.on {
            self.curve.push((time, self.last));
        }
        Ok(())
    }

    /// What it says if it stops the run at the end of the present step.
    ///
    /// # Errors
    /// An expression that has no value.
    pub fn reached(&mut self, sim: &mut Simulation, scene: &LoadedScene) -> Result<Option<String>, String> {
        let (time, step) = (sim.world.resource::<Clock>().time, sim.world.resource::<Clock>().step);
        let before = self.last;
        let said = match &self.on {
            On::System(_) => None,
            On::Time(t) => {
                self.last = time;
                (before < *t && time >= *t).then(|| format!("t = {}", number(time)))
            }
            On::Step(n) => (step == *n).then(|| format!("step {n}")),
            On::If(e) => {
                self.last = e.value(sim)?;
                (before == 0.0 && self.last != 0.0).then(|| e.text.clone())
            }
            On::Watch { expression: e, by } => {
                let now = e.value(sim)?;
                if self.curve.len() >= LONGEST {
                    let mut n = 0;
                    self.curve.retain(|_| {
                        n += 1;
                        n % 2 == 1
                    });
                }
                self.curve.push((time, now));
                // A value that is no number any more has changed, too.
                let stays = (now - before).abs() <= *by;
                let changed = now != before && !stays;
                if changed {
                    self.last = now;
                }
                let unit = e.quantity().map_or(String::new(), |q| unit(q, scene.scene.units));
                changed.then(|| format!("{}: {} -> {}", e.text, number(before), quantity(now, &unit)))
            }
        };
        Ok(said.map(|text| format!("stop {}: {text}", self.number)))
    }

    /// What it is, for the list.
    pub fn about(&self, systems: &[String]) -> String {
        match &self.on {
            On::System(n) => format!("before {}", systems[*n]),
            On::Time(t) => format!("t = {}", number(*t)),
            On::Step(n) => format!("step {n}"),
            On::If(e) => format!("if {}", e.text),
            On::Watch { expression, by } if *by == 0.0 => format!("watch {}, now {}", expression.text, number(self.last)),
            On::Watch { expression, by } => format!("watch {} by {}, now {}", expression.text, number(*by), number(self.last)),
        }
    }
}
