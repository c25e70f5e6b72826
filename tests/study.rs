//! Studies: what they run, keep and refuse, and what comes out of them.
use braid_ecs::output::summary::{Measure, Summary};
use braid_ecs::study::{self, Done, Ended, Event, Existing, Options, Plan, Record, Status, StudyError};
use braid_ecs::systems::default_plugins;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

const STRIP: &str = r#"(
    units: MmNTonne,
    materials: {"steel": (young: "200 GPa", poisson: 0.3, density: "7.85 g/cm3")},
    polylines: [(name: "strip", points: [[0, 0, 0], [100, 0, 0]], subdivisions: 5, radius: "0.25 mm", material: "steel", model: Beams, start: Clamped)],
    loads: [(nodes: ["strip.0.end"], force: [0, 0.01, 0])],
    probes: {"tip": Displacement(node: "strip.0.end", component: Y), "root": Reaction(node: "strip.0.start", component: Y)},
    stop: (time: "2 ms"),
    output: (pictures: false, frames: Never),
)"#;

const STUDY: &str = r#"(
    title: "A strip <in> steps",
    scene: "strip.ron",
    axes: [
        (name: "elements", points: [
            (label: "2", set: {"polylines[0].subdivisions": 2}),
            (label: "4", set: {"polylines[0].subdivisions": 4}),
        ]),
        (name: "load", points: [
            (label: "10 mN"),
            (label: "20 mN", set: {"loads[0].force[1]": "20 mN"}),
        ]),
    ],
    rows: [(label: "as it is")],
    reference: ["4", "*"],
    outcomes: [(name: "tip"), (name: "root", error: None)],
    convergence: "elements",
    published: [(row: ["2", "10 mN"], source: "others", values: {"tip": (value: 0.005)}, errors: {"tip": "5 %"}, wall: "2 min", note: "by hand")],
)"#;

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("strip.ron"), STRIP).unwrap();
    std::fs::write(dir.path().join("steps.ron"), STUDY).unwrap();
    dir
}

/// Exit code, standard output, standard error.
fn program(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_braid-ecs"));
    let o = command.args(arguments).current_dir(folder).output().expect("the program starts");
    let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
    (o.status.code().expect("no signal"), text(&o.stdout), text(&o.stderr))
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn plan(folder: &Path, text: &str) -> Plan {
    let file = study::load_text(&folder.join("steps.ron").display().to_string(), text.into()).unwrap();
    Plan::new(file, &default_plugins).unwrap()
}

#[test]
fn a_study_runs_its_rows_and_writes_tables_plots_and_a_report() {
    let dir = folder();
    let (code, out, err) = program(dir.path(), &["study", "steps.ron", "--jobs", "2", "--threads", "1"]);
    assert_eq!(code, 0, "{err}");
    assert!(err.contains("steps: 5 rows, 5 runs, 2 at a time; results go to results/steps"), "{err}");
    assert!(err.contains("as it is: done in") && err.contains("5 of 5"), "{err}");
    for part in ["tip [mm]", "difference", "4, 20 mN", "completed", "results/steps/report.html"] {
        assert!(out.contains(part), "{part} is missing in\n{out}");
    }
    let results = dir.path().join("results/steps");
    let all = json(&results.join("study.json"));
    assert_eq!(all["state"], "ended");
    assert_eq!(all["machine"]["jobs"], 2);
    let rows = all["results"]["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["2-10_mN", "2-20_mN", "4-10_mN", "4-20_mN", "as_it_is"]);
    // Every row has the outcome of its own run, and is compared with the one of the same load.
    let tip = |i: usize| rows[i]["outcomes"][0]["value"].as_f64().unwrap();
    for (i, name) in names.iter().enumerate() {
        let summary = json(&results.join("rows").join(name).join("summary.json"));
        assert_eq!(summary["probes"]["tip"].as_f64().unwrap(), tip(i));
        assert_eq!(summary["threads"], 1);
        let resolved = std::fs::read_to_string(results.join("rows").join(name).join("scene.resolved.ron")).unwrap();
        let wanted = ["subdivisions: 2", "subdivisions: 2", "subdivisions: 4", "subdivisions: 4", "subdivisions: 5"][i];
        assert!(resolved.contains(wanted), "{name}: {wanted}");
        assert_eq!(resolved.contains("0.02"), [1, 3].contains(&i), "{name}");
    }
    let error = rows[0]["outcomes"][0]["error"].as_f64().unwrap();
    assert_eq!(error, ((tip(0) - tip(2)) / tip(2).abs()).abs());
    assert_eq!(rows[0]["cumulated"].as_f64(), Some(error), "the root is not counted");
    assert_eq!(rows[1]["reference"], "4-20_mN");
    assert!(rows[2]["cumulated"].is_null() && rows[4]["reference"].is_null());
    assert!(rows.iter().any(|r| r["front"] == true) && rows[4]["front"] == false);
    // The table as text.
    let mut csv = csv::Reader::from_path(results.join("study.csv")).unwrap();
    let headers = csv.headers().unwrap().clone();
    assert_eq!(headers.iter().take(5).collect::<Vec<_>>(), ["row", "elements", "load", "tip [mm]", "tip ci95 [mm]"]);
    let records: Vec<csv::StringRecord> = csv.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), 5);
    assert_eq!(records[3].iter().take(3).collect::<Vec<_>>(), ["4, 20 mN", "4", "20 mN"]);
    assert_eq!(records[3][3].parse::<f64>().unwrap(), tip(3));
    assert_eq!(records[4].iter().take(3).collect::<Vec<_>>(), ["as it is", "", ""]);
    // One page that needs nothing else.
    let page = std::fs::read_to_string(results.join("report.html")).unwrap();
    assert!(!page.contains("http") && !page.contains("src=") && !page.contains("href="), "the page needs nothing from elsewhere");
    for part in
        ["A strip &lt;in&gt; steps", "<svg", "others", "2.0 min", "by hand", "Convergence", "Assumptions", "Study file", "@media print"]
    {
        assert!(page.contains(part), "{part} is missing");
    }
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    for name in ["value_tip", "value_root", "error_tip", "cumulated_error", "wall_time", "error_over_time", "convergence"] {
        let svg = std::fs::read_to_string(results.join(format!("plots/{name}.svg"))).unwrap();
        assert!(svg.contains("</svg>") && !svg.contains("NaN"), "{name}");
    }
    assert!(!results.join("plots/error_root.svg").exists());
}

