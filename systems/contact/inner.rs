//! The inner list: which records may touch before all of them are looked at again.
//!
//! Most records of a list do not touch, and will not in the next steps. So all records are evaluated only
//! now and then, in a *look*; in between only those that are *near*: the rows at the front of their pools. A
//! look is good for some steps, in which every node goes on with the forecast of the outer list
//! ([`super::search`]) and leaves it by no more than a small share of its room there; whether it does is
//! seen in every step, before any force is computed. So there are two skins: a wide one that is costly to
//! renew and a narrow one that is cheap (as in D. C. Rapaport, *The Art of Molecular Dynamics Simulation*
//! (2004), section 3.4).
//!
//! Between two looks only the centrelines beside near records are brought up to date ([`Needed`]).
use super::lines::{Centrelines, JointMasses, Lines};
use super::records::*;
use super::search::Search;
use braid_ecs::prelude::*;

/// Steps that a look is made for, and those that it must be good for if no new list is to be made.
const STEPS: [f64; 2] = [12.0, 4.0];
/// Smallest, largest and first share of the room that nodes may use between two looks.
const SHARE: [f64; 3] = [0.01, 0.25, 0.05];
/// Factors on the share when a look was over before its time, and when it was not.
const FOLLOW: [f64; 2] = [1.2, 0.97];
/// How far a centreline may move over the motion of its nodes: the sum of the weights of four of them at mid-span.
const CURVE: f64 = 1.25;
/// Records per parallel chunk.
const CHUNK: usize = 2048;

/// When the next look is due.
#[derive(Resource, Clone, Debug, Serialize, Deserialize)]
pub struct InnerList {
    /// Share of its room in the outer list by which a node may leave its forecast.
    share: f64,
    /// Time for which the look was made, and how much of it is over.
    horizon: f64,
    elapsed: f64,
    /// Positions at the last look, of the nodes in the order of [`Lines::rows`], and vectors of the images.
    reference: Vec<DVec3>,
    shift: Vec<DVec3>,
    /// True in a step in which all records are looked at.
    pub due: bool,
    /// Looks so far.
    pub looks: u64,
}

impl Default for InnerList {
    fn default() -> Self {
        InnerList { share: SHARE[2], horizon: 0.0, elapsed: 0.0, reference: Vec::new(), shift: Vec::new(), due: true, looks: 0 }
    }
}

impl InnerList {
    /// Decides, after a step of `dt` to the positions `x` and the image vectors `shift`, whether a look is due in it.
    pub fn follow(&mut self, search: &Search, lines: &Lines, x: &[Position], shift: &[DVec3], dt: f64) {
        self.elapsed += dt;
        self.due |= self.reference.len() != lines.rows.len() || self.elapsed > self.horizon * (1.0 + 1e-9);
        if self.due {
            return;
        }
        let left = |k: usize| x[lines.rows[k] as usize].0 - self.reference[k];
        let nodes = search.farthest(lines, self.elapsed, left);
        let used = nodes + search.period_left(shift, &self.shift, self.elapsed);
        if used.is_nan() || used > self.share {
            self.due = true;
            self.share = (self.share * FOLLOW[0]).min(SHARE[1]);
        }
    }

    /// Asks for a look in the next step.
    pub fn invalidate(&mut self) {
        self.reference.clear();
        self.due = true;
    }

    /// True if the outer list may not last through the look that is due.
    pub fn outgrows(&self, search: &mut Search, lines: &Lines, now: &Centrelines, dt: f64) -> bool {
        search.outdated(lines, now, self.elapsed, STEPS[1] * dt, self.share)
    }

    /// Starts the stretch after a look, with steps of about `dt`, within what the outer list was made for.
    pub fn begin(&mut self, search: &Search, lines: &Lines, now: &Centrelines, x: &[Position], dt: f64) {
        if self.elapsed > self.horizon {
            self.share = (self.share * FOLLOW[1]).max(SHARE[0]);
        }
        self.reference.clear();
        self.reference.extend(lines.rows.iter().map(|row| x[*row as usize].0));
        self.shift.clone_from(&now.shift);
        (self.horizon, self.elapsed, self.due) = ((STEPS[0] * dt).min(search.remaining()), 0.0, false);
        self.looks += 1;
    }

    /// Moves the near records to the front of their columns, each part in its old order; returns how many there are.
    /// Needs the states of an evaluation of all records.
    pub fn divide_lines(&self, search: &Search, records: &mut [LineRecord], states: &mut [LineState]) -> usize {
        let far = |r: &LineRecord, s: &LineState| {
            if s.stiffness > 0.0 || s.damper != 0.0 {
                return false;
            }
            let (n, j) = (r.node as usize, r.segment as usize);
            -s.overlap > CURVE * search.approach(&[n], &[j, j + 1], r.image, self.horizon, self.share)
        };
        divide(records, states, far)
    }

