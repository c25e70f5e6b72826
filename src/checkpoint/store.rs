//! The folder `checkpoints/` of a run.
//!
//! | file | content |
//! |---|---|
//! | `scene.ron` | the scene after `--set`, with which the run goes on |
//! | `a.ckpt`, `b.ckpt` | the last two checkpoints; the older one is overwritten |
//! | `stopped.ckpt` | where the run was stopped |
//! | `good.ckpt` | the last good state of a run that has failed |
//! | `end.ckpt` | where it ended; the others are then gone |
//! | `lock` | held by the program that runs |
use super::format::{Checkpoint, Fault, Header, SceneHash};
use crate::output::OutputError;
use crate::output::disk;
use crate::output::file::{lock, remove, sync_folder, write_atomic};
use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Why no checkpoint can be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] OutputError),
    /// The folder is not that of a run.
    #[error("`{}` is not the output folder of a run: there is no checkpoints/scene.ron in it", .0.display())]
    NoRun(PathBuf),
    /// The run ended before its first checkpoint.
    #[error("`{}` holds no checkpoint that can be used; start the run again", .0.display())]
    Nothing(PathBuf),
    /// A program is still running there.
    #[error("a run is still going on in `{}`", .0.display())]
    InUse(PathBuf),
    /// No program is running there.
    #[error("no run is going on in `{}`", .0.display())]
    Idle(PathBuf),
    /// A checkpoint was refused.
    #[error("`{}` {fault}{}", path.display(), offer.as_ref().map_or(String::new(), |o| format!("\n  help: {o}")))]
    Refused {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: Fault,
        /// What could be used instead.
        offer: Option<String>,
    },
    /// The state does not fit the scene.
    #[error("the state cannot be restored: {0}")]
    State(String),
}

/// Which checkpoint is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The next one of the ring.
    Ring,
    /// At a stop from outside.
    Stopped,
    /// The last good state before a failure.
    Good,
    /// At the end of the run.
    End,
}

const RING: [&str; 2] = ["a.ckpt", "b.ckpt"];
const STOPPED: &str = "stopped.ckpt";
const GOOD: &str = "good.ckpt";
const END: &str = "end.ckpt";
const SCENE: &str = "scene.ron";
const ALL: [&str; 5] = [RING[0], RING[1], STOPPED, GOOD, END];

/// The folder, held by this program.
pub struct Store {
    folder: PathBuf,
    next: usize,
    /// Held as long as this lives.
    _lock: File,
}

/// The checkpoint to go on from.
pub struct Found {
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// Its file.
    pub path: PathBuf,
    /// The scene after `--set`.
    pub scene: String,
    /// Checkpoints that were passed over, with what is wrong with them.
    pub passed_over: Vec<(PathBuf, Fault)>,
}

fn folder_of(out: &Path) -> PathBuf {
    out.join("checkpoints")
}

fn hold(out: &Path) -> Result<File, CheckpointError> {
    let path = folder_of(out).join("lock");
    for _ in 0..TRIES {
        if let Some(file) = lock(&path)? {
            return Ok(file);
        }
        // Somebody who only looks holds the lock for a moment.
        std::thread::sleep(Duration::from_millis(20));
    }
    Err(CheckpointError::InUse(out.to_owned()))
}

/// True while a program runs in the folder; `None` if there is no telling.
pub fn in_use(out: &Path) -> Option<bool> {
    match File::open(folder_of(out).join("lock")).ok()?.try_lock_shared() {
        Ok(()) => Some(false),
        Err(TryLockError::WouldBlock) => Some(true),
        Err(TryLockError::Error(_)) => None,
    }
}

impl Store {
    /// Begins a new run in the output folder `out`: keeps the scene, drops checkpoints of another run.
    ///
    /// # Errors
    /// What the operating system says; a run that is going on there.
    pub fn create(out: &Path, scene: &str) -> Result<Self, CheckpointError> {
        let folder = folder_of(out);
        disk::create_dir_all(&folder).map_err(|e| OutputError::io("create the folder", &folder, e))?;
        let lock = hold(out)?;
        ALL.iter().try_for_each(|name| remove(&folder.join(name)))?;
        write_atomic(&folder.join(SCENE), scene.as_bytes())?;
        Ok(Store { folder, next: 0, _lock: lock })
    }

    /// Takes hold of the folder of an earlier run.
    ///
    /// # Errors
    /// A folder without a run, or with one that is going on; what the operating system says.
    pub fn open(out: &Path) -> Result<Self, CheckpointError> {
        if !folder_of(out).join(SCENE).exists() {
            return Err(CheckpointError::NoRun(out.to_owned()));
        }
        Ok(Store { folder: folder_of(out), next: 0, _lock: hold(out)? })
    }

