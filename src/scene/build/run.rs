//! Damping, time integration and the end of the run.
use super::{Builder, at};
use crate::model::{AxialScheme, Damping, Integration, RotaryInertiaRule, Steady, Stop};
use crate::scene::error::Problem;
use crate::scene::schema::{AxialSpec, DampingSpec, RotaryInertiaSpec, Scene, SteadySpec, StopSpec};

impl Builder<'_> {
    pub(super) fn add_run(&mut self, scene: &mut Scene) {
        let spec = &scene.integration;
        let safety = spec.safety.0;
        if !(safety > 0.0 && safety < 1.0) {
            self.problem(at("integration.safety"), format!("the safety factor must be above 0 and below 1, not {safety}"));
        }
        if let Some(dt) = spec.dt {
            self.above_zero(at("integration.dt"), "the time step", dt.0);
        }
        if spec.monitor_every == 0 {
            self.problem(at("integration.monitor_every"), "monitor_every must be at least 1");
        }
        self.not_negative(at("integration.bulk_viscosity"), "the bulk viscosity", spec.bulk_viscosity.0);
        if let RotaryInertiaSpec::Scaled(f) = spec.rotary_inertia {
            self.above_zero(at("integration.rotary_inertia"), "the factor on the rotary inertia", f.0);
        }
        let damping = match *scene.damping.get_or_insert(DampingSpec::None) {
            DampingSpec::None => Damping::None,
            DampingSpec::Kinetic => Damping::Kinetic,
            DampingSpec::Mass(alpha) => {
                self.not_negative(at("damping"), "the damping rate", alpha.0);
                Damping::Mass(alpha.0)
            }
            DampingSpec::Auto => {
                self.problems.push(
                    Problem::new(at("damping"), "automatic damping needs a braid under a force")
                        .help("give the rate: Mass(120), with 1/rate about the slowest time of the problem"),
                );
                Damping::None
            }
        };
        let spec = &scene.integration;
        self.model.integration = Integration {
            axial: match spec.axial {
                AxialSpec::Explicit => AxialScheme::Explicit,
                AxialSpec::Implicit => AxialScheme::Implicit,
            },
            safety,
            dt: spec.dt.map(f64::from),
            rotary_inertia: match spec.rotary_inertia {
                RotaryInertiaSpec::Scaled(f) => RotaryInertiaRule::Scaled(f.0),
                RotaryInertiaSpec::Physical => RotaryInertiaRule::Physical,
            },
            damping,
            bulk_viscosity: spec.bulk_viscosity.0,
            monitor_every: spec.monitor_every.max(1),
        };
        self.add_stop(&mut scene.stop);
    }

    fn add_stop(&mut self, stop: &mut StopSpec) {
        if stop.time.is_none() && stop.steps.is_none() && stop.steady.is_none() {
            self.problems.push(
                Problem::new(at("stop"), "the run never ends: `stop` is missing")
                    .help("give stop: (time: ...), (steps: ...) or (steady: (interval: ...))"),
            );
        }
        if let Some(t) = stop.time {
            self.above_zero(at("stop.time"), "the end time", t.0);
        }
        let steady = stop.steady.as_mut().and_then(|s| self.steady(s));
        self.model.stop = Stop { time: stop.time.map(f64::from), steps: stop.steps, steady };
    }

    fn steady(&mut self, spec: &mut SteadySpec) -> Option<Steady> {
        let path = at("stop.steady");
        let dummy = match &spec.watch {
            Some(name) => {
                let node = self.node(&path.key("watch"), name)?;
                if !self.model.nodes[node.row()].dummy {
                    self.problem(path.key("watch"), "only the period vector of a dummy node can be watched");
                }
                Some(node)
            }
            None => (0..self.model.nodes.len()).find(|i| self.model.nodes[*i].dummy).map(|i| crate::components::NodeId(i as u32)),
        };
        let Some(interval) = spec.interval else {
            self.problem(path, "the interval of the steady state is missing: only braids under a force know their own time");
            return None;
        };
        self.above_zero(path.key("interval"), "the interval of the steady state", interval.0);
        self.above_zero(path.key("change"), "the relative change of the steady state", spec.change.0);
        if spec.repeats == 0 {
            self.problem(path.key("repeats"), "repeats must be at least 1");
        }
        let earliest = spec.earliest.get_or_insert_default().0;
        self.not_negative(path.key("earliest"), "the earliest steady state", earliest);
        Some(Steady {
            dummy,
            interval: interval.0,
            change: spec.change.0,
            repeats: spec.repeats,
            earliest,
            kinetic_to_strain: spec.kinetic_to_strain.map_or(f64::INFINITY, f64::from),
        })
    }
}
