//! The systems of contact between filaments.
use super::assemble::*;
use super::kernel::Penalty;
use super::lines::{Centrelines, Lines};
use super::list::{Builder, excluded};
use super::records::*;
use super::search::Search;
use super::spec::InitialOverlap;
use braid_ecs::prelude::*;

/// Masses of the nodes by row, periodic copies with the mass of the whole node.
#[derive(Resource, Clone, Debug, Default)]
pub struct JointMasses(pub Vec<f64>);

/// What the last evaluation asks of the next search.
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Requests {
    /// Records have left their segment.
    pub strayed: bool,
    /// Filaments that touch have turned against each other: crossings must be looked for.
    pub turned: bool,
    /// The list must be made again in this step.
    pub rebuild: bool,
}

/// Overlap that goes away in time.
#[derive(Resource, Clone, Copy, Debug)]
pub struct Relaxation {
    /// What was asked for.
    pub rule: InitialOverlap,
}

impl Relaxation {
    /// Factor on the offsets in the step that ends at `time`.
    pub fn keep(&self, time: f64, dt: f64) -> f64 {
        match self.rule {
            InitialOverlap::Relax(t) if time < t.0 => (1.0 - time / t.0) / (1.0 - (time - dt).max(0.0) / t.0),
            InitialOverlap::Relax(_) => 0.0,
            _ => 1.0,
        }
    }
}

/// Scratch space of the list.
#[derive(Resource, Default)]
pub struct ListBuilder(pub Builder);

/// Centrelines follow the nodes.
pub fn refresh(lines: Res<Lines>, masses: Res<JointMasses>, mut now: ResMut<Centrelines>, mut nodes: Query<(&Position, &Velocity)>) {
    let (x, v) = columns(&mut nodes);
    now.refresh(&lines, x, v, &masses.0);
}

/// Records that have left their segment move to the next one; decides whether a new list is due.
pub fn follow(
    clock: Res<Clock>,
    lines: Res<Lines>,
    now: Res<Centrelines>,
    live: Res<LiveRecords>,
    mut search: ResMut<Search>,
    mut requests: ResMut<Requests>,
    mut gather: ResMut<Gather>,
    mut line: Query<(&mut LineRecord, &mut LineState)>,
    mut point: Query<(&mut PointRecord, &mut PointState)>,
) {
    if requests.strayed {
        let (mut lr, mut ls) = columns(&mut line);
        let (mut pr, mut ps) = columns(&mut point);
        let (lr, ls) = (&mut lr.bypass_change_detection()[..live.lines], &mut ls.bypass_change_detection()[..live.lines]);
        let (pr, ps) = (&mut pr.bypass_change_detection()[..live.points], &mut ps.bypass_change_detection()[..live.points]);
        for (r, s) in lr.iter_mut().zip(ls) {
            r.rehome(&lines, &mut s.t);
        }
        for (r, s) in pr.iter_mut().zip(ps) {
            r.rehome(&lines, &mut s.t);
        }
        gather.index(&lines, lr, pr);
        requests.strayed = false;
    }
    requests.rebuild = search.outdated(&lines, &now, clock.dt) || requests.turned;
}

/// Makes a new list if one is due.
pub fn rebuild(world: &mut World) {
    super::stiffness::resolve(world);
    if world.resource::<Requests>().rebuild {
        make_list(world);
        *world.resource_mut::<Requests>() = Requests::default();
        world.get_resource_or_init::<StiffnessChanged>().0 = true;
    }
}

/// Finds all pairs, makes records of them with the history of the old ones, and writes them to the pools.
pub fn make_list(world: &mut World) {
    let mut search = world.remove_resource::<Search>().expect("inserted by the installer");
    let mut builder = world.remove_resource::<ListBuilder>().expect("inserted by the installer");
    let mut gather = world.remove_resource::<Gather>().expect("inserted by the installer");
    let live = *world.resource::<LiveRecords>();
    let mut line = world.query::<(&mut LineRecord, &mut LineState)>();
    let mut point = world.query::<(&mut PointRecord, &mut PointState)>();
    {
        let (lines, now, penalty) = (world.resource::<Lines>(), world.resource::<Centrelines>(), world.resource::<Penalty>());
        let touching = world.resource::<SelfContact>().0;
        let never = |c| excluded(lines, c) || !touching && lines.chain_of(c.a) == lines.chain_of(c.b) && c.image == lines.images.zero();
        search.candidates(lines, now, never, &mut builder.0.candidates);
        builder.0.build(penalty, lines, now);
        let (mut old_lines, mut old_points) = ((Vec::new(), Vec::new()), (Vec::new(), Vec::new()));
        for (r, s) in line.iter(world).take(live.lines) {
            old_lines.0.push(*r);
            old_lines.1.push(*s);
        }
        for (r, s) in point.iter(world).take(live.points) {
            old_points.0.push(*r);
            old_points.1.push(*s);
        }
        builder.0.inherit(lines, (&old_lines.0, &old_lines.1), (&old_points.0, &old_points.1));
    }
    grow_lines(world, builder.0.lines.len());
    grow_points(world, builder.0.points.len());
    for (new, (mut r, mut s)) in builder.0.lines.iter().zip(line.iter_mut(world)) {
        (*r, *s) = *new;
    }
    for (new, (mut r, mut s)) in builder.0.points.iter().zip(point.iter_mut(world)) {
        (*r, *s) = *new;
    }
    *world.resource_mut::<LiveRecords>() = LiveRecords { lines: builder.0.lines.len(), points: builder.0.points.len() };
    let records: (Vec<LineRecord>, Vec<PointRecord>) =
        (builder.0.lines.iter().map(|r| r.0).collect(), builder.0.points.iter().map(|r| r.0).collect());
    gather.index(world.resource::<Lines>(), &records.0, &records.1);
    world.insert_resource(search);
    world.insert_resource(builder);
    world.insert_resource(gather);
}

