//! The schema of a study file: every key with its unit and default. See `scenes/studies/README.md`.
use crate::scene::units::{Ratio, Time, finite};
use ron::value::RawValue;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// A study: one scene in many variants, and what of their results is compared.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Study {
    /// One line for outputs. Default empty.
    #[serde(default)]
    pub title: String,
    /// Scene of all rows that name none of their own, relative to the study file.
    #[serde(default)]
    pub scene: Option<String>,
    /// Changes of the scene in every row.
    #[serde(default)]
    pub set: Sets,
    /// Named axes; their product gives rows.
    #[serde(default)]
    pub axes: Vec<AxisSpec>,
    /// Rows one by one, behind those of the axes.
    #[serde(default)]
    pub rows: Vec<EntrySpec>,
    /// Labels of the row that errors are relative to, one per axis, `*` for the label of the row itself.
    #[serde(default)]
    pub reference: Option<Vec<String>>,
    /// Repetitions of every row with other seeds.
    #[serde(default)]
    pub replicates: Option<ReplicatesSpec>,
    /// What is compared: measures and probes. Must be given.
    pub outcomes: Vec<OutcomeSpec>,
    /// Numbers of others, shown beside those of the rows.
    #[serde(default)]
    pub published: Vec<PublishedSpec>,
    /// Name of the axis along which convergence is judged.
    #[serde(default)]
    pub convergence: Option<String>,
    /// What makes the value of a row uncertain, found from others.
    #[serde(default)]
    pub uncertainty: Option<UncertaintySpec>,
    /// Half width of what is not known of the reference, over its value, by outcome; what a study with `uncertainty` has found.
    #[serde(default)]
    pub reference_uncertainty: BTreeMap<String, Ratio>,
    /// Most rows at a time, whatever the number of processors.
    #[serde(default)]
    pub max_parallel: Option<u16>,
    /// Whether the report shows the last picture of every row. Default false.
    #[serde(default)]
    pub pictures: bool,
    /// What is assumed beyond the scenes, for the report.
    #[serde(default)]
    pub assumptions: Vec<String>,
}

/// An axis of a study.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisSpec {
    /// Name. Must be given.
    pub name: String,
    /// Its points, in the order of the rows. Must be given.
    pub points: Vec<EntrySpec>,
}

/// A point of an axis, or a row by itself.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EntrySpec {
    /// Its name. Must be given.
    pub label: String,
    /// Another scene, relative to the study file.
    #[serde(default)]
    pub scene: Option<String>,
    /// Changes of the scene.
    #[serde(default)]
    pub set: Sets,
}

/// Repetitions.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplicatesSpec {
    /// One seed per repetition. Must be given.
    pub seeds: Vec<u64>,
}

/// How uncertain the value of a row is.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintySpec {
    /// Labels of the row. Must be given.
    pub base: Vec<String>,
    /// What contributes. Must be given.
    pub parts: Vec<PartSpec>,
}

/// One contribution to an uncertainty.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartSpec {
    /// Name. Must be given.
    pub name: String,
    /// How it is found. Default `Difference`.
    #[serde(default)]
    pub by: PartBy,
    /// Labels of the rows it is found from; none for `Places`.
    #[serde(default)]
    pub rows: Vec<Vec<String>>,
}

/// How a contribution to an uncertainty is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub enum PartBy {
    /// Largest difference of a row to the base.
    #[default]
    Difference,
    /// Half width of the 95 % interval of the mean over base and rows, after Student.
    Scatter,
    /// Half width of the 95 % interval of the base over the places at which it is measured.
    Places,
}

/// How a difference to the reference becomes an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub enum ErrorSpec {
    /// |a - a_ref| / |a_ref|.
    #[default]
    Relative,
    /// |a - a_ref| over a given size (unit of the outcome), for references near zero.
    Scaled(f64),
    /// No error: shown, not counted.
    None,
}

/// A compared quantity.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutcomeSpec {
    /// A measure (`length`, `angle`, `thickness`) or a probe of the scene. Must be given.
    pub name: String,
    /// Error against the reference. Default `Relative`.
    #[serde(default)]
    pub error: ErrorSpec,
    /// Change between two points of the convergence axis that counts as none, for outcomes without
    /// an interval. Default 0.5 %.
    #[serde(default = "tolerance")]
    pub tolerance: Ratio,
}

fn tolerance() -> Ratio {
    Ratio(0.005)
}

/// A number of others.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedValue {
    /// The value, in the unit of the outcome. Must be given.
    #[serde(deserialize_with = "finite")]
    pub value: f64,
    /// Half width of its 95 % interval.
    #[serde(default)]
    pub ci95: Option<f64>,
}

/// What others have found for a row.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedSpec {
    /// Labels of the row. Must be given.
    pub row: Vec<String>,
    /// Where the numbers are from. Must be given.
    pub source: String,
    /// Values by outcome.
    #[serde(default)]
    pub values: BTreeMap<String, PublishedValue>,
    /// Errors by outcome.
    #[serde(default)]
    pub errors: BTreeMap<String, Ratio>,
    /// Sum of the errors.
    #[serde(default)]
    pub cumulated: Option<Ratio>,
    /// Wall time (s).
    #[serde(default)]
    pub wall: Option<Time>,
    /// What should be known about the numbers. Default empty.
    #[serde(default)]
    pub note: String,
}

/// Changes of a scene, in the order of the file: path, and value as it stands there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sets(pub Vec<(String, String)>);

impl<'de> Deserialize<'de> for Sets {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Pairs;
        impl<'de> Visitor<'de> for Pairs {
            type Value = Sets;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("changes of the scene, as in {\"tow.filaments\": 19}")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Sets, A::Error> {
                let mut sets = Vec::new();
                while let Some((path, value)) = map.next_entry::<String, Box<RawValue>>()? {
                    sets.push((path, value.get_ron().trim().to_owned()));
                }
                Ok(Sets(sets))
            }
        }
        deserializer.deserialize_map(Pairs)
    }
}
