//! Contact without an engine: filaments at given places, and the forces on their nodes.
// Every test file takes what it needs.
#![allow(dead_code)]
use braid_ecs::prelude::*;
use braid_ecs::systems::contact::assemble::*;
use braid_ecs::systems::contact::inner::*;
use braid_ecs::systems::contact::kernel::*;
use braid_ecs::systems::contact::law::{APART, Law};
use braid_ecs::systems::contact::lines::*;
use braid_ecs::systems::contact::list::*;
use braid_ecs::systems::contact::records::*;
use braid_ecs::systems::contact::search::*;

pub struct Rig {
    pub settings: Penalty,
    pub lines: Lines,
    pub now: Centrelines,
    pub search: Search,
    pub builder: Builder,
    pub line: (Vec<LineRecord>, Vec<LineState>, Vec<LineForce>),
    pub point: (Vec<PointRecord>, Vec<PointState>, Vec<PointForce>),
    pub inner: InnerList,
    pub needed: Needed,
    pub near: (usize, usize),
    pub x: Vec<Position>,
    pub v: Vec<Velocity>,
    pub mass: Vec<f64>,
    pub force: Vec<DVec3>,
    pub lost: Totals,
    pub rehomed: usize,
}

pub fn settings(line_stiffness: f64, point_stiffness: f64) -> Penalty {
    Penalty {
        law: Law { friction: 0.0, tangential: 0.5, damping: 0.0, toe: 1e-3, hardening: 0.0, dt: 0.0 },
        line_stiffness,
        point_stiffness,
        window: [0.10, 0.25],
        keep: 1.0,
    }
}

/// Adds a filament through the points.
pub fn filament(model: &mut Model, points: &[DVec3], radius: f64) -> usize {
    let nodes = points
        .iter()
        .map(|p| {
            model.nodes.push(Node::at(*p));
            NodeId(model.nodes.len() as u32 - 1)
        })
        .collect();
    model.filaments.push(Filament { nodes, radius, tow: 0, index: model.filaments.len(), closed: false, contact: true });
    model.filaments.len() - 1
}

/// Points on a straight line.
pub fn straight(from: DVec3, step: DVec3, count: usize) -> Vec<DVec3> {
    (0..count).map(|i| from + step * i as f64).collect()
}

impl Rig {
    pub fn new(model: &Model, settings: Penalty, skin: f64) -> Rig {
        let x: Vec<Position> = model.nodes.iter().map(|n| Position(n.position)).collect();
        let v: Vec<Velocity> = model.nodes.iter().map(|n| Velocity(n.velocity)).collect();
        let places: Vec<DVec3> = x.iter().map(|p| p.0).collect();
        let lines = Lines::new(model, |n| n.row(), &places).unwrap();
        let search = Search::new(skin * lines.mean_radius);
        let count = x.len();
        let mut rig = Rig {
            settings,
            lines,
            now: Centrelines::default(),
            search,
            builder: Builder::default(),
            line: Default::default(),
            point: Default::default(),
            inner: InnerList::default(),
            needed: Needed::default(),
            near: (0, 0),
            x,
            v,
            mass: vec![1.0; count],
            force: vec![DVec3::ZERO; count],
            lost: Totals::default(),
            rehomed: 0,
        };
        rig.rebuild();
        rig.touch();
        rig
    }

    /// Lets what touches now do so with its full stiffness, as at the start of a run.
    pub fn touch(&mut self) {
        self.line.1.iter_mut().for_each(|s| s.stiffness = APART);
        self.point.1.iter_mut().for_each(|s| s.stiffness = APART);
    }

    pub fn refresh(&mut self) {
        self.now.refresh_periods(&self.lines, &self.x, &self.v);
        self.now.refresh(&self.lines, &self.x, &self.v, &self.mass, None);
    }

    pub fn rebuild(&mut self) {
        self.refresh();
        let lines = &self.lines;
        self.search.candidates(lines, &self.now, |c| excluded(lines, c), &mut self.builder.candidates);
        self.builder.build(&self.settings, lines, &self.now);
        self.line.1 = self.builder.line_states(lines, &self.line.0, &self.line.1);
        self.builder.inherit_points(lines, &self.point.0, &self.point.1);
        self.line.0 = self.builder.lines.iter().map(|r| r.0).collect();
        self.line.2 = vec![LineForce::default(); self.line.0.len()];
        self.point.0 = self.builder.points.iter().map(|r| r.0).collect();
        self.point.1 = self.builder.points.iter().map(|r| r.1).collect();
        self.point.2 = vec![PointForce::default(); self.point.0.len()];
        self.inner.invalidate();
    }

