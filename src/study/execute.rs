//! Runs the rows of a study, each in a process of its own, several at a time.
//!
//! A row that fails is recorded and the others go on. Processes keep rows from each other: one that
//! runs out of memory or is killed takes nothing with it.
use super::StudyError;
use super::plan::{Plan, Run};
use super::record::{self, Ended, Record, Status};
use super::share;
use crate::output::OutputError;
use crate::output::control;
use crate::output::file::{claim_folder, lock};
use crate::output::summary::Summary;
use std::collections::VecDeque;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Condvar, Mutex, mpsc};
use std::time::{Duration, Instant};

/// What to do with a folder that holds a study already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Leave it alone.
    Refuse,
    /// Keep the rows that have ended and run the others.
    Resume,
    /// Move it aside.
    MoveAside,
}

/// How a study is run.
#[derive(Clone, Debug)]
pub struct Options {
    /// The program that runs a scene, `braid-ecs` itself.
    pub program: PathBuf,
    /// Folder of the study.
    pub folder: PathBuf,
    /// Runs at a time, at least one.
    pub jobs: usize,
    /// Threads of each run; without it one, and more for a run that would outlast all others, out of `processors`.
    pub threads: Option<usize>,
    /// Threads of all runs together.
    pub processors: usize,
    /// What to do with an earlier study in the folder.
    pub existing: Existing,
}

/// Something that happened to a run, by its index in the plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// It had ended in an earlier study and is kept.
    Kept(usize),
    /// It has been started.
    Started(usize),
    /// It has ended.
    Ended(usize, &'a Ended),
    /// Nothing happened for a while.
    Waiting,
}

/// Time between two looks at a process.
const LOOK: Duration = Duration::from_millis(20);
/// Time between two events at least.
const BEAT: Duration = Duration::from_millis(500);

/// Time that a run has to write its checkpoint when the study is stopped.
const PATIENCE: Duration = Duration::from_secs(10);

/// Exit codes of a run that was stopped.
const STOPPED: [i32; 2] = [75, 130];

/// A folder that belongs to one study at a time.
#[derive(Debug)]
pub struct Claim {
    /// Where an earlier study went.
    pub aside: Option<PathBuf>,
    /// Fingerprint of the program.
    pub build: String,
    /// What earlier runs have left, in the order of the plan.
    pub kept: Vec<Option<Ended>>,
    _lock: File,
}

impl Claim {
    /// Kept runs that another build of this version has made: their numbers may differ.
    pub fn of_other_builds(&self) -> usize {
        self.kept.iter().flatten().filter(|e| e.record.build != self.build).count()
    }
}

/// Takes the folder of a study, and looks which of its runs have ended already.
///
/// # Errors
/// A folder that is in use or holds other results; rows that were made from something else.
pub fn claim(plan: &Plan, options: &Options) -> Result<Claim, StudyError> {
    let folder = options.folder.as_path();
    let build = fingerprint(&options.program)?;
    let study = folder.join("study.json").exists();
    if folder.join(LOCK).exists() {
        drop(hold(folder)?);
    }
    // Rows are removed before they are run again: they must be those of a study.
    if !study && folder.join("rows").exists() {
        return Err(OutputError::Occupied { path: folder.to_owned() }.into());
    }
    let resume = options.existing == Existing::Resume && study;
    let aside = if resume { None } else { claim_folder(folder, options.existing == Existing::MoveAside)? };
    let lock = hold(folder)?;
    let mut changed = Vec::new();
    let mut kept = Vec::new();
    for run in &plan.runs {
        // A failed run is tried again.
        let ended = record::read(&folder.join(&run.folder))?.filter(|e| e.summary.is_some());
        if let Some(ended) = &ended {
            let changes = ended.record.changes(&Record::of(plan, run, &build));
            if !changes.is_empty() {
                changed.push((plan.rows[run.row].label(), changes.join("; ")));
            }
        }
        kept.push(ended);
    }
    changed.dedup();
    if changed.is_empty() { Ok(Claim { aside, build, kept, _lock: lock }) } else { Err(StudyError::Changed(changed)) }
}

const LOCK: &str = ".lock";

