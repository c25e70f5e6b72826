//! From a model to the input of a picture: tubes, mandrel, repeated cells.
use super::lines::Lines;
use super::render::{PictureInput, Surface, Tube, View, repeat};
use crate::assembly::node_states;
use crate::components::NodeId;
use crate::model::Model;
use crate::simulation::{NodeRows, Simulation};
use glam::DVec3;
use std::collections::BTreeMap;

/// What a picture needs to know besides the positions.
pub struct Scenery {
    surfaces: Vec<Surface>,
    /// Line that carries on where line `i` ends in the next cell.
    successor: Vec<usize>,
    /// Row of the only period vector.
    period: Option<usize>,
}

/// Most cells drawn side by side.
const MOST_CELLS: usize = 4;

impl Scenery {
    /// The scenery of a model that has been built, with its rigid surfaces.
    pub fn of(model: &Model, lines: &Lines, surfaces: Vec<Surface>, sim: &Simulation) -> Self {
        let rows = sim.world.resource::<NodeRows>();
        let mut dummies: Vec<NodeId> = model.periodic.iter().flat_map(|p| p.dummies.clone()).collect();
        dummies.sort_unstable();
        dummies.dedup();
        let period = if let [only] = dummies[..] { Some(rows.of(only)) } else { None };
        let image_of: BTreeMap<usize, usize> = model.periodic.iter().map(|p| (rows.of(p.image), rows.of(p.node))).collect();
        let starts: BTreeMap<usize, usize> = lines.lines.iter().enumerate().map(|(i, l)| (l.rows[0] as usize, i)).collect();
        let next = |last: usize| image_of.get(&last).and_then(|first| starts.get(first)).copied();
        let successor = lines.lines.iter().enumerate().map(|(i, l)| next(l.rows[l.rows.len() - 1] as usize).unwrap_or(i)).collect();
        Scenery { surfaces, successor, period }
    }

    /// The picture of the present state. A cell with one period is shown as often as makes a
    /// well-shaped picture.
    pub fn picture(&self, lines: &Lines, sim: &mut Simulation) -> PictureInput {
        let states = node_states(&mut sim.world);
        let tubes: Vec<Tube> = lines
            .lines
            .iter()
            .map(|l| Tube {
                points: l.rows.iter().map(|r| states[*r as usize].x).collect(),
                radius: l.radius,
                colour: l.tow,
                // Three shades tell neighbouring filaments of a tow apart.
                shade: 1.0 - 0.12 * (l.index % 3) as f64,
            })
            .collect();
        let period = self.period.map(|r| states[r].x).filter(|p| p.is_finite() && p.length() > 0.0);
        let axis = period.unwrap_or_else(|| self.axis(&tubes));
        let count = period.map_or(1, |p| cells(&tubes, p));
        let tubes = repeat(&tubes, &self.successor, count, period.unwrap_or(DVec3::ZERO));
        PictureInput { tubes, surfaces: self.surfaces.clone(), view: View::along(axis) }
    }

    /// The direction to lay across the picture: that of a bar, or the longest extension.
    fn axis(&self, tubes: &[Tube]) -> DVec3 {
        for s in &self.surfaces {
            if let Surface::Prism { axis, .. } | Surface::Cylinder { axis, .. } = s {
                return *axis;
            }
        }
        let size = extent(tubes);
        let longest = size.max_element();
        DVec3::AXES.into_iter().find(|a| a.dot(size) == longest).unwrap_or(DVec3::X)
    }
}

fn extent(tubes: &[Tube]) -> DVec3 {
    let points = || tubes.iter().flat_map(|t| &t.points).filter(|p| p.is_finite());
    let low = points().fold(DVec3::INFINITY, |m, p| m.min(*p));
    let high = points().fold(DVec3::NEG_INFINITY, |m, p| m.max(*p));
    (high - low).max(DVec3::ZERO)
}

/// Cells that make the drawn length about one and a half times the width across.
fn cells(tubes: &[Tube], period: DVec3) -> usize {
    let along = period.normalize();
    let size = extent(tubes);
    let across = (size - size.dot(along.abs()) * along.abs()).length() / std::f64::consts::SQRT_2;
    ((1.4 * across / period.length()).ceil() as usize).clamp(2, MOST_CELLS)
}
