//! The bytes of a checkpoint.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `braidckp` |
//! | 4 | format version, little endian |
//! | … | [`Header`], state of the recorder, state of the world, as postcard writes them |
//! | 32 | BLAKE3 of everything before |
//!
//! The first and the last line of the table stay as they are in every format version, so that a
//! damaged file can be told from one of another version.
use crate::output::recorder::RecorderState;
use crate::output::summary::Retry;
use crate::run::Status;
use serde::{Deserialize, Serialize};

const MAGIC: &[u8; 8] = b"braidckp";
const CHECKSUM: usize = blake3::OUT_LEN;

/// Version of the format that is written and read.
pub const FORMAT: u32 = 3;

/// BLAKE3 of the text of a scene after `--set`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneHash(pub [u8; 32]);

impl SceneHash {
    /// The hash of a text.
    pub fn of(text: &str) -> Self {
        SceneHash(*blake3::hash(text.as_bytes()).as_bytes())
    }
}

impl std::fmt::Display for SceneHash {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0[..8].iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

/// What a checkpoint says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the program that wrote it.
    pub program: String,
    /// Revision of its sources.
    pub revision: String,
    /// The scene file of the run, for its name.
    pub scene: String,
    /// The scene after `--set`.
    pub scene_hash: SceneHash,
    /// Completed steps.
    pub step: u64,
    /// Time.
    pub time: f64,
    /// Time between two looks of the observer.
    pub sample_interval: f64,
    /// Expected length of the run (time), for progress.
    pub duration: Option<f64>,
    /// End time in place of the stop criteria of the scene.
    pub until: Option<f64>,
    /// How the run has ended with this step, if it has.
    pub ended: Option<Status>,
    /// Failures after which the run has gone back.
    pub retries: Vec<Retry>,
}

/// A checkpoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Checkpoint {
    /// What it says about itself.
    pub header: Header,
    /// State of the outputs.
    pub recorder: RecorderState,
    /// State of the world, as [`Simulation::save_state`](crate::simulation::Simulation::save_state) gives it.
    pub state: Vec<u8>,
}

/// What is wrong with a checkpoint.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// Not what was written.
    #[error("is damaged: {0}")]
    Damaged(String),
    /// Another format.
    #[error("has format version {0}, and this program (braid-ecs {program}) reads version {FORMAT}; resume with the program that wrote it",
        program = env!("CARGO_PKG_VERSION"))]
    Format(u32),
    /// Another version of the program, whose results would differ.
    #[error("was written by braid-ecs {0}, and this is {program}, which would go on with other numbers; resume with the program that wrote it",
        program = env!("CARGO_PKG_VERSION"))]
    Program(String),
    /// Another scene.
    #[error("belongs to another scene: it was written for scene {found}, and the scene in this folder is {here}")]
    Scene {
        /// Scene of the checkpoint.
        found: SceneHash,
        /// Scene of the folder.
        here: SceneHash,
    },
}

impl Checkpoint {
    /// The bytes of the file.
    ///
    /// # Errors
    /// A part that cannot be written, by name.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(FORMAT.to_le_bytes());
        let mut bytes = postcard::to_extend(self, bytes).map_err(|e| format!("a checkpoint cannot be written: {e}"))?;
        let sum = blake3::hash(&bytes);
        bytes.extend(sum.as_bytes());
        Ok(bytes)
    }

    /// Reads the bytes of a file and checks that it goes on with the scene.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn decode(bytes: &[u8], scene: SceneHash) -> Result<Self, Fault> {
        let damaged = |what: &str| Fault::Damaged(what.into());
        if bytes.len() < MAGIC.len() + 4 + CHECKSUM {
            return Err(damaged(&format!("it is only {} bytes long", bytes.len())));
        }
        let (content, sum) = bytes.split_at(bytes.len() - CHECKSUM);
        let (magic, content_after) = content.split_at(MAGIC.len());
        if magic != MAGIC {
            return Err(damaged("it does not begin as a checkpoint of braid-ecs does"));
        }
        if blake3::hash(content).as_bytes() != sum {
            return Err(damaged("its content does not match its checksum"));
        }
        let (version, content) = content_after.split_at(4);
        let version = u32::from_le_bytes([version[0], version[1], version[2], version[3]]);
        if version != FORMAT {
            return Err(Fault::Format(version));
        }
        // The header comes first and alone: what follows it may look different in another program.
        let (header, _) = postcard::take_from_bytes::<Header>(content).map_err(|e| Fault::Damaged(e.to_string()))?;
        if header.program != env!("CARGO_PKG_VERSION") {
            return Err(Fault::Program(header.program));
        }
        if header.scene_hash != scene {
            return Err(Fault::Scene { found: header.scene_hash, here: scene });
        }
        postcard::from_bytes(content).map_err(|e| Fault::Damaged(e.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkpoint(program: &str) -> Checkpoint {
        let header = Header {
            program: program.into(),
            revision: "a".into(),
            scene: "a.ron".into(),
            scene_hash: SceneHash::of("a"),
            step: 7,
            time: 0.1,
            sample_interval: f64::INFINITY,
            duration: None,
            until: None,
            ended: None,
            retries: Vec::new(),
        };
        Checkpoint { header, recorder: RecorderState::default(), state: (0..200).collect() }
    }

    #[test]
    fn every_flipped_bit_and_every_cut_is_noticed() {
        let good = checkpoint(env!("CARGO_PKG_VERSION")).encode().unwrap();
        let read = Checkpoint::decode(&good, SceneHash::of("a")).unwrap();
        assert_eq!((read.header.step, read.state.len()), (7, 200));
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 1 << (at % 8);
            assert!(matches!(Checkpoint::decode(&bad, SceneHash::of("a")), Err(Fault::Damaged(_))), "byte {at}");
            assert!(matches!(Checkpoint::decode(&good[..at], SceneHash::of("a")), Err(Fault::Damaged(_))), "cut at {at}");
        }
    }

    #[test]
    fn other_programs_and_scenes_are_told_apart() {
        let of = |program: &str, scene| Checkpoint::decode(&checkpoint(program).encode().unwrap(), SceneHash::of(scene)).unwrap_err();
        assert_eq!(of("9.9.9", "a"), Fault::Program("9.9.9".into()));
        assert!(of(env!("CARGO_PKG_VERSION"), "b").to_string().contains("another scene"));
        let mut newer = checkpoint("9.9.9").encode().unwrap();
        newer.truncate(newer.len() - CHECKSUM);
        newer[8] = FORMAT as u8 + 1;
        let sum = *blake3::hash(&newer).as_bytes();
        newer.extend(sum);
        assert_eq!(Checkpoint::decode(&newer, SceneHash::of("a")).unwrap_err(), Fault::Format(FORMAT + 1));
    }
}
