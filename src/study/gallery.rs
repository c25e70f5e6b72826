//! The last pictures of the rows, side by side.
use super::plan::Plan;
use super::results::{Results, RowResult};
use super::text::escape;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write as _;
use std::path::Path;

/// First bytes of a PNG.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

/// The pictures as part of a page; `folder` is that of the study. Empty if the study wants none.
pub(super) fn gallery(plan: &Plan, results: &Results, folder: &Path) -> String {
    if !plan.file.study.pictures {
        return String::new();
    }
    let mut h = String::from("<h2>Pictures</h2>\n<div class=\"pictures\">\n");
    for row in &results.rows {
        let label = escape(&row.label());
        let _ = match picture(row, folder) {
            Ok(data) => {
                writeln!(h, "<figure><img alt=\"{label}\" src=\"data:image/png;base64,{data}\"><figcaption>{label}</figcaption></figure>")
            }
            Err(why) => writeln!(h, "<figure><p class=\"none\">{}</p><figcaption>{label}</figcaption></figure>", escape(&why)),
        };
    }
    h + "</div>\n<p>The end of the first run of every row.</p>\n"
}

/// The last picture of the first run of a row in base 64, or why there is none.
fn picture(row: &RowResult, folder: &Path) -> Result<String, String> {
    let run = row.runs.first().ok_or("no run")?;
    if run.record.is_none() {
        return Err("no picture: the run is missing".into());
    }
    let path = format!("{}/final.png", run.folder);
    let bytes = std::fs::read(folder.join(&path)).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound if run.status == "failed" => "no picture: the run failed".to_owned(),
        std::io::ErrorKind::NotFound => format!("no picture: there is no {path} (output.pictures may be false)"),
        _ => format!("no picture: {path}: {e}"),
    })?;
    if bytes.starts_with(PNG) { Ok(STANDARD.encode(bytes)) } else { Err(format!("no picture: {path} is no PNG")) }
}
