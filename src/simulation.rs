//! The simulation: a world, the schedule of the time step, and the loop around them.
use crate::components::*;
use crate::element::{Element, NodeMass};
use crate::model::{Model, RotaryInertiaRule};
use crate::registry::{Installer, Registry};
use crate::run::RunState;
use crate::state;
use crate::step::{Clock, StepSet, TimeStep};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{LogLevel, ScheduleBuildSettings, ScheduleConfigs, SingleThreadedExecutor};
use bevy_ecs::system::ScheduleSystem;
use glam::{DQuat, DVec3};

/// A plugin registers what it brings: elements, systems, sections of the scene.
pub trait Plugin {
    /// Registers everything.
    fn build(&self, sim: &mut Simulation);
}

impl<F: Fn(&mut Simulation)> Plugin for F {
    fn build(&self, sim: &mut Simulation) {
        self(sim);
    }
}

impl<A: Plugin, B: Plugin> Plugin for (A, B) {
    fn build(&self, sim: &mut Simulation) {
        self.0.build(sim);
        self.1.build(sim);
    }
}

/// Why a model could not be built or run.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The model contradicts itself.
    #[error("{0}")]
    Model(String),
    /// A node can move but has no mass.
    #[error("node {node} can move but has no mass: no element is attached to it")]
    NoMass {
        /// Node id.
        node: u32,
    },
    /// A non-finite number or a runaway was found.
    #[error("numerical failure at t = {time:e}, step {step}: {message}")]
    Numerical {
        /// Time of the failure.
        time: f64,
        /// Step of the failure.
        step: u64,
        /// What, where, and the likely cause.
        message: String,
    },
}

/// What the user should know about how the model is run, in the order in which it was found.
#[derive(Resource, Clone, Debug, Default)]
pub struct Notes(pub Vec<String>);

/// Set by a system that finds the run broken; the loop stops on it.
#[derive(Resource, Clone, Debug, Default)]
pub struct Failure(pub Option<String>);

/// Maps node ids to rows of the node columns; tied nodes map to the row of their host.
#[derive(Resource, Clone, Debug, Default)]
pub struct NodeRows {
    rows: Vec<u32>,
    ids: Vec<NodeId>,
}

impl NodeRows {
    /// Row of the node that carries the motion of `node`.
    #[inline]
    pub fn of(&self, node: NodeId) -> usize {
        self.rows[node.0 as usize] as usize
    }
    /// The node in `row`.
    pub fn id(&self, row: usize) -> NodeId {
        self.ids[row]
    }
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.ids.len()
    }
    /// True without nodes.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }
}

/// Present when the nodes of the model have rotations.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Rotations;

/// The entities of the nodes, in row order.
#[derive(Resource, Clone, Debug, Default)]
pub struct NodeEntities(pub Vec<Entity>);

/// What installers see: the model and the world to fill, the schedule to extend.
pub struct Install<'a> {
    /// The world; nodes are spawned already.
    pub world: &'a mut World,
    /// The model.
    pub model: &'a Model,
    schedule: &'a mut Schedule,
    slots: &'a mut [u32; 10],
}

/// Position of a system inside its set; systems of a set run in the order in which they were added.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Slot(StepSet, u32);

