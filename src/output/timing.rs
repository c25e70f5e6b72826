//! Where the wall time of a step goes, by set.
//!
//! Marker systems between the sets read the clock on every 17th step. An executor that
//! times each system would need `unsafe`; markers need only their dispatch, about 30 ns each, so
//! they are left out of models whose whole step takes a few microseconds.
use crate::simulation::Simulation;
use crate::step::StepSet;
use bevy_ecs::prelude::*;
use std::collections::BTreeMap;
use std::time::Instant;

/// Steps between two measured ones: odd, so that it does not fall in step with other intervals.
const EVERY: u32 = 17;
const SETS: usize = StepSet::ORDER.len();

#[derive(Resource)]
struct StepTimer {
    every: u32,
    countdown: u32,
    last: Instant,
    nanoseconds: [u64; SETS],
}

/// The marker before set `K`, and after the last set for `K = SETS`.
fn mark<const K: usize>(mut timer: ResMut<StepTimer>) {
    let timer = timer.bypass_change_detection();
    if K == 0 {
        timer.countdown = timer.countdown.checked_sub(1).unwrap_or(timer.every - 1);
        if timer.countdown == 0 {
            timer.last = Instant::now();
        }
    } else if timer.countdown == 0 {
        let now = Instant::now();
        timer.nanoseconds[K - 1] += (now - timer.last).as_nanos() as u64;
        timer.last = now;
    }
}

/// Adds the markers to the schedule of the time step; call it before the model is built.
pub fn install(sim: &mut Simulation) {
    sim.world.insert_resource(StepTimer { every: EVERY, countdown: 2, last: Instant::now(), nanoseconds: [0; SETS] });
    let [a, b, c, d, e, f, g, h, i, j] = StepSet::ORDER;
    sim.schedule.add_systems(
        (
            mark::<0>.before(a),
            mark::<1>.after(a).before(b),
            mark::<2>.after(b).before(c),
            mark::<3>.after(c).before(d),
            mark::<4>.after(d).before(e),
            mark::<5>.after(e).before(f),
            mark::<6>.after(f).before(g),
            mark::<7>.after(g).before(h),
            mark::<8>.after(h).before(i),
            mark::<9>.after(i).before(j),
            mark::<10>.after(j),
        )
            .chain(),
    );
}

/// Forgets what was measured so far, and measures every step from now on.
pub fn reset(world: &mut World) {
    if let Some(mut timer) = world.get_resource_mut::<StepTimer>() {
        *timer = StepTimer { every: 1, countdown: 1, last: Instant::now(), nanoseconds: [0; SETS] };
    }
}

/// What was measured so far, for [`go_on`]; empty without [`install`].
pub fn so_far(world: &World) -> Vec<u64> {
    world.get_resource::<StepTimer>().map_or(Vec::new(), |t| t.nanoseconds.to_vec())
}

/// Goes on from what was measured in an earlier part of the run.
pub fn go_on(world: &mut World, nanoseconds: &[u64]) {
    if let (Some(mut timer), Ok(before)) = (world.get_resource_mut::<StepTimer>(), nanoseconds.try_into()) {
        timer.nanoseconds = before;
    }
}

/// Fraction of the measured wall time per set; empty without [`install`] or before the first
/// measured step.
pub fn share(world: &World) -> BTreeMap<String, f64> {
    let Some(timer) = world.get_resource::<StepTimer>() else { return BTreeMap::new() };
    let total: u64 = timer.nanoseconds.iter().sum();
    if total == 0 {
        return BTreeMap::new();
    }
    StepSet::ORDER.iter().zip(timer.nanoseconds).map(|(set, ns)| (format!("{set:?}"), ns as f64 / total as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn the_slow_set_gets_the_time() {
        let mut sim = Simulation::new(|_: &mut Simulation| {});
        install(&mut sim);
        // Two of the sets have a system, the others are empty: markers stay in order around them.
        sim.schedule.add_systems((|| std::thread::sleep(Duration::from_millis(3))).in_set(StepSet::ContactForces));
        sim.schedule.add_systems((|| std::thread::sleep(Duration::from_millis(1))).in_set(StepSet::Dynamics));
        assert!(share(&sim.world).is_empty());
        for _ in 0..2 * EVERY {
            sim.step();
        }
        let share = share(&sim.world);
        assert_eq!(share.len(), SETS);
        assert!((share.values().sum::<f64>() - 1.0).abs() < 1e-12);
        // 3 ms against 1 ms; sleeping is never shorter than asked but may be longer.
        assert!(share["ContactForces"] > 0.5 && share["Dynamics"] > 0.1 && share["Kinematics"] < 0.05, "{share:?}");
        assert!(share["ContactForces"] > share["Dynamics"]);
    }
}
