//! `summary.json`: the outcome of a run in one small file, with stable keys.
//!
//! | key | meaning |
//! |---|---|
//! | `scene`, `version` | name of the scene; version of the program |
//! | `provenance` | what made the files: program, revision, scene, hash of the scene with all defaults, seed, target, features |
//! | `status` | `converged` (steady), `completed` (end time or steps), `stopped` (from outside), `failed` |
//! | `time`, `steps`, `dt` | end time, completed steps, last time step |
//! | `dt_limit` | `value`: stable limit without the safety factor; `by`: what sets it |
//! | `nodes`, `elements`, `contacts` | counts; contacts are those that carry a force at the end |
//! | `threads`, `wall_s`, `cpu_s`, `element_steps_per_s` | speed; `cpu_s` is null where the system does not tell |
//! | `share` | fraction of the step's wall time per set; empty for models too small to be timed |
//! | `energy` | energies since the start in the scene's unit, `balance_error` relative |
//! | `quality` | see [`Quality`] |
//! | `measures` | `length`, `angle`, `thickness`, … : mean, half width of the 95 % interval, number of values, unit |
//! | `lists` | neighbour lists of the contacts between filaments; see [`Lists`] |
//! | `probes` | name: value |
//! | `retries` | failures after which the run went back: `time`, `step`, `message`, `from_step`, `safety` from then on |
//! | `state_hash` | 32 bytes in hexadecimal over the state of all nodes; see [`state_hash`] |
//!
//! Numbers that are not finite are written as null.
use super::file::{OutputError, json, write_atomic};
use crate::assembly::node_states;
use crate::ledger::EnergyLedger;
use bevy_ecs::prelude::World;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The stable limit of the time step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DtLimit {
    /// Limit without the safety factor (time).
    pub value: Option<f64>,
    /// What sets it.
    pub by: String,
}

/// Energies since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Energies {
    /// Work of loads and prescribed motions.
    pub external_work: Option<f64>,
    /// Kinetic energy.
    pub kinetic: Option<f64>,
    /// Strain energy.
    pub strain: Option<f64>,
    /// Energy stored in contacts.
    pub contact: Option<f64>,
    /// Dissipated by friction.
    pub friction: Option<f64>,
    /// Dissipated by damping, the implicit axial solve included.
    pub damping: Option<f64>,
    /// Work not accounted for, relative to the largest term.
    pub balance_error: Option<f64>,
}

impl Energies {
    /// The energies of a ledger.
    pub fn of(e: &EnergyLedger) -> Self {
        Energies {
            external_work: finite(e.external_work),
            kinetic: finite(e.kinetic),
            strain: finite(e.strain),
            contact: finite(e.contact),
            friction: finite(e.friction),
            damping: finite(e.damping + e.axial),
            balance_error: finite(e.balance_error()),
        }
    }
}

/// How far the result can be trusted. Null where a figure has no meaning for the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Root mean square of the net force on the free nodes over that of the element end forces.
    pub force_residual: Option<f64>,
    /// Net force on the dummy nodes over the force that acts on them.
    pub dummy_balance: Option<f64>,
    /// Kinetic energy over external work.
    pub kinetic_to_work: Option<f64>,
    /// Largest penetration over the smaller radius.
    pub max_penetration_to_radius: Option<f64>,
    /// 99th percentile of the same over active contacts.
    pub p99_penetration_to_radius: Option<f64>,
    /// Factor by which the contacts were made stiffer for the target penetration; null without one.
    pub stiffness_raised: Option<f64>,
}

/// Neighbour lists of the contacts between filaments; null without such contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Lists {
    /// Times the list was made.
    pub rebuilds: Option<u64>,
    /// Mean number of steps that a list lasted.
    pub steps_per_list: Option<f64>,
    /// Records of nodes and crossings in the last list.
    pub records: Option<usize>,
}

/// A measured quantity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measure {
    /// Mean of the values.
    pub mean: Option<f64>,
    /// Half width of the 95 % confidence interval of the mean (Student t); null for one value.
    pub ci95: Option<f64>,
    /// Number of values.
    pub n: usize,
    /// Unit.
    pub unit: String,
}

/// A failure after which the run went back to its last good state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Retry {
    /// Time of the failure.
    pub time: f64,
    /// Step of the failure.
    pub step: u64,
    /// What was found.
    pub message: String,
    /// Step from which the run went on.
    pub from_step: u64,
    /// Safety factor of the time step from then on.
    pub safety: f64,
}

/// The whole file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Summary {
    pub scene: String,
    pub version: String,
    pub provenance: BTreeMap<String, String>,
    pub status: String,
    pub time: Option<f64>,
    pub steps: u64,
    pub dt: Option<f64>,
    pub dt_limit: DtLimit,
    pub nodes: usize,
    pub elements: usize,
    pub contacts: usize,
    pub threads: usize,
    pub wall_s: f64,
    pub cpu_s: Option<f64>,
    pub element_steps_per_s: Option<f64>,
    pub share: BTreeMap<String, f64>,
    pub energy: Energies,
    pub quality: Quality,
    pub measures: BTreeMap<String, Measure>,
    pub lists: Lists,
    pub probes: BTreeMap<String, Option<f64>>,
    pub retries: Vec<Retry>,
    pub state_hash: String,
}

