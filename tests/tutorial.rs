//! The tutorial: its code is that of the example, its scenes run and give what it says.
use braid_ecs::kit::Specimen;
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use braid_ecs::verify::verify;

#[allow(dead_code)]
#[path = "../examples/tutorial.rs"]
mod tutorial;
use tutorial::{Fibre, plugin};

const PAGE: &str = include_str!("../systems/TUTORIAL.md");
const BAR: &str = include_str!("../examples/scenes/tutorial_bar.ron");
const BRAID: &str = include_str!("../examples/scenes/tutorial_braid.ron");

/// The blocks of the page in a language.
fn blocks(language: &str) -> Vec<&'static str> {
    PAGE.split(&format!("```{language}\n")).skip(1).map(|t| t.split("```").next().expect("a split has a first part")).collect()
}

fn loaded(text: &str) -> (Simulation, scene::LoadedScene) {
    let sim = Simulation::new((default_plugins, plugin));
    let loaded = scene::load_text("a.ron", text.into(), &[], &sim.registry).unwrap_or_else(|e| panic!("{e}"));
    (sim, loaded)
}

#[test]
fn the_code_of_the_page_is_that_of_the_example() {
    let code = include_str!("../examples/tutorial.rs");
    let all = blocks("rust");
    // The lines of the kit are those of this file, with the scene of this file.
    let (kit, rest): (Vec<&str>, Vec<&str>) = all.into_iter().partition(|b| b.contains("Specimen"));
    assert_eq!((kit.len(), rest.len()), (1, 7));
    for block in rest {
        assert!(code.contains(block), "not in examples/tutorial.rs:\n{block}");
    }
    assert_eq!(blocks("ron"), [BAR, BRAID]);
}

#[test]
fn the_fibre_holds() -> Result<(), Box<dyn std::error::Error>> {
    const SCENE: &str = BAR;
    let report = Specimen::<Fibre, 2>::of_scene((default_plugins, plugin), SCENE)?.report();
    assert!(report.holds(), "{report}");
    assert!(include_str!("tutorial.rs").contains(blocks("rust").iter().find(|b| b.contains("Specimen")).expect("one")));
    Ok(())
}

#[test]
fn the_bar_comes_to_its_known_answers() {
    let (sim, loaded) = loaded(BAR);
    let verified = verify(&loaded, sim).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(verified.rows.len(), 3);
    for row in &verified.rows {
        assert!(row.holds(), "{row:?}");
    }
}

#[test]
fn the_braid_moves_and_keeps_its_energy() {
    let (mut sim, loaded) = loaded(BRAID);
    sim.build(&loaded.model).expect("a sound model");
    run::run(&mut sim, &loaded.model, f64::INFINITY, &mut run::Blind).expect("a stable run");
    let e = *sim.world.resource::<EnergyLedger>();
    assert!(e.external_work > 0.0 && e.balance_error().abs() < 1e-3, "{e:?}");
    let length = |sim: &mut Simulation, name: &str| {
        let probe = &loaded.probes.iter().find(|p| p.0 == name).expect("a probe of the scene").1;
        probe.evaluate(&mut sim.world)
    };
    let start = loaded.model.nodes[loaded.model.node_names["period"].row()].position.length();
    assert!(length(&mut sim, "length") > start, "it gets longer");
}

#[cfg(debug_assertions)]
#[test]
fn the_prompt_shows_the_fibre() {
    use braid_ecs::stepper::{Session, run_script};
    let (sim, loaded) = loaded(BAR);
    let mut session = Session::new(sim, loaded, std::sync::Arc::default()).unwrap_or_else(|e| panic!("{}", e.1));
    let mut out = Vec::new();
    run_script(&mut session, "page", "step\nprint element my.fibre 1\n".as_bytes(), &mut out).unwrap_or_else(|e| panic!("{e}"));
    let said = String::from_utf8(out).expect("text");
    assert_eq!(blocks("console"), [said.as_str()], "\n{said}");
}
