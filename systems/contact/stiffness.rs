//! Stiffness of the contacts: from the scene, or from mass and time step; and what it does to the
//! stable time step.
use super::assemble::{carriers, each_line, of_point};
use super::inner::refresh_all;
use super::kernel::Penalty;
use super::lines::{Centrelines, Lines, NONE};
use super::records::*;
use super::spec::ContactSpec;
use braid_ecs::prelude::*;

/// Penalty stiffness x dt^2 / nodal mass that leaves a hexagonal tow stable at 0.9 of the elements' time step.
const SHARE: f64 = 0.08;

/// How the stiffness is to be found, until it is.
#[derive(Resource, Clone, Debug)]
pub struct Wanted {
    spec: ContactSpec,
    safety: f64,
    dt: Option<f64>,
}

impl Wanted {
    /// From the sections of the model.
    pub fn new(model: &Model, spec: &ContactSpec) -> Self {
        Wanted { spec: spec.clone(), safety: model.integration.safety, dt: model.integration.dt }
    }
}

/// Line and point stiffness; `length` is the mean segment length.
pub fn given(spec: &ContactSpec, length: f64) -> Option<(f64, f64)> {
    match (spec.line_stiffness, spec.stiffness) {
        (Some(l), Some(p)) => Some((l.0, p.0)),
        (Some(l), None) => Some((l.0, l.0 * length)),
        (None, Some(p)) => Some((p.0 / length, p.0)),
        (None, None) => None,
    }
}

/// Largest stiffness / mass of the elements, as an angular frequency squared; bars that are
/// integrated implicitly count only if nothing else is there.
pub fn element_frequency(world: &mut World) -> f64 {
    let mut masses = world.query::<(&Mass, Option<&RotaryInertia>)>();
    let masses: Vec<(f64, f64)> = masses.iter(world).map(|(m, j)| (m.0, j.map_or(0.0, |j| j.0))).collect();
    let mut bound = vec![StiffnessBound::default(); masses.len()];
    if let Some(kinds) = world.remove_resource::<KindReports>() {
        for k in &kinds.0 {
            (k.stiffness)(world, &mut bound);
        }
        world.insert_resource(kinds);
    }
    let mut worst = 0.0f64;
    for (b, (m, j)) in bound.iter().zip(&masses) {
        if *m > 0.0 {
            worst = worst.max(b.translation / m);
        }
        if *j > 0.0 {
            worst = worst.max(b.rotation / j);
        }
    }
    if worst > 0.0 {
        return worst;
    }
    let mut bars = world.query::<&AxialBar>();
    for bar in bars.iter(world) {
        for row in bar.rows {
            let m = masses[row as usize].0;
            if m > 0.0 {
                worst = worst.max(4.0 * bar.ea / (bar.rest_length * m));
            }
        }
    }
    worst
}

/// Finds the stiffness if it is not known yet.
pub fn resolve(world: &mut World) {
    let Some(wanted) = world.remove_resource::<Wanted>() else { return };
    let (length, lightest) = {
        let lines = world.resource::<Lines>();
        let now = world.resource::<Centrelines>();
        let masses = lines.slots.iter().zip(&now.v).filter(|(s, v)| s.row != NONE && v[3] > 0.0).map(|(_, v)| v[3]);
        (lines.mean_length, masses.fold(f64::INFINITY, f64::min))
    };
    let (line, point) = given(&wanted.spec, length).unwrap_or_else(|| {
        let omega2 = element_frequency(world);
        // dt = safety 2 / omega, unless the scene gives one.
        let per_mass = match wanted.dt {
            Some(dt) => 1.0 / (dt * dt),
            None => omega2 / (4.0 * wanted.safety * wanted.safety),
        };
        let point = SHARE * lightest * per_mass;
        (point / length, point)
    });
    let mut penalty = world.resource_mut::<Penalty>();
    penalty.line_stiffness = line;
    penalty.point_stiffness = point;
}

/// Adds the bounds of the near records, which are those that may touch before the next look, and before this is asked
/// again: for K = k n n^t w w^t the row sums give K <= diag(k |w_i| sum |w_j|). The friction spring has the weights w along the filament and, where it turns
/// a tangent, others across it.
pub fn bounds(world: &mut World, out: &mut [StiffnessBound]) {
    resolve(world);
    refresh_all(world);
    let mut line_query = world.query::<(&LineRecord, &LineState)>();
    let mut point_query = world.query::<(&PointRecord, &PointState)>();
    let masses: Vec<f64> = world.query::<&Mass>().iter(world).map(|m| m.0).collect();
    let live = *world.resource::<LiveRecords>();
    let (lines, now, penalty) = (world.resource::<Lines>(), world.resource::<Centrelines>(), *world.resource::<Penalty>());
    let mut still = penalty;
    still.law.dt = 0.0;
    let narrow = penalty.law.damped_stiffness();
    let mut spread = Spread::new(lines, masses.len());
    let tangential = if penalty.law.friction > 0.0 { penalty.law.tangential } else { 0.0 };
    let radius = |slot: u32| lines.slots[slot as usize].radius;
    let (records, states): (Vec<LineRecord>, Vec<LineState>) = line_query.iter(world).take(live.near_lines).map(|(r, s)| (*r, *s)).unzip();
    each_line(&still, lines, now, &records, &states, |k, t, stiffness| {
        let record = &records[k];
        if stiffness == 0.0 {
            return;
        }
        spread.node(record.node, 1.0);
        spread.segment(now, record.segment, t);
        spread.image(record.image);
        spread.turn(record.node, radius(record.node));
        spread.turn_along(now, record.segment, t);
        spread.add(stiffness * narrow, tangential * stiffness);
    });
    for (record, state) in point_query.iter(world).take(live.near_points) {
        let c = of_point(&still, lines, now, record, state);
        if c.stiffness == 0.0 {
            continue;
        }
        spread.segment(now, record.segments[0], c.t[0]);
        spread.segment(now, record.segments[1], c.t[1]);
        spread.image(record.image);
        spread.turn_along(now, record.segments[0], c.t[0]);
        spread.turn_along(now, record.segments[1], c.t[1]);
        spread.add(c.stiffness * narrow, tangential * c.stiffness);
    }
    let mut kappa = spread.kappa;
    share_copies(lines, &masses, &mut kappa);
    for (o, k) in out.iter_mut().zip(kappa) {
        o.translation += k;
    }
}

