//! Pictures from the prompt: curves, filaments, frames for ParaView. Nothing is overwritten.
use super::address::Words;
use super::session::Session;
use super::stops::On;
use crate::output::file::{OutputError, write_atomic};
use crate::output::lines::Lines;
use crate::output::measured::{surfaces, unit};
use crate::output::picture::Scenery;
use crate::output::plot::{Axis, Plot, Series, panels};
use crate::output::{frame, render, vtp};
use crate::registry::SpecError;
use std::path::PathBuf;

/// Pixels of a picture, and of one diagram.
const PICTURE: (u32, u32) = (1200, 800);
const DIAGRAM: (u32, u32) = (900, 300);

/// The file to write, by default named after scene and step; one that is there is left alone.
fn file(session: &Session, mut words: Words<'_>, ending: &str) -> Result<PathBuf, SpecError> {
    let default = format!("{}_step{}.{ending}", session.scene.name(), session.step());
    let name = words.next().unwrap_or(&default);
    words.end()?;
    let path = PathBuf::from(name);
    if path.extension().is_none_or(|e| e != ending) {
        return Err(SpecError::new(name, format!("the file must end in .{ending}")));
    }
    if path.exists() {
        return Err(SpecError::new(name, format!("`{name}` is there already")).help("take another name"));
    }
    Ok(path)
}

fn fail(e: OutputError) -> SpecError {
    SpecError::new("", e.to_string())
}

impl Session {
    /// What made a file, so that one of a modified run can be told.
    fn provenance(&self) -> Vec<(String, String)> {
        let pair = |k: &str, v: String| (k.to_owned(), v);
        let mut all = vec![
            pair("program", format!("braid-ecs {}", env!("CARGO_PKG_VERSION"))),
            pair("scene", self.scene.name()),
            pair("step", self.clock().step.to_string()),
        ];
        all.extend(self.modified.map(|step| pair("modified", format!("since step {step}"))));
        all
    }
}

/// `plot [FILE.svg]`
pub(super) fn plot(session: &mut Session, words: Words<'_>) -> Result<String, SpecError> {
    let path = file(session, words, "svg")?;
    let units = session.scene.scene.units;
    let watches =
        session.stops.iter().filter_map(|s| if let On::Watch { expression, .. } = &s.on { Some((expression, &s.curve)) } else { None });
    let plots: Vec<Plot> = watches
        .map(|(e, curve)| {
            let unit = e.quantity().map_or(String::new(), |q| format!(" [{}]", unit(q, units)));
            Plot {
                title: String::new(),
                x: Axis::linear(format!("time [{}]", units.time())),
                y: Axis::linear(format!("{}{unit}", e.text)),
                series: vec![Series::line("", curve.clone())],
            }
        })
        .collect();
    if plots.is_empty() {
        return Err(SpecError::new("", "nothing is watched").help("`watch EXPR` keeps a curve from then on"));
    }
    let size = (DIAGRAM.0, DIAGRAM.1 * plots.len() as u32);
    write_atomic(&path, panels(&plots, size).as_bytes()).map_err(fail)?;
    Ok(format!("{} curves in {}", plots.len(), path.display()))
}

fn lines(session: &mut Session) -> Result<Lines, SpecError> {
    let lines = Lines::of(&session.scene.model, &mut session.sim);
    if lines.lines.is_empty() { Err(SpecError::new("", "the scene has no lines to draw")) } else { Ok(lines) }
}

/// `render [FILE.png]`
pub(super) fn render(session: &mut Session, words: Words<'_>) -> Result<String, SpecError> {
    let path = file(session, words, "png")?;
    let lines = lines(session)?;
    let scenery = Scenery::of(&session.scene.model, &lines, surfaces(&session.scene.model), &session.sim);
    let provenance = session.provenance();
    let texts: Vec<(&str, &str)> = provenance.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    let input = scenery.picture(&lines, &mut session.sim);
    render::render(&input, PICTURE.0, PICTURE.1).write_png(&path, &texts).map_err(fail)?;
    Ok(format!("{} lines in {}", lines.lines.len(), path.display()))
}

/// `frame [FILE.vtp]`
pub(super) fn frame(session: &mut Session, words: Words<'_>) -> Result<String, SpecError> {
    let path = file(session, words, "vtp")?;
    let lines = lines(session)?;
    let (provenance, time) = (session.provenance(), session.clock().time);
    vtp::write(&path, &frame::frame(&lines, &mut session.sim.world, &provenance), time).map_err(fail)?;
    Ok(format!("{} lines in {}", lines.lines.len(), path.display()))
}
