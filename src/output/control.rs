//! Commands to a run that goes on, through the small file `control` in its output folder: one word,
//! which the running program takes away about once a second.
use super::file::{OutputError, replace};
use std::path::{Path, PathBuf};

/// What a running program can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Finish the step, write a checkpoint and all outputs, and end.
    Stop,
    /// Write a checkpoint.
    Checkpoint,
    /// Write a frame.
    Frame,
}

impl Command {
    /// All of them with their words.
    pub const ALL: [(&'static str, Command); 3] = [("stop", Command::Stop), ("checkpoint", Command::Checkpoint), ("frame", Command::Frame)];

    /// Puts the command into the folder of a run; one that still waits there is replaced.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn send(self, folder: &Path) -> Result<(), OutputError> {
        let word = Command::ALL.iter().find(|(_, c)| *c == self).map_or("", |(w, _)| w);
        replace(&path(folder), word.as_bytes())
    }

    /// Takes the command that waits in the folder of a run: `Err` with what is there if it is none.
    pub fn take(folder: &Path) -> Option<Result<Command, String>> {
        let path = path(folder);
        let word = std::fs::read(&path).ok()?;
        // A command that cannot be taken away would be obeyed every second.
        std::fs::remove_file(&path).ok()?;
        let word = String::from_utf8_lossy(&word).trim().to_string();
        Some(Command::ALL.iter().find(|(w, _)| *w == word).map(|(_, c)| *c).ok_or(word))
    }

    /// True while a command waits in the folder of a run.
    pub fn waits(folder: &Path) -> bool {
        path(folder).exists()
    }
}

fn path(folder: &Path) -> PathBuf {
    folder.join("control")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_taken_once() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(Command::take(dir.path()), None);
        for (_, command) in Command::ALL {
            command.send(dir.path()).unwrap();
            assert!(Command::waits(dir.path()));
            assert_eq!(Command::take(dir.path()), Some(Ok(command)));
            assert_eq!(Command::take(dir.path()), None);
        }
        std::fs::write(dir.path().join("control"), "jump\n").unwrap();
        assert_eq!(Command::take(dir.path()), Some(Err("jump".into())));
    }
}
