//! `braid-ecs study FILE`: one scene in many variants, run side by side and compared.
use super::message::{Failure, line, out};
use super::progress::duration_text;
use super::signals;
use crate::simulation::Plugin;
use crate::study::eta::Eta;
use crate::study::{self, Done, Event, Existing, Options, Plan, StudyError};
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Arguments of a study.
#[derive(Args, Debug)]
pub(super) struct StudyArgs {
    /// The study file (.ron).
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Output folder [default: results/<study>].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Rows to run at a time [default: as many as there are processors for their threads].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Threads of each row [default: one, and more for a row that would outlast all others].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Keep the rows that an earlier study in the folder has finished.
    #[arg(long, conflicts_with = "force")]
    resume: bool,
    /// Move an earlier study aside (to <folder>.1, .2, ...) instead of refusing.
    #[arg(long)]
    force: bool,
    /// Let the study use scenes outside its folder and the working folder.
    #[arg(long)]
    outside: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs a study and prints its table.
pub(super) fn run(args: &StudyArgs, plugins: impl Plugin) -> Result<(), Failure> {
    let mut file = study::load(&args.file)?;
    file.outside = args.outside;
    let plan = Plan::new(file, &plugins)?;
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.map(usize::from);
    let jobs = args.jobs.map_or((processors / threads.unwrap_or(1)).max(1), usize::from);
    let options = Options {
        program: std::env::current_exe().map_err(|e| Failure::Usage(format!("cannot find this program: {e}")))?,
        folder: args.out.clone().unwrap_or_else(|| PathBuf::from("results").join(plan.file.name())),
        jobs: jobs.min(plan.file.study.max_parallel.map_or(usize::MAX, usize::from)).min(plan.runs.len()),
        threads,
        processors: args.jobs.map_or(processors, usize::from),
        existing: match (args.resume, args.force) {
            (true, _) => Existing::Resume,
            (_, true) => Existing::MoveAside,
            _ => Existing::Refuse,
        },
    };
    let claim = study::claim(&plan, &options)?;
    let mut progress = Progress::new(&plan, &options, args.quiet);
    if let (Some(aside), false) = (&claim.aside, args.quiet) {
        line(&format!("earlier results moved to {}", aside.display()));
    }
    if !args.quiet {
        let (rows, runs) = (plan.rows.len(), plan.runs.len());
        let each = threads.filter(|t| *t > 1).map_or(String::new(), |t| format!(" with {t} threads each"));
        line(&format!(
            "{}: {rows} rows, {runs} runs, {} at a time{each}; results go to {}",
            plan.file.name(),
            options.jobs,
            options.folder.display()
        ));
    }
    if let (n @ 1.., false) = (claim.of_other_builds(), args.quiet) {
        line(&format!("note: {n} of the kept runs were made by another build of this version"));
    }
    let stop = Arc::new(AtomicBool::new(false));
    signals::catch(&stop);
    let done = study::perform(&plan, &options, &claim, &|| stop.load(Ordering::Relaxed), &mut |event| progress.hear(event));
    progress.clear();
    let done = done?;
    if !args.quiet {
        print(&plan, &done, &options);
    }
    match done {
        Done { missing: 1.., .. } => Err(Failure::StudyStopped),
        Done { failed: failed @ 1.., .. } => Err(Failure::Rows(failed)),
        _ => Ok(()),
    }
}

/// Shows how far a study has come.
struct Progress<'a> {
    plan: &'a Plan,
    eta: Eta,
    ended: usize,
    failed: usize,
    kept: usize,
    bar: Option<ProgressBar>,
    quiet: bool,
}

impl<'a> Progress<'a> {
    fn new(plan: &'a Plan, options: &Options, quiet: bool) -> Self {
        let costs: Vec<Option<f64>> = plan.runs.iter().map(|r| plan.rows[r.row].cost).collect();
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::with_draw_target(Some(plan.runs.len() as u64), ProgressDrawTarget::stderr());
            bar.set_style(ProgressStyle::with_template("{bar:20.cyan/238} {pos}/{len}  {wide_msg}").expect("a fixed template"));
            bar
        });
        Progress { plan, eta: Eta::new(&costs, options.jobs), ended: 0, failed: 0, kept: 0, bar, quiet }
    }

    fn name(&self, run: usize) -> String {
        let run = &self.plan.runs[run];
        let seed = run.seed.map_or(String::new(), |s| format!(", seed {s}"));
        format!("{}{seed}", self.plan.rows[run.row].label())
    }

    fn hear(&mut self, event: Event<'_>) {
        let now = Instant::now();
        match event {
            Event::Kept(run) => {
                self.eta.kept(run);
                self.kept += 1;
                self.ended += 1;
            }
            Event::Started(run) => self.eta.started(run, now),
            Event::Ended(run, ended) => {
                self.eta.ended(run, now, ended.summary.is_none());
                self.ended += 1;
                let outcome = if ended.summary.is_some() {
                    format!("done in {}", duration_text(ended.record.process_s))
                } else {
                    self.failed += 1;
                    format!("FAILED: {}", ended.record.message.lines().next().unwrap_or_default())
                };
                self.say(&format!("{}: {outcome}{}", self.name(run), self.rest(now, self.bar.is_none())));
            }
            Event::Waiting => {}
        }
        if let Some(bar) = &self.bar {
            bar.set_position(self.ended as u64);
            bar.set_message(self.rest(now, false).trim_start_matches([';', ' ']).to_owned());
        }
    }

    /// What is still to come; with the count where no bar shows it.
    fn rest(&self, now: Instant, count: bool) -> String {
        let mut text = if count { format!("; {} of {}", self.ended, self.plan.runs.len()) } else { String::new() };
        if self.failed > 0 {
            text += &format!(", {} failed", self.failed);
        }
        if let Some(left) = self.eta.remaining(now).filter(|l| *l > Duration::ZERO) {
            text += &format!("; about {} left", duration_text(left.as_secs_f64()));
        }
        text
    }

    fn say(&self, text: &str) {
        match &self.bar {
            _ if self.quiet => {}
            Some(bar) => bar.println(text),
            None => line(text),
        }
    }

    fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        if self.kept > 0 {
            self.say(&format!("{} runs were kept from an earlier study", self.kept));
        }
    }
}

/// The table at the end.
fn print(plan: &Plan, done: &Done, options: &Options) {
    out(&study::table(plan, &done.results));
    let uncertainty = study::uncertainty_table(&done.results);
    if !uncertainty.is_empty() {
        out(&uncertainty);
    }
    out(&format!("report: {}", options.folder.join("report.html").display()));
}

impl From<StudyError> for Failure {
    fn from(e: StudyError) -> Self {
        match e {
            StudyError::Output(e) => Failure::Output(e),
            e => Failure::Study(e),
        }
    }
}
