//! Implicit axial tension: the tensions at the end of the step from one scalar tridiagonal solve
//! per chain, so that the axial wave no longer limits the time step.
//!
//! With W the inverse masses, t_e the direction of bar e at t_n, v* the velocities kicked by all other
//! forces, dt the coming step and k the kick, the tension T_e acts from t_n to t_(n+1) and satisfies
//! the law of the bar at the *end* of the step:
//!
//!   T_e L_e / EA_e = l_e(n+1) - L_e,   l_e(n+1) = l_e + dt t_e . dv* + dt^2 |dv_across|^2 / (2 l_e) + dt t_e . d(k W G T)
//!
//! where dv is the difference of the end velocities (before the kick in the third term). The third term is the lengthening by transverse
//! motion to second order, without which a swinging bar would creep. Inside a chain bar e meets only bars
//! e-1 and e+1, hence the symmetric positive definite tridiagonal (or cyclic) matrix
//!
//!   L_e/EA_e + dt k t_e (W_a + W_b) t_e   on the diagonal,   -dt k t_e W_b t_(e+1)   beside it.
//!
//! Chains that run through a periodic face are joined through the dummy nodes: with gamma_ej the rate of
//! stretch of bar e per velocity of border member j, beta the border's velocity and S its Schur
//! complement (`constraint.rs`), (S/k + dt gamma^t A^-1 gamma) beta = -gamma^t A^-1 r closes the system exactly.
//!
//! The stiffness EA is exact at rest. In motion the scheme is the backward Euler method along the bar: axial waves
//! shorter than the step are damped, which is its purpose; transverse motion keeps the
//! central differences. What is dissipated is accounted for: the work of the tensions less the
//! change of the strain energy (`EnergyLedger::axial`).
//! In compression the bar may turn as freely as in tension: nothing locks.
use crate::systems::boundary::PrescribedRow;
use crate::systems::constraint::Constraints;
use crate::systems::integration::MassDamping;
use braid_ecs::prelude::*;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Registers the implicit axial scheme.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("implicit axial tension", install);
}

/// One bar of a chain with its working numbers.
#[derive(Clone, Copy, Debug, Default)]
struct Bar {
    rows: [u32; 2],
    carriers: [u32; 2],
    rest_length: f64,
    ea: f64,
    /// True if one of the ends is an image, so that its velocity has dummy terms.
    image: bool,
    t: DVec3,
    length: f64,
    /// Rate of the length before the kick.
    rate_before: f64,
    /// Lengthening by transverse motion.
    turning: f64,
    upper: f64,
    pivot: f64,
    y: f64,
    /// Solution for the unit load of the last bar of a closed chain.
    z: f64,
    tension: f64,
}

/// One chain of bars, each starting where the one before ends.
#[derive(Clone, Debug, Default)]
struct AxialChain {
    bars: Vec<Bar>,
    closed: bool,
    /// gamma_ej of the bars that feel the border: (bar, member, value), and A^-1 gamma by member.
    gamma: Vec<(usize, usize, f64)>,
    solved: Vec<(usize, Vec<f64>)>,
    /// Where gamma comes from: (bar, member, axis, coefficient with the sign of the end).
    couplings: Vec<(usize, usize, usize, f64)>,
    work: f64,
}

/// All chains of the model.
#[derive(Resource, Clone, Debug, Default)]
pub struct AxialChains {
    chains: Vec<AxialChain>,
    /// Work that the motion has done on the bars, and the last kick's part of it (force x length).
    work: f64,
    last: f64,
    /// Number of springs left to the explicit scheme.
    explicit: usize,
    border: Vec<f64>,
    /// What prescribed motions add to the velocities in this step, by row; empty if there are none.
    jumps: Vec<DVec3>,
    /// Longest time step that the scheme is trusted with (time).
    pub longest_step: f64,
}

/// Longest step in stable steps of the explicit scheme: a bar that is hit while it swings farther
/// in one step is stretched by the swing, and the wave that this starts is lost in the damping.
const LONGEST: f64 = 20.0;

