//! What contacts look like from outside: every touching record, and their summary.
use super::assemble::{of_line, of_point};
use super::inner::{InnerList, refresh_all};
use super::kernel::{Contact, Penalty};
use super::lines::{Centrelines, Lines, xyz};
use super::records::*;
use super::search::Search;
use super::target::Target;
use crate::systems::energy::{LookNow, MonitorEvery};
use braid_ecs::prelude::*;

/// Records per parallel chunk.
const CHUNK: usize = 256;

/// What kind of contact a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum ContactKind {
    /// Filaments side by side.
    Line,
    /// Filaments that cross.
    Point,
    /// A node on a surface.
    Surface,
    /// A filament over an edge of a surface.
    Edge,
}

/// One place where filaments or surfaces touch or nearly touch.
#[derive(Clone, Copy, Debug)]
pub struct ContactReport {
    /// Kind.
    pub kind: ContactKind,
    /// Filament in the model (the one whose node it is, or the first).
    pub filament: usize,
    /// The other filament or surface.
    pub other: usize,
    /// Place half way between the centrelines, or on the centreline for surfaces.
    pub place: DVec3,
    /// Normal towards the first filament.
    pub normal: DVec3,
    /// Distance of the surfaces, negative in contact (length).
    pub gap: f64,
    /// Part of the overlap that is free of force (length).
    pub offset: f64,
    /// Smaller radius (length).
    pub radius: f64,
    /// Normal force (force).
    pub normal_force: f64,
    /// Friction force on the first filament (force).
    pub friction_force: DVec3,
    /// Angle between the centrelines, seen along the normal (radian).
    pub angle: f64,
    /// True if friction is at its limit.
    pub slides: bool,
    /// Elastic energy (force x length).
    pub energy: f64,
}

/// Penalty with which looking changes nothing.
fn still(penalty: &Penalty) -> Penalty {
    let mut s = *penalty;
    s.law.dt = 0.0;
    s.keep = 1.0;
    s
}

fn report(penalty: &Penalty, c: &Contact<f64>, place: DVec3, names: (usize, usize), radius: f64, kind: ContactKind) -> ContactReport {
    let r = &c.response;
    let normal = c.normal.lane(0);
    let friction_force = r.force.lane(0) - normal * r.normal_force;
    ContactReport {
        kind,
        filament: names.0,
        other: names.1,
        place,
        normal,
        gap: -c.penetration - c.offset,
        offset: c.offset,
        radius,
        normal_force: r.normal_force,
        friction_force,
        angle: c.sine.clamp(0.0, 1.0).asin(),
        slides: r.normal_force > 0.0 && friction_force.length() >= penalty.law.friction * r.normal_force * (1.0 - 1e-9),
        energy: r.energy,
    }
}

/// All records between filaments that are less than one radius apart, in record order.
pub fn filament_contacts(world: &mut World) -> Vec<ContactReport> {
    if !world.contains_resource::<Search>() {
        return Vec::new();
    }
    refresh_all(world);
    let live = *world.resource::<LiveRecords>();
    reports(world, live.lines, live.points)
}

/// Those of the near records, which are all that touch.
fn near_contacts(world: &mut World) -> Vec<ContactReport> {
    let live = world.get_resource::<LiveRecords>().copied().unwrap_or_default();
    if live.near_lines + live.near_points == 0 { Vec::new() } else { reports(world, live.near_lines, live.near_points) }
}

/// Reports of the first so many line and point records.
fn reports(world: &mut World, line_records: usize, point_records: usize) -> Vec<ContactReport> {
    let mut line_query = world.query::<(&LineRecord, &LineState)>();
    let mut point_query = world.query::<(&PointRecord, &PointState)>();
    let (lines, now) = (world.resource::<Lines>(), world.resource::<Centrelines>());
    let penalty = still(world.resource::<Penalty>());
    let near = |c: &Contact<f64>| c.penetration + c.offset > -0.5 * c.reach && c.stiffness > 0.0;
    let report_of = |c: &Contact<f64>, centre: DVec3, slots: [u32; 2], kind: ContactKind| {
        let place = centre - c.normal.lane(0) * (0.5 * (c.reach - c.penetration - c.offset));
        let [a, b] = slots.map(|s| (lines.place_of(s).0, now.x[s as usize][3]));
        report(&penalty, c, place, (a.0, b.0), a.1.min(b.1), kind)
    };
    let of_a_line = |(record, state): (&LineRecord, &LineState)| {
        let c = of_line(&penalty, lines, now, record, state);
        near(&c).then(|| report_of(&c, xyz(&now.x[record.node as usize]), [record.node, record.segment], ContactKind::Line))
    };
    let of_a_point = |(record, state): (&PointRecord, &PointState)| {
        let c = of_point(&penalty, lines, now, record, state);
        let centre = |i: u32| xyz(&now.x[i as usize]) + super::list::curve_of(lines, now, i).at(c.t[0]).x.lane(0);
        near(&c).then(|| report_of(&c, centre(record.segments[0]), record.segments, ContactKind::Point))
    };
    let (mut line_query, mut point_query) = (line_query.query(world), point_query.query(world));
    let ((lr, ls), (pr, ps)) = (columns(&mut line_query), columns(&mut point_query));
    let of_lines = parallel::chunks(line_records, CHUNK, |k| lr[k.clone()].iter().zip(&ls[k]).filter_map(of_a_line).collect::<Vec<_>>());
    let of_points = parallel::chunks(point_records, CHUNK, |k| pr[k.clone()].iter().zip(&ps[k]).filter_map(of_a_point).collect::<Vec<_>>());
    of_lines.into_iter().chain(of_points).flatten().collect()
}

