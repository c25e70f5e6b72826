//! Advice from a small file whose answers are known.
#[path = "support/program.rs"]
mod program;
use braid_ecs::advise::Data;
use program::Bench;

const DATA: &str = r#"{
    "format": 1, "study": "small", "made_by": "hand", "reference": "finest",
    "covered": [{"name": "pattern", "value": "Diamond"}, {"name": "axial force", "value": "0.001"}],
    "rows": [
        {"label": "trusses", "sets": [["tow.model", "Trusses"], ["tow.filaments", "7"], ["tow.elements", "8"]],
         "error": 0.67, "error_ci95": 0.1, "steps": 100, "elements": 672, "run_s": 1, "first_step_s": 1e-4},
        {"label": "sum", "sets": [["tow.model", "Embedded"], ["tow.bending", "SumOfFilaments"], ["tow.filaments", "7"], ["tow.elements", "9"],
         ["contact.stiffness", "\"0.04 N/mm\""]],
         "error": 0.14, "error_ci95": null, "steps": 200, "elements": 1512, "run_s": 4, "first_step_s": 1e-4}
    ]
}"#;

/// A bench with the data and a scene of which one word is changed.
fn bench(from: &str, to: &str) -> Bench {
    let bench = Bench::new();
    std::fs::write(bench.path("data.json"), DATA).unwrap();
    let scene = std::fs::read_to_string("scenes/embedded7.ron").unwrap();
    assert!(scene.contains(from));
    std::fs::write(bench.path("mine.ron"), scene.replacen(from, to, 1)).unwrap();
    bench
}

#[test]
fn the_proposed_scene_is_the_model_of_the_row() {
    let bench = bench("seed: 1", "seed: 2");
    let done = bench.expect(0, &["advise", "mine.ron", "--error", "20%", "--from", "data.json"]);
    let marked = done.out.lines().find(|l| l.starts_with("->")).expect("one is marked");
    assert!(marked.contains("sum") && marked.contains("14") && marked.contains("1512 elements"), "{}", done.out);
    assert!(done.out.contains("errors against finest") && done.out.contains("to run it: braid-ecs mine.advised.ron"), "{}", done.out);
    let text = std::fs::read_to_string(bench.path("mine.advised.ron")).unwrap();
    for part in ["// Model `sum` of the study `small`", "bending: SumOfFilaments", "elements: 9", "seed: 2", "\"0.04 N/mm\""] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    bench.expect(0, &["check", "mine.advised.ron"]);
    // What is there stays, unless asked.
    let again = bench.expect(2, &["advise", "mine.ron", "--error", "90%", "--from", "data.json"]);
    assert!(again.err.contains("`mine.advised.ron` is there already"), "{}", again.err);
    assert_eq!(std::fs::read_to_string(bench.path("mine.advised.ron")).unwrap(), text);
    bench.expect(0, &["advise", "mine.ron", "--error", "90%", "--from", "data.json", "--force"]);
    assert!(std::fs::read_to_string(bench.path("mine.advised.ron")).unwrap().contains("model: Trusses"), "the cheaper one will do");
}

#[test]
fn what_cannot_be_met_is_said_and_the_nearest_shown() {
    let bench = bench("seed: 1", "seed: 2");
    let done = bench.expect(6, &["advise", "mine.ron", "--error", "1%", "--from", "data.json"]);
    assert!(done.out.contains("no row meets what was asked for"), "{}", done.out);
    assert!(done.out.lines().any(|l| l.starts_with("->") && l.contains("sum")), "{}", done.out);
}

#[test]
fn a_scene_outside_of_the_study_is_told_where() {
    let bench = bench("pattern: Diamond", "pattern: Regular");
    let done = bench.expect(0, &["advise", "mine.ron", "--error", "20%", "--from", "data.json", "--out", "new.ron"]);
    assert!(done.out.contains("outside what the study covered: pattern Regular (study: Diamond)"), "{}", done.out);
    assert!(done.out.contains("tows 12 (study: none)"), "facts that the study does not tell: {}", done.out);
    assert!(std::fs::read_to_string(bench.path("new.ron")).unwrap().contains("against finest, extrapolated"));
}

#[test]
fn demands_that_make_no_sense_are_refused() {
    let bench = bench("seed: 1", "seed: 2");
    std::fs::copy("scenes/cantilever.ron", bench.path("cantilever.ron")).unwrap();
    std::fs::write(bench.path("old.json"), r#"{"format": 7}"#).unwrap();
    std::fs::write(bench.path("study.json"), r#"{"results": {"rows": []}}"#).unwrap();
    for (arguments, code, message) in [
        (&["advise", "mine.ron"][..], 2, "say what is wanted: --error 5%, --time 60s, or both"),
        (&["advise", "mine.ron", "--error=-5%"], 2, "an error must be above zero"),
        (&["advise", "mine.ron", "--error", "few"], 2, "few"),
        (&["advise", "mine.ron", "--time", "5 kg"], 2, "5 kg"),
        (&["advise", "cantilever.ron", "--error", "5%"], 2, "has no braid"),
        (&["advise", "mine.ron", "--error", "5%", "--from", "none.json"], 4, "none.json"),
        (&["advise", "mine.ron", "--error", "5%", "--from", "old.json"], 2, "has format version 7, and this program reads version 1"),
        (&["advise", "mine.ron", "--error", "5%", "--from", "study.json"], 2, "braid-ecs advise --collect study.json --out FILE"),
    ] {
        let done = bench.expect(code, arguments);
        assert!(done.err.contains(message), "{arguments:?}: {}", done.err);
    }
    assert!(!bench.path("mine.advised.ron").exists());
}

#[test]
fn the_advice_of_the_program_names_models_that_scenes_know() {
    let data = Data::shipped();
    assert!(data.rows.len() >= 3 && data.covered.iter().any(|f| f.name == "pattern"));
    let bench = bench("seed: 1", "seed: 2");
    let done = bench.expect(0, &["advise", "mine.ron", "--error", "20%"]);
    assert!(!done.out.contains("outside"), "{}", done.out);
    for row in &data.rows {
        let sets: Vec<String> = row.sets.iter().map(|(p, v)| format!("{p}={v}")).collect();
        let mut arguments = vec!["check", "mine.ron"];
        sets.iter().for_each(|s| arguments.extend(["--set", s]));
        if row.elements < 10_000 {
            bench.expect(0, &arguments);
        }
        assert!(row.error > 0.0 && row.run_s > 0.0 && row.first_step_s > 0.0, "{}", row.label);
    }
}