fn hold(folder: &Path) -> Result<File, StudyError> {
    lock(&folder.join(LOCK))?.ok_or_else(|| StudyError::Busy(folder.to_owned()))
}

fn fingerprint(program: &Path) -> Result<String, StudyError> {
    let fail = |e| StudyError::from(OutputError::io("read", program, e));
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(program).map_err(fail)?).map_err(fail)?;
    Ok(hasher.finalize().to_hex()[..16].to_owned())
}

/// Makes the runs of a plan that have not ended; returns all that have, in the order of the plan.
/// `stop` is asked several times a second and ends the study, the runs that go on included; `watch`
/// hears what happens.
///
/// # Errors
/// A program that cannot be started, files that cannot be written, and what `watch` says.
pub fn execute(
    plan: &Plan,
    options: &Options,
    claim: &Claim,
    stop: &(dyn Fn() -> bool + Sync),
    watch: &mut dyn FnMut(Event<'_>) -> Result<(), StudyError>,
) -> Result<Vec<Option<Ended>>, StudyError> {
    let mut ended = claim.kept.clone();
    for i in (0..ended.len()).filter(|i| ended[*i].is_some()) {
        watch(Event::Kept(i))?;
    }
    let waiting: VecDeque<usize> = plan.order().into_iter().filter(|i| ended[*i].is_none()).collect();
    let workers = options.jobs.clamp(1, waiting.len().max(1));
    let queue = Queue::new(plan, options, waiting);
    let broken = std::sync::atomic::AtomicBool::new(false);
    let halt = || stop() || broken.load(std::sync::atomic::Ordering::Relaxed);
    let (send, receive) = mpsc::channel::<(usize, Option<Result<Option<Ended>, StudyError>>)>();
    std::thread::scope(|scope| {
        for _ in 0..workers {
            let (send, queue, halt) = (send.clone(), &queue, &halt);
            scope.spawn(move || {
                while let Some((i, threads)) = queue.next(halt) {
                    // The receiver lives until all senders are gone.
                    let _ = send.send((i, None));
                    let ended = one(plan, &plan.runs[i], options, threads, &claim.build, halt);
                    queue.give_back(threads);
                    let _ = send.send((i, Some(ended)));
                }
            });
        }
        drop(send);
        let mut first = None;
        loop {
            let heard = match receive.recv_timeout(BEAT) {
                Err(mpsc::RecvTimeoutError::Disconnected) => break,
                Err(mpsc::RecvTimeoutError::Timeout) => watch(Event::Waiting),
                Ok((i, None)) => watch(Event::Started(i)),
                Ok((_, Some(Ok(None)))) => Ok(()),
                Ok((i, Some(Ok(Some(e))))) => watch(Event::Ended(i, ended[i].insert(e))),
                Ok((_, Some(Err(e)))) => Err(e),
            };
            if let Err(e) = heard {
                // The other runs are stopped; the first error is the one to report.
                broken.store(true, std::sync::atomic::Ordering::Relaxed);
                first.get_or_insert(e);
            }
        }
        first.map_or(Ok(()), Err)
    })?;
    Ok(ended)
}

/// The runs that wait, and the threads that nobody uses.
struct Queue<'a> {
    plan: &'a Plan,
    threads: Option<usize>,
    /// Most threads that a run can use.
    processors: usize,
    state: Mutex<(VecDeque<usize>, usize)>,
    given_back: Condvar,
}

impl<'a> Queue<'a> {
    fn new(plan: &'a Plan, options: &Options, waiting: VecDeque<usize>) -> Self {
        let free = options.threads.map_or(options.processors, |threads| threads * options.jobs).max(1);
        let processors = std::thread::available_parallelism().map_or(1, usize::from);
        Queue { plan, threads: options.threads, processors, state: Mutex::new((waiting, free)), given_back: Condvar::new() }
    }