impl AxialChains {
    /// Number of bars in chains, and of springs that stay explicit.
    pub fn counts(&self) -> (usize, usize) {
        (self.chains.iter().map(|c| c.bars.len()).sum(), self.explicit)
    }
    /// Work of the motion on the bars so far: half of the last kick lies before the current time (force x length).
    pub fn work(&self) -> f64 {
        self.work - 0.5 * self.last
    }
}

impl Kept for AxialChains {
    type State = (f64, f64);
    fn state(&self) -> (f64, f64) {
        (self.work, self.last)
    }
    fn put_back(&mut self, (work, last): (f64, f64)) {
        (self.work, self.last) = (work, last);
    }
}

fn install(cx: &mut Install<'_>) {
    if cx.model.integration.axial == AxialScheme::Explicit {
        return;
    }
    let Some(kinds) = cx.world.remove_resource::<KindReports>() else { return };
    let offers: Vec<_> = kinds.0.iter().map(|k| (k.springs)(cx.world)).collect();
    let springs: Vec<(usize, usize, [u32; 2], AxialSpring)> = offers
        .iter()
        .enumerate()
        .flat_map(|(k, list)| list.iter().enumerate().filter_map(move |(i, s)| s.map(|(rows, s)| (k, i, rows, s))))
        .collect();
    let built = chains(cx, &springs);
    for (k, kind) in kinds.0.iter().enumerate() {
        let mut taken = vec![false; kind.count];
        for (s, spring) in springs.iter().enumerate() {
            if spring.0 == k {
                taken[spring.1] = built.taken[s];
            }
        }
        (kind.release)(cx.world, &taken);
    }
    cx.world.insert_resource(kinds);
    let explicit = built.taken.iter().filter(|t| !**t).count();
    if explicit > 0 {
        cx.note(format!(
            "{explicit} of {} axial springs stay explicit: more than two bars meet at their nodes, or a general equation holds them; they limit the time step",
            springs.len()
        ));
    }
    if built.chains.is_empty() {
        return;
    }
    let entities: Vec<_> = built
        .chains
        .iter()
        .flat_map(|c| &c.bars)
        .map(|b| (AxialBar { rows: b.rows, rest_length: b.rest_length, ea: b.ea }, Tension(0.0)))
        .collect();
    cx.world.spawn_batch(entities);
    let stored = strain_energy(cx.world);
    let members = cx.world.get_resource::<Constraints>().map_or(0, |c| c.border_len());
    let light: Vec<f64> = cx.world.query::<&InverseMass>().iter(cx.world).map(|w| w.0.max_element()).collect();
    let frequency2 = |b: &Bar| 4.0 * b.ea / b.rest_length * light[b.carriers[0] as usize].max(light[b.carriers[1] as usize]);
    let fastest = built.chains.iter().flat_map(|c| &c.bars).map(frequency2).fold(0.0, f64::max);
    let longest_step = if fastest > 0.0 { LONGEST * 2.0 / fastest.sqrt() } else { f64::INFINITY };
    cx.world.insert_resource(AxialChains {
        chains: built.chains,
        work: stored,
        last: 0.0,
        explicit,
        border: vec![0.0; members],
        jumps: Vec::new(),
        longest_step,
    });
    cx.world.get_resource_or_init::<KindReports>().0.push(KindReport {
        name: "axial bar",
        count: 0,
        strain_energy,
        stiffness: |_, _| {},
        section_force: |_, _| None,
        rows: |_, _| Vec::new(),
        sections: |_, _| {},
        springs: |_| Vec::new(),
        release: |_, _| {},
    });
    cx.remember::<Tension>();
    cx.remember_part::<AxialChains>();
    cx.world.init_resource::<Constraints>();
    cx.add_system(StepSet::Dynamics, solve_tensions);
}

struct Built {
    chains: Vec<AxialChain>,
    taken: Vec<bool>,
}

