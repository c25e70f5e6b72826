//! The commands of the prompt: their names, and what each of them does with the words after it.
use super::address::Words;
use super::past::Past;
use super::session::{Session, Snapshot, Until};
use super::stops::{On, Stop};
use super::text::{quantity, table};
use super::{pictures, print, survey};
use crate::output::summary::state_hash;
use crate::registry::SpecError;
use crate::scene::units::Time;

/// What a command answers.
#[derive(Debug, PartialEq, Eq)]
pub enum Reply {
    /// Something to say, or nothing.
    Text(String),
    /// The session is over.
    Quit,
}

type Answer = Result<String, SpecError>;

struct Command {
    name: &'static str,
    short: &'static str,
    words: &'static str,
    about: &'static str,
    run: fn(&mut Session, Words<'_>) -> Answer,
}

const fn command(
    name: &'static str,
    short: &'static str,
    words: &'static str,
    about: &'static str,
    run: fn(&mut Session, Words<'_>) -> Answer,
) -> Command {
    Command { name, short, words, about, run }
}

/// All commands, in the order of `help`; `quit` needs no function.
const COMMANDS: [Command; 22] = [
    command("step", "s", "[N]", "make N steps (1)", step),
    command("sys", "si", "[N]", "run N systems (1)", sys),
    command("finish", "f", "", "go to the end of this step", |s, w| w.end().and_then(|()| s.finish_step())),
    command("continue", "c", "[until t=TIME | until step=N]", "go on to a stop, or until then", go_on),
    command("back", "b", "[N]", "go back N steps (1), with the same bits; within a step to its beginning", back),
    command(
        "break",
        "",
        "SYSTEM | t=TIME | step=N | if EXPR",
        "stop before a system, at a time or step, or when a condition comes true",
        set_break,
    ),
    command("watch", "w", "EXPR [by CHANGE]", "stop when a value changes by more than CHANGE (0), and keep its curve", watch),
    command("delete", "d", "[N]", "delete a stop, or all", delete),
    command("info", "i", "time | dt | energy | systems | breaks | contacts | mesh | stored | memory", "tell about the run", survey::info),
    command(
        "print",
        "p",
        "node ... | tow T fil F node N [x v f m w] | element [KIND] N | tie N | dummy N | contact N | COMPONENT N | RESOURCE | EXPR",
        "all components of something, a resource, or a value",
        print::print,
    ),
    command("top", "", "N speed | force | penetration | strain | curvature", "where it is largest", survey::top),
    command("list", "l", "near NODE", "elements at a node, its neighbours and contacts", survey::list),
    command(
        "set",
        "",
        "NODE|ELEMENT COMPONENT.FIELD VALUE | RESOURCE.FIELD VALUE",
        "change a value; the run is marked as modified",
        print::set,
    ),
    command("save", "", "NAME", "remember the present state", save),
    command("restore", "", "NAME", "go to a remembered state; the way back begins there", restore),
    command("diff", "", "NAME", "what differs from a remembered state", survey::diff),
    command("hash", "", "", "fingerprint of positions, velocities and orientations", hash),
    command("plot", "", "[FILE.svg]", "draw the curves of all watches", pictures::plot),
    command("render", "", "[FILE.png]", "draw the filaments", pictures::render),
    command("frame", "", "[FILE.vtp]", "write a frame for ParaView", pictures::frame),
    command("help", "h", "[COMMAND]", "this list, or one command", help),
    command("quit", "q", "", "leave", |_, _| Ok(String::new())),
];

/// Names of all commands.
pub fn names() -> impl Iterator<Item = &'static str> {
    COMMANDS.iter().map(|c| c.name)
}

/// What may follow a command, for completion.
pub fn words_of(name: &str) -> impl Iterator<Item = &'static str> {
    let words = COMMANDS.iter().find(|c| c.name == name || c.short == name && !c.short.is_empty()).map_or("", |c| c.words);
    words.split([' ', '|', '[', ']']).filter(|w| !w.is_empty() && w.chars().all(|c| c.is_ascii_lowercase()))
}

impl Session {
    /// Does what a line says. Empty lines and `#` comments do nothing.
    ///
    /// # Errors
    /// What cannot be done; `path` is the offending word.
    pub fn execute(&mut self, line: &str) -> Result<Reply, SpecError> {
        let mut words = Words::of(line);
        let Some(name) = words.next().filter(|w| !w.starts_with('#')) else { return Ok(Reply::Text(String::new())) };
        let found = find(name)?;
        if found.name == "quit" {
            return Ok(Reply::Quit);
        }
        (found.run)(self, words).map(Reply::Text)
    }
}