/// True if a filament may touch itself.
#[derive(Resource, Clone, Copy, Debug)]
pub struct SelfContact(pub bool);

/// Rows to add to a pool that has `have` and needs `need`, with room for more.
pub fn shortage(need: usize, have: usize) -> usize {
    if need.max(1) > have { (need + need / 2).max(16) - have } else { 0 }
}

/// Makes room for so many line records.
pub fn grow_lines(world: &mut World, need: usize) {
    let rows = shortage(need, world.query::<&LineRecord>().iter(world).len());
    let idle = LineRecord { node: u32::MAX, segment: u32::MAX, image: 0, half: false, crossing: false };
    world.spawn_batch(vec![(idle, LineState::at(0.0), LineForce::default()); rows]);
}

/// Makes room for so many point records.
pub fn grow_points(world: &mut World, need: usize) {
    let rows = shortage(need, world.query::<&PointRecord>().iter(world).len());
    let idle = PointRecord { segments: [u32::MAX; 2], image: 0 };
    world.spawn_batch(vec![(idle, PointState::at([0.0; 2]), PointForce::default()); rows]);
}

/// After a restore: who acts on whom follows from the records, and the stiffness has been found.
pub fn settle(world: &mut World) {
    world.remove_resource::<super::stiffness::Wanted>();
    let live = *world.resource::<LiveRecords>();
    let records: Vec<LineRecord> = world.query::<&LineRecord>().iter(world).take(live.lines).copied().collect();
    let points: Vec<PointRecord> = world.query::<&PointRecord>().iter(world).take(live.points).copied().collect();
    world.resource_scope(|world, mut gather: Mut<Gather>| gather.index(world.resource::<Lines>(), &records, &points));
}

/// Forces of all records, and their sums at the nodes.
pub fn forces(
    clock: Res<Clock>,
    relaxation: Res<Relaxation>,
    mut penalty: ResMut<Penalty>,
    (lines, now, live): (Res<Lines>, Res<Centrelines>, Res<LiveRecords>),
    mut requests: ResMut<Requests>,
    mut gather: ResMut<Gather>,
    mut ledger: ResMut<EnergyLedger>,
    mut line: Query<(&LineRecord, &mut LineState, &mut LineForce)>,
    mut point: Query<(&PointRecord, &mut PointState, &mut PointForce)>,
    mut nodes: Query<&mut Force>,
) {
    penalty.law.dt = clock.dt;
    penalty.keep = relaxation.keep(clock.time, clock.dt);
    let (lr, mut ls, mut lf) = columns(&mut line);
    let (pr, mut ps, mut pf) = columns(&mut point);
    let n = live.lines;
    let (lr, ls, lf) = (&lr[..n], &mut ls.bypass_change_detection()[..n], &mut lf.bypass_change_detection()[..n]);
    let n = live.points;
    let (pr, ps, pf) = (&pr[..n], &mut ps.bypass_change_detection()[..n], &mut pf.bypass_change_detection()[..n]);
    let mut total = evaluate_lines(&penalty, &lines, &now, lr, ls, lf);
    total.add(evaluate_points(&penalty, &lines, &now, pr, ps, pf));
    requests.strayed |= total.strayed;
    requests.turned |= total.turned;
    ledger.friction += total.friction;
    ledger.damping += total.damping;
    ledger.external_work += total.relaxed;
    gather.sum(&lines, &now, lr, lf, pr, pf);
    let mut force = columns(&mut nodes);
    let force = force.bypass_change_detection();
    gather.scatter(&lines, |row, f| force[row].0 += f);
}