/// Sorts the springs into chains: parallel springs merge, chains end at held nodes and do not run
/// through nodes where more than two bars meet.
fn chains(cx: &Install<'_>, springs: &[(usize, usize, [u32; 2], AxialSpring)]) -> Built {
    let constraints = cx.world.get_resource::<Constraints>();
    let carrier = |row: u32| -> Option<usize> {
        match constraints {
            Some(c) => c.carried(row as usize).map(|c| c.carrier),
            None => Some(row as usize),
        }
    };
    // Merge parallel springs: the same two rows.
    let mut merged: BTreeMap<[u32; 2], (f64, f64, Vec<usize>)> = BTreeMap::new();
    let mut taken = vec![false; springs.len()];
    for (s, (_, _, rows, spring)) in springs.iter().enumerate() {
        if carrier(rows[0]).is_some() && carrier(rows[1]).is_some() {
            let key = [rows[0].min(rows[1]), rows[0].max(rows[1])];
            let k = spring.ea / spring.rest_length;
            let entry = merged.entry(key).or_insert((0.0, 0.0, Vec::new()));
            entry.0 += k;
            entry.1 += k * spring.rest_length;
            entry.2.push(s);
        }
    }
    let bars: Vec<([u32; 2], f64, f64, Vec<usize>)> = merged.into_iter().map(|(rows, (k, kl, list))| (rows, k, kl / k, list)).collect();
    let held: Vec<bool> = {
        let entities = &cx.world.resource::<NodeEntities>().0;
        entities.iter().map(|e| cx.world.get::<InverseMass>(*e).is_some_and(|w| w.0 == DVec3::ZERO)).collect()
    };
    let mut at: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (b, (rows, ..)) in bars.iter().enumerate() {
        for r in rows {
            at.entry(carrier(*r).expect("filtered above")).or_default().push(b);
        }
    }
    let open = |vertex: usize| !held[vertex] && at[&vertex].len() <= 2;
    let usable: Vec<bool> = bars
        .iter()
        .map(|(rows, ..)| {
            let [a, b] = rows.map(|r| carrier(r).expect("filtered above"));
            a != b && (held[a] || open(a)) && (held[b] || open(b))
        })
        .collect();
    let mut used = vec![false; bars.len()];
    let mut chains = Vec::new();
    // Open chains first, from their ends; what is left are rings.
    for rings in [false, true] {
        for first in 0..bars.len() {
            if used[first] || !usable[first] {
                continue;
            }
            let ends = bars[first].0.map(|r| carrier(r).expect("filtered above"));
            let follows = |vertex: usize, b: usize| at[&vertex].iter().copied().find(|o| *o != b && usable[*o]).filter(|_| open(vertex));
            let start = if rings {
                0
            } else {
                match (follows(ends[0], first), follows(ends[1], first)) {
                    (None, _) => 0,
                    (_, None) => 1,
                    _ => continue,
                }
            };
            let mut list = Vec::new();
            let (mut b, mut from) = (first, ends[start]);
            let closed = loop {
                used[b] = true;
                let (rows, k, rest, parts) = &bars[b];
                let ends = rows.map(|r| carrier(r).expect("filtered above"));
                let flip = ends[0] != from;
                let order = if flip { [rows[1], rows[0]] } else { *rows };
                let carriers = order.map(|r| carrier(r).expect("filtered above"));
                list.push(Bar {
                    rows: order,
                    carriers: carriers.map(|c| c as u32),
                    rest_length: *rest,
                    ea: k * rest,
                    image: order.iter().zip(&carriers).any(|(r, c)| *r as usize != *c),
                    ..Default::default()
                });
                for p in parts {
                    taken[*p] = true;
                }
                from = carriers[1];
                match follows(from, b) {
                    Some(next) if !used[next] => b = next,
                    Some(next) => break next == first && list.len() > 2,
                    None => break false,
                }
            };
            chains.push(AxialChain { bars: list, closed, ..Default::default() });
        }
    }
    if let Some(c) = constraints {
        for chain in &mut chains {
            couple(chain, c);
        }
    }
    Built { chains, taken }
}