#[test]
fn resume_keeps_what_is_finished_and_nothing_is_overwritten() {
    let dir = folder();
    let run = |arguments: &[&str]| program(dir.path(), &[&["study", "steps.ron", "--out", "r"], arguments].concat());
    assert_eq!(run(&["--quiet"]), (0, String::new(), String::new()), "quiet is silent");
    let record = |row: &str| dir.path().join("r/rows").join(row).join("row.json");
    let first = std::fs::read_to_string(record("4-10_mN")).unwrap();
    // Without --resume nothing is touched.
    let (code, _, err) = run(&[]);
    assert_eq!(code, 4);
    assert!(err.contains("already holds") && err.contains("--resume") && err.contains("--force"), "{err}");
    // A row without its record did not end.
    std::fs::remove_file(record("2-20_mN")).unwrap();
    std::fs::write(dir.path().join("r/rows/2-20_mN/left over"), "").unwrap();
    let (code, out, err) = run(&["--resume"]);
    assert_eq!(code, 0, "{err}");
    assert!(err.contains("2, 20 mN: done in") && !err.contains("4, 10 mN: done"), "{err}");
    assert!(err.contains("4 runs were kept"), "{err}");
    assert!(out.contains("4, 10 mN"), "the table has all rows: {out}");
    assert_eq!(std::fs::read_to_string(record("4-10_mN")).unwrap(), first);
    assert!(record("2-20_mN").exists() && !dir.path().join("r/rows/2-20_mN/left over").exists());
    // A kept row of another build of the same version is named.
    let build = json(&record("as_it_is"))["build"].as_str().unwrap().to_owned();
    let text = std::fs::read_to_string(record("as_it_is")).unwrap();
    std::fs::write(record("as_it_is"), text.replace(&build, "0123456789abcdef")).unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert!(code == 0 && err.contains("note: 1 of the kept runs were made by another build of this version"), "{err}");
    let page = std::fs::read_to_string(dir.path().join("r/report.html")).unwrap();
    assert!(page.contains("made by 2 builds of this version"));
    // New rows are run beside the kept ones.
    std::fs::write(dir.path().join("steps.ron"), STUDY.replace("(label: \"as it is\")", "(label: \"as it is\"), (label: \"new\")"))
        .unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert_eq!(code, 0, "{err}");
    assert!(err.contains("new: done in") && err.contains("5 runs were kept"), "{err}");
    let (code, _, err) = run(&["--force", "--quiet"]);
    assert_eq!(code, 0, "{err}");
    assert_eq!(std::fs::read_to_string(dir.path().join("r.1/rows/4-10_mN/row.json")).unwrap(), first);
}