/// A node and its periodic copies move together: their stiffness is theirs in proportion to mass.
pub fn share_copies(lines: &Lines, masses: &[f64], kappa: &mut [f64]) {
    let mut sums: std::collections::BTreeMap<u32, (f64, f64)> = std::collections::BTreeMap::new();
    for (row, &to) in lines.independent.iter().enumerate() {
        if to as usize != row {
            sums.entry(to).or_insert((kappa[to as usize], masses[to as usize]));
            let sum = sums.get_mut(&to).expect("just entered");
            sum.0 += kappa[row];
            sum.1 += masses[row];
        }
    }
    for (row, &to) in lines.independent.iter().enumerate() {
        if let Some((k, m)) = sums.get(&to)
            && *m > 0.0
        {
            kappa[row] = k * masses[row] / m;
        }
    }
}

/// Collects the weights of one record by row.
pub struct Spread<'a> {
    /// The filaments.
    pub lines: &'a Lines,
    /// Bound of each row.
    pub kappa: Vec<f64>,
    /// Weights of the current record; the rows may repeat.
    pub weights: Vec<(u32, f64)>,
    /// Those by which friction at the surface turns a tangent.
    pub turns: Vec<(u32, f64)>,
}

impl<'a> Spread<'a> {
    /// Of no record so far.
    pub fn new(lines: &'a Lines, rows: usize) -> Self {
        Spread { lines, kappa: vec![0.0; rows], weights: Vec::new(), turns: Vec::new() }
    }

    /// Adds the weights of the tangent of a slot, `arm` away from the surface.
    pub fn turn(&mut self, slot: u32, arm: f64) {
        for (at, c) in self.lines.tangent_slots(slot) {
            let row = self.lines.slots[at as usize].row;
            if row != NONE {
                self.turns.push((row, c * arm));
            }
        }
    }

    /// Adds the weights of the tangent at parameter `t` of a segment.
    pub fn turn_along(&mut self, now: &Centrelines, segment: u32, t: f64) {
        let h = now.tangent[segment as usize][3];
        let chord = now.x[segment as usize + 1].iter().zip(&now.x[segment as usize]).take(3).map(|(b, a)| (b - a).powi(2)).sum::<f64>();
        // The arm acts on the unit tangent, the nodes make tangents per length.
        let arm = self.lines.slots[segment as usize].radius * h / chord.sqrt().max(f64::MIN_POSITIVE);
        let s = t.clamp(0.0, 1.0);
        self.turn(segment, arm * (1.0 - s));
        self.turn(segment + 1, arm * s);
    }
    /// Adds the weight of a slot.
    pub fn node(&mut self, slot: u32, weight: f64) {
        let s = &self.lines.slots[slot as usize];
        if s.row != NONE {
            self.weights.push((s.row, weight));
        }
    }

    /// Adds the weights of the nodes of a segment at parameter `t`.
    pub fn segment(&mut self, now: &Centrelines, segment: u32, t: f64) {
        for (slot, weight) in carriers(self.lines, now, segment, t) {
            self.node(slot, weight);
        }
    }

    /// Adds the weights of the dummy nodes behind an image.
    pub fn image(&mut self, image: super::images::Image) {
        let k = self.lines.images.multiples(image);
        for (d, row) in self.lines.images.dummies.iter().enumerate() {
            if k[d] != 0 {
                self.weights.push((*row, f64::from(k[d])));
            }
        }
    }

    /// Adds the bound of springs of this normal and tangential stiffness with the collected weights.
    pub fn add(&mut self, normal: f64, tangential: f64) {
        let sum = |weights: &[(u32, f64)]| weights.iter().map(|w| w.1.abs()).sum::<f64>();
        let pushed = sum(&self.weights);
        let dragged = tangential * (pushed + sum(&self.turns));
        for (row, w) in self.weights.drain(..) {
            self.kappa[row as usize] += (normal * pushed).max(dragged) * w.abs();
        }
        for (row, w) in self.turns.drain(..) {
            self.kappa[row as usize] += dragged * w.abs();
        }
    }
}
