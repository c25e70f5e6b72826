//! Tells the program which revision of the sources it was built from. Programs for development are not: they would have to be
//! built anew after every commit.
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let release = std::env::var("PROFILE").is_ok_and(|p| p == "release");
    let revision = if release { revision().unwrap_or_else(|| "unknown".into()) } else { "development".into() };
    println!("cargo:rustc-env=BRAID_ECS_REVISION={revision}");
}

/// The commit, with a plus where files differ from it; none outside a repository of this package.
fn revision() -> Option<String> {
    let package = std::env::var("CARGO_MANIFEST_DIR").ok()?;
    let git = |arguments: &[&str]| {
        let done = Command::new("git").args(arguments).current_dir(&package).output().ok().filter(|o| o.status.success())?;
        Some(String::from_utf8_lossy(&done.stdout).trim().to_string())
    };
    if std::fs::canonicalize(git(&["rev-parse", "--show-toplevel"])?).ok()? != std::fs::canonicalize(&package).ok()? {
        return None;
    }
    for changing in ["HEAD", "index", "logs/HEAD"] {
        println!("cargo:rerun-if-changed={}", git(&["rev-parse", "--git-path", changing])?);
    }
    let changed = !git(&["status", "--porcelain", "--untracked-files=no"])?.is_empty();
    Some(git(&["rev-parse", "--short=12", "HEAD"])? + if changed { "+" } else { "" })
}
