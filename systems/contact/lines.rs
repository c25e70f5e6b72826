//! Filaments as contact sees them: slots in a row, one per node, with a ghost before and behind.
//!
//! A filament with n nodes takes n + 2 slots. The ghosts of a filament that runs through a periodic
//! face, or of a ring, are the nodes beyond the face, shifted by the period; those of a free end are
//! not used. A segment has the number of the slot of its first node. The node P' at the end of a
//! filament that goes on in another one is the node P of that one: it bounds a segment, but does
//! not look for contacts of its own.
use super::curve::tangent_stencil;
use super::images::{Image, Images};
use super::inner::Needed;
use braid_ecs::prelude::*;
use std::collections::BTreeMap;

/// Slots per parallel chunk.
const CHUNK: usize = 512;

/// Marks a slot without a row.
pub const NONE: u32 = u32::MAX;

/// What never changes about a slot and is asked for again and again: eight bytes, so that those of many slots are at hand.
#[derive(Clone, Copy, Debug)]
pub struct Joint {
    /// Row of the node, [`NONE`] for the ghost of a free end.
    pub row: u32,
    /// Image by which the node is shifted (ghosts only).
    pub image: Image,
    /// True if nothing goes on before the first or behind the last node of the segment.
    pub free: [bool; 2],
}

/// What else never changes about a slot.
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// Number of the filament among those with contact.
    pub filament: u32,
    /// True before the first and behind the last node of a filament.
    pub ghost: bool,
    /// True if the node looks for contacts.
    pub looks: bool,
    /// True if a segment starts here.
    pub segment: bool,
    /// Contact radius (length).
    pub radius: f64,
    /// Half of the length of the segments before and after the node (length).
    pub half: [f64; 2],
    /// Mean length of the neighbouring segments (length).
    pub spacing: f64,
    /// Length of the segment that starts here (length).
    pub length: f64,
}

/// How the centreline at a slot follows from three slots in a row.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stencil {
    /// Place of the first of them relative to this slot.
    pub first: isize,
    /// Coefficients of the tangent (1 / length).
    pub tangent: [f64; 3],
    /// Coefficients of the second derivative by arc length, zero at free ends (1 / length^2).
    bend: [f64; 3],
    /// Length of the segment that starts here (length).
    length: f64,
}

impl Stencil {
    /// With segments of these lengths, two before and two after the slot; zero where there is none.
    fn new(lengths: [f64; 4]) -> Self {
        let (tangent, first) = tangent_stencil(lengths);
        let [_, before, after, _] = lengths;
        let whole = 0.5 * (before + after);
        let bend = if before > 0.0 && after > 0.0 {
            [1.0 / (before * whole), -1.0 / (before * whole) - 1.0 / (after * whole), 1.0 / (after * whole)]
        } else {
            [0.0; 3]
        };
        Stencil { first, tangent, bend, length: after }
    }
}

/// Where a segment goes on: the neighbouring segment and the image step to it.
pub type Link = Option<(u32, Image)>;

/// All filaments with contact.
#[derive(Resource, Clone, Debug, Default)]
pub struct Lines {
    /// Slots, filament by filament.
    pub slots: Vec<Slot>,
    /// Nodes of the slots.
    pub joints: Vec<Joint>,
    /// How the centreline at each slot follows from those around it; nothing for ghosts.
    pub stencils: Vec<Stencil>,
    /// First slot (a ghost) of each filament, and the end.
    pub start: Vec<u32>,
    /// Index of each filament in the model.
    pub model_index: Vec<usize>,
    /// Number of the chain that each filament is part of (filaments that go on in each other).
    pub chain: Vec<u32>,
    /// Segment after and before each segment, by slot.
    pub links: Vec<[Link; 2]>,
    /// Period vectors.
    pub images: Images,
    /// Rows that carry the motion of dependent periodic nodes, each with one of these, in order.
    copies: Vec<(u32, u32)>,
    /// Numbers of all slots.
    pub every: Vec<u32>,
    /// Rows of the nodes of all filaments, filament by filament.
    pub rows: Vec<u32>,
    /// Slot of each of [`Lines::rows`].
    pub row_slots: Vec<u32>,
    /// Mean radius (length).
    pub mean_radius: f64,
    /// Mean segment length (length).
    pub mean_length: f64,
}

