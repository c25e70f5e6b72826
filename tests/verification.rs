//! The quick ones among the scenes with known answers; `braid-ecs verify` runs all of them.
use braid_ecs::prelude::*;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use braid_ecs::verify::verify;
use std::path::Path;

const QUICK: [&str; 24] = [
    "BR04_diamond",
    "CF01_capstan_polygon",
    "CF01_capstan_moving",
    "CF02_helix_pressure",
    "CF04_incline_holds",
    "CF04_incline_slides",
    "CF04_thrown_holds",
    "CF04_thrown_stops",
    "CF05_coulomb_oscillator",
    "CF10_band_corner",
    "CF17_friction_direction",
    "CF17_friction_direction_90",
    "DY08_step_of_bars",
    "DY14_elastic_pendulum",
    "DY15_spinning_ring",
    "PM02_lattices_free",
    "PM04_honeycomb",
    "PM06_periodic_chain",
    "PM07_lever",
    "PM08_embedded_beam",
    "SL01_elastica",
    "SL09_two_bar_truss",
    "SL11_star_dome",
    "SL12_catenary",
];

#[test]
fn quick_scenes_give_their_known_answers() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/verification");
    for name in QUICK {
        let sim = Simulation::new(default_plugins);
        let loaded = scene::load(folder.join(format!("{name}.ron")), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
        let outcome = verify(&loaded, sim).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(!outcome.rows.is_empty(), "{name} expects nothing");
        for row in &outcome.rows {
            assert!(row.holds(), "{name}: {} is {:?} instead of {} +- {}", row.name, row.found, row.expected, row.allowed);
        }
    }
}

/// Whatever the folder holds can be read, and expects something.
#[test]
fn every_scene_of_the_folder_is_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/verification");
    let registry = Simulation::new(default_plugins).registry;
    let mut count = 0;
    for entry in std::fs::read_dir(folder).expect("the folder is there") {
        let path = entry.expect("an entry").path();
        let loaded = scene::load(&path, &[], &registry).unwrap_or_else(|e| panic!("{e}"));
        assert!(!loaded.scene.expect.is_empty(), "{} expects nothing", path.display());
        count += 1;
    }
    assert!(count >= QUICK.len());
}
