//! The lines of a model: its filaments, and chains of elements that no filament covers.
use crate::assembly::KindReports;
use crate::components::*;
use crate::element::SectionForce;
use crate::model::Model;
use crate::simulation::{NodeRows, Simulation};
use bevy_ecs::prelude::*;
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Rows of the nodes, at least two.
    pub rows: Vec<u32>,
    /// Radius to draw (length).
    pub radius: f64,
    /// Tow; chains of elements without a filament count as the tow after the last.
    pub tow: usize,
    /// Index of the filament inside its tow.
    pub index: usize,
    /// Index into the model's filaments.
    pub filament: Option<usize>,
}

/// All lines of a model and the way from element results to their points.
pub struct Lines {
    /// The lines.
    pub lines: Vec<Line>,
    /// First segment of each line.
    start: Vec<usize>,
    segments: BTreeMap<(u32, u32), usize>,
    /// Initial tangent and normal at every point, line after line; empty without rotations.
    triads: Vec<(DVec3, DVec3)>,
}

/// Results at the points of all lines, line after line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointResults {
    /// Axial force, mean of the two segments that meet (force).
    pub axial: Vec<f64>,
    /// Largest bending moment of the same (force x length).
    pub bending: Vec<f64>,
    /// Root mean square over all segments of the resultant of axial and shear force (force).
    pub typical_force: f64,
}

fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

impl Lines {
    /// The lines of a model that has been built.
    pub fn of(model: &Model, sim: &mut Simulation) -> Self {
        let rows = sim.world.resource::<NodeRows>().clone();
        let mut lines: Vec<Line> = Vec::new();
        let mut covered = BTreeSet::new();
        for (i, f) in model.filaments.iter().enumerate() {
            let mut r: Vec<u32> = f.nodes.iter().map(|n| rows.of(*n) as u32).collect();
            if f.closed && r.first() != r.last() {
                r.push(r[0]);
            }
            covered.extend(r.windows(2).map(|w| key(w[0], w[1])));
            lines.push(Line { rows: r, radius: f.radius, tow: f.tow, index: f.index, filament: Some(i) });
        }
        let free_tow = lines.iter().map(|l| l.tow + 1).max().unwrap_or(0);
        let first_free = lines.len();
        each_section(&mut sim.world, &mut |element, _| {
            for w in element.windows(2).filter(|w| covered.insert(key(w[0], w[1]))) {
                match lines[first_free..].last_mut() {
                    Some(last) if last.rows.last() == Some(&w[0]) => last.rows.push(w[1]),
                    _ => lines.push(Line { rows: w.to_vec(), radius: 0.0, tow: free_tow, index: lines.len() - first_free, filament: None }),
                }
            }
        });
        let radius = free_radius(&mut sim.world, &lines[first_free..]);
        lines[first_free..].iter_mut().for_each(|l| l.radius = radius);

        let mut start = vec![0];
        let mut segments = BTreeMap::new();
        for l in &lines {
            let first = start[start.len() - 1];
            segments.extend(l.rows.windows(2).enumerate().map(|(i, w)| (key(w[0], w[1]), first + i)));
            start.push(first + l.rows.len() - 1);
        }
        let mut out = Lines { lines, start, segments, triads: Vec::new() };
        if sim.world.query::<&Orientation>().iter(&sim.world).next().is_some() {
            let initial: Vec<DVec3> = sim.world.query::<&InitialPosition>().iter(&sim.world).map(|p| p.0).collect();
            out.triads = out.lines.iter().flat_map(|l| triads(&l.rows.iter().map(|r| initial[*r as usize]).collect::<Vec<_>>())).collect();
        }
        out
    }

    /// Number of points of all lines.
    pub fn points(&self) -> usize {
        self.lines.iter().map(|l| l.rows.len()).sum()
    }

    /// Rows of all points, line after line.
    pub fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        self.lines.iter().flat_map(|l| l.rows.iter().map(|r| *r as usize))
    }

    /// Tangent and normal of the cross-section at every point, carried along by the rotations
    /// (by row); `None` without rotations.
    pub fn current_triads(&self, rotations: &[DQuat]) -> Option<Vec<(DVec3, DVec3)>> {
        (!self.triads.is_empty()).then(|| self.rows().zip(&self.triads).map(|(r, (t, n))| (rotations[r] * *t, rotations[r] * *n)).collect())
    }

    /// Section forces of the elements and of the implicit axial bars, brought to the points.
    pub fn results(&self, world: &mut World) -> PointResults {
        let mut of_segment = vec![(0.0, 0.0f64, 0.0f64); self.start[self.start.len() - 1]];
        let segment = |rows: &[u32]| rows.get(..2).and_then(|r| self.segments.get(&key(r[0], r[1])).copied());
        each_section(world, &mut |rows, force| {
            if let Some(s) = segment(rows).filter(|_| rows.len() == 2) {
                of_segment[s].0 += force.axial;
                of_segment[s].1 = of_segment[s].1.max(force.bending.abs());
                of_segment[s].2 += force.shear;
            }
        });
        for (bar, tension) in world.query::<(&AxialBar, &Tension)>().iter(world) {
            if let Some(s) = segment(&bar.rows) {
                of_segment[s].0 += tension.0;
            }
        }
        let squares: f64 = of_segment.iter().map(|s| s.0 * s.0 + s.2 * s.2).sum();
        let mut out = PointResults { typical_force: (squares / of_segment.len().max(1) as f64).sqrt(), ..Default::default() };
        for (l, first) in self.lines.iter().zip(&self.start) {
            let s = &of_segment[*first..first + l.rows.len() - 1];
            for i in 0..l.rows.len() {
                let (before, after) = (s[i.saturating_sub(1)], s[i.min(s.len() - 1)]);
                out.axial.push(0.5 * (before.0 + after.0));
                out.bending.push(before.1.max(after.1));
            }
        }
        out
    }
}

/// Calls back with rows and section forces of all elements of all kinds.
fn each_section(world: &mut World, each: &mut dyn FnMut(&[u32], SectionForce)) {
    let kinds: Vec<_> = world.get_resource::<KindReports>().map_or(Vec::new(), |k| k.0.iter().map(|r| r.sections).collect());
    kinds.into_iter().for_each(|f| f(world, each));
}

/// A radius that shows bare elements as slender bars.
fn free_radius(world: &mut World, lines: &[Line]) -> f64 {
    let x: Vec<DVec3> = world.query::<&Position>().iter(world).map(|p| p.0).collect();
    let (mut low, mut high, mut shortest) = (DVec3::INFINITY, DVec3::NEG_INFINITY, f64::INFINITY);
    for w in lines.iter().flat_map(|l| l.rows.windows(2)) {
        let (a, b) = (x[w[0] as usize], x[w[1] as usize]);
        low = low.min(a.min(b));
        high = high.max(a.max(b));
        shortest = shortest.min(a.distance(b));
    }
    if lines.is_empty() { 0.0 } else { ((high - low).length() / 120.0).min(0.3 * shortest) }
}

/// Tangents of a curve and normals carried along it without twist (Bishop 1975).
fn triads(points: &[DVec3]) -> Vec<(DVec3, DVec3)> {
    let last = points.len() - 1;
    let mut normal = DVec3::ZERO;
    (0..points.len())
        .map(|i| {
            let t = (points[(i + 1).min(last)] - points[i.saturating_sub(1)]).normalize_or(DVec3::X);
            normal = (normal - normal.dot(t) * t).try_normalize().unwrap_or_else(|| t.any_orthonormal_vector());
            (t, normal)
        })
        .collect()
}