#[test]
fn rows_made_from_something_else_are_refused_by_name() {
    let dir = folder();
    let run = |arguments: &[&str]| program(dir.path(), &[&["study", "steps.ron", "--out", "r", "--quiet"], arguments].concat());
    assert_eq!(run(&[]).0, 0);
    let help = "\n  help: choose another folder with --out DIR, or add --force instead of --resume to run all rows anew\n";
    // Another value.
    std::fs::write(dir.path().join("steps.ron"), STUDY.replace("subdivisions\": 4", "subdivisions\": 3")).unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert_eq!(code, 4);
    let what = "`polylines[0].subdivisions` was `4`, and is now `3`";
    assert_eq!(err, format!("error: row `4, 10 mN` cannot be kept: {what}\nrow `4, 20 mN` cannot be kept: {what}{help}"));
    // Another scene.
    std::fs::write(dir.path().join("steps.ron"), STUDY).unwrap();
    std::fs::write(dir.path().join("strip.ron"), format!("{STRIP}// longer")).unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert_eq!(code, 4);
    assert!(err.starts_with("error: row `2, 10 mN` cannot be kept: its scene `strip.ron` has changed\nrow `2, 20 mN`"), "{err}");
    // Another program.
    std::fs::write(dir.path().join("strip.ron"), STRIP).unwrap();
    let path = dir.path().join("r/rows/as_it_is/row.json");
    let record = std::fs::read_to_string(&path).unwrap();
    let version = format!("\"version\": \"{}\"", env!("CARGO_PKG_VERSION"));
    std::fs::write(&path, record.replace(&version, "\"version\": \"0.0.1\"")).unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert_eq!(code, 4);
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(err, format!("error: row `as it is` cannot be kept: it was run by version 0.0.1, this is version {version}{help}"));
    // A record that was tampered with is neither trusted nor thrown away.
    std::fs::write(&path, "{}").unwrap();
    let (code, _, err) = run(&["--resume"]);
    assert_eq!(code, 4);
    assert!(err.contains("cannot read `r/rows/as_it_is/row.json`: missing field"), "{err}");
    assert!(dir.path().join("r/rows/as_it_is/summary.json").exists());
}

#[test]
fn a_failed_row_is_recorded_and_the_others_go_on() {
    let dir = folder();
    let study = STUDY.replace(
        "rows: [(label: \"as it is\")]",
        "rows: [(label: \"burst\", set: {\"loads[0].force[1]\": 1e200, \"amplitudes\": {\"up\": Ramp(rise: \"1 ms\")}, \"loads[0].amplitude\": \"up\"})]",
    );
    std::fs::write(dir.path().join("steps.ron"), study).unwrap();
    let (code, out, err) = program(dir.path(), &["study", "steps.ron", "--out", "r"]);
    assert_eq!(code, 5, "{err}");
    assert!(err.contains("burst: FAILED: ") && err.ends_with("1 run failed; what came out of the others is kept\n"), "{err}");
    assert!(out.lines().any(|l| l.starts_with("burst") && l.ends_with("failed")), "{out}");
    let record = json(&dir.path().join("r/rows/burst/row.json"));
    assert_eq!((record["status"].as_str(), record["exit_code"].as_i64()), (Some("failed"), Some(5)));
    let message = record["message"].as_str().unwrap();
    assert!(message.contains("step ") && message.contains("node "), "{message}");
    let page = std::fs::read_to_string(dir.path().join("r/report.html")).unwrap();
    assert!(page.contains("Row <b>burst</b> failed"));
    assert_eq!(json(&dir.path().join("r/study.json"))["results"]["rows"][0]["runs"][0]["status"], "completed");
    // It is tried again, and alone.
    let (code, _, err) = program(dir.path(), &["study", "steps.ron", "--out", "r", "--resume"]);
    assert_eq!(code, 5, "{err}");
    assert!(err.contains("4 runs were kept") && err.contains("burst: FAILED"), "{err}");
}