fn find(name: &str) -> Result<&'static Command, SpecError> {
    let found = COMMANDS.iter().find(|c| c.name == name || !c.short.is_empty() && c.short == name);
    found.ok_or_else(|| SpecError::unknown(name, "command", name, names()))
}

fn step(session: &mut Session, mut words: Words<'_>) -> Answer {
    let count = words.number_or("a number of steps", 1)?;
    words.end()?;
    session.go(Until::Steps(count))
}

fn sys(session: &mut Session, mut words: Words<'_>) -> Answer {
    let count = words.number_or("a number of systems", 1)?;
    words.end()?;
    session.run_systems(count)
}

/// A time with or without a unit.
fn time(session: &Session, text: &str) -> Result<f64, SpecError> {
    let read = session.scene.scene.units.while_reading(|| Time::parse(text));
    read.map(f64::from).map_err(|e| SpecError::new(text, e))
}

/// Reads `t=TIME` or `step=N`.
fn moment(session: &Session, text: &str) -> Option<Result<On, SpecError>> {
    let (name, value) = text.split_once('=')?;
    let value = value.trim();
    match name.trim() {
        "t" => Some(time(session, value).map(On::Time)),
        "step" => Some(value.parse().map(On::Step).map_err(|_| SpecError::new(value, format!("`{value}` is not a number of steps")))),
        _ => None,
    }
}

fn go_on(session: &mut Session, mut words: Words<'_>) -> Answer {
    if words.peek().is_none() {
        return session.go(Until::Stopped);
    }
    let wrong = |word: &str| {
        SpecError::new(word, format!("`{word}` cannot be read")).help("continue, continue until t=1 ms, continue until step=100")
    };
    if !words.skip_word("until") {
        return Err(wrong(words.rest()));
    }
    let until = match moment(session, words.rest()).ok_or_else(|| wrong(words.rest()))?? {
        On::Time(t) if t <= session.clock().time => return Err(SpecError::new(words.rest(), "this time is over").help("`back` goes back")),
        On::Step(n) if n <= session.clock().step => return Err(SpecError::new(words.rest(), "this step is over").help("`back` goes back")),
        On::Time(t) => Until::Time(t),
        On::Step(n) => Until::Step(n),
        _ => return Err(wrong(words.rest())),
    };
    session.go(until)
}

fn back(session: &mut Session, mut words: Words<'_>) -> Answer {
    let count: u64 = words.number_or("a number of steps", 1)?;
    words.end()?;
    // A step that has begun counts: one step back is its beginning.
    let now = session.step();
    let to = now
        .checked_sub(count)
        .ok_or_else(|| SpecError::new("", format!("the run began {now} steps ago")).help(format!("`back {now}` goes to its start")))?;
    session.back_to(to)
}

fn add(session: &mut Session, on: On) -> Answer {
    let number = session.stops.iter().map(|s| s.number).max().unwrap_or(0) + 1;
    let stop = Stop::new(number, on, &mut session.sim).map_err(|e| SpecError::new("", e))?;
    if let On::System(system) = stop.on {
        session.driver.set_break(&mut session.sim, system, true);
    }
    let said = format!("stop {number}: {}", stop.about(&session.systems()));
    session.stops.push(stop);
    Ok(said)
}

fn set_break(session: &mut Session, mut words: Words<'_>) -> Answer {
    if words.skip_word("if") {
        let condition = session.expression(words.rest())?;
        return add(session, On::If(condition));
    }
    if let Some(moment) = moment(session, words.rest()) {
        return add(session, moment?);
    }
    let name = words.rest();
    if name.is_empty() {
        return Err(SpecError::new("", "what to stop at is missing").help("a system, t=1 ms, step=100, or if speed > 2"));
    }
    let systems = session.systems();
    // A name without what stands in angle brackets is enough where it is the only one.
    let plain = |s: &str| s.split('<').next().unwrap_or_default().to_string();
    let meant: Vec<usize> = match systems.iter().position(|s| s == name) {
        Some(exact) => vec![exact],
        None => (0..systems.len()).filter(|n| plain(&systems[*n]) == name).collect(),
    };
    match meant[..] {
        [one] => add(session, On::System(one)),
        [] => Err(SpecError::unknown(name, "system", name, systems.iter().map(String::as_str))),
        _ => {
            let all: Vec<&str> = meant.iter().map(|n| systems[*n].as_str()).collect();
            Err(SpecError::new(name, format!("`{name}` is the name of several systems")).help(all.join(", ")))
        }
    }
}