/// Which bars of a chain feel which border members.
fn couple(chain: &mut AxialChain, constraints: &Constraints) {
    for (i, bar) in chain.bars.iter().enumerate() {
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let carried = constraints.carried(bar.rows[side] as usize).expect("chains run through carried rows only");
            for axis in 0..3 {
                for j in 0..constraints.border_len() {
                    let mut coefficient = constraints.response(carried.carrier, axis, j);
                    let (row, member_axis) = constraints.border_dof(j);
                    if member_axis == axis && carried.dummies.contains(&row) {
                        coefficient += 1.0;
                    }
                    if coefficient != 0.0 {
                        chain.couplings.push((i, j, axis, sign * coefficient));
                    }
                }
            }
        }
    }
    let members: std::collections::BTreeSet<usize> = chain.couplings.iter().map(|c| c.1).collect();
    chain.solved = members.into_iter().map(|j| (j, vec![0.0; chain.bars.len()])).collect();
}

/// Numbers that all bars share in one step.
#[derive(Clone, Copy)]
struct Step {
    dt: f64,
    /// Kick with what the mass damping leaves of it.
    kick: f64,
    whole_kick: f64,
    /// What the mass damping leaves of the velocity before.
    keep: f64,
}

type BarQuery = (&'static AxialBar, &'static mut Tension);
type NodeQuery = (&'static Position, &'static mut Velocity, &'static mut Force, &'static InverseMass);

fn solve_tensions(
    clock: Res<Clock>,
    damping: Res<MassDamping>,
    mut constraints: ResMut<Constraints>,
    mut axial: ResMut<AxialChains>,
    prescribed: Query<&PrescribedRow>,
    mut nodes: Query<NodeQuery>,
    mut bars: Query<BarQuery>,
) {
    let (x, mut v, mut f, w) = columns(&mut nodes);
    let (v, f) = (v.bypass_change_detection(), f.bypass_change_detection());
    let (keep, kick) = damping.kick(clock.kick());
    let step = Step { dt: clock.dt_next, kick, whole_kick: clock.kick(), keep };
    let AxialChains { chains, border, work, last, jumps, .. } = &mut *axial;
    let constraints = &mut *constraints;
    if !prescribed.is_empty() {
        jumps.clear();
        jumps.resize(x.len(), DVec3::ZERO);
        for p in prescribed.iter().filter(|p| p.dof < 3) {
            jumps[p.row as usize][p.dof] = p.jump();
        }
    }
    let jumps = &*jumps;

    let solve = |c: &mut AxialChain| c.solve(step, (x, &*v, &*f, w), jumps, constraints);
    if chains.len() > 1 && rayon::current_num_threads() > 1 && chains.iter().map(|c| c.bars.len()).sum::<usize>() > 1000 {
        chains.par_iter_mut().for_each(solve);
    } else {
        chains.iter_mut().for_each(solve);
    }
    if !border.is_empty() {
        border_velocity(step, chains, constraints, border);
    }
    let mut tension = columns(&mut bars).1;
    let mut out = tension.bypass_change_detection().iter_mut();
    *last = 0.0;
    for chain in chains.iter_mut() {
        chain.finish(step, border);
        *last += chain.work;
        for b in &chain.bars {
            out.next().expect("one entity per bar").0 = b.tension;
            let pull = b.t * b.tension;
            let (i, j) = (b.carriers[0] as usize, b.carriers[1] as usize);
            f[i].0 += pull;
            v[i].0 += w[i].0 * pull * step.kick;
            f[j].0 -= pull;
            v[j].0 -= w[j].0 * pull * step.kick;
            if b.image {
                pull_dummies(b, pull, constraints, f);
            }
        }
    }
    *work += *last;
    // The border moves, and with it what hangs on it; the forces stay effective (force x inverse mass).
    for (j, beta) in border.iter().enumerate() {
        let (row, axis) = constraints.border_dof(j);
        v[row].0[axis] += beta;
        f[row].0[axis] += constraints.border_mass(j) * beta / step.kick;
        for (row, dof, response) in constraints.responses(j) {
            if dof < 3 {
                v[row].0[dof] += response * beta;
                f[row].0[dof] += response * beta / (step.kick * w[row].0[dof]);
            }
        }
    }
}

