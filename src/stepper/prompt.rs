//! Where commands come from: a terminal with history and completion, or lines of a script or a pipe.
use super::commands::{Reply, names, words_of};
use super::session::Session;
use crate::registry::SpecError;
use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::history::MemHistory;
use rustyline::{Config, Context, Editor, Helper};
use std::io::{BufRead, Write};

/// A command of a script that could not be done.
#[derive(Debug, thiserror::Error)]
#[error("{file}:{line}:{column}: {error}{}", .error.help.as_ref().map_or(String::new(), |h| format!("\n  help: {h}")))]
pub struct ScriptError {
    /// The script.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column of the offending word, from 1.
    pub column: usize,
    /// What is wrong.
    pub error: SpecError,
}

/// Column of the offending word in a line, from 1.
fn column(line: &str, error: &SpecError) -> usize {
    let at = if error.path.is_empty() { None } else { line.find(error.path.as_str()) };
    line[..at.unwrap_or(line.len() - line.trim_start().len())].chars().count() + 1
}

/// Runs the commands of a script, each written behind the prompt, until its end or `quit`. The first that cannot be done
/// ends it.
///
/// # Errors
/// That command, with its place; `file` is the name of the script.
pub fn run_script(session: &mut Session, file: &str, lines: impl BufRead, out: &mut dyn Write) -> Result<(), ScriptError> {
    for (n, line) in lines.lines().enumerate() {
        let fail = |line: &str, error: SpecError| ScriptError { file: file.into(), line: n + 1, column: column(line, &error), error };
        let line = line.map_err(|e| fail("", SpecError::new("", format!("the script cannot be read: {e}"))))?;
        if line.trim().is_empty() {
            continue;
        }
        // A closed pipe is no reason to fail. Comments stand alone.
        let prompt = if line.trim_start().starts_with('#') { String::new() } else { session.prompt() };
        let _ = writeln!(out, "{prompt}{}", line.trim());
        match session.execute(&line).map_err(|e| fail(&line, e))? {
            Reply::Quit => return Ok(()),
            Reply::Text(text) if text.is_empty() => {}
            Reply::Text(text) => {
                let _ = writeln!(out, "{text}");
            }
        }
    }
    Ok(())
}

/// Asks for commands on a terminal until `quit` or the end of the input.
///
/// # Errors
/// What the terminal says.
pub fn ask(session: &mut Session) -> Result<(), String> {
    let config = Config::builder().auto_add_history(true).build();
    let mut editor: Editor<Guide, MemHistory> = Editor::with_history(config, MemHistory::new()).map_err(|e| e.to_string())?;
    editor.set_helper(Some(Guide { systems: session.systems() }));
    let mut last = String::new();
    loop {
        let line = match editor.readline(&session.prompt()) {
            Ok(line) => line,
            // Ctrl-C at the prompt drops the line.
            Err(ReadlineError::Interrupted) => continue,
            Err(ReadlineError::Eof) => return Ok(()),
            Err(e) => return Err(e.to_string()),
        };
        // An empty line repeats the last command, as debuggers do.
        if !line.trim().is_empty() {
            last = line;
        }
        match session.execute(&last) {
            Ok(Reply::Quit) => return Ok(()),
            Ok(Reply::Text(text)) if text.is_empty() => {}
            Ok(Reply::Text(text)) => println!("{text}"),
            Err(e) => println!("error: {e}{}", e.help.as_ref().map_or(String::new(), |h| format!("\n  help: {h}"))),
        }
    }
}

/// Completes commands, and the words and systems that may follow them.
struct Guide {
    systems: Vec<String>,
}

impl Guide {
    fn candidates(&self, before: &str) -> (usize, Vec<String>) {
        let start = before.rfind(char::is_whitespace).map_or(0, |at| at + 1);
        let begun = &before[start..];
        let fits = |word: &str| word.starts_with(begun);
        let mut found: Vec<String> = match before[..start].split_whitespace().next() {
            None => names().filter(|n| fits(n)).map(str::to_string).collect(),
            Some(command @ ("break" | "b")) => {
                let words = words_of(command).map(str::to_string);
                words.chain(self.systems.iter().cloned()).filter(|w| fits(w)).collect()
            }
            Some("help" | "h") => names().filter(|n| fits(n)).map(str::to_string).collect(),
            Some(command) => words_of(command).filter(|w| fits(w)).map(str::to_string).collect(),
        };
        found.sort();
        found.dedup();
        if let [only] = &mut found[..] {
            only.push(' ');
        }
        (start, found)
    }
}

impl Completer for Guide {
    type Candidate = String;

    fn complete(&self, line: &str, pos: usize, _: &Context<'_>) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(self.candidates(&line[..pos]))
    }
}

impl rustyline::hint::Hinter for Guide {
    type Hint = String;
}
impl rustyline::highlight::Highlighter for Guide {}
impl rustyline::validate::Validator for Guide {}
impl Helper for Guide {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_words_and_systems_are_completed() {
        let guide = Guide { systems: vec!["kick_velocities".into(), "kick_spins".into()] };
        assert_eq!(guide.candidates("st"), (0, vec!["step ".to_string()]));
        assert_eq!(guide.candidates("break kick_s"), (6, vec!["kick_spins ".to_string()]));
        assert_eq!(guide.candidates("info en").1, ["energy "]);
        assert_eq!(guide.candidates("top 3 sp").1, ["speed "]);
        assert!(guide.candidates("xyz ").1.is_empty());
    }

    #[test]
    fn an_error_stands_at_its_word() {
        assert_eq!(column("break  wrong", &SpecError::new("wrong", "")), 8);
        assert_eq!(column("  back 9", &SpecError::new("", "")), 3);
    }
}