fn watch(session: &mut Session, words: Words<'_>) -> Answer {
    let (text, by) = match words.rest().rsplit_once(" by ") {
        Some((text, by)) => {
            let change = by.trim().parse().ok().filter(|b: &f64| *b >= 0.0);
            (text, change.ok_or_else(|| SpecError::new(by, format!("`{}` is not a change", by.trim())).help("a number from 0"))?)
        }
        None => (words.rest(), 0.0),
    };
    let expression = session.expression(text)?;
    add(session, On::Watch { expression, by })
}

fn delete(session: &mut Session, mut words: Words<'_>) -> Answer {
    let doomed = match words.peek() {
        None => None,
        Some(word) => {
            let number: u32 = words.number("the number of a stop")?;
            let known: Vec<String> = session.stops.iter().map(|s| s.number.to_string()).collect();
            if session.stops.iter().all(|s| s.number != number) {
                return Err(SpecError::unknown(word, "stop", word, known.iter().map(String::as_str)));
            }
            Some(number)
        }
    };
    words.end()?;
    let (gone, kept) = std::mem::take(&mut session.stops).into_iter().partition(|s| doomed.is_none_or(|n| n == s.number));
    session.stops = kept;
    let gone: Vec<Stop> = gone;
    for stop in gone {
        if let On::System(n) = stop.on
            && session.stops.iter().all(|s| !matches!(s.on, On::System(m) if m == n))
        {
            session.driver.set_break(&mut session.sim, n, false);
        }
    }
    Ok(String::new())
}

fn save(session: &mut Session, mut words: Words<'_>) -> Answer {
    let name = words.next().ok_or_else(|| SpecError::new("", "a name is missing").help("save before"))?;
    words.end()?;
    session.refuse_within_step("a state is saved")?;
    if session.snapshots.contains_key(name) {
        return Err(SpecError::new(name, format!("`{name}` is saved already")).help("take another name"));
    }
    let state = session.sim.save_state().map_err(|e| SpecError::new("", e))?;
    let step = session.clock().step;
    session.snapshots.insert(name.into(), Snapshot { step, state, modified: session.modified });
    Ok(format!("`{name}` is the state of step {step}"))
}

/// The saved state called by the next word.
pub(super) fn snapshot<'a>(session: &'a Session, words: &mut Words<'_>) -> Result<&'a Snapshot, SpecError> {
    let name = words.next().ok_or_else(|| SpecError::new("", "the name of a saved state is missing"))?;
    words.end()?;
    let known = || session.snapshots.keys().map(String::as_str);
    session.snapshots.get(name).ok_or_else(|| SpecError::unknown(name, "saved state", name, known()))
}

fn restore(session: &mut Session, mut words: Words<'_>) -> Answer {
    let saved = snapshot(session, &mut words)?;
    let (step, state, modified) = (saved.step, saved.state.clone(), saved.modified);
    session.take_state(&state)?;
    session.modified = modified;
    // What lies before it may have been another run, if something was changed: the way back begins here.
    session.past = Past::default();
    session.past.keep(step, state, true);
    session.arrive()?;
    Ok(String::new())
}

fn hash(session: &mut Session, words: Words<'_>) -> Answer {
    words.end()?;
    Ok(state_hash(&mut session.sim.world))
}

fn help(_: &mut Session, mut words: Words<'_>) -> Answer {
    if let Some(name) = words.next() {
        let c = find(name)?;
        words.end()?;
        let short = if c.short.is_empty() { String::new() } else { format!(", in short {}", c.short) };
        let mut text = format!("{} {}{short}\n  {}", c.name, c.words, c.about);
        if c.words.contains("EXPR") {
            let known: Vec<(&str, &str)> = super::reading::Word::ALL.iter().map(|w| (w.0, w.3)).collect();
            text += "\nEXPR is arithmetic with < <= > >= == != && || over\n";
            text += &table(&known);
            text += "\n  {node 3 v.x}  x, v, f, m, w of a node: a component, or the length";
            text += "\n  {element KIND N field}, {name of a probe}, {Displacement(node: 3, component: X)}";
        }
        return Ok(text);
    }
    let rows: Vec<(String, &str)> =
        COMMANDS.iter().map(|c| (if c.short.is_empty() { c.name.into() } else { format!("{}, {}", c.name, c.short) }, c.about)).collect();
    Ok(table(&rows))
}

impl Session {
    /// Time and step in words.
    pub(super) fn now(&self) -> String {
        let clock = self.clock();
        format!("step {}, t = {}", clock.step, quantity(clock.time, self.scene.scene.units.time()))
    }
}