/// Raw tension on the dummy nodes of an image: to their residual, or to the reaction where they are held.
fn pull_dummies(b: &Bar, pull: DVec3, constraints: &mut Constraints, f: &mut [Force]) {
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let carried = constraints.carried(b.rows[side] as usize).expect("chains run through carried rows only");
        for row in carried.dummies {
            for axis in 0..3 {
                match constraints.border_member(row, axis) {
                    Some(j) => constraints.border_residual[j] += sign * pull[axis],
                    None => f[row].0[axis] += sign * pull[axis],
                }
            }
        }
    }
}

/// Solves for the velocities beta that the tensions give to the border.
fn border_velocity(step: Step, chains: &[AxialChain], constraints: &Constraints, beta: &mut [f64]) {
    let n = beta.len();
    let (mut load, mut stiffness) = (vec![0.0; n], vec![0.0; n * n]);
    for chain in chains {
        for (e, j, g) in &chain.gamma {
            load[*j] -= g * chain.bars[*e].y;
            for (k, column) in &chain.solved {
                stiffness[j * n + k] += g * column[*e];
            }
        }
    }
    // (I + k dt S^-1 gamma^t A^-1 gamma) beta = -k S^-1 gamma^t A^-1 r
    let mut a = vec![0.0; n * n];
    for i in 0..n {
        beta[i] = (0..n).map(|j| constraints.schur_inverse(i, j) * load[j]).sum::<f64>() * step.kick;
        for k in 0..n {
            let product: f64 = (0..n).map(|j| constraints.schur_inverse(i, j) * stiffness[j * n + k]).sum();
            a[i * n + k] = f64::from(i == k) + step.kick * step.dt * product;
        }
    }
    for k in 0..n {
        for i in k + 1..n {
            let factor = a[i * n + k] / a[k * n + k];
            if factor != 0.0 {
                for j in k..n {
                    a[i * n + j] -= factor * a[k * n + j];
                }
                beta[i] -= factor * beta[k];
            }
        }
    }
    for k in (0..n).rev() {
        for j in k + 1..n {
            beta[k] -= a[k * n + j] * beta[j];
        }
        beta[k] /= a[k * n + k];
    }
}

type NodeSlices<'a> = (&'a [Position], &'a [Velocity], &'a [Force], &'a [InverseMass]);

