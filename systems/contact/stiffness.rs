//! Stiffness of the contacts: from the scene, or from mass and time step; and what it does to the
//! stable time step.
use super::assemble::{CARRIERS, carriers, first_carrier, line_stiffnesses, of_point};
use super::inner::refresh_all;
use super::kernel::Penalty;
use super::lines::{Centrelines, Lines, NONE, xyz};
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
        let masses = lines.joints.iter().zip(&now.v).filter(|(s, v)| s.row != NONE && v[3] > 0.0).map(|(_, v)| v[3]);
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

/// Adds the bounds of the near records, touching or not: for K = k n n^t w w^t the row sums give
/// K <= diag(k |w_i| sum |w_j|). The friction spring has the weights w along the filament and, where it turns
/// a tangent, others across it. For the first step, and for who asks before a run; in a run [`Burden`] follows what touches.
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
    let (mut spread, mut kappa) = (Spread::new(lines, &penalty), vec![0.0; masses.len()]);
    let mut add = |row: u32, k: f64| kappa[row as usize] += k;
    let mut query = line_query.query(world);
    let (records, states) = columns(&mut query);
    let (records, states) = (&records[..live.near_lines], &states[..live.near_lines]);
    for (record, (t, stiffness)) in records.iter().zip(line_stiffnesses(&still, lines, now, records, states)) {
        spread.line(now, record, t, stiffness, &mut add);
    }
    let mut query = point_query.query(world);
    let (records, states) = columns(&mut query);
    for (record, state) in records[..live.near_points].iter().zip(states) {
        let c = of_point(&still, lines, now, record, state);
        spread.point(now, record, c.t, c.stiffness, &mut add);
    }
    share_copies(lines, &masses, &mut kappa);
    for (o, k) in out.iter_mut().zip(kappa) {
        o.translation += k;
    }
}

/// The stiffness of the records that touch or soon will, by row: what contacts do to the time step now.
///
/// Many records of a node are near, few touch at a time, and the step may follow those. One spring alone that is hit
/// within a step or two must be resolved better than stability asks for, or the hit makes energy: it counts more than once.
#[derive(Resource, Clone, Debug, Default)]
pub struct Burden {
    /// Row that stands for each row: that of the node for its periodic copies.
    carrier: Vec<u32>,
    /// Mass of the whole node, by row.
    mass: Vec<f64>,
    sum: Vec<f64>,
    largest: Vec<f64>,
    rows: Vec<u32>,
}

/// Records per parallel chunk.
const CHUNK: usize = 128;
/// Rows that a line record and a point record usually bear on.
const LINE_ROWS: usize = CARRIERS + 4;
const POINT_ROWS: usize = 2 * CARRIERS;

/// Factor on the stiffness of the stiffest spring at a node: 1.1 / omega instead of 1.8 / omega for one alone.
const ALONE: f64 = 2.5;

impl Burden {
    /// Of nothing yet.
    pub fn new(lines: &Lines, masses: &[f64]) -> Self {
        let mut carrier: Vec<u32> = (0..masses.len() as u32).collect();
        for mut copies in lines.copies() {
            let to = copies.next().expect("a node has itself");
            copies.for_each(|row| carrier[row] = to as u32);
        }
        let none = vec![0.0; masses.len()];
        Burden { carrier, mass: masses.to_vec(), sum: none.clone(), largest: none, rows: Vec::new() }
    }

    fn add(&mut self, row: u32, stiffness: f64) {
        let row = self.carrier[row as usize];
        let (sum, largest) = (&mut self.sum[row as usize], &mut self.largest[row as usize]);
        if *sum == 0.0 {
            self.rows.push(row);
        }
        *sum += stiffness;
        *largest = largest.max(stiffness);
    }

    /// Takes over the records of this step.
    pub fn take(
        &mut self,
        penalty: &Penalty,
        lines: &Lines,
        now: &Centrelines,
        (line_records, line_states, lines_bearing): (&[LineRecord], &[LineState], &[(u32, f64)]),
        (point_records, point_states, points_bearing): (&[PointRecord], &[PointState], &[(u32, f64)]),
        out: &mut ActingStiffness,
    ) {
        let of_lines = parallel::chunks(lines_bearing.len(), CHUNK, |range| {
            let (mut spread, mut bounds) = (Spread::new(lines, penalty), Vec::with_capacity(range.len() * LINE_ROWS));
            for (k, stiffness) in &lines_bearing[range] {
                let k = *k as usize;
                spread.line(now, &line_records[k], line_states[k].t, *stiffness, &mut |row, k| bounds.push((row, k)));
            }
            bounds
        });
        let of_points = parallel::chunks(points_bearing.len(), CHUNK, |range| {
            let (mut spread, mut bounds) = (Spread::new(lines, penalty), Vec::with_capacity(range.len() * POINT_ROWS));
            for (k, stiffness) in &points_bearing[range] {
                let k = *k as usize;
                spread.point(now, &point_records[k], point_states[k].t, *stiffness, &mut |row, k| bounds.push((row, k)));
            }
            bounds
        });
        // In the order of the records, whatever the number of threads.
        of_lines.iter().chain(&of_points).flatten().for_each(|(row, k)| self.add(*row, *k));
        out.rows.clear();
        for row in self.rows.drain(..) {
            let i = row as usize;
            if self.mass[i] > 0.0 {
                out.rows.push((row, self.sum[i].max(ALONE * self.largest[i]) / self.mass[i]));
            }
            (self.sum[i], self.largest[i]) = (0.0, 0.0);
        }
    }
}

