//! The systems of contact between filaments.
use super::assemble::*;
use super::inner::{InnerList, Needed};
use super::kernel::Penalty;
use super::lines::{Centrelines, JointMasses, Lines};
use super::list::{Builder, excluded};
use super::records::*;
use super::search::Search;
use super::spec::InitialOverlap;
use super::stiffness::Burden;
use crate::systems::energy::{LookNow, MonitorEvery};
use braid_ecs::prelude::*;

/// What the last evaluation asks of the next search.
#[derive(Resource, Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Requests {
    /// Filaments that touch have turned against each other: crossings must be looked for.
    pub turned: bool,
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

/// Centrelines follow the nodes: all of them when all records or contacts are looked at, else those that are needed.
pub fn refresh(
    clock: Res<Clock>,
    lines: Res<Lines>,
    masses: Res<JointMasses>,
    needed: Res<Needed>,
    mut now: ResMut<Centrelines>,
    inner: Option<ResMut<InnerList>>,
    search: Option<Res<Search>>,
    requests: Option<Res<Requests>>,
    (look, every): (Option<Res<LookNow>>, Option<Res<MonitorEvery>>),
    mut nodes: Query<(&Position, &Velocity)>,
) {
    let (x, v) = columns(&mut nodes);
    now.refresh_periods(&lines, x, v);
    // Whoever looks at all contacts in this step sees the motion that their forces are computed with.
    let mut all = look.is_some_and(|l| l.0) || every.is_some_and(|e| clock.step.is_multiple_of(e.0));
    if let (Some(mut inner), Some(search), Some(requests)) = (inner, search, requests) {
        inner.due |= requests.turned;
        inner.follow(&search, &lines, x, &now.shift, clock.dt);
        all |= inner.due;
    }
    now.refresh(&lines, x, v, &masses.0, (!all).then_some(&*needed));
}

/// Makes a new list if one is due.
pub fn rebuild(world: &mut World) {
    super::stiffness::resolve(world);
    if !world.resource::<InnerList>().due {
        return;
    }
    let dt = world.resource::<Clock>().dt_target;
    let outgrown = world.resource_scope(|world, mut search: Mut<Search>| {
        world.resource::<InnerList>().outgrows(&mut search, world.resource::<Lines>(), world.resource::<Centrelines>(), dt)
    });
    if outgrown || world.resource::<Requests>().turned {
        make_list(world);
        *world.resource_mut::<Requests>() = Requests::default();
    }
}

