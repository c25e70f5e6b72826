//! Every file of `scenes/bad` is refused before the first step, with the message that stands in it.
use braid_ecs::prelude::*;
use braid_ecs::run;
use braid_ecs::scene;
use braid_ecs::systems::default_plugins;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/bad")
}

/// What the program says about a scene, with the exit code; the folder is left out of the message.
fn refuse(path: &Path) -> (String, u8) {
    let mut sim = Simulation::new(default_plugins);
    let name = path.display().to_string();
    let errors = match scene::load(path, &[], &sim.registry) {
        Err(errors) => errors,
        Ok(loaded) => {
            let outcome = sim.build(&loaded.model).and_then(|()| run::start(&mut sim, &loaded.model));
            loaded.explain(&outcome.expect_err("a bad scene is refused before the first step"))
        }
    };
    // The report for a terminal must not fail either.
    let mut report = String::new();
    for e in &errors.errors {
        miette::NarratableReportHandler::new().render_report(&mut report, e).expect("a report");
    }
    (errors.to_string().replace(&name, &path.file_name().unwrap().to_string_lossy()), errors.category.exit_code())
}

/// The message in the comment at the top of a file.
fn expected(text: &str) -> String {
    text.lines().map_while(|l| l.strip_prefix("// ")).collect::<Vec<_>>().join("\n")
}

#[test]
fn every_bad_scene_gives_the_message_in_it() {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder()).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    let mut wrong = Vec::new();
    for path in &files {
        let text = std::fs::read_to_string(path).unwrap();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let (message, code) = refuse(path);
        let expected = match name.as_str() {
            // Nothing can stand in an empty file.
            "BI14_empty.ron" | "BI14_blank.ron" => {
                format!(
                    "{name}: the scene is empty\n  help: the smallest scene is (units: Si, nodes: [...], elements: {{...}}, stop: (time: 1))"
                )
            }
            _ => expected(&text),
        };
        if message != expected || code != 3 {
            wrong.push(format!("== {name} (exit code {code})\nexpected\n{expected}\nfound\n{message}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for n in 1..=20 {
        assert!(files.iter().any(|f| f.file_name().unwrap().to_string_lossy().starts_with(&format!("BI{n:02}"))), "BI{n:02} has a file");
    }
}
