//! Everything that a scene may name, with one sentence each: what `braid-ecs plugins` lists.
use crate::registry::{Registry, SettingsKind};
use serde::Serialize;

/// What kind of thing a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Group {
    /// A kind of element, a key of `elements`.
    Element,
    /// A section of the scene that a plugin reads.
    Settings,
    /// A section of the scene from which a plugin makes filaments.
    Generator,
    /// A choice of `probes`; those of plugins are named in `Custom(probe: ...)`.
    Probe,
    /// A number reported at the end of every run that has it.
    Measure,
    /// A choice of `amplitudes`.
    Amplitude,
}

impl Group {
    /// All groups, in the order in which they are listed.
    pub const ALL: [Group; 6] = [Group::Element, Group::Settings, Group::Generator, Group::Probe, Group::Measure, Group::Amplitude];

    /// Heading of the list.
    pub fn title(self) -> &'static str {
        match self {
            Group::Element => "elements",
            Group::Settings => "settings",
            Group::Generator => "generators of plugins",
            Group::Probe => "probes",
            Group::Measure => "measures",
            Group::Amplitude => "amplitudes",
        }
    }
}

/// One name that a scene may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Entry {
    /// What it stands for.
    pub group: Group,
    /// The name.
    pub name: &'static str,
    /// One sentence.
    pub about: &'static str,
}

/// Measures of the program, with one sentence each.
pub const MEASURES: [(&str, &str); 3] = [
    ("length", "length of the period: of the cell of a braid, or of the first dummy node"),
    ("angle", "braid angle at the crossings, in degrees, with a 95 % interval"),
    ("thickness", "thickness of the braid at the crossings, with a 95 % interval"),
];

/// Probes of the program, with one sentence each.
pub const PROBES: [(&str, &str); 25] = [
    ("Position", "current position of a node, or the period vector of a dummy node"),
    ("Displacement", "displacement of a node from its initial position"),
    ("Velocity", "velocity of a node"),
    ("Rotation", "rotation vector of a node from its initial orientation"),
    ("Reaction", "force with which the support holds a node"),
    ("ReactionMoment", "moment with which the support holds a node"),
    ("TotalReaction", "sum of the support forces of several nodes"),
    ("TotalReactionMoment", "sum of the support moments of several nodes about the origin"),
    ("SectionForce", "section force of one element"),
    ("Energy", "a term of the energy balance"),
    ("ContactForce", "sum of all normal contact forces"),
    ("MaxContactForce", "largest normal contact force"),
    ("MaxPenetration", "largest penetration over the smaller radius"),
    ("SurfaceForce", "force of the filaments on a rigid surface"),
    ("SurfaceMoment", "moment of the filaments on a rigid surface about the origin"),
    ("Momentum", "momentum of all nodes"),
    ("AngularMomentum", "moment of momentum of all nodes about the origin"),
    ("Direction", "where a direction fixed in the cross-section of a node points"),
    ("TimeStep", "time step"),
    ("DummyLength", "length of the period vector of a dummy node"),
    ("Distance", "distance of two nodes"),
    ("Angle", "angle between the lines through two pairs of nodes"),
    ("Custom", "a probe of a plugin, by its name"),
    ("Max", "largest value of a probe so far"),
    ("Min", "smallest value of a probe so far"),
];

/// Amplitudes of the program, with one sentence each.
pub const AMPLITUDES: [(&str, &str); 6] = [
    ("Constant", "always 1"),
    ("SmoothStep", "from 0 to 1 with zero velocity and acceleration at both ends"),
    ("Ramp", "from 0 to 1 in a straight line"),
    ("Table", "straight lines between points, constant outside"),
    ("Sine", "sin(2 pi f t + phase)"),
    ("Custom", "an amplitude of a plugin, by its name"),
];

impl Registry {
    /// Everything that a scene may name, group by group; what plugins have added comes in the order
    /// in which they have.
    pub fn catalog(&self) -> Vec<Entry> {
        let entry = |group| move |(name, about): (&'static str, &'static str)| Entry { group, name, about };
        let elements = self.elements.iter().map(|k| (k.name, k.about)).map(entry(Group::Element));
        let group_of = |k: &SettingsKind| if k.generate.is_some() { Group::Generator } else { Group::Settings };
        let mut settings: Vec<Entry> = self.settings.iter().map(|k| Entry { group: group_of(k), name: k.key, about: k.about }).collect();
        settings.sort_by_key(|e| e.group);
        let probes = PROBES.into_iter().chain(self.probes.iter().map(|k| (k.name, k.about))).map(entry(Group::Probe));
        let measures = MEASURES.into_iter().chain(self.measures.iter().map(|k| (k.name, k.about))).map(entry(Group::Measure));
        let amplitudes = AMPLITUDES.into_iter().chain(self.amplitudes.iter().map(|k| (k.name, k.about))).map(entry(Group::Amplitude));
        elements.chain(settings).chain(probes).chain(measures).chain(amplitudes).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::schema::{AmplitudeSpec, ProbeSpec};

    /// The choices that the reader of `T` knows, from its own message.
    fn choices<T: serde::de::DeserializeOwned + std::fmt::Debug>() -> Vec<&'static str> {
        match crate::scene::ron_options().from_str::<T>("NoSuchChoice").expect_err("not a choice").code {
            ron::Error::NoSuchEnumVariant { expected, .. } => expected.to_vec(),
            other => panic!("{other}"),
        }
    }

    #[test]
    fn every_choice_of_the_reader_is_listed() {
        assert_eq!(choices::<ProbeSpec>(), PROBES.map(|p| p.0));
        assert_eq!(choices::<AmplitudeSpec>(), AMPLITUDES.map(|a| a.0));
    }

    #[test]
    fn every_entry_says_in_one_line_what_it_is() {
        let sim = crate::simulation::Simulation::new(crate::systems::default_plugins);
        for e in sim.registry.catalog() {
            assert!(!e.about.is_empty() && !e.about.contains('\n') && !e.about.ends_with('.'), "{e:?}");
        }
    }
}