#[test]
fn rows_may_have_several_threads_which_their_times_tell() {
    let dir = folder();
    let (code, _, err) = program(dir.path(), &["study", "steps.ron", "--out", "r", "--jobs", "2", "--threads", "2"]);
    assert_eq!(code, 0, "{err}");
    assert!(err.contains("2 at a time with 2 threads each"), "{err}");
    let all = json(&dir.path().join("r/study.json"));
    assert_eq!(all["machine"]["threads"], 2);
    assert!(all["results"]["rows"].as_array().unwrap().iter().all(|r| r["threads"] == 2));
    assert!(std::fs::read_to_string(dir.path().join("r/report.html")).unwrap().contains("2 runs at a time with 2 threads each"));
    // Advice expects times of one thread.
    let (code, _, err) = program(dir.path(), &["advise", "--collect", "r/study.json", "--out", "advice.json"]);
    assert_eq!(code, 2, "{err}");
    assert!(err.contains("ran row `2, 10 mN` with 2 threads"), "{err}");
    assert!(!dir.path().join("advice.json").exists());
}

#[test]
fn a_row_that_outlasts_all_others_gets_the_threads_that_are_free() {
    // One processor has no second thread to give.
    if std::thread::available_parallelism().map_or(1, usize::from) < 2 {
        return;
    }
    let dir = folder();
    let study = STUDY.replace("rows: [(label: \"as it is\")]", "rows: [(label: \"long\", set: {\"polylines[0].subdivisions\": 40})]");
    std::fs::write(dir.path().join("steps.ron"), study).unwrap();
    let threads = |out: &str| {
        let all = json(&dir.path().join(out).join("study.json"));
        let of = |r: &Value| (r["labels"][0].as_str().unwrap().to_owned(), r["threads"].as_u64().unwrap());
        (all["machine"]["threads"].clone(), all["results"]["rows"].as_array().unwrap().iter().map(of).collect::<Vec<_>>())
    };
    let (code, out, err) = program(dir.path(), &["study", "steps.ron", "--out", "r", "--jobs", "2"]);
    assert_eq!(code, 0, "{err}");
    let (given, rows) = threads("r");
    assert!(given.is_null());
    // Of the others the last one may find a second thread free.
    assert!(rows.iter().any(|(label, n)| label == "long" && *n == 2) && rows.iter().any(|(_, n)| *n == 1), "{rows:?}");
    assert!(out.lines().any(|l| l.starts_with("long") && l.contains(" s, 2 threads  ")), "{out}");
    let page = std::fs::read_to_string(dir.path().join("r/report.html")).unwrap();
    assert!(page.contains("2 runs at a time with 1 or 2 threads each") && page.contains(" s, 2 threads</td>"));
    let (code, _, err) = program(dir.path(), &["study", "steps.ron", "--out", "s", "--jobs", "2", "--threads", "1"]);
    assert_eq!(code, 0, "{err}");
    assert!(threads("s").1.iter().all(|(_, n)| *n == 1));
}

fn options(folder: &Path, existing: Existing) -> Options {
    Options {
        program: PathBuf::from(env!("CARGO_BIN_EXE_braid-ecs")),
        folder: folder.join("r"),
        jobs: 1,
        threads: None,
        processors: 1,
        existing,
    }
}

#[test]
fn a_stopped_study_keeps_its_rows_and_goes_on_later() {
    let dir = folder();
    let plan = plan(dir.path(), STUDY);
    let perform = |existing, stop_after: usize| -> (Done, Vec<usize>) {
        let options = options(dir.path(), existing);
        let claim = study::claim(&plan, &options).unwrap();
        assert!(matches!(study::claim(&plan, &options), Err(StudyError::Busy(_))), "one study at a time");
        let (stop, mut ended) = (AtomicBool::new(false), Vec::new());
        let done = study::perform(&plan, &options, &claim, &|| stop.load(Ordering::Relaxed), &mut |event| {
            if let Event::Ended(i, e) = event {
                assert_eq!(e.record.status, Status::Finished, "{}", e.record.message);
                ended.push(i);
                stop.store(ended.len() >= stop_after, Ordering::Relaxed);
            }
        });
        (done.unwrap(), ended)
    };
    let (done, first) = perform(Existing::Refuse, 2);
    assert!(first.len() >= 2 && done.missing == 5 - first.len(), "{first:?}");
    assert_eq!(json(&dir.path().join("r/study.json"))["state"], "interrupted");
    let (done, second) = perform(Existing::Resume, 9);
    assert_eq!((done.missing, done.failed, first.len() + second.len()), (0, 0, 5));
    assert!(first.iter().all(|i| !second.contains(i)));
    // The longest rows come first: most elements, then in the order of the study.
    let all: Vec<usize> = first.into_iter().chain(second).collect();
    assert_eq!(all, plan.order());
    assert_eq!(all[0], 4, "the row of five elements");
}