/// Finds all pairs, makes records of them with the history of the old ones, and writes them to the pools.
pub fn make_list(world: &mut World) {
    let mut search = world.remove_resource::<Search>().expect("inserted by the installer");
    let mut builder = world.remove_resource::<ListBuilder>().expect("inserted by the installer");
    let live = *world.resource::<LiveRecords>();
    // Columns that are not there cannot be read.
    grow_lines(world, 0);
    grow_points(world, 0);
    let mut line = world.query::<(&mut LineRecord, &mut LineState)>();
    let mut point = world.query::<(&mut PointRecord, &mut PointState)>();
    let (mut old_lines, mut old_points) = (world.query::<(&LineRecord, &LineState)>(), world.query::<(&PointRecord, &PointState)>());
    let states = {
        let (lines, now, penalty) = (world.resource::<Lines>(), world.resource::<Centrelines>(), world.resource::<Penalty>());
        let touching = world.resource::<SelfContact>().0;
        let never = |c| excluded(lines, c) || !touching && lines.chain_of(c.a) == lines.chain_of(c.b) && c.image == lines.images.zero();
        search.candidates(lines, now, never, &mut builder.0.candidates);
        builder.0.build(penalty, lines, now);
        let (mut old_lines, mut old_points) = (old_lines.query(world), old_points.query(world));
        let ((records, was), (points, were)) = (columns(&mut old_lines), columns(&mut old_points));
        builder.0.inherit_points(lines, &points[..live.points], &were[..live.points]);
        builder.0.line_states(lines, &records[..live.lines], &was[..live.lines])
    };
    grow_lines(world, builder.0.lines.len());
    grow_points(world, builder.0.points.len());
    for (((record, _), state), (mut r, mut s)) in builder.0.lines.iter().zip(&states).zip(line.iter_mut(world)) {
        (*r, *s) = (*record, *state);
    }
    for (new, (mut r, mut s)) in builder.0.points.iter().zip(point.iter_mut(world)) {
        (*r, *s) = *new;
    }
    let (lines, points) = (builder.0.lines.len(), builder.0.points.len());
    *world.resource_mut::<LiveRecords>() = LiveRecords { lines, points, near_lines: lines, near_points: points };
    world.resource_mut::<InnerList>().invalidate();
    world.resource_mut::<Needed>().stale = true;
    world.insert_resource(search);
    world.insert_resource(builder);
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

/// After a restore: the stiffness has been found, and the centrelines are those of another time.
pub fn settle(world: &mut World) {
    world.remove_resource::<super::stiffness::Wanted>();
    world.resource_mut::<Needed>().stale = true;
    world.resource_mut::<Centrelines>().complete = false;
}

/// Forces of the near records, or of all in a step with a look, their sums at the nodes, and the stiffness of those that touch or soon will.
pub fn forces(
    clock: Res<Clock>,
    relaxation: Res<Relaxation>,
    (lines, now, search): (Res<Lines>, Res<Centrelines>, Res<Search>),
    (mut penalty, mut requests, mut needed): (ResMut<Penalty>, ResMut<Requests>, ResMut<Needed>),
    (mut live, mut inner): (ResMut<LiveRecords>, ResMut<InnerList>),
    (burden, acting): (Option<ResMut<Burden>>, Option<ResMut<ActingStiffness>>),
    mut ledger: ResMut<EnergyLedger>,
    mut line: Query<(&mut LineRecord, &mut LineState, &mut LineForce)>,
    mut point: Query<(&mut PointRecord, &mut PointState, &mut PointForce)>,
    mut nodes: Query<(&Position, &mut Force)>,
) {
    penalty.law.dt = clock.dt;
    penalty.keep = relaxation.keep(clock.time, clock.dt);
    let (mut lr, mut ls, mut lf) = columns(&mut line);
    let (mut pr, mut ps, mut pf) = columns(&mut point);
    let (n, m) = if inner.due { (live.lines, live.points) } else { (live.near_lines, live.near_points) };
    let (lr, ls, lf) =
        (&mut lr.bypass_change_detection()[..n], &mut ls.bypass_change_detection()[..n], &mut lf.bypass_change_detection()[..n]);
    let (pr, ps, pf) =
        (&mut pr.bypass_change_detection()[..m], &mut ps.bypass_change_detection()[..m], &mut pf.bypass_change_detection()[..m]);
    let of_lines = evaluate_lines(&penalty, &lines, &now, lr, ls, lf);
    let of_points = evaluate_points(&penalty, &lines, &now, pr, ps, pf);
    for total in [&of_lines, &of_points] {
        requests.turned |= total.turned;
        ledger.friction += total.friction;
        ledger.damping += total.damping;
        ledger.external_work += total.relaxed;
    }
    let (x, mut force) = columns(&mut nodes);
    let force = force.bypass_change_detection();
    let hand_over = || {
        scatter(&lines, &now, (lr, lf, &of_lines.touching), (pr, pf, &of_points.touching), |row, f| force[row].0 += f);
    };
    let bear = || {
        if let (Some(mut burden), Some(mut acting)) = (burden, acting) {
            burden.take(&penalty, &lines, &now, (lr, ls, &of_lines.bearing), (pr, ps, &of_points.bearing), &mut acting);
        }
    };
    // Each in its own order, whatever the number of threads.
    parallel::both(of_lines.touching.len() + of_points.touching.len(), hand_over, bear);
    // Records that have left their segment move to the next one.
    for k in of_lines.strayed {
        let (r, s) = (&mut lr[k as usize], &mut ls[k as usize]);
        r.rehome(&lines, &mut s.t);
        needed.stale |= !needed.covers(r.segment);
    }
    for k in of_points.strayed {
        let (r, s) = (&mut pr[k as usize], &mut ps[k as usize]);
        r.rehome(&lines, &mut s.t);
        needed.stale |= !r.segments.iter().all(|s| needed.covers(*s));
    }
    if inner.due {
        inner.begin(&search, &lines, &now, x, clock.dt_target.max(clock.dt));
        live.near_lines = inner.divide_lines(&search, lr, ls);
        live.near_points = inner.divide_points(&search, pr, ps);
        needed.stale = true;
    }
}
