//! Whatever stands in a file or on the command line, the reader answers with a message.
use braid_ecs::prelude::*;
use braid_ecs::scene::{self, error::Category};
use braid_ecs::systems::default_plugins;

const SCENES: [&str; 4] = [
    include_str!("../scenes/cantilever.ron"),
    include_str!("../scenes/lattice_pbc.ron"),
    include_str!("../scenes/two_filaments.ron"),
    include_str!("../scenes/embedded7.ron"),
];

/// Reads a text; an error must have a message, and a place inside the text.
fn read(text: &str, sets: &[(String, String)]) -> bool {
    let sim = Simulation::new(default_plugins);
    match scene::load_text("mangled.ron", text.to_string(), sets, &sim.registry) {
        Ok(_) => true,
        Err(errors) => {
            assert!(!errors.errors.is_empty());
            for e in &errors.errors {
                assert!(!e.message.is_empty());
                let (line, column) = e.place();
                assert!(line >= 1 && column >= 1);
                let _ = e.word();
                let mut report = String::new();
                miette::NarratableReportHandler::new().render_report(&mut report, e).expect("a report");
            }
            false
        }
    }
}

/// Without comments and long words, so that every place that is struck means something.
fn bare(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(|l| l.split("//").next().unwrap_or(l).trim()).filter(|l| !l.is_empty()).collect();
    // Small, so that reading many variants is quick.
    lines.join("\n").replace("filaments: 7", "filaments: 1").replace("elements: 31", "elements: 2")
}

#[test]
fn cut_off_scenes_are_refused() {
    for text in SCENES.map(bare) {
        assert!(read(&text, &[]), "the whole scene is sound");
        for end in (0..text.len() - 1).step_by(7).filter(|i| text.is_char_boundary(*i)) {
            assert!(!read(&text[..end], &[]), "cut at {end}");
        }
    }
}

#[test]
fn struck_scenes_never_panic() {
    let bits = [
        "",
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ":",
        "\"",
        "//",
        "/*",
        "-1",
        "NaN",
        "1e999",
        "99999999999999999999",
        "\u{20ac}",
        "Some",
        "r#\"",
        "\0",
    ];
    let mut state = 1u64;
    let mut next = |n: usize| {
        // Linear congruential generator of D. E. Knuth (MMIX).
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % n
    };
    for text in SCENES.map(bare) {
        for _ in 0..300 {
            let mut at = next(text.len());
            while !text.is_char_boundary(at) {
                at -= 1;
            }
            let mut end = (at + next(8)).min(text.len());
            while !text.is_char_boundary(end) {
                end += 1;
            }
            read(&format!("{}{}{}", &text[..at], bits[next(bits.len())], &text[end..]), &[]);
        }
    }
}

#[test]
fn nonsense_on_the_command_line_never_panics() {
    let text = bare(SCENES[3]);
    let values = ["", "(", "\"", "NaN", "-1", "1e999", "99999999999999999999", "[[[", "Some(", "a b", "()", "\u{20ac}"];
    for path in [
        "",
        ".",
        "[0]",
        "tow",
        "tow.filaments",
        "tow.model",
        "seed",
        "units",
        "version",
        "load.force",
        "nodes[3]",
        "contact",
        "a.b.c",
        "mandrel.shape",
    ] {
        for value in values {
            read(&text, &[(path.to_string(), value.to_string())]);
        }
    }
}

#[test]
fn giants_are_refused_before_they_are_built() {
    let text = bare(SCENES[3]);
    for (path, value) in [("tow.filaments", "4000000000"), ("tow.elements", "18446744073709551615"), ("braid.tows", "1000000000")] {
        let sim = Simulation::new(default_plugins);
        let e = scene::load_text("giant.ron", text.clone(), &[(path.into(), value.into())], &sim.registry).map(|_| ()).expect_err(path);
        assert!(e.to_string().contains("too large") && e.to_string().contains("giant.ron:"), "{e}");
    }
    let deep = format!("(units: Si, nodes: {}{})", "[".repeat(100_000), "]".repeat(100_000));
    assert!(!read(&deep, &[]));
}

#[test]
fn files_that_cannot_be_read_are_file_errors() {
    let sim = Simulation::new(default_plugins);
    let folder = tempfile::tempdir().unwrap();
    let load = |path: &std::path::Path| scene::load(path, &[], &sim.registry).map(|_| ()).expect_err("no scene");
    for path in [folder.path().join("missing.ron"), folder.path().to_path_buf()] {
        let e = load(&path);
        assert_eq!((e.category, e.category.exit_code()), (Category::File, 4), "{e}");
        assert!(e.to_string().contains(&path.display().to_string()));
    }
    let binary = folder.path().join("binary.ron");
    std::fs::write(&binary, [b'(', 0xff, 0xfe]).unwrap();
    let e = load(&binary);
    assert_eq!(e.category, Category::Scene);
    assert!(e.to_string().contains("not UTF-8 text: byte 1"), "{e}");
}
