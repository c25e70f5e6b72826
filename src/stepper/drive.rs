//! The time step, system by system: bevy's [`Stepping`] on the schedule of the step.
use crate::simulation::Simulation;
use crate::step::TimeStep;
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{NodeId, ScheduleLabel, SingleThreadedExecutor, Stepping, SystemKey};

/// The schedule that opens a frame of [`Stepping`]; it must not be the one that is stepped.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
struct Frame;

/// The systems of a step in their order, and where they can be stopped.
pub struct Driver {
    systems: Vec<(SystemKey, String)>,
    frame: Schedule,
}

impl Driver {
    /// Takes over the schedule of a simulation that has been started.
    pub fn new(sim: &mut Simulation) -> Self {
        let names = sim.schedule.systems().expect("a simulation that has been started has its systems sorted");
        let systems = names.map(|(key, s)| (key, s.name().shortname().to_string())).collect();
        let mut frame = Schedule::new(Frame);
        frame.set_executor(SingleThreadedExecutor::new());
        frame.add_systems(Stepping::begin_frame);
        Driver { systems, frame }
    }

    /// Names of the systems, in the order in which they run.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.systems.iter().map(|s| s.1.as_str())
    }

    /// Puts the cursor at the beginning of a step and sets the systems to stop before.
    pub fn rewind(&self, sim: &mut Simulation, breaks: impl IntoIterator<Item = usize>) {
        let mut stepping = Stepping::new();
        stepping.add_schedule(TimeStep).enable();
        for system in breaks {
            stepping.set_breakpoint_node(TimeStep, NodeId::System(self.systems[system].0));
        }
        sim.world.insert_resource(stepping);
    }

    /// Sets or clears a stop before a system.
    pub fn set_break(&self, sim: &mut Simulation, system: usize, on: bool) {
        let node = NodeId::System(self.systems[system].0);
        let mut stepping = sim.world.resource_mut::<Stepping>();
        if on {
            stepping.set_breakpoint_node(TimeStep, node);
        } else {
            stepping.clear_breakpoint_node(TimeStep, node);
        }
    }

    /// Number of the system that runs next; 0 between two steps.
    pub fn next(&self, sim: &Simulation) -> usize {
        match sim.world.resource::<Stepping>().cursor() {
            Some((_, NodeId::System(key))) => self.systems.iter().position(|s| s.0 == key).unwrap_or(0),
            _ => 0,
        }
    }

    /// Runs one system.
    pub fn one(&mut self, sim: &mut Simulation) {
        sim.world.resource_mut::<Stepping>().step_frame();
        self.run(sim);
    }

    /// Runs to the end of the step, or to the next system to stop before.
    pub fn on(&mut self, sim: &mut Simulation) {
        sim.world.resource_mut::<Stepping>().continue_frame();
        self.run(sim);
    }

    fn run(&mut self, sim: &mut Simulation) {
        self.frame.run(&mut sim.world);
        sim.step();
    }
}
