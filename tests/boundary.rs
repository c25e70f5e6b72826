//! The physics compiles as an outside crate: it uses what the prelude and other public modules give to everybody.
use braid_ecs::prelude::*;

#[allow(dead_code, unused_imports, missing_docs)]
#[path = "../systems/mod.rs"]
mod systems;

#[test]
fn systems_compiled_from_outside_register_the_same_elements() {
    let names = |sim: &Simulation| sim.registry.elements.iter().map(|k| k.name).collect::<Vec<_>>();
    let outside = Simulation::new(systems::default_plugins);
    let inside = Simulation::new(braid_ecs::systems::default_plugins);
    assert_eq!(names(&outside), names(&inside));
    let installers = |sim: &Simulation| sim.registry.installers.iter().map(|i| i.0).collect::<Vec<_>>();
    assert_eq!(installers(&outside), installers(&inside));
}