/// All contacts of the model, filaments first.
pub fn all_contacts(world: &mut World) -> Vec<ContactReport> {
    let mut all = filament_contacts(world);
    all.extend(crate::systems::surface::surface_contacts(world));
    all
}

/// Present when the summary is taken by a system already.
#[derive(Resource)]
struct Summarised;

/// Adds the system that keeps [`ContactSummary`], once.
pub fn install(cx: &mut Install<'_>) {
    if !cx.world.contains_resource::<Summarised>() {
        cx.world.insert_resource(Summarised);
        cx.world.init_resource::<ContactSummary>();
        cx.add_system(StepSet::Monitor, look);
    }
}

fn look(world: &mut World) {
    let step = world.resource::<Clock>().step;
    let due = world.get_resource::<LookNow>().is_none_or(|l| l.0)
        || world.get_resource::<MonitorEvery>().is_none_or(|e| step.is_multiple_of(e.0));
    if due {
        summarise(world);
    }
}

/// Penetration under load that stops a run, in radii: half a diameter.
const DEEPEST: f64 = 1.0;

/// Penetration over the radius, without the overlap that the start has left free of force.
fn under_load(c: &ContactReport) -> f64 {
    (-c.gap - c.offset) / c.radius
}

fn too_deep(c: &ContactReport) -> String {
    let bodies = match c.kind {
        ContactKind::Line | ContactKind::Point => format!("filaments {} and {} press", c.filament, c.other),
        ContactKind::Surface | ContactKind::Edge => format!("filament {} presses into surface {}", c.filament, c.other),
    };
    let p = c.place;
    format!(
        "{bodies} {:.0} % of the radius deep at ({:.4e}, {:.4e}, {:.4e}): soon they would pass through each other. \
         The contact is too soft for the load: raise its stiffness (contact: (stiffness: ...)), or apply the load more slowly",
        100.0 * under_load(c),
        p.x,
        p.y,
        p.z
    )
}

/// Takes the summary and the elastic energy of all contacts now.
pub fn summarise(world: &mut World) {
    let mut contacts = near_contacts(world);
    contacts.extend(crate::systems::surface::surface_contacts(world));
    let live = world.get_resource::<LiveRecords>().copied().unwrap_or_default();
    let mut summary =
        ContactSummary { records: live.lines + live.points, near: live.near_lines + live.near_points, ..ContactSummary::default() };
    summary.raised = world.get_resource::<Target>().map_or(0.0, |t| t.raised);
    summary.rebuilds = world.get_resource::<Search>().map_or(0, |s| s.rebuilds);
    summary.looks = world.get_resource::<InnerList>().map_or(0, |i| i.looks);
    let mut depths = Vec::new();
    let mut energy = 0.0;
    if let Some(deep) = contacts.iter().filter(|c| c.normal_force > 0.0).find(|c| under_load(c) > DEEPEST) {
        let message = too_deep(deep);
        world.resource_mut::<Failure>().0.get_or_insert(message);
    }
    for c in &contacts {
        energy += c.energy;
        if c.normal_force > 0.0 {
            summary.active += 1;
            summary.total_force += c.normal_force;
            summary.max_force = summary.max_force.max(c.normal_force);
            depths.push(under_load(c));
        }
    }
    if !depths.is_empty() {
        depths.sort_unstable_by(f64::total_cmp);
        summary.max_penetration_to_radius = depths[depths.len() - 1];
        summary.p99_penetration_to_radius = depths[((depths.len() as f64 * 0.99).ceil() as usize).clamp(1, depths.len()) - 1];
    }
    *world.resource_mut::<ContactSummary>() = summary;
    world.get_resource_or_init::<EnergyLedger>().contact = energy;
}