#[test]
fn a_row_that_was_stopped_goes_on_from_its_checkpoint() {
    let dir = folder();
    let long = "(scene: \"strip.ron\", rows: [(label: \"long\", set: {\"stop.time\": \"400 ms\"})], outcomes: [(name: \"tip\")])";
    let plan = plan(dir.path(), long);
    let row = dir.path().join("r/rows/long");
    let perform = |existing, stop: &(dyn Fn() -> bool + Sync)| {
        let options = options(dir.path(), existing);
        let claim = study::claim(&plan, &options).unwrap();
        study::perform(&plan, &options, &claim, stop, &mut |_| ()).unwrap()
    };
    // Stopped as soon as it tells how far it is.
    let done = perform(Existing::Refuse, &|| row.join("status.json").exists());
    assert_eq!((done.missing, done.failed), (1, 0));
    assert_eq!(json(&row.join("row.json"))["status"], "running");
    assert!(row.join("checkpoints").read_dir().unwrap().next().is_some(), "it was given the time to write one");
    // A run from the start would remove the folder.
    std::fs::write(row.join("notes.txt"), "mine").unwrap();
    let done = perform(Existing::Resume, &|| false);
    assert_eq!((done.missing, done.failed), (0, 0));
    assert!(row.join("notes.txt").exists());
    let (code, _, err) = program(dir.path(), &["strip.ron", "--set", "stop.time=400 ms", "--out", "whole", "--quiet"]);
    assert_eq!(code, 0, "{err}");
    let (broken, whole) = (json(&row.join("summary.json")), json(&dir.path().join("whole/summary.json")));
    assert_eq!((&broken["state_hash"], &broken["steps"]), (&whole["state_hash"], &whole["steps"]));
}

#[test]
fn a_folder_with_rows_of_something_else_is_left_alone() {
    let dir = folder();
    std::fs::create_dir_all(dir.path().join("r/rows/2-10_mN")).unwrap();
    for existing in [Existing::Refuse, Existing::Resume, Existing::MoveAside] {
        let error = study::claim(&plan(dir.path(), STUDY), &options(dir.path(), existing)).unwrap_err();
        assert!(error.to_string().contains("already holds"), "{error}");
    }
}

