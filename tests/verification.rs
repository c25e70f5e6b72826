//! The quick ones among the scenes with known answers; all of them when asked for (`--ignored`), as with `braid-ecs verify`.
use braid_ecs::prelude::*;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use braid_ecs::verify::{Verified, rows, verify};
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

/// What a scene of the manual expects and does not give.
fn missed(name: &str) -> Vec<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/verification/{name}.ron"));
    let sim = Simulation::new(default_plugins);
    let loaded = scene::load(path, &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    let outcome = match verify(&loaded, sim) {
        Ok(outcome) => outcome,
        Err(e) => return vec![format!("{name}: {e}")],
    };
    assert!(!outcome.rows.is_empty(), "{name} expects nothing");
    let wrong = outcome.rows.iter().filter(|row| !row.holds());
    wrong.map(|row| format!("{name}: {} is {:?} instead of {} +- {}", row.name, row.found, row.expected, row.allowed)).collect()
}

#[test]
fn quick_scenes_give_their_known_answers() {
    let wrong: Vec<String> = QUICK.iter().flat_map(|name| missed(name)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
#[ignore = "takes minutes; `.ci/run` runs it"]
fn all_scenes_give_their_known_answers() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/verification");
    let entries = std::fs::read_dir(folder).expect("the folder is there").map(|e| e.expect("an entry").path());
    let mut names: Vec<String> = entries.map(|p| p.file_stem().expect("a file").to_string_lossy().into_owned()).collect();
    names.sort();
    let (next, wrong) = (std::sync::atomic::AtomicUsize::new(0), std::sync::Mutex::new(Vec::new()));
    let work = || {
        while let Some(name) = names.get(next.fetch_add(1, std::sync::atomic::Ordering::Relaxed)) {
            let missed = missed(name);
            wrong.lock().expect("nobody panics with it").extend(missed);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    let wrong = wrong.into_inner().expect("nobody panics with it");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
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

/// The order of convergence of every quantity between two meshes; the quick ones among the scenes that say how they are refined.
#[test]
fn errors_fall_with_the_square_of_the_mesh() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/verification");
    let registry = Simulation::new(default_plugins).registry;
    // A name in the list has no order: exact by symmetry or balance, or next to a zero of its error.
    let cases: [(&str, [f64; 2], &[&str]); 4] = [
        ("SL12_catenary", [0.5, 1.0], &["middle x", "weight on the support"]),
        ("SL01_elastica", [0.5, 1.0], &["u, 10"]),
        ("SL08_toggle", [0.5, 1.0], &[]),
        ("DY04_sudden_weight", [0.5, 1.0], &["middle"]),
    ];
    for (name, meshes, without) in cases {
        let loaded = scene::load(folder.join(format!("{name}.ron")), &[], &registry).unwrap_or_else(|e| panic!("{e}"));
        let on = |mesh: f64| {
            let refined = loaded.on_mesh(mesh, &registry).unwrap_or_else(|e| panic!("{e}"));
            let outcome = verify(&refined, Simulation::new(default_plugins)).unwrap_or_else(|e| panic!("{name}: {e}"));
            Verified { mesh, ..outcome }
        };
        let rows = rows(&meshes.map(on));
        let (coarse, fine): (Vec<_>, Vec<_>) = rows.iter().partition(|r| r.mesh == meshes[0]);
        assert_eq!(2 * coarse[0].elements, fine[0].elements);
        for row in fine.iter().filter(|r| !without.contains(&r.quantity.as_str())) {
            let order = row.order.unwrap_or_else(|| panic!("{name}: {} has no order", row.quantity));
            assert!((1.7..2.3).contains(&order), "{name}: {} has the order {order}", row.quantity);
        }
    }
}

/// What cannot be refined is refused where it stands.
#[test]
fn a_mesh_that_cannot_be_made_is_named() {
    let registry = Simulation::new(default_plugins).registry;
    let text = |refine: &str| {
        format!(
            "(units: Si, materials: {{ \"m\": (young: 1e9, poisson: 0.3, density: 1000) }},
polylines: [(name: \"a\", points: [[0, 0, 0], [1, 0, 0], [2, 0, 0]], subdivisions: 6, radius: 0.01, material: \"m\", start: Clamped)],
stop: (time: 1), probes: {{ \"u\": Displacement(node: \"a.points[1]\", component: Y), \"v\": Displacement(node: \"a.0[9]\", component: Y) }},
refine: [{refine}])"
        )
    };
    let error = |refine: &str| scene::load_text("a.ron", text(refine), &[], &registry).map(|_| ()).expect_err(refine).to_string();
    let e = error("\"polylines[0].subdivision\"");
    assert!(e.contains("a.ron:4:") && e.contains("did you mean `polylines[0].subdivisions`"), "{e}");
    let e = error("\"polylines[0].radius\"");
    assert!(e.contains("`0.01`") && e.contains("only whole numbers"), "{e}");
    assert!(error("\"\"").contains("is not a path"));
    let e = error("\"polylines[0].subdivisions\", \"polylines[0].subdivisions\"");
    assert!(e.contains("named twice"), "{e}");

    let loaded = scene::load_text("a.ron", text("\"polylines[0].subdivisions\""), &[], &registry).unwrap_or_else(|e| panic!("{e}"));
    let refused = |factor: f64| loaded.on_mesh(factor, &registry).map(|_| ()).expect_err("no mesh").to_string();
    let e = refused(0.4);
    assert!(e.contains("a.ron:2:") && e.contains("0.4 times 6") && e.contains("k / 6"), "{e}");
    let e = refused(0.5);
    assert!(e.contains("a.0[9]"), "a node that is not there on the coarse mesh: {e}");
    let finer = loaded.on_mesh(2.0, &registry).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(finer.model.nodes.len(), 25);
    let none = scene::load_text("a.ron", text(""), &[], &registry).unwrap_or_else(|e| panic!("{e}"));
    assert!(none.on_mesh(2.0, &registry).map(|_| ()).expect_err("no refine").to_string().contains("does not say how its mesh is refined"));
}