/// Where a filament goes on beyond its last node, and where it comes from.
#[derive(Clone, Copy, Debug, Default)]
struct Ends {
    next: Option<(usize, Image)>,
    previous: Option<(usize, Image)>,
}

impl Lines {
    /// Slots that make the tangent of a slot, with their coefficients.
    #[inline(always)]
    pub fn tangent_slots(&self, slot: u32) -> impl Iterator<Item = (u32, f64)> {
        let s = &self.stencils[slot as usize];
        let first = (slot as isize + s.first) as u32;
        (first..).zip(s.tangent).filter(|(_, c)| *c != 0.0)
    }

    /// Filaments with contact of a model; `row` maps nodes to rows, `x` gives the initial positions by row.
    ///
    /// # Errors
    /// More than three period vectors, or a filament that ends in two others.
    pub fn new(model: &Model, row: impl Fn(NodeId) -> usize, x: &[DVec3]) -> Result<Lines, String> {
        let with_contact = |f: &usize| model.filaments[*f].contact && model.filaments[*f].nodes.len() > 1;
        let mut lines = Lines { model_index: (0..model.filaments.len()).filter(with_contact).collect(), ..Lines::default() };
        if lines.model_index.is_empty() {
            return Ok(lines);
        }
        for pair in &model.periodic {
            lines.copies.push((row(pair.node) as u32, row(pair.image) as u32));
            for d in &pair.dummies {
                let r = row(*d) as u32;
                if !lines.images.dummies.contains(&r) {
                    lines.images.dummies.push(r);
                }
            }
        }
        lines.copies.sort_unstable();
        lines.images.dummies.sort_unstable();
        if lines.images.dummies.len() > 3 {
            return Err(format!("contact looks across at most three period vectors, the model has {}", lines.images.dummies.len()));
        }
        let ends = lines.find_ends(model, &row)?;
        for (f, &m) in lines.model_index.clone().iter().enumerate() {
            lines.start.push(lines.slots.len() as u32);
            lines.push_filament(model, m, f, &ends, &row);
        }
        lines.start.push(lines.slots.len() as u32);
        lines.every = (0..lines.slots.len() as u32).collect();
        lines.row_slots = lines.every.iter().copied().filter(|i| !lines.slots[*i as usize].ghost).collect();
        lines.rows = lines.row_slots.iter().map(|i| lines.joints[*i as usize].row).collect();
        lines.measure(x);
        lines.link(model, &ends);
        lines.join_chains(&ends);
        Ok(lines)
    }

    fn find_ends(&self, model: &Model, row: &impl Fn(NodeId) -> usize) -> Result<Vec<Ends>, String> {
        let nodes = |f: usize| &model.filaments[self.model_index[f]].nodes;
        let mut first: BTreeMap<usize, usize> = BTreeMap::new();
        for f in 0..self.model_index.len() {
            if !model.filaments[self.model_index[f]].closed {
                first.insert(row(nodes(f)[0]), f);
            }
        }
        // A pair says x' = x + T: going on from x' the successor at x is shifted by +T.
        let mut steps: BTreeMap<usize, (usize, [i32; 3])> = BTreeMap::new();
        for pair in &model.periodic {
            let mut k = [0; 3];
            for d in &pair.dummies {
                let at = self.images.dummies.iter().position(|r| *r as usize == row(*d)).expect("collected above");
                k[at] += 1;
            }
            steps.insert(row(pair.image), (row(pair.node), k));
            steps.entry(row(pair.node)).or_insert((row(pair.image), k.map(|k| -k)));
        }
        let mut ends = vec![Ends::default(); self.model_index.len()];
        for f in 0..ends.len() {
            let filament = &model.filaments[self.model_index[f]];
            let last = row(*filament.nodes.last().expect("two nodes at least"));
            if filament.closed {
                ends[f] = Ends { next: Some((f, self.images.zero())), previous: Some((f, self.images.zero())) };
            } else if let Some((partner, k)) = steps.get(&last)
                && let Some(&next) = first.get(partner)
            {
                let image = self.images.of(*k).ok_or_else(|| "a periodic pair repeats a dummy node more than twice".to_string())?;
                if ends[next].previous.is_some() {
                    return Err(format!("filament {} is the continuation of two filaments", self.model_index[next]));
                }
                ends[f].next = Some((next, image));
                ends[next].previous = Some((f, self.images.negative(image)));
            }
        }
        Ok(ends)
    }