    /// The next run and its threads, as soon as there is one for it; none if there is no run, or none is to be made any more.
    fn next(&self, halt: &dyn Fn() -> bool) -> Option<(usize, usize)> {
        let mut state = self.state.lock().unwrap_or_else(|e| e.into_inner());
        while !halt() {
            let (waiting, free) = &mut *state;
            if *free > 0 || waiting.is_empty() {
                let run = waiting.pop_front()?;
                let cost = |run: &usize| self.plan.rows[self.plan.runs[*run].row].cost.unwrap_or(f64::NAN);
                let share = || share::threads(cost(&run), waiting.iter().map(cost).sum(), (*free).min(self.processors));
                let threads = self.threads.unwrap_or_else(share);
                *free -= threads;
                return Some((run, threads));
            }
            state = self.given_back.wait_timeout(state, LOOK).unwrap_or_else(|e| e.into_inner()).0;
        }
        None
    }

    fn give_back(&self, threads: usize) {
        self.state.lock().unwrap_or_else(|e| e.into_inner()).1 += threads;
        self.given_back.notify_all();
    }
}

/// Makes one run, from its last checkpoint if it was begun before; none if it was stopped.
fn one(
    plan: &Plan,
    run: &Run,
    options: &Options,
    threads: usize,
    build: &str,
    stop: &dyn Fn() -> bool,
) -> Result<Option<Ended>, StudyError> {
    let folder = options.folder.join(&run.folder);
    let record = Record { jobs: options.jobs, ..Record::of(plan, run, build) };
    // Whole paths cannot be taken for options or commands.
    let whole = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.to_owned());
    let mut command = Command::new(&options.program);
    if record::unfinished(&folder, &record)? {
        command.arg("resume").arg(whole(&folder));
    } else {
        if folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(|e| OutputError::io("remove the unfinished run in", &folder, e))?;
        }
        std::fs::create_dir_all(&folder).map_err(|e| OutputError::io("create the folder", &folder, e))?;
        record.write(&folder)?;
        command.arg(whole(&plan.rows[run.row].scene));
        command.args(plan.sets(run).iter().map(|(path, value)| format!("--set={path}={value}")));
        command.arg("--out").arg(whole(&folder));
    }
    let log = folder.join("log.txt");
    let file = File::create(&log).map_err(|e| OutputError::io("write", &log, e))?;
    command.args(["--quiet", "--threads", &threads.to_string()]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(file);
    let begin = Instant::now();
    let start = |e| StudyError::Start { program: options.program.clone(), source: e };
    let mut child = command.spawn().map_err(start)?;
    let status = loop {
        if let Some(status) = child.try_wait().map_err(start)? {
            break status;
        }
        if stop() {
            end(&mut child, &folder);
            return Ok(None);
        }
        std::thread::sleep(LOOK);
    };
    // Ctrl-C reaches the run, too, and may end it before it ends this study.
    if status.code().is_some_and(|c| STOPPED.contains(&c)) || (stop() && !status.success()) {
        return Ok(None);
    }
    let (exit_code, process_s) = (status.code(), begin.elapsed().as_secs_f64());
    let mut record = Record { status: Status::Failed, exit_code, process_s, ..record };
    let summary =
        if status.success() { Summary::read(&folder).map_err(|e| e.to_string()) } else { Err(message(&log, &status.to_string())) };
    let summary = match summary {
        Ok(summary) => {
            record.status = Status::Finished;
            Some(summary)
        }
        Err(message) => {
            record.message = message;
            None
        }
    };
    record.write(&folder)?;
    Ok(Some(Ended { record, summary }))
}

/// Ends a run: with a checkpoint, or at once if it does not listen.
fn end(child: &mut Child, folder: &Path) {
    // A command that cannot be written is one that is not heard.
    let _ = control::Command::Stop.send(folder);
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(LOOK);
    }
    // It may have ended by itself; both ways it is gone after the wait.
    let _ = child.kill();
    let _ = child.wait();
    // What it has not heard must not stop the next one.
    let _ = control::Command::take(folder);
}

/// Longest message that is kept (characters).
const MESSAGE: usize = 2000;

/// What a failed run has said, from its error on.
fn message(log: &Path, status: &str) -> String {
    let text = std::fs::read(log).map(|b| String::from_utf8_lossy(&b).into_owned()).unwrap_or_default();
    let from = text.find("error: ").map_or(0, |i| i + "error: ".len());
    let said: String = text[from..].trim().chars().take(MESSAGE).collect();
    if said.is_empty() { format!("it ended without a word: {status}") } else { said }
}
