//! The disk, as outputs and checkpoints use it. In the program's own tests it can be told to fail.
use std::fs::{self, File, Metadata};
use std::io::{self, Write};
use std::path::Path;
#[cfg(test)]
use std::path::PathBuf;

/// A file that is being written.
#[derive(Debug)]
pub struct DiskFile {
    file: File,
    #[cfg(test)]
    path: PathBuf,
}

impl DiskFile {
    fn new(file: File, _path: &Path) -> Self {
        DiskFile {
            file,
            #[cfg(test)]
            path: _path.to_owned(),
        }
    }

    #[cfg(test)]
    fn allowed(&self) -> io::Result<()> {
        faults::next(&self.path)
    }

    #[cfg(not(test))]
    fn allowed(&self) -> io::Result<()> {
        Ok(())
    }

    /// Waits until content and length are on the disk.
    pub fn sync_data(&self) -> io::Result<()> {
        self.allowed()?;
        self.file.sync_data()
    }

    /// Waits until everything about the file is on the disk.
    pub fn sync_all(&self) -> io::Result<()> {
        self.allowed()?;
        self.file.sync_all()
    }

    /// Cuts the file to a length (bytes).
    pub fn set_len(&self, length: u64) -> io::Result<()> {
        self.allowed()?;
        self.file.set_len(length)
    }

    /// What the system knows of the file.
    pub fn metadata(&self) -> io::Result<Metadata> {
        self.file.metadata()
    }
}

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        #[cfg(test)]
        match faults::write(&self.path, bytes.len()) {
            faults::Write::Whole => {}
            faults::Write::Fails(error) => return Err(error),
            faults::Write::Short(n) => return self.file.write(&bytes[..n]),
            faults::Write::Torn(n) => return self.file.write_all(&bytes[..n]).map(|()| bytes.len()),
        }
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(not(test))]
fn allowed(_path: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
fn allowed(path: &Path) -> io::Result<()> {
    faults::next(path)
}

/// Makes a file, or empties it.
pub fn create(path: &Path) -> io::Result<DiskFile> {
    allowed(path)?;
    Ok(DiskFile::new(File::create(path)?, path))
}

/// Opens a file to write on at its end.
pub fn append(path: &Path) -> io::Result<DiskFile> {
    allowed(path)?;
    Ok(DiskFile::new(File::options().append(true).open(path)?, path))
}

/// Renames a file or folder.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    allowed(to)?;
    fs::rename(from, to)
}

/// Removes a file.
pub fn remove_file(path: &Path) -> io::Result<()> {
    allowed(path)?;
    fs::remove_file(path)
}

/// Makes a folder and those above it.
pub fn create_dir_all(path: &Path) -> io::Result<()> {
    allowed(path)?;
    fs::create_dir_all(path)
}

/// A disk that fails: for tests.
#[cfg(test)]
pub mod faults {
    use super::*;
    use std::sync::Mutex;

    /// How it fails.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum Fault {
        /// From then on nothing can be written: the disk is full.
        Full,
        /// One operation fails.
        Broken,
        /// One write takes only half of the bytes, and the next operation fails.
        Short,
        /// One write loses half of the bytes without saying so, and the fifth operation after it fails: the file has then got its
        /// name.
        Torn,
    }

    struct Plan {
        folder: PathBuf,
        fault: Fault,
        /// Operations to the fault; below zero after it.
        left: i64,
        /// Operations so far.
        seen: i64,
    }

    static PLAN: Mutex<Option<Plan>> = Mutex::new(None);

    /// What becomes of a write.
    pub(super) enum Write {
        Whole,
        Fails(io::Error),
        Short(usize),
        Torn(usize),
    }

    fn plan<T>(f: impl FnOnce(&mut Option<Plan>) -> T) -> T {
        f(&mut PLAN.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    /// Operations below `folder` go wrong from the one with this number (from 0) on.
    pub fn begin(folder: &Path, fault: Fault, at: i64) {
        plan(|p| *p = Some(Plan { folder: folder.to_owned(), fault, left: at, seen: 0 }));
    }

    /// The disk is good again; the number of operations since `begin`.
    pub fn end() -> i64 {
        plan(|p| p.take().map_or(0, |p| p.seen))
    }

    fn error(fault: Fault) -> io::Error {
        // ENOSPC and EIO on Unix.
        io::Error::from_raw_os_error(if fault == Fault::Full { 28 } else { 5 })
    }

    pub(super) fn next(path: &Path) -> io::Result<()> {
        match write(path, 0) {
            Write::Fails(e) => Err(e),
            _ => Ok(()),
        }
    }

    pub(super) fn write(path: &Path, bytes: usize) -> Write {
        plan(|p| {
            let Some(p) = p.as_mut().filter(|p| path.starts_with(&p.folder)) else { return Write::Whole };
            p.seen += 1;
            p.left -= 1;
            match (p.fault, p.left) {
                (_, 0..) => Write::Whole,
                (Fault::Full, _) | (Fault::Broken, -1) => Write::Fails(error(p.fault)),
                // Only a write can be cut: it waits for the next one.
                (Fault::Short | Fault::Torn, -1) if bytes < 2 || p.fault == Fault::Torn && !path.to_string_lossy().contains(".ckpt") => {
                    p.left += 1;
                    Write::Whole
                }
                (Fault::Short, -1) => Write::Short(bytes / 2),
                (Fault::Torn, -1) => Write::Torn(bytes / 2),
                (Fault::Short, -2) | (Fault::Torn, -6) => Write::Fails(error(p.fault)),
                _ => Write::Whole,
            }
        })
    }
}
