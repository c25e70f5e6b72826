//! The loop around the step: start, stop criteria, and what looks on.
use crate::simulation::{Simulation, SimulationError};

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
    /// Called before the first step, then after every sample interval and once at the end.
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), SimulationError>;
    /// True to stop the run after this step.
    fn stop_requested(&self) -> bool {
        false
    }
}