    fn push_filament(&mut self, model: &Model, m: usize, f: usize, ends: &[Ends], row: &impl Fn(NodeId) -> usize) {
        let filament = &model.filaments[m];
        let zero = self.images.zero();
        let ghost = Slot {
            filament: f as u32,
            ghost: true,
            looks: false,
            segment: false,
            radius: filament.radius,
            half: [0.0; 2],
            spacing: 0.0,
            length: 0.0,
        };
        let joint = |row: u32, image: Image| Joint { row, image, free: [false; 2] };
        let inner = |other: usize, from_start: bool| {
            let nodes = &model.filaments[self.model_index[other]].nodes;
            row(if from_start { nodes[1] } else { nodes[nodes.len() - 2] }) as u32
        };
        let before = ends[f].previous.map_or(joint(NONE, zero), |(p, image)| joint(inner(p, false), image));
        let behind = ends[f].next.map_or(joint(NONE, zero), |(n, image)| joint(inner(n, true), image));
        let count = filament.nodes.len();
        self.slots.push(ghost);
        self.joints.push(before);
        for (i, node) in filament.nodes.iter().enumerate() {
            self.slots.push(Slot { ghost: false, looks: i + 1 < count || ends[f].next.is_none(), segment: i + 1 < count, ..ghost });
            let free = [i == 0 && ends[f].previous.is_none(), i + 2 == count && ends[f].next.is_none()];
            self.joints.push(Joint { free, ..joint(row(*node) as u32, zero) });
        }
        self.slots.push(ghost);
        self.joints.push(behind);
    }

    /// Lengths, tributary lengths and tangent coefficients from the initial positions.
    fn measure(&mut self, x: &[DVec3]) {
        let mut vectors = Vec::new();
        self.images.vectors(|r| x[r], &mut vectors);
        let place: Vec<Option<DVec3>> =
            self.joints.iter().map(|s| (s.row != NONE).then(|| x[s.row as usize] + vectors[s.image as usize])).collect();
        let length = |a: usize, b: usize| match (place[a], place[b]) {
            (Some(a), Some(b)) => a.distance(b),
            _ => 0.0,
        };
        self.stencils = vec![Stencil::default(); self.slots.len()];
        let (mut sum, mut radius, mut count) = (0.0, 0.0, 0usize);
        for f in 0..self.model_index.len() {
            let range = self.start[f] as usize + 1..self.start[f + 1] as usize - 1;
            for i in range {
                let (before, after) = (length(i - 1, i), length(i, i + 1));
                let farther = [
                    if before > 0.0 && after == 0.0 { length(i - 2, i - 1) } else { 0.0 },
                    if after > 0.0 && before == 0.0 { length(i + 1, i + 2) } else { 0.0 },
                ];
                let s = &mut self.slots[i];
                s.half = [0.5 * before, 0.5 * after];
                s.spacing = if before > 0.0 && after > 0.0 { 0.5 * (before + after) } else { before + after };
                s.length = after;
                self.stencils[i] = Stencil::new([farther[0], before, after, farther[1]]);
                if s.segment {
                    sum += after;
                    radius += s.radius;
                    count += 1;
                }
            }
        }
        self.mean_length = sum / count as f64;
        self.mean_radius = radius / count as f64;
    }

