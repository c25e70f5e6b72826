//! Files that are either whole or absent, and the folder that a run writes into.
use super::disk;
use serde::Serialize;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Why an output could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The operating system refused.
    #[error("cannot {action} `{}`: {source}", path.display())]
    Io {
        /// What was tried (`write`, `create the folder`).
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The reason given by the system.
        source: std::io::Error,
    },
    /// The folder holds the results of another run.
    #[error("`{}` already holds the results of a run", path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// A file or folder in the way that another command, or somebody else, has written.
    #[error("`{}` is in the way: it was not written by `{author}`", path.display())]
    Foreign {
        /// The file or folder.
        path: PathBuf,
        /// Who wanted to write there.
        author: &'static str,
    },
}

impl OutputError {
    /// An error of the operating system on `path`.
    pub fn io(action: &'static str, path: &Path, source: std::io::Error) -> Self {
        OutputError::Io { action, path: path.to_owned(), source }
    }
}

/// Writes a whole file under a temporary name and renames it: readers see the old file or the new
/// one, never half of it.
///
/// # Errors
/// What the operating system says about the folder or the disk.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write_part(path, bytes, true)
}

/// Writes a whole file under a temporary name and renames it, without waiting for the disk: for files that
/// are replaced so often that the last one may be lost with the power.
///
/// # Errors
/// What the operating system says about the folder or the disk.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), OutputError> {
    write_part(path, bytes, false)
}

/// A value as indented JSON with a line break at the end.
pub fn json(value: &impl Serialize) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("numbers and texts only");
    text.push(b'\n');
    text
}

/// Removes a file; one that is not there is no error.
///
/// # Errors
/// What the operating system says.
pub fn remove(path: &Path) -> Result<(), OutputError> {
    match disk::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(OutputError::io("remove", path, e)),
        _ => Ok(()),
    }
}

/// Takes the lock of a file, which is made for it; none if another program holds it. The system lets
/// go of it when the file is dropped, or the program ends, however it does. Where the file system
/// knows no locks, everybody gets it.
///
/// # Errors
/// What the operating system says about the file.
pub fn lock(path: &Path) -> Result<Option<fs::File>, OutputError> {
    let file = fs::File::create(path).map_err(|e| OutputError::io("write", path, e))?;
    match file.try_lock() {
        Err(fs::TryLockError::WouldBlock) => Ok(None),
        Ok(()) | Err(fs::TryLockError::Error(_)) => Ok(Some(file)),
    }
}

/// Waits until the names in a folder are on the disk.
///
/// # Errors
/// What the operating system says.
pub fn sync_folder(folder: &Path) -> Result<(), OutputError> {
    // Only Unix lets a folder be opened as a file.
    if cfg!(unix) { fs::File::open(folder).and_then(|f| f.sync_all()).map_err(|e| OutputError::io("write", folder, e)) } else { Ok(()) }
}

fn write_part(path: &Path, bytes: &[u8], sync: bool) -> Result<(), OutputError> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = disk::create(&part)?;
        file.write_all(bytes)?;
        if sync {
            file.sync_all()?;
        }
        disk::rename(&part, path)
    };
    write().map_err(|e| {
        // The unfinished file would only confuse; the first error is the one to report.
        let _ = fs::remove_file(&part);
        OutputError::io("write", path, e)
    })
}

/// What marks a folder as the results of a run or a study.
const MARKS: [&str; 5] = ["summary.json", "history.csv", "results.pvd", "checkpoints", "study.json"];

/// True if `folder` holds the results of a run or a study.
pub fn holds_results(folder: &Path) -> bool {
    MARKS.iter().any(|m| folder.join(m).exists())
}

/// Makes the output folder of a run. A folder with results is refused, or, with `force`, moved
/// aside to the first free name among `<name>.1`, `<name>.2`, …; returns where it went.
///
/// # Errors
/// [`OutputError::Occupied`] without `force`; what the operating system says otherwise.
pub fn claim_folder(folder: &Path, force: bool) -> Result<Option<PathBuf>, OutputError> {
    let mut moved = None;
    if holds_results(folder) {
        if !force {
            return Err(OutputError::Occupied { path: folder.to_owned() });
        }
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let free = (1u32..).map(|i| folder.with_file_name(format!("{name}.{i}"))).find(|p| !p.exists());
        let aside = free.expect("some number is free");
        disk::rename(folder, &aside).map_err(|e| OutputError::io("move aside", folder, e))?;
        moved = Some(aside);
    }
    disk::create_dir_all(folder).map_err(|e| OutputError::io("create the folder", folder, e))?;
    Ok(moved)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_results_is_refused_or_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("braid");
        assert_eq!(claim_folder(&out, false).unwrap(), None);
        // An empty folder, or one without results, is used as it is.
        fs::write(out.join("notes.txt"), "mine").unwrap();
        assert_eq!(claim_folder(&out, false).unwrap(), None);
        fs::write(out.join("summary.json"), "{}").unwrap();
        assert!(matches!(claim_folder(&out, false), Err(OutputError::Occupied { .. })));
        assert!(out.join("summary.json").exists(), "a refusal changes nothing");
        assert_eq!(claim_folder(&out, true).unwrap(), Some(dir.path().join("braid.1")));
        assert!(dir.path().join("braid.1/notes.txt").exists() && !out.join("summary.json").exists());
        fs::write(out.join("history.csv"), "").unwrap();
        assert_eq!(claim_folder(&out, true).unwrap(), Some(dir.path().join("braid.2")));
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_atomic(&path, b"old").unwrap();
        write_atomic(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary file is left");
        let error = write_atomic(&dir.path().join("no/such/b.txt"), b"x").unwrap_err();
        assert!(error.to_string().contains("b.txt"), "{error}");
    }
}
