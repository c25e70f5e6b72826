//! The same bits on any number of threads.
use super::{Finding, KitError, Specimen};
use crate::element::Element;
use crate::run;
use crate::simulation::{Simulation, SimulationError};
use crate::state;
use crate::systems::default_plugins;

/// Sets of nodes: enough elements that the loop over them is split.
const SETS: usize = 1500;
const STEPS: usize = 8;
const THREADS: [usize; 3] = [1, 2, 5];

/// Runs many of the element on several numbers of threads and compares the whole states.
pub(super) fn finding<E: Element<N>, const N: usize>(specimen: &Specimen<E, N>) -> Finding {
    let (value, meaning) = match differences(specimen) {
        Ok(names) => (names.len() as f64, format!("states differ between {THREADS:?} threads in {}", names.join(", "))),
        Err(e) => (f64::NAN, format!("the run on several threads has failed: {e}")),
    };
    Finding { name: "determinism", value, least: 0.0, most: 0.0, meaning }
}

fn differences<E: Element<N>, const N: usize>(specimen: &Specimen<E, N>) -> Result<Vec<String>, KitError> {
    let unfit = |why: String| KitError::Unfit { kind: E::NAME, why };
    let mut model = specimen.crowd(SETS);
    // Every node moves another way, so that no two elements feel the same.
    let speed = 1e-3 * specimen.size() / step_of(specimen)?;
    for (k, node) in model.nodes.iter_mut().enumerate() {
        let t = k as f64;
        node.velocity = glam::DVec3::new(t.sin(), (1.3 * t).cos(), (0.7 * t).sin()) * speed;
    }
    let run = |threads: usize| -> Result<Vec<u8>, KitError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| unfit(format!("no {threads} threads: {e}")))?;
        pool.install(|| {
            let mut sim = simulation::<E, N>();
            sim.build(&model)?;
            run::start(&mut sim, &model)?;
            for _ in 0..STEPS {
                run::step(&mut sim)?;
            }
            sim.refresh_energies();
            sim.save_state().map_err(unfit)
        })
    };
    let reference = run(THREADS[0])?;
    let mut names = Vec::new();
    for threads in &THREADS[1..] {
        names.extend(state::differences(&reference, &run(*threads)?).map_err(unfit)?);
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// The first-party systems with this kind, if it is not one of theirs.
fn simulation<E: Element<N>, const N: usize>() -> Simulation {
    let mut sim = Simulation::new(default_plugins);
    if sim.registry.element(E::NAME).is_none() {
        sim.add_element::<E, N>();
    }
    sim
}

/// Stable step of one set of nodes (time).
fn step_of<E: Element<N>, const N: usize>(specimen: &Specimen<E, N>) -> Result<f64, KitError> {
    let model = specimen.crowd(1);
    let mut sim = simulation::<E, N>();
    sim.build(&model)?;
    let (limit, _) = crate::systems::time_step::stable_limit(&mut sim.world);
    if limit.is_finite() && limit > 0.0 {
        Ok(limit)
    } else {
        Err(SimulationError::Model(format!("the stiffness bound gives a time step of {limit:e}")).into())
    }
}
