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
mod chains;
mod solve;

use crate::systems::boundary::PrescribedRow;
use crate::systems::constraint::Constraints;
use crate::systems::integration::MassDamping;
use braid_ecs::prelude::*;
use chains::{Chain, chains};
use rayon::prelude::*;
use solve::{LANES, Pack, Step};

/// Registers the implicit axial scheme.
pub fn plugin(sim: &mut Simulation) {
    sim.add_installer("implicit axial tension", install);
}

/// Marks a row at which no bar ends.
const NOWHERE: u32 = u32::MAX;

/// All chains of the model.
#[derive(Resource, Clone, Debug, Default)]
pub struct AxialChains {
    /// Chains of equal length, four at a time.
    packs: Vec<Pack>,
    /// Ends of bars by the row that carries them: pack, and end in the pack.
    joints: Incidence<(u32, u32)>,
    /// Place of each row in the list of these, [`NOWHERE`] if no bar ends there.
    places: Vec<u32>,
    /// Work that the motion has done on the bars, and the last kick's part of it (force x length).
    work: f64,
    last: f64,
    /// Number of springs left to the explicit scheme.
    explicit: usize,
    border: Vec<f64>,
    /// What prescribed motions add to the velocities in this step, by row; empty if there are none.
    jumps: Vec<DVec3>,
    /// Stable step of the explicit scheme (time): the first ones of a run, if nothing but the scheme limits them.
    pub explicit_step: f64,
    /// Longest time step that the scheme is trusted with (time): the axial waves that start where a bar is hit while it swings are
    /// lost in its damping, and what is hit in a few steps only is not resolved.
    pub longest_step: f64,
    /// Step in which no bar turns too far, as it moves now (time).
    pub turning_step: f64,
}

