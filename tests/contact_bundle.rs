//! Bundles squeezed and let go: contact with friction makes no energy, and has the same bits on any number of threads.
#[path = "support/bits.rs"]
mod bits;
use bits::{bits, on_threads};
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::systems::contact::monitor::summarise;
use braid_ecs::systems::default_plugins;

/// A hexagonal bundle of beams whose outer filaments are pressed inwards for a while and then let go.
fn bundle(filaments: usize, contact: &str) -> scene::LoadedScene {
    // Filaments of a hexagon come ring by ring: the last ring is pressed.
    let rings = [(1, 7), (7, 19), (19, 37)].into_iter().find(|r| r.1 == filaments).expect("a full hexagon");
    let loads: Vec<String> = (rings.0..rings.1)
        // The directions are found from the places below.
        .map(|f| format!("(nodes: [\"b.{f}[4]\"], force: FORCE{f}, amplitude: \"squeeze\")"))
        .collect();
    let text = format!(
        r#"(
        units: Consistent,
        materials: {{ "m": (young: 1e4, poisson: 0.3, density: 1) }},
        bundles: [(name: "b", filaments: {filaments}, radius: 0.1, length: 4, elements: 8, gap: 1.01, perturbation: 0.01, material: "m",
                   start: Clamped, end: Clamped)],
        loads: [{}],
        amplitudes: {{ "squeeze": Table([(0, 0), (2, 1), (4, 1), (4.1, 0)]) }},
        contact: ({contact}),
        stop: (time: 8),
    )"#,
        loads.join(", ")
    );
    let registry = Simulation::new(default_plugins).registry;
    let places = {
        let mut bare = text.clone();
        for f in rings.0..rings.1 {
            bare = bare.replace(&format!("FORCE{f},"), "[0, 0, 0],");
        }
        let loaded = scene::load_text("bundle.ron", bare, &[], &registry).unwrap_or_else(|e| panic!("{e}"));
        loaded.model.filaments.iter().map(|f| loaded.model.nodes[f.nodes[4].row()].position).collect::<Vec<_>>()
    };
    let mut loaded = text;
    for (f, place) in places.iter().enumerate().take(rings.1).skip(rings.0) {
        let push = DVec3::new(place.x, place.y, 0.0).normalize() * -0.1;
        loaded = loaded.replace(&format!("FORCE{f},"), &format!("[{}, {}, 0],", push.x, push.y));
    }
    scene::load_text("bundle.ron", loaded, &[], &registry).unwrap_or_else(|e| panic!("{e}"))
}

struct Watch(f64, f64);

impl run::Observer for Watch {
    fn sample(&mut self, sim: &mut Simulation) -> Result<(), braid_ecs::simulation::SimulationError> {
        sim.refresh_energies();
        let ledger = sim.world.resource::<EnergyLedger>();
        self.0 = self.0.max(ledger.external_work.abs());
        self.1 = self.1.max(ledger.imbalance().abs());
        Ok(())
    }
}

#[test]
fn squeezing_and_letting_go_makes_no_energy() {
    for filaments in [7, 19, 37] {
        let loaded = bundle(filaments, "friction: 0.3");
        let outcome = |threads: usize| {
            on_threads(threads, || {
                let mut sim = Simulation::new(default_plugins);
                sim.build(&loaded.model).expect("a sound model");
                let mut watch = Watch(0.0, 0.0);
                run::run(&mut sim, &loaded.model, 0.1, &mut watch).expect("a stable run");
                (watch, sim.world.resource::<EnergyLedger>().friction, bits(&mut sim))
            })
        };
        let (watch, friction, reference) = outcome(1);
        assert!(watch.0 > 0.0 && friction > 1e-3 * watch.0, "{filaments}: they have rubbed, {friction} of {}", watch.0);
        assert!(watch.1 < 5e-3 * watch.0, "{filaments} filaments: {} of {} is missing", watch.1, watch.0);
        for threads in [2, 5] {
            assert!(outcome(threads).2 == reference, "{filaments} filaments, {threads} threads");
        }
    }
}

/// Saved under load, restored on other threads: the same bits to the end.
#[test]
fn a_squeezed_bundle_goes_on_from_a_saved_state() {
    let loaded = bundle(7, "friction: 0.3");
    let started = || {
        let mut sim = Simulation::new(default_plugins);
        sim.build(&loaded.model).expect("a sound model");
        run::start(&mut sim, &loaded.model).expect("a stable start");
        sim
    };
    let go = |sim: &mut Simulation, until: f64| {
        while sim.world.resource::<Clock>().time < until {
            sim.step();
        }
    };
    let (saved, reference) = on_threads(1, || {
        let mut sim = started();
        go(&mut sim, 3.0);
        let saved = sim.save_state().expect("a state");
        go(&mut sim, 6.0);
        (saved, bits(&mut sim))
    });
    for threads in [1, 2, 5] {
        let again = on_threads(threads, || {
            let mut sim = started();
            sim.restore_state(&saved).expect("a state of this scene");
            go(&mut sim, 6.0);
            bits(&mut sim)
        });
        assert!(again == reference, "{threads} threads");
    }
}

/// Soft contacts are made stiffer until the target holds, with a smaller step and a closed balance.
#[test]
fn a_target_penetration_is_reached_as_far_as_the_step_may_shrink() {
    let squeezed = |slower: f64| {
        let loaded = bundle(
            7,
            &format!("friction: 0.3, stiffness: 1, penetration: (target: 0.01, slower: {slower})), integration: (monitor_every: 4"),
        );
        let mut sim = Simulation::new(default_plugins);
        sim.build(&loaded.model).expect("a sound model");
        run::start(&mut sim, &loaded.model).expect("a stable start");
        let first = sim.world.resource::<Clock>().dt_limit;
        while sim.world.resource::<Clock>().time < 4.0 {
            sim.step();
        }
        sim.refresh_energies();
        summarise(&mut sim.world);
        let (contacts, ledger) = (*sim.world.resource::<ContactSummary>(), *sim.world.resource::<EnergyLedger>());
        assert!(ledger.balance_error().abs() < 5e-3, "{ledger:?}");
        (0.5 * contacts.p99_penetration_to_radius, contacts.raised, first / sim.world.resource::<Clock>().dt_limit)
    };
    let (soft, one, _) = squeezed(1.0);
    assert!(soft > 0.02 && one == 1.0, "{soft} with the stiffness of the scene");
    let (held, raised, slower) = squeezed(20.0);
    assert!(held < 0.0105 && raised > 2.0 && slower < 20.0, "{held}, {raised} times stiffer, {slower} times slower");
    let (half, raised, _) = squeezed(1.2);
    assert!((raised - 1.44).abs() < 1e-9 && half > held && half < soft, "{half}, {raised} times stiffer");
}