    fn link(&mut self, model: &Model, ends: &[Ends]) {
        let zero = self.images.zero();
        self.links = vec![[None, None]; self.slots.len()];
        for (f, end) in ends.iter().enumerate() {
            let first = self.start[f] + 1;
            let last = self.start[f + 1] - 3;
            for j in first..=last {
                let next = if j < last { Some((j + 1, zero)) } else { end.next.map(|(n, image)| (self.start[n] + 1, image)) };
                let previous = if j > first { Some((j - 1, zero)) } else { end.previous.map(|(p, image)| (self.start[p + 1] - 3, image)) };
                self.links[j as usize] = [next, previous];
            }
        }
        debug_assert!(model.filaments.len() >= ends.len());
    }

    fn join_chains(&mut self, ends: &[Ends]) {
        let mut group: Vec<usize> = (0..ends.len()).collect();
        // Every filament has at most one successor: walking along them labels a chain once.
        for f in 0..ends.len() {
            let (mut at, mut low, mut members) = (f, f, vec![f]);
            while let Some((n, _)) = ends[at].next {
                if n == f {
                    break;
                }
                low = low.min(group[n]);
                members.push(n);
                at = n;
            }
            for m in members {
                group[m] = group[m].min(low);
            }
        }
        let mut numbers: BTreeMap<usize, u32> = BTreeMap::new();
        self.chain = group
            .iter()
            .map(|g| {
                let next = numbers.len() as u32;
                *numbers.entry(*g).or_insert(next)
            })
            .collect();
    }

    /// Chain of the filament that a slot belongs to.
    #[inline]
    pub fn chain_of(&self, slot: u32) -> u32 {
        self.chain[self.slots[slot as usize].filament as usize]
    }

    /// True if the nodes of chain `a` look for chain `b`: every chain is looked for by half of its neighbours.
    #[inline]
    pub fn looks_first(a: u32, b: u32) -> bool {
        if (a + b) & 1 == 0 { a < b } else { a > b }
    }

    /// Rows of every periodic node and its copies.
    pub fn copies(&self) -> impl Iterator<Item = impl Iterator<Item = usize> + Clone + '_> {
        let alike = self.copies.chunk_by(|a, b| a.0 == b.0);
        alike.map(|copies| std::iter::once(copies[0].0 as usize).chain(copies.iter().map(|(_, row)| *row as usize)))
    }

    /// Slots of segments, in order.
    pub fn segments(&self) -> impl Iterator<Item = u32> + '_ {
        self.slots.iter().enumerate().filter(|(_, s)| s.segment).map(|(i, _)| i as u32)
    }

    /// Filament number in the model and node number in the filament of a slot.
    pub fn place_of(&self, slot: u32) -> (usize, usize) {
        let f = self.slots[slot as usize].filament as usize;
        (self.model_index[f], (slot - self.start[f] - 1) as usize)
    }
}

/// Positions, tangents and velocities of all slots at the current time.
#[derive(Resource, Clone, Debug, Default)]
pub struct Centrelines {
    /// Position and contact radius.
    pub x: Vec<[f64; 4]>,
    /// Tangent by arc length, and segment length.
    pub tangent: Vec<[f64; 4]>,
    /// Velocity and mass.
    pub v: Vec<[f64; 4]>,
    /// Second derivative of the position by arc length (1 / length).
    pub bend: Vec<[f64; 4]>,
    /// Rate of the tangent.
    pub rate: Vec<[f64; 4]>,
    /// Vectors of the images.
    pub shift: Vec<DVec3>,
    /// Rates of the image vectors.
    pub shift_rate: Vec<DVec3>,
    /// True if all slots are up to date.
    pub complete: bool,
}

/// Masses of the nodes by row, periodic copies with the mass of the whole node.
#[derive(Resource, Clone, Debug, Default)]
pub struct JointMasses(pub Vec<f64>);