impl Install<'_> {
    /// Adds a system to a set of the time step. Inside a set systems run in the order in which
    /// they were added, except in [`StepSet::ElementForces`], where each writes only its own columns.
    pub fn add_system<M>(&mut self, set: StepSet, system: impl IntoScheduleConfigs<ScheduleSystem, M>) {
        let n = &mut self.slots[set as usize];
        let mut config: ScheduleConfigs<ScheduleSystem> = system.into_configs().in_set(set).in_set(Slot(set, *n));
        if *n > 0 && set != StepSet::ElementForces {
            config = config.after(Slot(set, *n - 1));
        }
        *n += 1;
        self.schedule.add_systems(config);
    }

    /// Adds a constraint: `impose` takes dependents where the others have gone, in [`StepSet::Constraints`], and `condense` hands the forces
    /// on them to the others, in [`StepSet::Condensation`]. One without the other makes energy.
    pub fn add_constraint<A, B>(
        &mut self,
        impose: impl IntoScheduleConfigs<ScheduleSystem, A>,
        condense: impl IntoScheduleConfigs<ScheduleSystem, B>,
    ) {
        self.add_system(StepSet::Constraints, impose);
        self.add_system(StepSet::Condensation, condense);
    }

    /// True if the nodes of this model have rotations.
    pub fn rotations(&self) -> bool {
        self.world.contains_resource::<Rotations>()
    }

    /// Leaves a note for the user: something was done in another way than asked.
    pub fn note(&mut self, text: String) {
        self.world.get_resource_or_init::<Notes>().0.push(text);
    }

    /// Row of a node.
    pub fn row(&self, node: NodeId) -> usize {
        self.world.resource::<NodeRows>().of(node)
    }
}

/// Two systems that could run in either order with different results are an error.
fn settings(shuffle_seed: Option<u64>) -> ScheduleBuildSettings {
    ScheduleBuildSettings { ambiguity_detection: LogLevel::Error, auto_insert_apply_deferred: false, shuffle_seed, ..Default::default() }
}

/// World, schedule and registry.
pub struct Simulation {
    /// All entities and resources.
    pub world: World,
    /// The schedule of one time step.
    pub schedule: Schedule,
    /// What the plugins have registered.
    pub registry: Registry,
}

impl Simulation {
    /// A simulation with the given plugins and no model.
    pub fn new(plugins: impl Plugin) -> Self {
        let mut schedule = Schedule::new(TimeStep);
        schedule.set_executor(SingleThreadedExecutor::new());
        schedule.set_build_settings(settings(None));
        let [a, b, c, d, e, f, g, h, i, j] = StepSet::ORDER;
        schedule.configure_sets((a, b, c, d, e, f, g, h, i, j).chain());
        let mut sim = Simulation { world: World::new(), schedule, registry: Registry::default() };
        plugins.build(&mut sim);
        sim
    }

    /// Sorts systems whose order does not matter by chance; every seed gives the same results.
    pub fn shuffle_schedule(&mut self, seed: u64) {
        self.schedule.set_build_settings(settings(Some(seed)));
    }

    /// Names of the systems of a step, in the order in which they run.
    pub fn system_names(&self) -> Vec<String> {
        self.schedule.systems().map_or(Vec::new(), |all| all.map(|(_, s)| s.name().shortname().to_string()).collect())
    }

    /// Registers an element kind.
    pub fn add_element<E: Element<N>, const N: usize>(&mut self) {
        self.registry.add_element::<E, N>();
    }

    /// Registers settings: a top-level key of the scene.
    pub fn add_settings<S: crate::registry::Settings>(&mut self) {
        self.registry.add_settings::<S>();
    }

    /// Registers a probe: a value that scenes may ask for with `Custom(probe: ...)`.
    pub fn add_probe<P: crate::registry::CustomProbe>(&mut self) {
        self.registry.add_probe::<P>();
    }

    /// Registers an amplitude: a function of time that scenes may ask for with `Custom(amplitude: ...)`.
    pub fn add_amplitude<A: crate::registry::CustomAmplitude>(&mut self) {
        self.registry.add_amplitude::<A>();
    }

    /// Registers a measure: a number that every run reports at its end where `take` gives one.
    pub fn add_measure(&mut self, kind: crate::registry::MeasureKind) {
        self.registry.add_measure(kind);
    }

    /// Names the dimensions of the fields of a component or a resource, so that whoever looks at it sees units: `("stiffness", "force / length")`.
    /// The words are length, mass, time, force, stress and energy; a component that is a single value has the field `""`.
    pub fn add_units<C: Component>(&mut self, fields: crate::registry::FieldDimensions) {
        self.registry.units.insert(std::any::type_name::<C>(), fields);
    }

