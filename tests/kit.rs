//! The test kit on every first-party element, on those of the examples, and on elements with planted mistakes.
use braid_ecs::kit::{Report, Specimen};
use braid_ecs::prelude::*;
use braid_ecs::systems::{beam::Beam, bending::Bending, default_plugins, truss::Truss};

#[path = "../examples/lab_plastic_truss.rs"]
mod lab_plastic_truss;
#[path = "../examples/lab_slip_beam.rs"]
mod lab_slip_beam;
#[path = "../examples/lab_spring.rs"]
mod lab_spring;

/// A scene with some elements on three nodes in a row.
fn scene(elements: &str) -> String {
    format!(
        r#"(
    units: Si,
    sections: {{"bar": Stiffness(ea: 40, ei: 3, gj: 2, ga: 70, mass: 0.3, inertia: 0.01)}},
    nodes: [[0, 0, 0], [1, 0.25, 0], [2, 0.5, 0]],
    elements: {{{elements}}},
    stop: (steps: 1),
)"#
    )
}

const TRUSS: &str = r#""truss": [(nodes: [0, 1, 2], section: "bar")]"#;

fn holds(report: &Report) {
    assert!(report.holds(), "{report}");
}

#[test]
fn every_first_party_element_holds() {
    let truss = Specimen::<Truss, 2>::of_scene(default_plugins, &scene(TRUSS)).expect("a sound scene").report();
    holds(&truss);
    // The bar on two equal masses meets its bound exactly; on these the middle one is twice as heavy.
    assert!((truss.value("time step").expect("reported") - 0.75f64.sqrt()).abs() < 1e-6, "{truss}");
    let beam = scene(r#""beam": [(nodes: [0, 1, 2], section: "bar")]"#);
    holds(&Specimen::<Beam, 2>::of_scene(default_plugins, &beam).expect("a sound scene").report());
    let bending = scene(&format!(r#"{TRUSS}, "bending": [(nodes: [0, 1, 2], section: "bar")]"#));
    holds(&Specimen::<Bending, 3>::of_scene(default_plugins, &bending).expect("a sound scene").report());
}

#[test]
fn the_elements_of_the_examples_hold() {
    let plugins = (default_plugins, lab_spring::plugin);
    let spring = scene(r#""lab.spring": [(nodes: [0, 1], stiffness: 5, cubic: 20)], "truss": [(nodes: [0, 1, 2], section: "bar")]"#);
    holds(&Specimen::<lab_spring::Spring, 2>::of_scene(plugins, &spring).expect("a sound scene").report());
    let plugins = (default_plugins, lab_slip_beam::plugin);
    let slip = scene(r#""lab.slip_beam": [(nodes: [0, 1, 2], section: "bar", stuck: 12, slip_moment: 100)]"#);
    holds(&Specimen::<lab_slip_beam::SlipBeam, 2>::of_scene(plugins, &slip).expect("a sound scene").report());
    // It yields at a strain of 0.1: the deformed shapes must stay below, where the energy is a function of the shape.
    let plugins = (default_plugins, lab_plastic_truss::plugin);
    let plastic =
        scene(r#""lab.plastic_truss": [(nodes: [0, 1], section: "bar", yield_force: 4)], "truss": [(nodes: [1, 2], section: "bar")]"#);
    let specimen = Specimen::<lab_plastic_truss::PlasticTruss, 2>::of_scene(plugins, &plastic).expect("a sound scene");
    holds(&specimen.deformed_by(0.01).report());
}

/// What is wrong with a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Mistake {
    Nothing,
    Sign,
    OneEnd,
    Energy,
    FixedDirection,
    SoftBound,
    StiffBound,
    Stressed,
}
use Mistake::*;

/// A spring with one mistake.
#[derive(Component, Clone, Debug, Serialize, Deserialize)]
struct Wrong {
    length: f64,
    mistake: Mistake,
}

#[derive(Deserialize)]
struct WrongSpec {
    nodes: Vec<NodeId>,
    mistake: Mistake,
}

impl Element<2> for Wrong {
    const NAME: &'static str = "test.wrong";
    const ABOUT: &'static str = "a spring with a mistake";
    type Force = DVec3;
    type Spec = WrongSpec;

    fn read(spec: WrongSpec, build: &mut Build<'_>) -> Result<(), SpecError> {
        let nodes = [spec.nodes[0], spec.nodes[1]];
        let [a, b] = nodes.map(|n| build.model.nodes[n.row()].position);
        let length = (b - a).length() * if spec.mistake == Stressed { 0.9 } else { 1.0 };
        build.model.add_element(Wrong { length, mistake: spec.mistake }, nodes);
        Ok(())
    }

    fn internal_force(&mut self, nodes: [NodeState; 2]) -> [DVec3; 2] {
        let d = nodes[1].x - nodes[0].x;
        let e = if self.mistake == FixedDirection { DVec3::X } else { d.normalize() };
        let f = e * (10.0 * (d.length() - self.length));
        match self.mistake {
            Sign => [f, -f],
            OneEnd => [-f, f * 0.5],
            _ => [-f, f],
        }
    }

    fn strain_energy(&self, nodes: [NodeState; 2]) -> f64 {
        let factor = if self.mistake == Energy { 10.0 } else { 5.0 };
        factor * ((nodes[1].x - nodes[0].x).length() - self.length).powi(2)
    }

    fn stiffness_bound(&self, _: [NodeState; 2], _: [NodeMass; 2]) -> [StiffnessBound; 2] {
        let k = match self.mistake {
            SoftBound => 10.0,
            StiffBound => 200.0,
            _ => 20.0,
        };
        [StiffnessBound { translation: k, rotation: 0.0 }; 2]
    }

    fn mass(&self) -> [NodeMass; 2] {
        [NodeMass { mass: 1.0, inertia: 0.0 }; 2]
    }
}

fn report(mistake: Mistake) -> Report {
    let plugins = (default_plugins, |sim: &mut Simulation| sim.add_element::<Wrong, 2>());
    let entry = format!("(nodes: [0, 1], mistake: {mistake:?})");
    let text = format!("(units: Si, nodes: [[0, 0, 0], [1, 0.25, 0]], elements: {{\"test.wrong\": [{entry}]}}, stop: (steps: 1))");
    Specimen::<Wrong, 2>::of_scene(plugins, &text).expect("a sound scene").report()
}

/// Names of the numbers that are not right.
fn found(mistake: Mistake) -> Vec<&'static str> {
    let report = report(mistake);
    let names: Vec<&str> = report.findings.iter().filter(|f| !f.holds()).map(|f| f.name).collect();
    assert_eq!(report.errors().len(), names.len());
    names
}

#[test]
fn planted_mistakes_are_found_and_named() {
    assert_eq!(found(Nothing), [""; 0]);
    assert!(found(Sign).contains(&"force is gradient"), "{:?}", found(Sign));
    assert!(found(OneEnd).contains(&"force balance"), "{:?}", found(OneEnd));
    assert_eq!(found(Energy), ["force is gradient"]);
    let fixed = found(FixedDirection);
    assert!(fixed.contains(&"objectivity") && fixed.contains(&"moment balance"), "{fixed:?}");
    assert_eq!(found(SoftBound), ["time step", "time step deformed"]);
    assert_eq!(found(StiffBound), ["time step"]);
    let stressed = found(Stressed);
    assert!(stressed.contains(&"rigid motion force") && stressed.contains(&"rigid motion energy"), "{stressed:?}");
}

#[test]
fn the_message_about_a_wrong_sign_names_force_and_slope() {
    let report = report(Sign);
    let errors = report.errors();
    let about = errors.iter().find(|e| e.contains("force is gradient")).expect("found");
    assert!(about.starts_with("test.wrong: force is gradient is "), "{about}");
    // Twice the force in one component, which is at least 1/sqrt(3) of the whole somewhere.
    assert!(report.value("force is gradient").expect("reported") >= 2.0 / 3f64.sqrt(), "{report}");
    assert!(
        about.contains("not the derivative of the strain energy") && about.contains("the force is") && about.contains("dE/dx is"),
        "{about}"
    );
}

#[test]
fn a_specimen_that_cannot_be_taken_is_refused() {
    let absent = Specimen::<Beam, 2>::of_scene(default_plugins, &scene(TRUSS)).expect_err("no beam");
    assert_eq!(absent.to_string(), "the scene has no element of kind `beam`");
    let wrong = Specimen::<Beam, 2>::of_scene(default_plugins, &scene(r#""baem": []"#)).expect_err("misspelt");
    assert!(wrong.to_string().contains("did you mean `beam`?"), "{wrong}");
}