    /// Finds the newest checkpoint, or takes the file `from`. Nothing is changed.
    ///
    /// Damaged checkpoints are passed over for an older one; those of another scene or program are not.
    ///
    /// # Errors
    /// No checkpoint that can be used.
    pub fn find(&mut self, from: Option<&Path>) -> Result<Found, CheckpointError> {
        let found = self.look_for(from)?;
        // The checkpoint that the run goes on from is the last to be overwritten.
        self.next = usize::from(found.path.ends_with(RING[0]));
        Ok(found)
    }

    fn look_for(&self, from: Option<&Path>) -> Result<Found, CheckpointError> {
        let path = self.folder.join(SCENE);
        let scene = fs::read_to_string(&path).map_err(|e| OutputError::io("read", &path, e))?;
        let hash = SceneHash::of(&scene);
        if let Some(path) = from {
            let path = if path.exists() { path.to_owned() } else { self.folder.join(path) };
            return match read(&path, hash)? {
                Ok(checkpoint) => Ok(Found { checkpoint, path, scene, passed_over: Vec::new() }),
                Err(fault) => Err(CheckpointError::Refused { path, fault, offer: None }),
            };
        }
        let (mut best, mut faults) = (None::<(Checkpoint, PathBuf)>, Vec::new());
        for path in ALL.map(|name| self.folder.join(name)).into_iter().filter(|p| p.exists()) {
            match read(&path, hash)? {
                Ok(c) if best.as_ref().is_none_or(|(b, _)| c.header.step >= b.header.step) => best = Some((c, path)),
                Ok(_) => {}
                Err(fault) => faults.push((path, fault)),
            }
        }
        let refused = faults.iter().position(|(_, fault)| best.is_none() || !matches!(fault, Fault::Damaged(_)));
        match (best, refused) {
            (best, Some(at)) => {
                let (path, fault) = faults.swap_remove(at);
                let offer = best.map(|(c, path)| {
                    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                    let (Header { step, time, .. }, out) = (c.header, self.folder.parent().unwrap_or(&self.folder).display());
                    format!("{name} of step {step}, t = {time:.4e} is good: braid-ecs resume {out} --from {name}")
                });
                Err(CheckpointError::Refused {
                    path,
                    fault,
                    offer: offer.or(Some("no other checkpoint is there; start the run again".into())),
                })
            }
            (Some((checkpoint, path)), None) => Ok(Found { checkpoint, path, scene, passed_over: faults }),
            (None, None) => Err(CheckpointError::Nothing(self.folder.clone())),
        }
    }

    /// Puts aside what cannot be used and removes checkpoints that the run has not reached yet; call it
    /// when nothing can go wrong any more.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn clear_after(&self, found: &Found) -> Result<(), OutputError> {
        for path in ALL.map(|name| self.folder.join(name)).into_iter().filter(|p| p.exists() && *p != found.path) {
            match fs::read(&path).map(|bytes| Checkpoint::decode(&bytes, found.checkpoint.header.scene_hash)) {
                Ok(Ok(c)) if c.header.step <= found.checkpoint.header.step => {}
                Ok(Ok(_)) => remove(&path)?,
                _ => {
                    let aside = path.with_extension("ckpt.unusable");
                    disk::rename(&path, &aside).map_err(|e| OutputError::io("move aside", &path, e))?;
                }
            }
        }
        Ok(())
    }

    /// Writes a checkpoint: whole or not at all, and on the disk when this returns. Returns its file.
    ///
    /// # Errors
    /// What the operating system says; the checkpoints that are there stay.
    pub fn put(&mut self, kind: Kind, checkpoint: &Checkpoint) -> Result<PathBuf, OutputError> {
        let name = match kind {
            Kind::Ring => RING[self.next],
            Kind::Stopped => STOPPED,
            Kind::Good => GOOD,
            Kind::End => END,
        };
        let path = self.folder.join(name);
        let bytes = checkpoint.encode().map_err(|e| OutputError::io("write", &path, std::io::Error::other(e)))?;
        write_atomic(&path, &bytes)?;
        sync_folder(&self.folder)?;
        match kind {
            Kind::Ring => self.next = 1 - self.next,
            Kind::Stopped | Kind::Good => {}
            Kind::End => {
                ALL.iter().filter(|n| **n != END).try_for_each(|n| remove(&self.folder.join(n)))?;
                // A program that was killed while it wrote has left half a file.
                ALL.iter().for_each(|n| drop(fs::remove_file(self.folder.join(format!("{n}.part")))));
            }
        }
        Ok(path)
    }
}

/// Tries of 20 ms to get the lock.
const TRIES: u32 = 25;

fn read(path: &Path, scene: SceneHash) -> Result<Result<Checkpoint, Fault>, OutputError> {
    let bytes = fs::read(path).map_err(|e| OutputError::io("read", path, e))?;
    Ok(Checkpoint::decode(&bytes, scene))
}
