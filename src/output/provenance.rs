//! What made a file: program, revision, scene, seed, platform. No time of day, no machine name and no number of threads, so that
//! equal runs give equal files; the threads are in `summary.json`.
use crate::scene::LoadedScene;
use std::collections::BTreeMap;

/// Names and values, in the order in which they are written.
pub type Provenance = Vec<(String, String)>;

/// Revision of the sources that the program was built from; `+` where they differed from it, `development` in builds for
/// development.
pub const REVISION: &str = env!("BRAID_ECS_REVISION");

/// Extensions of the processor that the program was built for.
pub fn features() -> String {
    let all =
        [("avx2", cfg!(target_feature = "avx2")), ("fma", cfg!(target_feature = "fma")), ("avx512f", cfg!(target_feature = "avx512f"))];
    let used: Vec<&str> = all.iter().filter(|f| f.1).map(|f| f.0).collect();
    if used.is_empty() { "none".into() } else { used.join(" ") }
}

/// The provenance of the files of a scene; `resolved` is its text with all defaults.
pub fn provenance(loaded: &LoadedScene, resolved: &str) -> Provenance {
    let pair = |k: &str, v: String| (k.to_owned(), v);
    vec![
        pair("program", format!("braid-ecs {}", env!("CARGO_PKG_VERSION"))),
        pair("revision", REVISION.into()),
        pair("scene", loaded.name()),
        pair("scene_hash", blake3::hash(resolved.as_bytes()).to_hex()[..16].to_owned()),
        pair("units", format!("{:?}", loaded.scene.units)),
        pair("seed", loaded.scene.seed.to_string()),
        pair("target", format!("{}-{}", std::env::consts::ARCH, std::env::consts::OS)),
        pair("features", features()),
    ]
}

/// As a map, for JSON.
pub fn map(provenance: &[(String, String)]) -> BTreeMap<String, String> {
    provenance.iter().cloned().collect()
}

/// As lines that begin with `mark`, for texts with comments.
pub fn lines(provenance: &[(String, String)], mark: &str) -> String {
    // A line break in a value must not leave the comment.
    provenance.iter().map(|(k, v)| format!("{mark} {k}: {}\n", v.replace(['\n', '\r'], " "))).collect()
}

/// As a comment for SVG and other XML.
pub fn xml_comment(provenance: &[(String, String)]) -> String {
    let text: Vec<String> = provenance.iter().map(|(k, v)| format!("{k}: {}", v.replace("--", "- -"))).collect();
    format!("<!-- {} -->\n", text.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_leaves_a_comment() {
        let odd = [("scene".to_string(), "a\n--> b".to_string())];
        assert_eq!(lines(&odd, "#"), "# scene: a --> b\n");
        assert_eq!(xml_comment(&odd).matches("-->").count(), 1);
    }
}
