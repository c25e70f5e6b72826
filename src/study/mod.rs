//! Studies: one scene in many variants, run side by side and compared.
//!
//! | step | file |
//! |---|---|
//! | the study file: every key | `schema.rs` |
//! | text to [`Study`], checks without scenes | `read.rs` |
//! | rows, runs, folders, references, expected cost | `draft.rs`, `plan.rs` |
//! | one process per run, several at a time | `execute.rs` |
//! | `row.json`: what a run was made from, for `--resume` | `record.rs` |
//! | remaining time | `eta.rs` |
//! | values with intervals, errors, front of time and error, convergence, uncertainty | `results.rs`, `convergence.rs`, `uncertainty.rs` |
//! | `study.json`, `study.csv` | `tables.rs` |
//! | pictures of the rows for the report, what their scenes share and differ in | `gallery.rs`, `facts.rs` |
//! | plots and `report.html` | `chart.rs`, `scatter.rs`, `plots.rs`, `report.rs`, `text.rs` |
//!
//! A study knows scenes and summaries only: nothing of elements, contacts or steps.
pub mod chart;
pub mod convergence;
mod draft;
pub mod eta;
mod execute;
mod facts;
mod gallery;
mod plan;
mod plots;
mod read;
mod record;
mod report;
pub mod results;
pub mod scatter;
mod schema;
mod share;
mod tables;
pub(crate) mod text;
pub mod uncertainty;

pub use execute::{Claim, Event, Existing, Options, claim, execute};
pub use plan::{MAX_ROWS, Plan, Row, Run};
pub use read::{StudyFile, load, load_text};
pub use record::{Ended, Record, Status};
pub use results::{Results, results};
pub use schema::*;
pub use tables::{Machine, State, table, uncertainty_table};

use crate::output::OutputError;
use std::path::PathBuf;

/// Why a study cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// A file or folder.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Another study works in the folder.
    #[error("another study is running in `{}`", .0.display())]
    Busy(PathBuf),
    /// Rows, and what they would now be made from that they were not made from.
    #[error("{}", changed(.0))]
    Changed(Vec<(String, String)>),
    /// A record that is not one.
    #[error("cannot read `{}`: {message}", path.display())]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// A run cannot be started.
    #[error("cannot start `{}`: {source}", program.display())]
    Start {
        /// The program.
        program: PathBuf,
        /// The reason given by the system.
        source: std::io::Error,
    },
}

/// Changed rows that are named.
const NAMED: usize = 5;

fn changed(rows: &[(String, String)]) -> String {
    let mut text: Vec<String> = rows.iter().take(NAMED).map(|(row, what)| format!("row `{row}` cannot be kept: {what}")).collect();
    if rows.len() > NAMED {
        text.push(format!("and {} more rows", rows.len() - NAMED));
    }
    text.join("\n")
}

/// How a study has ended.
#[derive(Debug)]
pub struct Done {
    /// What came out.
    pub results: Results,
    /// Runs that failed.
    pub failed: usize,
    /// Runs that were not made, because the study was stopped.
    pub missing: usize,
}

/// Runs a study in a folder that has been claimed, and writes its tables after every run, its plots
/// and its report at the end.
///
/// # Errors
/// Files that cannot be written, a program that cannot be started. A run that fails is no error here.
pub fn perform(
    plan: &Plan,
    options: &Options,
    claim: &Claim,
    stop: &(dyn Fn() -> bool + Sync),
    watch: &mut dyn FnMut(Event<'_>),
) -> Result<Done, StudyError> {
    let machine = Machine::here(options.jobs, options.threads, &claim.build);
    let mut ended = claim.kept.clone();
    tables::write(plan, &results(plan, &ended), &machine, State::Running, &options.folder)?;
    let ended = execute(plan, options, claim, stop, &mut |event| {
        watch(event);
        if let Event::Ended(i, e) = event {
            ended[i] = Some(e.clone());
            tables::write(plan, &results(plan, &ended), &machine, State::Running, &options.folder)?;
        }
        Ok(())
    })?;
    let results = results(plan, &ended);
    let missing = ended.iter().filter(|e| e.is_none()).count();
    let failed = ended.iter().flatten().filter(|e| e.summary.is_none()).count();
    let state = if missing > 0 { State::Interrupted } else { State::Ended };
    let plots = plots::write(plan, &results, &options.folder)?;
    report::write(plan, &results, &machine, state, &plots, &options.folder)?;
    tables::write(plan, &results, &machine, state, &options.folder)?;
    Ok(Done { results, failed, missing })
}
