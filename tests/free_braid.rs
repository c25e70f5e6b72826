//! Measures of a braid in motion: pulled without mandrel and contact it follows the closed form of
//! the stress-free helix of fixed turn, and its angle is that of the helix.
use braid_ecs::generate::*;
use braid_ecs::measure::*;
use braid_ecs::prelude::*;
use braid_ecs::run::{self, Blind};
use braid_ecs::systems::default_plugins;
use std::collections::BTreeMap;

/// Pulls a smooth braid of one filament per tow with the force that the closed form gives for `length`.
fn pulled_to(length: f64, model: FilamentModel, elements: usize) -> (BraidLayout, BraidMeasures) {
    let mut m = Model::new("free braid");
    let materials = BTreeMap::from([("glass".to_string(), Material { young: 72e3, poisson: 0.23, density: 2.58e-9 })]);
    let sections = BTreeMap::new();
    let spec = BraidSpec { undulation: Some(Length(0.0)), ..BraidSpec::new(3.0) };
    let tow = TowSpec { model, filaments: 1, elements, bending: Some(Bending::OneFilament), ..TowSpec::new(0.0025, "glass") };
    let registry = Simulation::new(default_plugins).registry;
    let layout = braid(&spec, &tow, 1, &registry, &mut Build { model: &mut m, materials: &materials, sections: &sections }).expect("valid");
    let force = layout.helix_force(length);
    let unit_time = (layout.mass * 0.5 * layout.geometry.radius / force).sqrt();
    let ramp = m.add_amplitude(Amplitude::SmoothStep { rise: 2.0 * unit_time });
    m.loads.push(NodalLoad { node: layout.dummy, force: DVec3::Z * force, moment: DVec3::ZERO, follower: false, amplitude: ramp });
    m.integration.damping = Damping::Mass(1.0 / unit_time);
    m.stop.time = Some(16.0 * unit_time);
    let mut sim = Simulation::new(default_plugins);
    sim.build(&m).expect("a sound model");
    run::run(&mut sim, &m, f64::INFINITY, &mut Blind).expect("a stable run");
    let measures = braid_measures(&m, &mut sim.world, Heights::Radial).expect("the model has a braid");
    (layout, measures)
}

#[test]
fn measures_follow_the_free_helix() {
    for (model, length) in [(FilamentModel::Beams, 2.6), (FilamentModel::Embedded, 3.1)] {
        let (layout, measures) = pulled_to(length, model.clone(), 20);
        assert!((measures.length / length - 1.0).abs() < 2e-3, "{model:?}: {} instead of {length}", measures.length);
        // Both tows stand at acos(h / L) to the axis.
        let full = 2.0 * (length / layout.arc_length).acos();
        assert!((measures.angle.mean - full).abs() < 0.01, "{} instead of {full}", measures.angle.mean);
        assert_eq!(measures.crossings.len(), 12);
        assert!(measures.angle.ci95.expect("12 crossings") < 1e-3, "all crossings are alike");
    }
}
