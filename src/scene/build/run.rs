//! Damping, time integration and the end of the run.
use super::{Builder, at};
use crate::amplitude::Amplitude;
use crate::components::{NodalLoad, NodeId};
use crate::model::{AxialScheme, Damping, Integration, RotaryInertiaRule, Steady, Stop, Watch};
use crate::scene::error::Problem;
use crate::scene::schema::{AxialSpec, DampingSpec, OnFailure, RotaryInertiaSpec, Scene, SteadySpec, StopSpec, WatchSpec};
use crate::scene::units::{Length, Rate, Ratio, Time};
use glam::DVec3;

/// Kinetic over strain energy at which a run that finds its own time is at rest.
const AT_REST: f64 = 1e-8;

/// Most times that a run is tried again: the time step is then a thousandth.
const MOST_RETRIES: u32 = 10;

impl Builder<'_> {
    /// The load along the period, and with it the time scale tF = sqrt(mass x stroke / force): with
    /// mass damping 1/tF and the force raised over 2 tF a braid closes without overshoot.
    pub(super) fn add_period_load(&mut self, scene: &mut Scene) {
        let Some(load) = &mut scene.load else { return };
        let path = at("load");
        if !self.above_zero(path.key("force"), "the force along the period", load.force.0) {
            return;
        }
        let dummies: Vec<NodeId> = (0..self.model.nodes.len()).filter(|i| self.model.nodes[*i].dummy).map(|i| NodeId(i as u32)).collect();
        let node = match (&load.node, dummies.as_slice()) {
            (Some(name), _) => self.node(&path.key("node"), name),
            (None, [one]) => Some(*one),
            (None, []) => {
                self.problems.push(
                    Problem::new(path.clone(), "`load` pulls along the period, and nothing in the scene is periodic")
                        .help("use `loads` for forces on nodes"),
                );
                None
            }
            (None, several) => {
                let names: Vec<String> = several.iter().map(|n| self.name_of(*n)).collect();
                self.problem(path.clone(), format!("`load` needs `node`: there are several dummy nodes: {}", names.join(", ")));
                None
            }
        };
        let Some(node) = node else { return };
        if !self.model.nodes[node.row()].dummy {
            self.problem(path.key("node"), format!("node {} is not a dummy node", self.name_of(node)));
            return;
        }
        let period = self.model.nodes[node.row()].position;
        let stroke = *load.stroke.get_or_insert(Length(match &self.braid {
            Some(b) if b.dummy == node => b.arc_length - b.cell_length,
            _ => 0.1 * period.length(),
        }));
        let mass: f64 = self.masses().iter().sum();
        if !self.above_zero(path.key("stroke"), "the stroke of the load", stroke.0) {
            return;
        }
        let scale = (mass * stroke.0 / load.force.0).sqrt();
        let rise = *load.rise.get_or_insert(Time(2.0 * scale));
        self.not_negative(path.key("rise"), "the rise of the load", rise.0);
        let amplitude = self.model.add_amplitude(Amplitude::SmoothStep { rise: rise.0 });
        let force = period.normalize_or_zero() * load.force.0;
        self.model.loads.push(NodalLoad { node, force, moment: DVec3::ZERO, follower: false, amplitude });
        self.time_scale = Some((scale, node));
    }

    /// The scheme, before the elements that depend on it; the damping comes with the loads.
    pub(super) fn add_integration(&mut self, scene: &Scene) {
        let spec = &scene.integration;
        let safety = spec.safety.0;
        if !(safety > 0.0 && safety < 1.0) {
            self.bad_value(at("integration.safety"), format!("the safety factor must be above 0 and below 1, not {safety}"));
        }
        if let Some(dt) = spec.dt {
            self.above_zero(at("integration.dt"), "the time step", dt.0);
        }
        if spec.monitor_every == 0 {
            self.bad_value(at("integration.monitor_every"), "monitor_every must be at least 1");
        }
        self.not_negative(at("integration.bulk_viscosity"), "the bulk viscosity", spec.bulk_viscosity.0);
        self.not_negative(at("integration.shear_flexibility"), "the shear flexibility", spec.shear_flexibility.0);
        self.above_zero(at("integration.courant"), "the Courant number", spec.courant.0);
        if let RotaryInertiaSpec::Scaled(f) = spec.rotary_inertia {
            self.above_zero(at("integration.rotary_inertia"), "the factor on the rotary inertia", f.0);
        }
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
            shear_flexibility: spec.shear_flexibility.0,
            courant: spec.courant.0,
            bulk_viscosity: spec.bulk_viscosity.0,
            monitor_every: spec.monitor_every.max(1),
            damping: Damping::None,
        };
    }

    pub(super) fn add_run(&mut self, scene: &mut Scene) {
        if let Some((scale, _)) = self.time_scale {
            if matches!(scene.damping, None | Some(DampingSpec::Auto)) {
                scene.damping = Some(DampingSpec::Mass(Rate(1.0 / scale)));
            }
            if scene.stop == StopSpec::default() {
                scene.stop = StopSpec { time: Some(Time(100.0 * scale)), steps: None, steady: Some(SteadySpec::default()) };
            }
            if let Some(steady) = &mut scene.stop.steady {
                steady.interval.get_or_insert(Time(scale));
                steady.earliest.get_or_insert(Time(12.0 * scale));
            }
        }
        let damping = match *scene.damping.get_or_insert(DampingSpec::None) {
            DampingSpec::None => Damping::None,
            DampingSpec::Kinetic => Damping::Kinetic,
            DampingSpec::Mass(alpha) => {
                self.not_negative(at("damping"), "the damping rate", alpha.0);
                Damping::Mass(alpha.0)
            }
            DampingSpec::Adaptive => Damping::Adaptive(self.time_scale.map(|(scale, _)| 1.0 / scale)),
            // Under `load` the automatic rate has been filled in already.
            DampingSpec::Auto => {
                self.problems.push(Problem::new(at("damping"), "automatic damping needs `load`: a force along the period").help(
                    "`Adaptive` finds the rate from the motion; or give it: Mass(120), with 1/rate about the slowest time of the problem",
                ));
                Damping::None
            }
        };
        self.model.integration.damping = damping;
        self.add_watch(&scene.watch);
        // With a load the stop follows from its time scale, unless something else was wrong before.
        if scene.load.is_none() || self.time_scale.is_some() {
            self.add_stop(&mut scene.stop);
        }
    }

    fn add_watch(&mut self, spec: &WatchSpec) {
        let limit = |limit: Option<Ratio>| limit.map_or(f64::INFINITY, f64::from);
        let watch = Watch {
            strain: limit(spec.strain),
            rotation: limit(spec.rotation),
            balance: limit(spec.balance),
            time_step: spec.time_step.map_or(0.0, f64::from),
        };
        for (key, value) in [("strain", watch.strain), ("rotation", watch.rotation), ("balance", watch.balance)] {
            self.above_zero(at("watch").key(key), &format!("the limit on the {key}"), value);
        }
        if !(0.0..1.0).contains(&watch.time_step) {
            self.bad_value(
                at("watch.time_step"),
                format!("the smallest time step is a share of the settled one: at least 0 and below 1, not {}", watch.time_step),
            );
        }
        if spec.on_failure == OnFailure::Retry(0) || matches!(spec.on_failure, OnFailure::Retry(n) if n > MOST_RETRIES) {
            self.bad_value(at("watch.on_failure"), format!("a run is tried again between 1 and {MOST_RETRIES} times"));
        }
        if matches!(spec.on_failure, OnFailure::Retry(_)) && self.model.integration.dt.is_some() {
            self.problems.push(
                Problem::new(at("watch.on_failure"), "a retry halves the safety factor, and the time step is given by integration.dt")
                    .help("leave integration.dt out"),
            );
        }
        self.model.watch = watch;
    }

    fn add_stop(&mut self, stop: &mut StopSpec) {
        if *stop == StopSpec::default() {
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
            None if self.time_scale.is_some() => self.time_scale.map(|t| t.1),
            None => (0..self.model.nodes.len()).find(|i| self.model.nodes[*i].dummy).map(|i| NodeId(i as u32)),
        };
        let finds_its_time = self.model.integration.damping == Damping::Adaptive(None);
        match spec.interval {
            Some(interval) => {
                self.above_zero(path.key("interval"), "the interval of the steady state", interval.0);
            }
            None if finds_its_time => {
                spec.kinetic_to_strain.get_or_insert(Ratio(AT_REST));
                let settled = self.model.amplitudes.iter().map(Amplitude::settled).fold(0.0, f64::max);
                spec.earliest.get_or_insert(Time(settled));
            }
            None => {
                self.problems.push(
                    Problem::new(path, "the interval of the steady state is missing: only structures under `load` know their own time")
                        .help("give it, about the slowest time of the problem; with `damping: Adaptive` it follows from the motion"),
                );
                return None;
            }
        }
        self.above_zero(path.key("change"), "the relative change of the steady state", spec.change.0);
        if spec.repeats == 0 {
            self.bad_value(path.key("repeats"), "repeats must be at least 1");
        }
        let earliest = spec.earliest.get_or_insert_default().0;
        self.not_negative(path.key("earliest"), "the earliest steady state", earliest);
        Some(Steady {
            dummy,
            interval: spec.interval.map(f64::from),
            change: spec.change.0,
            repeats: spec.repeats,
            earliest,
            kinetic_to_strain: spec.kinetic_to_strain.map_or(f64::INFINITY, f64::from),
        })
    }
}