impl AxialChain {
    /// Assembles the matrix, factorises it, and solves for y = A^-1 r and A^-1 gamma.
    fn solve(&mut self, step: Step, (x, v, f, w): NodeSlices<'_>, jumps: &[DVec3], constraints: &Constraints) {
        let h2 = step.dt * step.kick;
        // Kicked velocity of an end, and what the kick has added to it.
        let jump = |row: usize| jumps.get(row).copied().unwrap_or(DVec3::ZERO);
        let end = |row: u32, carrier: u32| -> (DVec3, DVec3) {
            let c = carrier as usize;
            let (mut velocity, mut kicked) = (v[c].0, w[c].0 * f[c].0 * step.kick + jump(c));
            if row != carrier {
                let carried = constraints.carried(row as usize).expect("chains run through carried rows only");
                for d in carried.dummies {
                    velocity += v[d].0;
                    kicked += w[d].0 * f[d].0 * step.kick + jump(d);
                }
            }
            (velocity, kicked)
        };
        for b in &mut self.bars {
            let d = x[b.rows[1] as usize].0 - x[b.rows[0] as usize].0;
            let l = d.length();
            b.t = d / l;
            let (va, ka) = end(b.rows[0], b.carriers[0]);
            let (vb, kb) = end(b.rows[1], b.carriers[1]);
            let dv = vb - va;
            let rate = b.t.dot(dv);
            // The turning of the bar from the velocity before the kick: the kick alone holds forces
            // that the tension balances, and would lengthen a bar at rest.
            let before = dv - (kb - ka);
            let across = before - b.t * b.t.dot(before);
            let across = across.length_squared();
            b.rate_before = b.t.dot(before) / step.keep;
            b.turning = 0.5 * step.dt * step.dt * across / l;
            b.y = l - b.rest_length + step.dt * rate + b.turning;
            let wt = (w[b.carriers[0] as usize].0 + w[b.carriers[1] as usize].0) * b.t;
            b.pivot = b.rest_length / b.ea + h2 * b.t.dot(wt);
            b.length = l;
        }
        let n = self.bars.len();
        for i in 0..n {
            let next = if i + 1 < n { i + 1 } else { 0 };
            let (a, b) = (self.bars[i], self.bars[next]);
            self.bars[i].upper = -h2 * a.t.dot(w[a.carriers[1] as usize].0 * b.t);
        }
        self.gamma.clear();
        for (e, j, axis, coefficient) in &self.couplings {
            self.gamma.push((*e, *j, coefficient * self.bars[*e].t[*axis]));
        }
        for (j, column) in &mut self.solved {
            column.fill(0.0);
            for (e, k, g) in &self.gamma {
                if k == j {
                    column[*e] += g;
                }
            }
        }
        // Thomas algorithm on the open part; a ring leaves its last bar out and puts it back below.
        let m = if self.closed { n - 1 } else { n };
        let (last_pivot, last_y) = (self.bars[n - 1].pivot, self.bars[n - 1].y);
        if self.closed {
            let (wrap, before) = (self.bars[n - 1].upper, self.bars[n - 2].upper);
            for b in &mut self.bars {
                b.z = 0.0;
            }
            self.bars[0].z += wrap;
            self.bars[m - 1].z += before;
        }
        for i in 1..m {
            let before = self.bars[i - 1];
            let factor = before.upper / before.pivot;
            let b = &mut self.bars[i];
            b.pivot -= factor * before.upper;
            b.y -= factor * before.y;
            b.z -= factor * before.z;
            for (_, column) in &mut self.solved {
                column[i] -= factor * column[i - 1];
            }
        }
        for i in (0..m).rev() {
            let after = if i + 1 < m { self.bars[i + 1] } else { Bar::default() };
            let b = &mut self.bars[i];
            let (upper, inverse) = (if i + 1 < m { b.upper } else { 0.0 }, 1.0 / b.pivot);
            b.y = (b.y - upper * after.y) * inverse;
            b.z = (b.z - upper * after.z) * inverse;
            for (_, column) in &mut self.solved {
                let next = if i + 1 < m { column[i + 1] } else { 0.0 };
                column[i] = (column[i] - upper * next) * inverse;
            }
        }
        if self.closed {
            let (wrap, before) = (self.bars[n - 1].upper, self.bars[n - 2].upper);
            let pivot = last_pivot - wrap * self.bars[0].z - before * self.bars[m - 1].z;
            let y = (last_y - wrap * self.bars[0].y - before * self.bars[m - 1].y) / pivot;
            self.bars[n - 1].y = y;
            for b in &mut self.bars[..m] {
                b.y -= b.z * y;
            }
            for (_, column) in &mut self.solved {
                let c = (column[n - 1] - wrap * column[0] - before * column[m - 1]) / pivot;
                column[n - 1] = c;
                for (b, value) in self.bars[..m].iter().zip(column.iter_mut()) {
                    *value -= b.z * c;
                }
            }
        }
    }

    /// Tensions with the border's motion, and the work of the motion on the bars: the kick takes just
    /// this out of the kinetic energy.
    fn finish(&mut self, step: Step, border: &[f64]) {
        for (j, column) in &self.solved {
            let push = step.dt * border[*j];
            for (b, z) in self.bars.iter_mut().zip(column) {
                b.y += push * z;
            }
        }
        self.work = 0.0;
        for b in &mut self.bars {
            b.tension = b.y;
            let after = b.rest_length * (1.0 + b.tension / b.ea);
            let rate_after = (after - b.length - b.turning) / step.dt;
            self.work += 0.5 * b.tension * (b.rate_before + rate_after) * step.whole_kick;
        }
    }
}

fn strain_energy(world: &mut World) -> f64 {
    let x: Vec<DVec3> = world.query::<&Position>().iter(world).map(|x| x.0).collect();
    let mut bars = world.query::<&AxialBar>();
    bars.iter(world)
        .map(|b| {
            let strain = (x[b.rows[1] as usize] - x[b.rows[0] as usize]).length() / b.rest_length - 1.0;
            0.5 * b.ea * b.rest_length * strain * strain
        })
        .sum()
}