#[test]
fn the_uncertainty_of_a_row_adds_up_from_those_beside_it() {
    let dir = folder();
    let study = "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\"), (label: \"half\"), (label: \"twice\"), (label: \"seed\")],
        uncertainty: (base: [\"a\"], parts: [(name: \"places\", by: Places), (name: \"penalty\", rows: [[\"half\"], [\"twice\"]]),
            (name: \"seeds\", by: Scatter, rows: [[\"seed\"]])]))";
    let plan = plan(dir.path(), study);
    let run = |i: usize, value: f64| ended(&plan, i, 1.0, &[("tip", value, Some(0.3))]);
    let all = [run(0, 4.0), run(1, 4.1), run(2, 3.6), run(3, 4.02)];
    let found = &study::results(&plan, &all).uncertainty[0];
    // Two values 0.02 apart: s = 0.02 / sqrt 2, n = 2, Student's quantile 12.7062047.
    let wanted = [0.3, 0.4, 12.7062047 * 0.01];
    for (part, wanted) in found.parts.iter().zip(wanted) {
        assert!((part.half_width.unwrap() - wanted).abs() < 1e-7, "{part:?}");
    }
    assert!((found.combined.unwrap() - wanted.iter().map(|w| w * w).sum::<f64>().sqrt()).abs() < 1e-7 && found.complete);
    // What has not been run is not known, and the sum no more than a bound.
    let found = study::results(&plan, &[run(0, 4.0), run(1, 4.1), None, run(3, 4.0)]);
    let text = study::uncertainty_table(&found);
    assert_eq!(text, "uncertainty of tip: at least 7.50 % (places 7.50 %, penalty not known, seeds 0.00 %)");
    assert!(!found.uncertainty[0].complete);
}

#[test]
fn what_is_not_known_of_the_reference_is_told() {
    let dir = folder();
    let text = STUDY.replace("reference: [\"4\", \"*\"]", "reference: [\"as it is\"], reference_uncertainty: {\"tip\": \"60 %\"}");
    std::fs::write(dir.path().join("steps.ron"), text).unwrap();
    let (code, _, err) = program(dir.path(), &["study", "steps.ron"]);
    assert_eq!(code, 0, "{err}");
    let all = json(&dir.path().join("results/steps/study.json"));
    let tip = &all["results"]["rows"][0]["outcomes"][0];
    let size = all["results"]["rows"][4]["outcomes"][0]["value"].as_f64().unwrap();
    let difference = tip["value"].as_f64().unwrap() - size;
    assert_eq!(tip["within"], difference.abs() <= 0.6 * size.abs());
    assert!((tip["error_ci95"].as_f64().unwrap() - 0.6).abs() < 1e-12);
    assert_eq!(all["outcomes"][0]["reference_uncertainty"], 0.6);
    let page = std::fs::read_to_string(dir.path().join("results/steps/report.html")).unwrap();
    for part in ["What is not known of the reference adds up to 60.0 %", "Error against elements", "The scenes"] {
        assert!(page.contains(part), "{part} is missing");
    }
}

/// A run that ended with these measures.
fn ended(plan: &Plan, run: usize, wall_s: f64, measures: &[(&str, f64, Option<f64>)]) -> Option<Ended> {
    let mut summary = Summary { status: "converged".into(), wall_s, ..Summary::default() };
    for (name, mean, ci95) in measures {
        let n = if ci95.is_some() { 12 } else { 1 };
        summary.measures.insert((*name).into(), Measure { mean: Some(*mean), ci95: *ci95, n, unit: "mm".into() });
    }
    let record = Record { status: Status::Finished, ..Record::of(plan, &plan.runs[run], "0") };
    Some(Ended { record, summary: Some(summary) })
}

#[test]
fn errors_and_intervals_are_those_of_the_definition() {
    let dir = folder();
    let study = "(scene: \"strip.ron\", outcomes: [(name: \"tip\"), (name: \"root\", error: Scaled(2))], reference: [\"c\"],
        rows: [(label: \"a\"), (label: \"b\"), (label: \"c\")])";
    let one = plan(dir.path(), study);
    let all = [
        ended(&one, 0, 10.0, &[("tip", 3.0, Some(0.3)), ("root", -1.0, None)]),
        ended(&one, 1, 20.0, &[("tip", 4.2, Some(0.1)), ("root", 1.0, None)]),
        ended(&one, 2, 99.0, &[("tip", 4.0, Some(0.4)), ("root", 0.0, None)]),
    ];
    let r = study::results(&one, &all);
    let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-14, "{a:?} is not {b}");
    near(r.rows[0].outcomes[0].difference, -0.25);
    near(r.rows[0].outcomes[0].error_ci95, 0.5 / 4.0);
    near(r.rows[0].outcomes[1].error, 0.5);
    near(r.rows[0].cumulated, 0.75);
    near(r.rows[1].cumulated, 0.05 + 0.5);
    assert_eq!([0, 1].map(|i| r.rows[i].outcomes[0].within), [Some(false), Some(true)]);
    assert_eq!(r.rows[0].outcomes[1].within, None, "a reference without interval");
    assert_eq!(r.rows.iter().map(|r| r.front).collect::<Vec<_>>(), [true, true, false]);
    assert!(r.rows[2].is_reference && r.rows[2].cumulated.is_none());
    // A row that is missing takes its own numbers with it, a reference those of all.
    let r = study::results(&one, &[None, all[1].clone(), None]);
    assert_eq!((r.rows[0].status(), r.rows[1].status()), ("missing".into(), "converged".into()));
    assert!(r.rows.iter().all(|r| r.cumulated.is_none() && !r.front));

    // Three repetitions: Student's quantile for two degrees of freedom is 4.302652730.
    let many = plan(dir.path(), &study.replace("reference", "replicates: (seeds: [7, 8, 9]), reference"));
    assert_eq!(many.runs.len(), 9);
    assert_eq!(many.runs[4].folder, "rows/b@seed-8");
    assert_eq!(many.sets(&many.runs[4]), [("seed".to_owned(), "8".to_owned())]);
    let value = |run: usize, tip: f64| ended(&many, run, 1.0, &[("tip", tip, Some(0.5)), ("root", 0.0, None)]);
    let tips = [3.0, 3.0, 3.0, 1.0, 2.0, 3.0, 4.0, 4.0, 4.0];
    let mut all: Vec<Option<Ended>> = tips.iter().enumerate().map(|(i, t)| value(i, *t)).collect();
    let r = study::results(&many, &all);
    near(r.rows[1].outcomes[0].value, 2.0);
    assert!((r.rows[1].outcomes[0].ci95.unwrap() - 4.302652730 / 3f64.sqrt()).abs() < 1e-8);
    assert_eq!((r.rows[1].outcomes[0].n, r.rows[0].outcomes[0].ci95), (3, Some(0.0)));
    near(r.rows[1].outcomes[0].difference, -0.5);
    // One of them is missing: t(0.975, 1) = 12.706204736.
    all[5] = None;
    let r = study::results(&many, &all);
    assert_eq!(r.rows[1].status(), "2 of 3 runs");
    assert!((r.rows[1].outcomes[0].ci95.unwrap() - 12.706204736 * 0.5).abs() < 1e-7);
}

/// What is said about a study, its folder left out.
fn refuse(text: &str) -> String {
    let dir = folder();
    let name = dir.path().join("s.ron").display().to_string();
    let error = match study::load_text(&name, text.into()) {
        Err(e) => e,
        Ok(file) => Plan::new(file, &default_plugins).expect_err("refused"),
    };
    assert_eq!(error.category.exit_code(), 3);
    error.to_string().replace(&format!("{}/", dir.path().display()), "")
}

#[test]
fn mistakes_are_named_with_their_place() {
    let said = [
        (
            "",
            "s.ron: the study is empty\n  help: the smallest study is (scene: \"a.ron\", rows: [(label: \"as it is\")], outcomes: [(name: \"tip\")])",
        ),
        (
            "(scene: \"strip.ron\", rows: [(label: \"a\")], outcome: [(name: \"tip\")])",
            "s.ron:1:44: outcome: unknown field `outcome` of study\n  help: did you mean `outcomes`? valid fields: `title`, `scene`, `set`, `axes`, `rows`, `reference`, `replicates`, `outcomes`, `published`, `convergence`, `uncertainty`, `reference_uncertainty`, `max_parallel`, `pictures`, `assumptions`",
        ),
        ("(rows: [(label: \"a\")])", "s.ron:1:1: field `outcomes` of study is missing"),
        (
            "(scene: \"strip.ron\", rows: [(label: \"a\", sets: {})], outcomes: [(name: \"tip\")])",
            "s.ron:1:42: rows[0].sets: unknown field `sets` of entry\n  help: did you mean `set`? valid fields: `label`, `scene`, `set`",
        ),
        (
            "(scene: \"strip.ron\",\n outcomes: [(name: \"tip\")])",
            "s.ron:1:1: the study has no rows\n  help: give it `axes`, `rows`, or both",
        ),
        (
            "(outcomes: [(name: \"tip\")], rows: [(label: \"a\"), (label: \"a\", scene: \"strip.ron\")])",
            "s.ron:1:58: rows[1].label: row `a` is there already",
        ),
        (
            "(outcomes: [(name: \"tip\")], rows: [(label: \"a\"), (label: \"b\", scene: \"strip.ron\")])",
            "s.ron:1:36: rows[0]: row `a` has no scene\n  help: give the study a `scene`, or the row one of its own",
        ),
        (
            "(outcomes: [(name: \"tip\")], rows: [(label: \"a\", scene: \"strp.ron\")])",
            "s.ron:1:56: rows[0].scene: strp.ron: cannot read the scene: No such file or directory (os error 2)",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tpi\")], rows: [(label: \"a\")])",
            "s.ron:1:40: outcomes[0].name: row `a`: unknown measure or probe `tpi`\n  help: did you mean `tip`? known: `root`, `tip`",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")],\n rows: [(label: \"a\"), (label: \"b\", set: {\"stop.tiem\": 1})])",
            "s.ron:2:55: rows[1].set.\"stop.tiem\": row `b`: --set stop.tiem=1: there is no `stop.tiem` in this scene\n  help: did you mean `stop.time`? nearest: `stop.time`, `stop.steps`, `stop`, `stop.steady`, `ties`\ndid you mean `time`? valid fields: `time`, `steps`, `steady`",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], set: {\"polylines[0].radius\": \"1 GPa\"}, rows: [(label: \"a\"), (label: \"b\")])",
            "s.ron:1:78: set.\"polylines[0].radius\": row `a`: `GPa` is not a unit of a length; write for example \"2.5 um\"\n  help: given by --set polylines[0].radius=\"1 GPa\"",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\")], reference: [\"b\"])",
            "s.ron:1:83: reference[0]: unknown row `b`\n  help: did you mean `a`? known: `a`",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], axes: [(name: \"x\", points: [(label: \"1\")]), (name: \"y\", points: [(label: \"2\")])], reference: [\"1\"])",
            "s.ron:1:142: reference: 1 labels are given, and there are 2 axes\n  help: a row is named by one label per axis",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], axes: [(name: \"x\", points: [])], convergence: \"y\")",
            "s.ron:1:76: axes[0].points: axis `x` has no points\ns.ron:1:95: convergence: unknown axis `y`\n  help: did you mean `x`? known: `x`",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\")], replicates: (seeds: [1, 2, 1]))",
            "s.ron:1:98: replicates.seeds[2]: seed 1 is given twice: its runs would be equal to the bit",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\", set: {\"seed\": 1, \"seed\": 2})])",
            "s.ron:1:86: rows[0].set.seed: an entry of this name is there already",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\")], published: [(row: [\"a\"], source: \"b\", wall: \"3 mm\")])",
            "s.ron:1:115: published[0].wall: `mm` is not a unit of a time; write for example \"10 ms\"",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\")], uncertainty: (base: [\"b\"], parts: [(name: \"mesh\")]))",
            "s.ron:1:92: uncertainty.base[0]: unknown row `b`\n  help: did you mean `a`? known: `a`\ns.ron:1:106: uncertainty.parts[0]: part `mesh` has no rows to be found from",
        ),
        (
            "(scene: \"strip.ron\", outcomes: [(name: \"tip\")], rows: [(label: \"a\")], reference_uncertainty: {\"tp\": \"1 %\"})",
            "s.ron:1:101: reference_uncertainty.tp: unknown outcome `tp`\n  help: did you mean `tip`? known: `tip`",
        ),
    ];
    let mut wrong = Vec::new();
    for (text, message) in said {
        let found = refuse(text);
        if found != message {
            wrong.push(format!("== {text}\nexpected\n{message}\nfound\n{found}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn mangled_studies_never_panic() {
    let dir = folder();
    let name = dir.path().join("s.ron").display().to_string();
    let mut sound = 0;
    let mut read = |text: &str| match study::load_text(&name, text.into()) {
        Ok(_) => sound += 1,
        Err(e) => assert!(!e.to_string().is_empty()),
    };
    for i in (0..STUDY.len()).filter(|i| STUDY.is_char_boundary(*i)) {
        read(&STUDY[..i]);
        for bit in ["(", "]", "\"", "{", "-1", "\u{20ac}", "//", ""] {
            read(&format!("{}{bit}{}", &STUDY[..i], STUDY.get(i + 1..).unwrap_or_default()));
        }
    }
    assert!(sound > 0, "changes of comments and labels do no harm");
}

#[test]
fn the_studies_of_the_project_are_sound() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/studies");
    let mut names = Vec::new();
    for path in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "ron")) {
        let mut file = study::load(&path).unwrap_or_else(|e| panic!("{e}"));
        names.push(file.name());
        // Small models: the paths are what is looked at.
        if file.name() != "cantilever" {
            let small = [("tow.filaments", "3"), ("tow.elements", "6")].map(|(p, v)| (p.to_owned(), v.to_owned()));
            let last = file.study.axes.last_mut().map_or(Vec::new(), |a| a.points.iter_mut().map(|p| &mut p.set).collect());
            for set in last.into_iter().chain(file.study.rows.iter_mut().map(|r| &mut r.set)) {
                set.0.extend(small.clone());
            }
        }
        let plan = Plan::new(file, &default_plugins).unwrap_or_else(|e| panic!("{e}"));
        assert!(plan.rows.iter().any(|r| r.reference.is_some()), "{path:?}");
    }
    names.sort();
    assert_eq!(
        names,
        ["cantilever", "convergence", "damping", "filaments", "friction", "load", "mesh", "paper", "pattern", "reference", "thickness"]
    );
}

#[test]
fn a_study_reads_no_scene_outside_unless_asked() {
    let (dir, elsewhere) = (folder(), folder());
    let far = elsewhere.path().join("strip.ron").display().to_string();
    std::fs::write(dir.path().join("far.ron"), STUDY.replace("\"strip.ron\"", &format!("{far:?}"))).unwrap();
    let (code, _, err) = program(dir.path(), &["study", "far.ron"]);
    assert_eq!(code, 3, "{err}");
    let message =
        format!("scene: the scene `{far}` lies outside the folder of the study and the working folder\n  help: allow it with --outside");
    assert!(err.contains(&message), "{err}");
    let (code, _, err) = program(dir.path(), &["study", "far.ron", "--outside", "--jobs", "2"]);
    assert_eq!(code, 0, "{err}");
}
