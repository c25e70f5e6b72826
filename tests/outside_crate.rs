//! A crate of somebody else: a path dependency, a plugin and one line of main give a whole command line.
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn text(path: impl AsRef<Path>) -> String {
    let path = Path::new(ROOT).join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The sections of the manifest whose heading begins so, as they are: with the same profile the
/// dependencies need not be compiled again.
fn sections(manifest: &str, heading: &str) -> String {
    let mut inside = false;
    let kept = manifest.lines().filter(|line| {
        if line.starts_with('[') {
            inside = line.starts_with(heading);
        }
        inside && !line.starts_with('#')
    });
    kept.map(|line| format!("{line}\n")).collect()
}

/// The line of the manifest that names this dependency.
fn dependency<'a>(manifest: &'a str, name: &str) -> &'a str {
    manifest.lines().find(|l| l.starts_with(&format!("{name} = "))).expect("a dependency of the project")
}

/// A new crate with the spring of the examples as its only source.
fn new_crate(folder: &Path) {
    let manifest = text("Cargo.toml");
    let own = format!(
        "[package]\nname = \"outside-braid\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\nbraid-ecs = {{ path = {ROOT:?} }}\n{}\n{}\n\n{}\n[profile.dev.package.braid-ecs]\nopt-level = 0\n",
        dependency(&manifest, "bevy_ecs"),
        dependency(&manifest, "serde"),
        sections(&manifest, "[profile.dev"),
    );
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("inside the folder")).expect("a folder");
        std::fs::write(path, text).expect("a file");
    };
    write("Cargo.toml", &own);
    write("Cargo.lock", &text("Cargo.lock"));
    // Settings of the compiler are part of what makes two builds of a dependency the same.
    write(".cargo/config.toml", &text(".cargo/config.toml"));
    write("src/spring.rs", &text("examples/lab_spring.rs"));
    write(
        "src/main.rs",
        "mod spring;\n\nfn main() -> std::process::ExitCode {\n    braid_ecs::cli::main((braid_ecs::systems::default_plugins, spring::plugin))\n}\n",
    );
    write("spring.ron", &text("examples/scenes/lab_spring.ron"));
}

fn run(command: &mut Command) -> (Output, String) {
    let output = command.output().expect("the program starts");
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    (output, said)
}

#[test]
fn a_new_crate_with_one_line_of_main_runs_a_scene_of_its_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    new_crate(folder.path());
    // The folder of the program is target/debug or target/release.
    let target = Path::new(env!("CARGO_BIN_EXE_braid-ecs")).ancestors().nth(2).expect("a target folder").to_owned();
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut build = Command::new(cargo);
    build.args(["build", "--offline", "--quiet", "--target-dir"]).arg(&target).current_dir(folder.path());
    let (built, said) = run(&mut build);
    assert!(built.status.success(), "{said}");

    let program: PathBuf = target.join("debug").join(format!("outside-braid{}", std::env::consts::EXE_SUFFIX));
    let (listed, said) = run(Command::new(&program).arg("plugins").current_dir(folder.path()));
    assert!(listed.status.success(), "{said}");
    assert!(said.lines().any(|l| l.trim_start().starts_with("lab.spring ")), "{said}");
    let (verified, said) = run(Command::new(&program).args(["verify", "spring.ron"]).current_dir(folder.path()));
    assert!(verified.status.success(), "{said}");
    assert!(said.contains("4 of 4 quantities as expected"), "{said}");
    let (ran, said) = run(Command::new(&program).args(["spring.ron", "--threads", "1"]).current_dir(folder.path()));
    assert!(ran.status.success(), "{said}");
    assert!(folder.path().join("results/spring/summary.json").exists(), "{said}");
}

#[test]
fn the_page_about_plugins_names_the_dependencies_of_this_version() {
    let (page, manifest) = (text("systems/README.md"), text("Cargo.toml"));
    for name in ["bevy_ecs", "serde"] {
        assert!(page.contains(dependency(&manifest, name)), "{name}");
    }
}