    /// Forces at the current positions, after a step `dt` with the current velocities.
    pub fn evaluate(&mut self, dt: f64) {
        self.settings.law.dt = dt;
        self.now.refresh_periods(&self.lines, &self.x, &self.v);
        self.inner.follow(&self.search, &self.lines, &self.x, &self.now.shift, dt);
        // Without time the nodes have been put somewhere else.
        self.inner.due |= dt == 0.0 || self.lost.turned;
        let due = self.inner.due;
        if due {
            self.refresh();
            if self.inner.outgrows(&mut self.search, &self.lines, &self.now, dt) || self.lost.turned {
                self.rebuild();
            }
        } else {
            if self.needed.stale {
                let mut marks = Marks::none(&self.lines);
                self.line.0[..self.near.0].iter().for_each(|r| marks.line(r));
                self.point.0[..self.near.1].iter().for_each(|r| marks.point(r));
                self.needed.list(&self.lines, marks);
            }
            self.now.refresh(&self.lines, &self.x, &self.v, &self.mass, Some(&self.needed));
        }
        let (n, m) = if due { (self.line.0.len(), self.point.0.len()) } else { self.near };
        let (lr, ls, lf) = (&mut self.line.0[..n], &mut self.line.1[..n], &mut self.line.2[..n]);
        let (pr, ps, pf) = (&mut self.point.0[..m], &mut self.point.1[..m], &mut self.point.2[..m]);
        let a = evaluate_lines(&self.settings, &self.lines, &self.now, lr, ls, lf);
        let b = evaluate_points(&self.settings, &self.lines, &self.now, pr, ps, pf);
        self.lost.friction += a.friction + b.friction;
        self.lost.damping += a.damping + b.damping;
        self.lost.turned = a.turned;
        self.force.fill(DVec3::ZERO);
        let force = &mut self.force;
        scatter(&self.lines, &self.now, (lr, lf, &a.touching), (pr, pf, &b.touching), |row, f| force[row] += f);
        for k in &a.strayed {
            lr[*k as usize].rehome(&self.lines, &mut ls[*k as usize].t);
        }
        for k in &b.strayed {
            pr[*k as usize].rehome(&self.lines, &mut ps[*k as usize].t);
        }
        if a.strayed.len() + b.strayed.len() > 0 {
            self.needed.stale = true;
            self.rehomed += 1;
        }
        if due {
            self.inner.begin(&self.search, &self.lines, &self.now, &self.x, dt);
            self.near = (self.inner.divide_lines(&self.search, lr, ls), self.inner.divide_points(&self.search, pr, ps));
            self.needed.stale = true;
        }
    }

    /// Forces after the closest points have settled, without any change of history in time.
    pub fn settle(&mut self) {
        for _ in 0..4 {
            self.evaluate(0.0);
        }
    }

    /// Elastic energy of all records.
    pub fn energy(&self) -> f64 {
        let mut sum = 0.0;
        for (r, s) in self.line.0.iter().zip(&self.line.1) {
            let c: Contact<f64> = of_line(&self.settings, &self.lines, &self.now, r, s);
            sum += c.response.energy;
        }
        for (r, s) in self.point.0.iter().zip(&self.point.1) {
            let c: Contact<f64> = of_point(&self.settings, &self.lines, &self.now, r, s);
            sum += c.response.energy;
        }
        sum
    }

    /// Total force on the nodes of a filament.
    pub fn force_on(&self, model: &Model, filament: usize) -> DVec3 {
        model.filaments[filament].nodes.iter().map(|n| self.force[n.row()]).sum()
    }

    /// Moves the nodes of a filament.
    pub fn shift(&mut self, model: &Model, filament: usize, by: DVec3) {
        for n in &model.filaments[filament].nodes {
            self.x[n.row()].0 += by;
        }
    }
}

/// Pseudo-random numbers in [-1, 1) (xorshift64*).
pub struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}