impl AxialChains {
    /// Number of bars in chains, and of springs that stay explicit.
    pub fn counts(&self) -> (usize, usize) {
        (self.packs.iter().map(Pack::count).sum(), self.explicit)
    }
    /// Counts what later changes of the velocities of some rows add to the work of the motion on the bars in a kick.
    pub fn follow(&mut self, changes: &[(usize, DVec3)], kick: f64) {
        let AxialChains { packs, joints, places, .. } = self;
        let ends = |row: usize| (places[row] != NOWHERE).then(|| joints.at(places[row] as usize));
        let sum = -changes.iter().filter_map(|(row, change)| Some(pulled(packs, ends(*row)?).dot(*change))).sum::<f64>();
        self.last += 0.5 * kick * sum;
        self.work += 0.5 * kick * sum;
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
    let packs = packs(built.chains, cx.world.get_resource::<Constraints>());
    let bars = || packs.iter().flat_map(Pack::bars);
    let entities: Vec<_> = bars().map(|b| (b, Tension(0.0))).collect();
    cx.world.spawn_batch(entities);
    let stored = strain_energy(cx.world);
    let members = cx.world.get_resource::<Constraints>().map_or(0, |c| c.border_len());
    let light: Vec<f64> = cx.world.query::<&InverseMass>().iter(cx.world).map(|w| w.0.max_element()).collect();
    let fastest = packs.iter().map(|p| p.frequency2(&light)).fold(0.0, f64::max);
    let explicit_step = if fastest > 0.0 { 2.0 / fastest.sqrt() } else { f64::INFINITY };
    let ends = packs.iter().enumerate().flat_map(|(k, p)| p.carriers().map(move |(row, end)| (row, (k as u32, end))));
    let joints = Incidence::new(ends);
    let mut places = vec![NOWHERE; light.len()];
    for (place, row) in (0..).zip(&joints.nodes) {
        places[*row as usize] = place;
    }
    cx.world.insert_resource(AxialChains {
        packs,
        joints,
        places,
        work: stored,
        last: 0.0,
        explicit,
        border: vec![0.0; members],
        jumps: Vec::new(),
        explicit_step,
        longest_step: cx.model.integration.courant * explicit_step,
        turning_step: f64::INFINITY,
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

/// Chains of the same length side by side.
fn packs(chains: Vec<Chain>, constraints: Option<&Constraints>) -> Vec<Pack> {
    let mut order = chains;
    order.sort_by_key(|c| (c.closed, c.bars.len()));
    let alike = order.chunk_by(|a, b| a.closed == b.closed && a.bars.len() == b.bars.len());
    alike.flat_map(|alike| alike.chunks(LANES)).map(|group| Pack::new(group, constraints)).collect()
}

/// Sum of the pulls on ends of bars.
fn pulled(packs: &[Pack], ends: &[(u32, u32)]) -> DVec3 {
    ends.iter().map(|(pack, end)| packs[*pack as usize].pull(*end)).sum()
}

/// Nodes per parallel chunk.
const CHUNK: usize = 512;

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
    let AxialChains { packs, joints, border, work, last, jumps, turning_step, .. } = &mut *axial;
    let constraints = &mut *constraints;
    if !prescribed.is_empty() {
        jumps.clear();
        jumps.resize(x.len(), DVec3::ZERO);
        for p in prescribed.iter().filter(|p| p.dof < 3) {
            jumps[p.row as usize][p.dof] = p.jump();
        }
    }
    let jumps = &*jumps;

    let columns_of_nodes = (x, &*v, &*f, w);
    let count = packs.iter().map(Pack::count).sum();
    let mut tension = columns(&mut bars).1;
    let tension = tension.bypass_change_detection();
    if border.is_empty() {
        // In one go, while the bars of a pack are at hand.
        each(&mut with_tensions(packs, tension), count, |(pack, tensions)| {
            pack.solve(step, columns_of_nodes, jumps);
            pack.finish(step, &[], tensions);
        });
    } else {
        each(packs, count, |pack| pack.solve(step, columns_of_nodes, jumps));
        border_velocity(step, packs, constraints, border);
        each(&mut with_tensions(packs, tension), count, |(pack, tensions)| pack.finish(step, border, tensions));
    }
    *turning_step = packs.iter().map(|p| p.turning_step).fold(f64::INFINITY, f64::min);
    *last = packs.iter().map(|p| p.done).sum();
    let packs = &*packs;
    parallel::picked2(f, v, &joints.nodes, CHUNK, |k, row, f, v| {
        let pull = pulled(packs, joints.at(k));
        f.0 += pull;
        v.0 += w[row].0 * pull * step.kick;
    });
    for (pull, dummies) in packs.iter().flat_map(Pack::hanging) {
        pull_dummies(dummies, pull, constraints, f);
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

/// Every pack with the tensions of its bars.
fn with_tensions<'a>(packs: &'a mut [Pack], mut tensions: &'a mut [Tension]) -> Vec<(&'a mut Pack, &'a mut [Tension])> {
    let of = |pack: &'a mut Pack| {
        let (own, others) = std::mem::take(&mut tensions).split_at_mut(pack.count());
        tensions = others;
        (pack, own)
    };
    packs.iter_mut().map(of).collect()
}

/// Runs `f` on every pack, in parallel where it pays with so many bars.
fn each<T: Send>(packs: &mut [T], bars: usize, f: impl Fn(&mut T) + Send + Sync) {
    if packs.len() > 1 && rayon::current_num_threads() > 1 && bars > 1000 {
        packs.par_iter_mut().for_each(f);
    } else {
        packs.iter_mut().for_each(f);
    }
}

/// Raw tension on the dummy nodes behind the end of a bar: to their residual, or to the reaction where they are held.
fn pull_dummies(dummies: &[usize], pull: DVec3, constraints: &mut Constraints, f: &mut [Force]) {
    for row in dummies {
        for axis in 0..3 {
            match constraints.border_member(*row, axis) {
                Some(j) => constraints.border_residual[j] += pull[axis],
                None => f[*row].0[axis] += pull[axis],
            }
        }
    }
}

/// Solves for the velocities beta that the tensions give to the border.
fn border_velocity(step: Step, packs: &[Pack], constraints: &Constraints, beta: &mut [f64]) {
    let n = beta.len();
    let (mut load, mut stiffness) = (vec![0.0; n], vec![0.0; n * n]);
    packs.iter().for_each(|p| p.load_border(&mut load, &mut stiffness));
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
