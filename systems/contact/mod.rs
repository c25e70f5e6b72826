//! Contact between filaments.
//!
//! Filaments are round tubes about C1 centrelines ([`curve`]). Side by side they touch through *line
//! records*, crossing through *point records* ([`records`], [`kernel`]), with one law of penalty,
//! damping and Coulomb friction ([`law`]). Which segments may touch is found with a bounding volume
//! tree and a skin ([`search`], [`list`], [`crossings`]), across periodic faces too ([`images`]), and which of them before long
//! with a second, narrow skin ([`inner`]). Records write
//! their own forces, and hand them to the nodes ([`assemble`]).
//!
//! Sources: J. Yastrebov, *Numerical Methods in Contact Mechanics* (2013) for penalty and return
//! mapping; C. Meier, W. A. Wall, A. Popp, *Int. J. Numer. Methods Eng.* 111 (2017) for joining line
//! and point contact of beams by angle; P. A. Cundall, O. D. L. Strack, *Geotechnique* 29 (1979) for
//! the friction spring.
pub mod assemble;
pub mod crossings;
pub mod curve;
pub mod images;
pub mod inner;
pub mod kernel;
pub mod law;
pub mod lines;
pub mod list;
pub mod monitor;
pub mod near;
pub mod records;
pub mod search;
mod spec;
pub mod stiffness;
pub mod systems;
pub mod target;

pub use monitor::{ContactKind, ContactReport, all_contacts, filament_contacts};
pub use spec::{ContactSpec, InitialOverlap};
pub(crate) use spec::{bounded, positive};

use braid_ecs::prelude::*;
use inner::{InnerList, Marks, Needed};
use kernel::Penalty;
use law::{APART, Law};
use lines::{Centrelines, JointMasses, Lines, joint_masses};
use records::*;
use search::Search;
use systems::*;

/// Registers contact between filaments, for models with a [`ContactSpec`].
pub fn plugin(sim: &mut Simulation) {
    sim.add_settings::<ContactSpec>();
    sim.add_installer("contact", install);
}

/// Overlap at the start that is let pass, in radii.
pub const TOLERATED_OVERLAP: f64 = 0.05;

/// Puts the filaments of the model into the world, once; false if there are none with contact.
pub fn install_lines(cx: &mut Install<'_>) -> Result<bool, String> {
    if cx.world.contains_resource::<Lines>() {
        return Ok(true);
    }
    let x: Vec<Position> = cx.world.query::<&Position>().iter(cx.world).copied().collect();
    let v: Vec<Velocity> = cx.world.query::<&Velocity>().iter(cx.world).copied().collect();
    let mass: Vec<Mass> = cx.world.query::<&Mass>().iter(cx.world).copied().collect();
    let places: Vec<DVec3> = x.iter().map(|x| x.0).collect();
    let lines = Lines::new(cx.model, |n| cx.row(n), &places)?;
    if lines.model_index.is_empty() {
        return Ok(false);
    }
    let masses = joint_masses(&lines, &mass);
    let mut now = Centrelines::default();
    now.refresh_periods(&lines, &x, &v);
    now.refresh(&lines, &x, &v, &masses, None);
    cx.world.insert_resource(lines);
    cx.world.insert_resource(now);
    cx.world.insert_resource(JointMasses(masses));
    cx.world.insert_resource(Needed { stale: true, ..Needed::default() });
    cx.add_system(StepSet::ContactSearch, inner::list_needed);
    cx.add_system(StepSet::ContactSearch, refresh);
    Ok(true)
}

fn install(cx: &mut Install<'_>) {
    let Some(spec) = cx.model.get::<ContactSpec>() else { return };
    let spec = spec.clone();
    if let Err(message) = install_spec(cx, &spec) {
        cx.world.resource_mut::<Failure>().0.get_or_insert(message);
    }
}

/// Name in reports of the time step.
const NAME: &str = "contact";