/// First three numbers of a row.
#[inline(always)]
pub fn xyz(row: &[f64; 4]) -> DVec3 {
    DVec3::new(row[0], row[1], row[2])
}

impl Centrelines {
    /// Brings the periods up to date with the node columns.
    pub fn refresh_periods(&mut self, lines: &Lines, x: &[Position], v: &[Velocity]) {
        lines.images.vectors(|r| x[r].0, &mut self.shift);
        lines.images.vectors(|r| v[r].0, &mut self.shift_rate);
    }

    /// Brings the slots up to date with the node columns, after the periods: all of them, or only those that are
    /// needed; what is left of the others is then of an earlier step.
    pub fn refresh(&mut self, lines: &Lines, x: &[Position], v: &[Velocity], mass: &[f64], needed: Option<&Needed>) {
        let n = lines.slots.len();
        self.x.resize(n, [0.0; 4]);
        self.v.resize(n, [0.0; 4]);
        self.tangent.resize(n, [0.0; 4]);
        self.rate.resize(n, [0.0; 4]);
        self.bend.resize(n, [0.0; 4]);
        let (of_place, of_frame) = needed.map_or((&lines.every, &lines.row_slots), |n| (&n.places, &n.frames));
        let Centrelines { x: places, tangent, v: speeds, bend, rate, shift, shift_rate, complete } = self;
        parallel::picked2(places, speeds, of_place, CHUNK, |_, i, place, speed| {
            put_place(&lines.joints[i], lines.slots[i].radius, x, v, mass, shift, shift_rate, place, speed);
        });
        let (x, v) = (&*places, &*speeds);
        parallel::picked3(tangent, bend, rate, of_frame, CHUNK, |_, i, tangent, bend, rate| {
            put_frame(&lines.stencils[i], i, x, v, tangent, bend, rate);
        });
        *complete = needed.is_none();
    }
}

/// Place and velocity of a slot.
#[inline(always)]
fn put_place(
    s: &Joint,
    radius: f64,
    x: &[Position],
    v: &[Velocity],
    mass: &[f64],
    shift: &[DVec3],
    shift_rate: &[DVec3],
    place: &mut [f64; 4],
    speed: &mut [f64; 4],
) {
    if s.row == NONE {
        return;
    }
    let r = s.row as usize;
    let (p, u) = (x[r].0 + shift[s.image as usize], v[r].0 + shift_rate[s.image as usize]);
    *place = [p.x, p.y, p.z, radius];
    *speed = [u.x, u.y, u.z, mass[r]];
}

/// Tangent, second derivative and rate of the tangent of slot `i`.
#[inline(always)]
fn put_frame(s: &Stencil, i: usize, x: &[[f64; 4]], v: &[[f64; 4]], tangent: &mut [f64; 4], bend: &mut [f64; 4], rate: &mut [f64; 4]) {
    let o = (i as isize + s.first) as usize;
    let blend = |of: &[[f64; 4]], [a, b, c]: [f64; 3]| {
        let [p, q, r] = of[o..o + 3].as_array().expect("three in a row").map(f64x4::new);
        p * f64x4::splat(a) + q * f64x4::splat(b) + r * f64x4::splat(c)
    };
    let with_length = |of: f64x4| {
        let [x, y, z, _] = of.to_array();
        [x, y, z, s.length]
    };
    (*tangent, *rate) = (with_length(blend(x, s.tangent)), with_length(blend(v, s.tangent)));
    *bend = blend(x, s.bend).to_array();
}

/// Masses by row in which periodic copies of a node share the mass of the whole node.
pub fn joint_masses(lines: &Lines, mass: &[Mass]) -> Vec<f64> {
    let mut joint: Vec<f64> = mass.iter().map(|m| m.0).collect();
    for copies in lines.copies() {
        let whole: f64 = copies.clone().map(|row| mass[row].0).sum();
        copies.for_each(|row| joint[row] = whole);
    }
    joint
}