impl Summary {
    /// Reads the summary in an output folder.
    ///
    /// # Errors
    /// What the operating system says; a file of another program.
    pub fn read(folder: &Path) -> Result<Self, OutputError> {
        let path = folder.join("summary.json");
        let fail = |e: std::io::Error| OutputError::io("read", &path, e);
        serde_json::from_slice(&std::fs::read(&path).map_err(fail)?).map_err(|e| fail(e.into()))
    }

    /// Writes the file.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        write_atomic(path, &json(self))
    }
}

/// The number, or none if it is not finite.
pub fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

/// Fingerprint of the state of the nodes: BLAKE3 over the bits (little endian, in row order) of
/// all positions, then all velocities, orientations (x, y, z, w) and angular velocities. Equal
/// hashes mean equal bits. Models without rotations count as unrotated.
pub fn state_hash(world: &mut World) -> String {
    let states = node_states(world);
    let mut hasher = blake3::Hasher::new();
    let mut feed = |numbers: &mut dyn Iterator<Item = f64>| {
        let bytes: Vec<u8> = numbers.flat_map(|x| x.to_bits().to_le_bytes()).collect();
        hasher.update(&bytes);
    };
    feed(&mut states.iter().flat_map(|s| s.x.to_array()));
    feed(&mut states.iter().flat_map(|s| s.v.to_array()));
    feed(&mut states.iter().flat_map(|s| s.q.to_array()));
    feed(&mut states.iter().flat_map(|s| s.w.to_array()));
    hasher.finalize().to_hex().to_string()
}

/// Processor time of this process so far, in seconds, where the system tells (Linux).
pub fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name in parentheses may hold blanks; utime and stime are the 12th and 13th field after
    // it, in ticks of 1/100 s (proc(5); the kernel reports USER_HZ = 100 on all common machines).
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |i: usize| fields.get(i)?.parse::<f64>().ok();
    Some((ticks(11)? + ticks(12)?) / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn the_keys_are_those_of_the_documentation() {
        let mut s = Summary { scene: "a".into(), ..Default::default() };
        s.measures.insert("length".into(), Measure { mean: Some(3.66), ci95: None, n: 1, unit: "mm".into() });
        s.probes.insert("tip".into(), finite(f64::NAN));
        let json: serde_json::Value = serde_json::to_value(&s).unwrap();
        let keys = |v: &serde_json::Value| v.as_object().unwrap().keys().cloned().collect::<Vec<_>>().join(" ");
        let mut top: Vec<&str> = "scene version provenance status time steps dt dt_limit nodes elements contacts threads wall_s cpu_s \
            element_steps_per_s share energy quality measures lists probes retries state_hash"
            .split_whitespace()
            .collect();
        top.sort_unstable();
        assert_eq!(keys(&json), top.join(" "));
        assert_eq!(keys(&json["dt_limit"]), "by value");
        assert_eq!(keys(&json["energy"]), "balance_error contact damping external_work friction kinetic strain");
        assert_eq!(
            keys(&json["quality"]),
            "dummy_balance force_residual kinetic_to_work max_penetration_to_radius p99_penetration_to_radius stiffness_raised"
        );
        assert_eq!(keys(&json["lists"]), "rebuilds records steps_per_list");
        assert_eq!(keys(&json["measures"]["length"]), "ci95 mean n unit");
        assert!(json["probes"]["tip"].is_null());
        assert_eq!(serde_json::from_value::<Summary>(json).unwrap(), s);
    }

    #[test]
    fn the_hash_sees_every_bit_of_the_state() {
        let world = |x: f64, w: f64| {
            let mut world = World::new();
            for i in 0..3 {
                let at = DVec3::new(f64::from(i), x, 0.0);
                world.spawn((Position(at), Velocity(DVec3::Y), Orientation(DQuat::IDENTITY), AngularVelocity(DVec3::splat(w))));
            }
            world
        };
        let base = state_hash(&mut world(1.0, 0.0));
        assert_eq!(base.len(), 64);
        assert_eq!(base, state_hash(&mut world(1.0, 0.0)));
        assert_ne!(base, state_hash(&mut world(1.0f64.next_up(), 0.0)));
        assert_ne!(base, state_hash(&mut world(1.0, 1e-300)));
        assert_ne!(base, state_hash(&mut world(1.0, -0.0)), "bits, not values");
    }

    #[test]
    fn processor_time_grows() {
        let Some(before) = cpu_seconds() else { return };
        let start = std::time::Instant::now();
        let mut x = 1.0f64;
        while start.elapsed().as_millis() < 60 {
            x = (x + 1.0).sqrt();
        }
        assert!(x > 0.0 && cpu_seconds().unwrap() > before);
    }
}
