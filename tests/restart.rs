//! A saved state goes on with the same bits, on any number of threads.
#[path = "support/bits.rs"]
mod bits;
use bits::on_threads;
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene::load;
use braid_ecs::state;
use braid_ecs::systems::default_plugins;
use std::path::Path;

/// A simulation of a scene of the project, ready for its first step.
fn started(scene: &str, sets: &[(&str, &str)]) -> Simulation {
    let mut sim = Simulation::new(default_plugins);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene);
    let sets: Vec<(String, String)> = sets.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
    let loaded = load(&path, &sets, &sim.registry).expect("a scene of the project");
    sim.build(&loaded.model).expect("a sound model");
    run::start(&mut sim, &loaded.model).expect("a stable start");
    sim
}

fn steps(sim: &mut Simulation, count: usize) {
    for _ in 0..count {
        sim.step();
    }
}

fn contacts(sim: &mut Simulation) -> usize {
    sim.refresh_energies();
    sim.world.get_resource::<ContactSummary>().map_or(0, |c| c.active)
}

#[test]
fn a_restored_run_goes_on_with_the_same_bits() {
    // Embedded elements that close on the mandrel with friction; beams in contact under prescribed motion; periodic
    // trusses; a single beam; trusses that a mandrel holds without penalty.
    let braid: &[(&str, &str)] = &[("load.stroke", "0.05 mm"), ("tow.elements", "15")];
    let held: &[(&str, &str)] = &[("load.stroke", "0.05 mm"), ("tow.elements", "15"), ("mandrel.enforcement", "Kinematic")];
    let cases: [(&str, &[(&str, &str)], [usize; 2], bool); 7] = [
        ("embedded7.ron", braid, [5000, 700], true),
        ("truss7.ron", braid, [3000, 300], true),
        ("strand_1x7.ron", &[], [2000, 500], true),
        ("lattice_pbc.ron", &[], [200, 200], false),
        ("cantilever.ron", &[], [300, 300], false),
        ("cantilever.ron", &[("damping", "Adaptive")], [300, 300], false),
        ("truss7.ron", held, [3000, 300], true),
    ];
    for (scene, sets, [before, after], touching) in cases {
        let (saved, reference) = on_threads(1, || {
            let mut sim = started(scene, sets);
            steps(&mut sim, before);
            let saved = sim.save_state().expect("a state that can be saved");
            steps(&mut sim, after);
            assert_eq!(contacts(&mut sim) > 10, touching, "{scene}: what touches");
            (saved, sim.save_state().expect("a state that can be saved"))
        });
        for threads in [1, 2] {
            let restored = on_threads(threads, || {
                let mut sim = started(scene, sets);
                sim.restore_state(&saved).expect("a state of this scene");
                assert!(sim.save_state().expect("saved again") == saved, "{scene}: the state differs as soon as it is restored");
                steps(&mut sim, after);
                contacts(&mut sim);
                sim.save_state().expect("a state that can be saved")
            });
            // The whole state: positions, velocities, friction history, lists, energies.
            let different = state::differences(&restored, &reference).expect("two states");
            assert!(different.is_empty(), "{scene} on {threads} threads: {different:?}");
        }
    }
}

#[test]
fn a_state_of_another_scene_is_refused() {
    let saved = started("cantilever.ron", &[]).save_state().expect("a state");
    let mut other = started("two_filaments.ron", &[]);
    let message = other.restore_state(&saved).expect_err("another scene");
    assert!(message.contains("another scene") || message.contains("in this scene"), "{message}");
    let mut same = started("cantilever.ron", &[]);
    for cut in [0, 1, saved.len() / 2, saved.len() - 1] {
        assert!(same.restore_state(&saved[..cut]).is_err(), "cut off at {cut}");
    }
    let mut longer = saved.clone();
    longer.push(0);
    assert!(same.restore_state(&longer).is_err());
}