    /// As [`InnerList::divide_lines`].
    pub fn divide_points(&self, search: &Search, records: &mut [PointRecord], states: &mut [PointState]) -> usize {
        let far = |r: &PointRecord, s: &PointState| {
            if s.stiffness > 0.0 || s.damper != 0.0 {
                return false;
            }
            let [a, b] = r.segments.map(|s| s as usize);
            -s.overlap > CURVE * search.approach(&[a, a + 1], &[b, b + 1], r.image, self.horizon, self.share)
        };
        divide(records, states, far)
    }
}

fn divide<R: Copy + Sync, S: Copy + Sync>(records: &mut [R], states: &mut [S], far: impl Fn(&R, &S) -> bool + Sync) -> usize {
    let of = |range: std::ops::Range<usize>| -> Vec<bool> { range.map(|k| far(&records[k], &states[k])).collect() };
    let far: Vec<bool> = parallel::chunks(records.len(), CHUNK, of).concat();
    let near = far.iter().filter(|f| !**f).count();
    if far[..near].iter().any(|f| *f) {
        let rest: Vec<(R, S)> = (0..far.len()).filter(|k| far[*k]).map(|k| (records[k], states[k])).collect();
        let mut to = 0;
        for k in 0..far.len() {
            if !far[k] {
                (records[to], states[to]) = (records[k], states[k]);
                to += 1;
            }
        }
        for (k, (r, s)) in rest.into_iter().enumerate() {
            (records[near + k], states[near + k]) = (r, s);
        }
    }
    near
}

/// Which slots the records between two looks need.
#[derive(Resource, Clone, Debug, Default)]
pub struct Needed {
    /// True if records have changed since the slots were listed.
    pub stale: bool,
    /// Who marks slots.
    pub sources: Vec<fn(&mut World, &mut Marks)>,
    /// Slots of which the place, and of which the tangent is needed, in order.
    pub places: Vec<u32>,
    /// Slots of which the tangent is needed, in order.
    pub frames: Vec<u32>,
    /// Whether it is, by slot.
    pub marked: Vec<bool>,
}

/// Marks on the slots.
#[derive(Clone, Debug, Default)]
pub struct Marks {
    place: Vec<bool>,
    frame: Vec<bool>,
}

impl Marks {
    /// None on any slot.
    pub fn none(lines: &Lines) -> Self {
        Marks { place: vec![false; lines.slots.len()], frame: vec![false; lines.slots.len()] }
    }

    /// The place and velocity of a slot are needed.
    pub fn place(&mut self, slot: u32) {
        self.place[slot as usize] = true;
    }

    /// Tangent and curvature of a slot are needed, too.
    pub fn frame(&mut self, slot: u32) {
        self.frame[slot as usize] = true;
    }

    /// The centreline of a segment is needed, and of its neighbours: a record may move on to them.
    pub fn segment(&mut self, segment: u32) {
        let j = segment as usize;
        for i in j.saturating_sub(1)..(j + 3).min(self.frame.len()) {
            self.frame[i] = true;
        }
    }

    /// What a line record needs: node and segment.
    pub fn line(&mut self, record: &LineRecord) {
        self.frame(record.node);
        self.segment(record.segment);
    }

    /// What a point record needs: both segments.
    pub fn point(&mut self, record: &PointRecord) {
        record.segments.iter().for_each(|s| self.segment(*s));
    }
}

impl Needed {
    /// Lists the marked slots.
    pub fn list(&mut self, lines: &Lines, mut marks: Marks) {
        let Needed { frames, places, .. } = self;
        frames.clear();
        for i in (0..marks.frame.len()).filter(|i| marks.frame[*i]) {
            marks.place[i] = true;
            if !lines.slots[i].ghost {
                frames.push(i as u32);
                let first = (i as isize + lines.stencils[i].first) as usize;
                marks.place[first..first + 3].fill(true);
            }
        }
        places.clear();
        places.extend((0..marks.place.len()).filter(|i| marks.place[*i]).map(|i| i as u32));
        self.marked = marks.frame;
        self.stale = false;
    }

    /// True if the centreline of a segment is brought up to date in every step.
    pub fn covers(&self, segment: u32) -> bool {
        let j = segment as usize;
        self.marked.get(j..j + 2).is_some_and(|m| m[0] && m[1])
    }
}

/// Lists the needed slots if records have changed.
pub fn list_needed(world: &mut World) {
    if !world.resource::<Needed>().stale {
        return;
    }
    let mut needed = world.remove_resource::<Needed>().expect("inserted by the installer");
    let mut marks = Marks::none(world.resource::<Lines>());
    for source in &needed.sources {
        source(world, &mut marks);
    }
    needed.list(world.resource::<Lines>(), marks);
    world.insert_resource(needed);
}

/// Brings all centrelines up to date with the nodes, for those who look at everything.
pub fn refresh_all(world: &mut World) {
    if world.resource::<Centrelines>().complete {
        return;
    }
    let (x, v): (Vec<Position>, Vec<Velocity>) = world.query::<(&Position, &Velocity)>().iter(world).map(|(x, v)| (*x, *v)).unzip();
    world.resource_scope(|world, mut now: Mut<Centrelines>| {
        let lines = world.resource::<Lines>();
        now.refresh_periods(lines, &x, &v);
        now.refresh(lines, &x, &v, &world.resource::<JointMasses>().0, None);
    });
}