    /// Registers a function that adds systems for models that need them.
    pub fn add_installer(&mut self, name: &'static str, installer: Installer) {
        self.registry.installers.push((name, installer));
    }

    /// Spawns a model: nodes, then elements in registration order, then what the installers add.
    ///
    /// # Errors
    /// Nodes without mass, ties in a circle, constraints that contradict each other.
    pub fn build(&mut self, model: &Model) -> Result<(), SimulationError> {
        self.spawn_nodes(model)?;
        self.world.insert_resource(Failure::default());
        self.world.insert_resource(Clock { dt_limit: f64::INFINITY, ..Default::default() });
        remember_nodes(&mut self.world);
        let mut slots = [0; 10];
        let mut install = Install { world: &mut self.world, model, schedule: &mut self.schedule, slots: &mut slots };
        // Loads and clearing come first in the assembly, so installers run before the elements
        // only where they say so by name; see `systems/mod.rs` for the order.
        let (before, after): (Vec<_>, Vec<_>) = self.registry.installers.iter().partition(|(name, _)| name.starts_with("load"));
        for (_, installer) in before {
            installer(&mut install);
        }
        for kind in &self.registry.elements {
            (kind.install)(&mut install);
        }
        for (_, installer) in after {
            installer(&mut install);
        }
        if let Some(message) = self.world.resource::<Failure>().0.clone() {
            return Err(SimulationError::Model(message));
        }
        self.schedule.initialize(&mut self.world).map_err(|e| SimulationError::Model(format!("schedule: {e:?}")))?;
        Ok(())
    }

    fn spawn_nodes(&mut self, model: &Model) -> Result<(), SimulationError> {
        let mut dependent = vec![None; model.nodes.len()];
        for t in &model.ties {
            dependent[t.embedded.row()] = Some(t.host);
        }
        let mut rows = NodeRows { rows: vec![u32::MAX; model.nodes.len()], ids: Vec::new() };
        for (i, d) in dependent.iter().enumerate() {
            if d.is_none() {
                rows.rows[i] = rows.ids.len() as u32;
                rows.ids.push(NodeId(i as u32));
            }
        }
        for i in 0..dependent.len() {
            let (mut n, mut hops) = (i, 0);
            while let Some(host) = dependent[n] {
                n = host.row();
                hops += 1;
                if hops > dependent.len() {
                    return Err(SimulationError::Model(format!("the ties of node {i} run in a circle")));
                }
            }
            rows.rows[i] = rows.rows[n];
        }

        let mut by_node: Vec<(NodeMass, f64)> =
            model.nodes.iter().map(|n| (NodeMass { mass: n.added_mass, inertia: n.added_inertia }, 0.0)).collect();
        for kind in &self.registry.elements {
            (kind.add_mass)(model, &mut by_node);
        }
        let mut masses = vec![NodeMass::default(); rows.len()];
        let mut lengths = vec![0.0f64; rows.len()];
        for (i, (m, length)) in by_node.iter().enumerate() {
            let r = rows.rows[i] as usize;
            masses[r].mass += m.mass;
            masses[r].inertia += m.inertia;
            lengths[r] = lengths[r].max(*length);
        }
        if let RotaryInertiaRule::Scaled(factor) = model.integration.rotary_inertia {
            for (i, m) in masses.iter_mut().enumerate() {
                if lengths[i] > 0.0 {
                    let added = model.nodes[rows.ids[i].row()].added_inertia;
                    m.inertia = added + factor * m.mass * lengths[i] * lengths[i];
                }
            }
        }
        let mut held = vec![[false; 6]; rows.len()];
        for f in &model.fixed {
            for d in &f.dofs {
                held[rows.of(f.node)][*d as usize] = true;
            }
        }
        for p in &model.prescribed {
            held[rows.of(p.node)][p.dof as usize] = true;
        }
        let inverse = |m: f64, held: &[bool]| DVec3::from_array(std::array::from_fn(|k| if held[k] || m <= 0.0 { 0.0 } else { 1.0 / m }));
        let rotations = self.registry.elements.iter().any(|k| k.rotations && (k.count)(model) > 0);
        if rotations {
            self.world.insert_resource(Rotations);
        }
        let entities: Vec<Entity> = if rotations {
            let bundles: Vec<_> = (0..rows.len())
                .map(|r| {
                    let n = &model.nodes[rows.ids[r].row()];
                    (
                        translation_bundle(n, masses[r].mass, inverse(masses[r].mass, &held[r][..3])),
                        (
                            Orientation(DQuat::IDENTITY),
                            AngularVelocity(n.angular_velocity),
                            Moment(DVec3::ZERO),
                            RotaryInertia(masses[r].inertia),
                            InverseInertia(inverse(masses[r].inertia, &held[r][3..])),
                        ),
                    )
                })
                .collect();
            self.world.spawn_batch(bundles).collect()
        } else {
            let bundles: Vec<_> = (0..rows.len())
                .map(|r| {
                    let n = &model.nodes[rows.ids[r].row()];
                    translation_bundle(n, masses[r].mass, inverse(masses[r].mass, &held[r][..3]))
                })
                .collect();
            self.world.spawn_batch(bundles).collect()
        };
        for (row, &e) in entities.iter().enumerate() {
            assert_eq!(self.world.entity(e).location().table_row.index(), row, "spawn order is row order");
        }
        for (id, n) in model.nodes.iter().enumerate() {
            if n.dummy {
                self.world.entity_mut(entities[rows.rows[id] as usize]).insert(DummyNode);
            }
        }
        for t in &model.ties {
            self.world.spawn(*t);
        }
        self.world.insert_resource(HeldDofs(held));
        self.world.insert_resource(NodeEntities(entities));
        self.world.insert_resource(rows);
        Ok(())
    }