fn install_spec(cx: &mut Install<'_>, spec: &ContactSpec) -> Result<(), String> {
    spec.check().map_err(|e| format!("contact.{}: {e}", e.path))?;
    if cx.model.filaments.iter().filter(|f| f.contact).count() == 0 || !install_lines(cx)? {
        return Ok(());
    }
    let (radius, length) = {
        let lines = cx.world.resource::<Lines>();
        (lines.mean_radius, lines.mean_length)
    };
    let (line_stiffness, point_stiffness) = stiffness::given(spec, length).unwrap_or((1.0, length));
    let law = Law {
        friction: spec.friction.0,
        tangential: spec.friction_stiffness.0,
        damping: spec.damping.0,
        toe: spec.toe.0,
        hardening: spec.hardening.0,
        dt: 0.0,
    };
    let window = [spec.window.0.0, spec.window.1.0];
    cx.world.insert_resource(Penalty { law, line_stiffness, point_stiffness, window, keep: 1.0 });
    cx.world.insert_resource(stiffness::Wanted::new(cx.model, spec));
    cx.world.insert_resource(Search::new(spec.skin.0 * radius));
    cx.world.insert_resource(SelfContact(spec.self_contact));
    cx.world.insert_resource(Relaxation { rule: spec.initial_overlap });
    cx.world.init_resource::<ListBuilder>();
    cx.world.init_resource::<InnerList>();
    cx.world.resource_mut::<Needed>().sources.push(mark);
    cx.world.init_resource::<LiveRecords>();
    // A step that is given follows nobody.
    if cx.model.integration.dt.is_none() {
        let burden = stiffness::Burden::new(cx.world.resource::<Lines>(), &cx.world.resource::<JointMasses>().0);
        cx.world.insert_resource(burden);
        cx.world.insert_resource(ActingStiffness { name: NAME, rows: Vec::new() });
    }
    cx.world.init_resource::<Requests>();
    cx.world.init_resource::<EnergyLedger>();
    make_list(cx.world);
    // What touches at the start does so with its full stiffness; the kernel cuts an offset down to
    // the overlap that is there.
    let offset = if spec.initial_overlap == InitialOverlap::Error { 0.0 } else { f64::MAX };
    for mut s in cx.world.query::<&mut LineState>().iter_mut(cx.world) {
        (s.offset, s.stiffness) = (offset, APART);
    }
    for mut s in cx.world.query::<&mut PointState>().iter_mut(cx.world) {
        (s.offset, s.stiffness) = (offset, APART);
    }
    if spec.initial_overlap == InitialOverlap::Error {
        refuse_overlap(cx.world)?;
    }
    cx.world.get_resource_or_init::<StiffnessSources>().0.push((NAME, stiffness::bounds));
    remember(cx);
    cx.add_system(StepSet::ContactSearch, rebuild);
    cx.add_system(StepSet::ContactForces, forces);
    monitor::install(cx);
    target::install(cx, spec);
    Ok(())
}

/// Marks the slots that the near records need.
fn mark(world: &mut World, marks: &mut Marks) {
    let live = *world.resource::<LiveRecords>();
    world.query::<&LineRecord>().iter(world).take(live.near_lines).for_each(|r| marks.line(r));
    world.query::<&PointRecord>().iter(world).take(live.near_points).for_each(|r| marks.point(r));
}

fn remember(cx: &mut Install<'_>) {
    cx.remember_pool::<LineRecord>(grow_lines);
    cx.remember_pool::<LineState>(grow_lines);
    cx.remember_pool::<LineForce>(grow_lines);
    cx.remember_pool::<PointRecord>(grow_points);
    cx.remember_pool::<PointState>(grow_points);
    cx.remember_pool::<PointForce>(grow_points);
    cx.remember_resource::<LiveRecords>();
    cx.remember_resource::<Penalty>();
    cx.remember_resource::<Requests>();
    cx.remember_resource::<Search>();
    cx.remember_resource::<InnerList>();
    cx.after_restore(settle);
}

/// Refuses overlaps at the start, naming the worst one.
fn refuse_overlap(world: &mut World) -> Result<(), String> {
    let contacts = filament_contacts(world);
    let Some(worst) = contacts.iter().min_by(|a, b| (a.gap / a.radius).total_cmp(&(b.gap / b.radius))) else { return Ok(()) };
    let depth = -worst.gap / worst.radius;
    if depth <= TOLERATED_OVERLAP {
        return Ok(());
    }
    let count = contacts.iter().filter(|c| -c.gap > TOLERATED_OVERLAP * c.radius).count();
    let p = worst.place;
    Err(format!(
        "filaments {} and {} overlap by {:.3e} at the start, {:.1} % of the radius, at ({:.4e}, {:.4e}, {:.4e}); {count} places overlap by more than {:.0} %. \
         Move them apart, or set contact: (initial_overlap: Offset) to leave the overlap free of force",
        worst.filament,
        worst.other,
        -worst.gap,
        100.0 * depth,
        p.x,
        p.y,
        p.z,
        100.0 * TOLERATED_OVERLAP
    ))
}