/// A node and its periodic copies move together: their stiffness is theirs in proportion to mass.
pub fn share_copies(lines: &Lines, masses: &[f64], kappa: &mut [f64]) {
    for copies in lines.copies() {
        let (k, m) = copies.clone().fold((0.0, 0.0), |(k, m), row| (k + kappa[row], m + masses[row]));
        if m > 0.0 {
            copies.for_each(|row| kappa[row] = k * masses[row] / m);
        }
    }
}

/// What a record does to a row: weight of the row along its normal and along the filament, and weight by which friction at the
/// surface turns a tangent.
#[derive(Clone, Copy)]
struct Weight {
    row: u32,
    push: f64,
    turn: f64,
}

/// Collects the weights of one record by row.
pub struct Spread<'a> {
    lines: &'a Lines,
    /// Factor on normal stiffnesses, and tangential over normal stiffness.
    normal: f64,
    tangential: f64,
    /// Weights of the current record; the rows may repeat.
    weights: Vec<Weight>,
}

impl<'a> Spread<'a> {
    /// For contacts between filaments.
    fn new(lines: &'a Lines, penalty: &Penalty) -> Self {
        let tangential = if penalty.law.friction > 0.0 { penalty.law.tangential } else { 0.0 };
        Spread { normal: penalty.law.damped_stiffness(), tangential, ..Spread::without_friction(lines) }
    }

    /// For contacts whose friction does not count, with a factor of one on the stiffness.
    pub fn without_friction(lines: &'a Lines) -> Self {
        Spread { lines, normal: 1.0, tangential: 0.0, weights: Vec::new() }
    }

    /// Hands the bounds of a line record to `add`.
    fn line(&mut self, now: &Centrelines, record: &LineRecord, t: f64, stiffness: f64, add: &mut impl FnMut(u32, f64)) {
        if stiffness == 0.0 {
            return;
        }
        self.node(record.node, 1.0);
        if self.tangential > 0.0 {
            let arm = self.lines.slots[record.node as usize].radius;
            for (slot, c) in self.lines.tangent_slots(record.node) {
                self.put(slot, 0.0, c * arm);
            }
        }
        self.segment(now, record.segment, t);
        self.image(record.image);
        self.add(stiffness, add);
    }

    /// Hands the bounds of a point record to `add`.
    fn point(&mut self, now: &Centrelines, record: &PointRecord, t: [f64; 2], stiffness: f64, add: &mut impl FnMut(u32, f64)) {
        if stiffness == 0.0 {
            return;
        }
        for (segment, t) in record.segments.into_iter().zip(t) {
            self.segment(now, segment, t);
        }
        self.image(record.image);
        self.add(stiffness, add);
    }

    fn put(&mut self, slot: u32, push: f64, turn: f64) {
        let row = self.lines.joints[slot as usize].row;
        if row != NONE {
            self.weights.push(Weight { row, push, turn });
        }
    }

    /// Adds the weight of a slot.
    pub fn node(&mut self, slot: u32, weight: f64) {
        self.put(slot, weight, 0.0);
    }

    /// Adds the weights of the nodes of a segment at parameter `t`, and of its tangent there at the surface.
    pub fn segment(&mut self, now: &Centrelines, segment: u32, t: f64) {
        let first = first_carrier(segment);
        let push = carriers(self.lines, now, segment, t);
        let mut turn = [0.0; CARRIERS];
        if self.tangential > 0.0 {
            let j = segment as usize;
            let chord = (xyz(&now.x[j + 1]) - xyz(&now.x[j])).length();
            // The arm acts on the unit tangent, the nodes make tangents per length.
            let arm = self.lines.slots[j].radius * now.tangent[j][3] / chord.max(f64::MIN_POSITIVE);
            let s = t.clamp(0.0, 1.0);
            for (slot, part) in [(segment, 1.0 - s), (segment + 1, s)] {
                for (at, c) in self.lines.tangent_slots(slot) {
                    turn[at.wrapping_sub(first) as usize] += c * part * arm;
                }
            }
        }
        for (k, (push, turn)) in push.into_iter().zip(turn).enumerate() {
            if push != 0.0 || turn != 0.0 {
                self.put(first.wrapping_add(k as u32), push, turn);
            }
        }
    }

    /// Adds the weights of the dummy nodes behind an image.
    fn image(&mut self, image: super::images::Image) {
        if image == self.lines.images.zero() {
            return;
        }
        let k = self.lines.images.multiples(image);
        for (d, row) in self.lines.images.dummies.iter().enumerate() {
            if k[d] != 0 {
                self.weights.push(Weight { row: *row, push: f64::from(k[d]), turn: 0.0 });
            }
        }
    }

    /// Hands the bounds of springs of this stiffness with the collected weights to `put`.
    pub fn add(&mut self, stiffness: f64, put: &mut impl FnMut(u32, f64)) {
        let (pushed, turned) = self.weights.iter().fold((0.0, 0.0), |(p, t), w| (p + w.push.abs(), t + w.turn.abs()));
        let dragged = stiffness * self.tangential * (pushed + turned);
        let either = (stiffness * self.normal * pushed).max(dragged);
        self.weights.drain(..).for_each(|w| put(w.row, either * w.push.abs() + dragged * w.turn.abs()));
    }
}