    /// Takes the energies of the current state now, outside the monitor steps.
    pub fn refresh_energies(&mut self) {
        self.world.resource_mut::<crate::systems::energy::LookNow>().0 = true;
        crate::systems::energy::take_energies(&mut self.world);
    }

    /// The whole state as bytes, for [`Simulation::restore_state`].
    ///
    /// # Errors
    /// A component or resource of a plugin that cannot be written.
    pub fn save_state(&mut self) -> Result<Vec<u8>, String> {
        state::save(&mut self.world)
    }

    /// Goes back to a saved state; this simulation has been built from the same scene, and started or not.
    ///
    /// # Errors
    /// A state of another scene or program; the simulation is then of no use any more.
    pub fn restore_state(&mut self, bytes: &[u8]) -> Result<(), String> {
        state::restore(&mut self.world, bytes)
    }

    /// One time step.
    pub fn step(&mut self) {
        self.schedule.run(&mut self.world);
    }
}

/// The state of every model, whatever the plugins.
fn remember_nodes(world: &mut World) {
    #[cfg(debug_assertions)]
    crate::stepper::inspect::know_constants(world);
    state::remember_resource::<Clock>(world);
    state::remember_resource::<RunState>(world);
    state::remember::<Position>(world);
    state::remember::<Velocity>(world);
    state::remember::<Force>(world);
    if world.contains_resource::<Rotations>() {
        state::remember::<Orientation>(world);
        state::remember::<AngularVelocity>(world);
        state::remember::<Moment>(world);
    }
}

/// Degrees of freedom held by supports or prescribed motions, by row.
#[derive(Resource, Clone, Debug, Default)]
pub struct HeldDofs(pub Vec<[bool; 6]>);

type TranslationBundle = (Position, InitialPosition, Velocity, Force, Mass, InverseMass);

fn translation_bundle(n: &crate::model::Node, mass: f64, inverse: DVec3) -> TranslationBundle {
    (Position(n.position), InitialPosition(n.position), Velocity(n.velocity), Force(DVec3::ZERO), Mass(mass), InverseMass(inverse))
}
