//! A run that is stopped, killed or out of disk goes on as if nothing had happened.
#[path = "support/program.rs"]
mod program;
use braid_ecs::checkpoint::{Checkpoint, SceneHash};
use program::{Bench, Done, assert_same, done, summary};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

fn scene(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).display().to_string()
}

/// Two wires in contact with friction: rows and frames at times that fall between those of a stop, a probe that
/// remembers, a checkpoint every few hundredths of a second.
fn wires(more: &[&'static str]) -> Vec<String> {
    let sets = [
        "stop.time=1.2 ms",
        "output.history=Count(30)",
        "output.frames=Count(7)",
        "output.checkpoint=0.05 s",
        "probes.deepest=Max(MaxPenetration)",
        "probes.lowest=Min(Displacement(node: \"below.0[2]\", component: Z))",
    ];
    let sets = sets.iter().chain(more).flat_map(|s| ["--set".to_string(), s.to_string()]);
    [scene("two_filaments.ron")].into_iter().chain(sets).collect()
}

fn run(bench: &Bench, scene: &[String], more: &[&str]) -> Done {
    let mut all: Vec<&str> = scene.iter().map(String::as_str).collect();
    all.extend(more);
    bench.run(&all)
}

/// Runs without a break; into `whole`.
fn unbroken(bench: &Bench, scene: &[String]) {
    let d = run(bench, scene, &["--out", "whole", "--threads", "1"]);
    assert_eq!(d.code, Some(0), "{}", d.err);
}

/// Runs, is stopped by its time limit, and resumes: after its first steps, after a few more, then (on a machine
/// that is not too fast) somewhere in the middle; then to the end. Tells how often it was stopped.
fn in_pieces(bench: &Bench, scene: &[String], middle: &str, folder: &str, threads: [&str; 2]) -> usize {
    let limits = ["1 ms", "1 ms", middle];
    let mut last = run(bench, scene, &["--out", folder, "--threads", threads[0], "--time-limit", limits[0]]);
    let mut stops = 0;
    while last.code == Some(75) {
        assert!(last.err.contains(&format!("braid-ecs resume {folder}")), "{}", last.err);
        assert_eq!(summary(&bench.path(folder))["status"], "stopped");
        stops += 1;
        let limit = limits.get(stops).map_or(vec![], |limit| vec!["--time-limit", *limit]);
        last = bench.run(&[&["resume", folder, "--threads", threads[stops % 2]], &limit[..]].concat());
    }
    assert_eq!(last.code, Some(0), "{}", last.err);
    stops
}

#[test]
fn a_run_in_pieces_leaves_the_files_of_an_unbroken_one() {
    let bench = Bench::new();
    let wires = wires(&[]);
    unbroken(&bench, &wires);
    for (folder, threads) in [("one", ["1", "1"]), ("changing", ["2", "1"])] {
        let stops = in_pieces(&bench, &wires, "0.08 s", folder, threads);
        assert!(stops >= 2, "stopped {stops} times");
        assert_same(&bench.path("whole"), &bench.path(folder), folder);
        // Only the last checkpoint is left of all.
        let mut left: Vec<_> = std::fs::read_dir(bench.path(folder).join("checkpoints")).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left, ["end.ckpt", "lock", "scene.ron"]);
    }
}

#[test]
fn a_braid_on_its_mandrel_and_periodic_trusses_go_on_too() {
    let bench = Bench::new();
    let cases: [(&str, &str, &[&str]); 2] = [
        (
            "embedded7.ron",
            "0.5 s",
            &["load.stroke=0.05 mm", "tow.elements=7", "stop=(steps: 800)", "output.history=Steps(70)", "output.pictures=false"],
        ),
        (
            "lattice_pbc.ron",
            "0.04 s",
            &["stop=(steps: 6000)", "output.history=Steps(7)", "output.frames=Steps(500)", "output.pictures=false"],
        ),
    ];
    for (name, limit, sets) in cases {
        let sets = sets.iter().flat_map(|s| ["--set".to_string(), s.to_string()]);
        let scene: Vec<String> = [scene(name)].into_iter().chain(sets).collect();
        let whole = run(&bench, &scene, &["--out", &format!("{name}.whole"), "--threads", "2"]);
        assert_eq!(whole.code, Some(0), "{}", whole.err);
        let stops = in_pieces(&bench, &scene, limit, name, ["1", "2"]);
        assert!(stops >= 2, "{name} was stopped {stops} times");
        assert_same(&bench.path(&format!("{name}.whole")), &bench.path(name), name);
    }
}

/// Kills a run, and then its resumed rest; `BRAID_KILLS` tells how many times, over a run that is then longer.
#[test]
fn killed_at_any_moment_it_ends_with_the_same_bits() {
    let kills: u64 = std::env::var("BRAID_KILLS").map_or(12, |n| n.parse().expect("a number of kills"));
    let bench = Bench::new();
    let wires = wires(&["stop.time=4 ms", "output.pictures=false"]);
    let begin = Instant::now();
    unbroken(&bench, &wires);
    let whole = begin.elapsed();
    let (mut killed, mut resumed) = (0, 0);
    for i in 0.. {
        if killed >= kills {
            break;
        }
        assert!(i < 10 * kills, "runs end before they are killed");
        let folder = format!("killed{i}");
        let mut all: Vec<&str> = wires.iter().map(String::as_str).collect();
        all.extend(["--quiet", "--threads", "1", "--out", &folder]);
        let mut child = bench.start(&all);
        let first = bench.path(&folder).join("checkpoints/a.ckpt");
        while !first.exists() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        for again in 0..3 {
            if again < 2 {
                // Moments that spread over the run: multiples of the golden section, which repeat nowhere.
                let share = ((2 * i + again) as f64 * 0.618_033_988_749_895).fract();
                std::thread::sleep(whole.mul_f64(0.6 * share));
                child.kill().unwrap();
            }
            let end = done(child);
            if end.code.is_some() {
                assert_eq!(end.code, Some(0), "{}", end.err);
                break;
            }
            killed += 1;
            resumed += 1;
            let more: &[&str] = if again == 0 { &[] } else { &["--threads", "2"] };
            child = bench.start(&[&["resume", folder.as_str(), "--quiet"], more].concat());
        }
        assert_same(&bench.path("whole"), &bench.path(&folder), &folder);
        std::fs::remove_dir_all(bench.path(&folder)).unwrap();
    }
    println!("{killed} kills, {resumed} resumed runs: the same files");
}

#[test]
fn signals_and_commands_stop_a_run_in_order() {
    let bench = Bench::new();
    let wires = wires(&["stop.time=4 ms", "output.checkpoint=None", "output.frames=Never", "output.pictures=false"]);
    unbroken(&bench, &wires);
    let whole = summary(&bench.path("whole"));
    for signal in ["-INT", "-TERM"] {
        let folder = format!("after{signal}");
        let mut all: Vec<&str> = wires.iter().map(String::as_str).collect();
        all.extend(["--out", &folder, "--threads", "1"]);
        let child = bench.start(&all);
        wait_for(&bench.path(&folder).join("status.json"));
        let told = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill");
        assert!(told.success());
        let d = done(child);
        assert_eq!(d.code, Some(75), "{signal}: {}", d.err);
        let checkpoints = bench.path(&folder).join("checkpoints");
        assert!(checkpoints.join("stopped.ckpt").exists() && !checkpoints.join("a.ckpt").exists());
        bench.expect(0, &["resume", &folder]);
        assert_eq!(summary(&bench.path(&folder))["state_hash"], whole["state_hash"]);
    }
}

#[test]
fn a_run_tells_how_far_it_is_and_does_what_it_is_told() {
    let bench = Bench::new();
    // Longer than the test takes.
    let wires = wires(&["stop.time=100 s", "output.frames=Never", "output.pictures=false"]);
    let mut all: Vec<&str> = wires.iter().map(String::as_str).collect();
    all.extend(["--out", "r", "--threads", "1"]);
    let child = bench.start(&all);
    wait_for(&bench.path("r/status.json"));
    let line = bench.expect(0, &["status", "r"]).out;
    assert!(line.contains("two_filaments: running") && line.contains("step "), "{line}");
    let busy = bench.expect(4, &["resume", "r"]).err;
    assert!(busy.contains("still going on"), "{busy}");
    let busy = bench.expect(4, &[wires[0].as_str(), "--out", "r", "--force"]).err;
    assert!(busy.contains("still going on"), "{busy}");
    bench.expect(0, &["ctl", "r", "frame"]);
    wait_for(&bench.path("r/frames/0000.vtp"));
    bench.expect(0, &["ctl", "r", "checkpoint"]);
    bench.expect(0, &["ctl", "r", "stop"]);
    let d = done(child);
    assert_eq!(d.code, Some(75), "{}", d.err);
    assert!(d.err.contains("frame at t") && d.err.contains("checkpoint at t") && d.err.contains("stopped at t"), "{}", d.err);
    let status: serde_json::Value = serde_json::from_slice(&std::fs::read(bench.path("r/status.json")).unwrap()).unwrap();
    assert_eq!(status["state"], "stopped");
    assert!(status["progress"].as_f64().unwrap() > 0.0 && status["energy"]["external_work"].is_f64(), "{status}");
    assert!(bench.expect(0, &["status", "r", "--watch"]).out.contains("stopped"), "it ends with the run");
    let idle = bench.expect(4, &["ctl", "r", "stop"]).err;
    assert!(idle.contains("no run is going on"), "{idle}");
    assert!(!bench.path("r/control").exists());
    assert!(bench.expect(4, &["status", "nowhere"]).err.contains("status.json"));
}

#[test]
fn a_run_that_is_over_says_so_and_can_run_on() {
    let bench = Bench::new();
    let wires = wires(&["output.pictures=false"]);
    unbroken(&bench, &wires);
    let before = program::outputs(&bench.path("whole"));
    let over = bench.expect(0, &["resume", "whole"]);
    assert!(over.out.contains("is over: completed") && over.out.contains("--until"), "{}", over.out);
    assert_eq!(program::outputs(&bench.path("whole")), before, "nothing has changed");
    let past = bench.expect(2, &["resume", "whole", "--until", "1 ms"]).err;
    assert!(past.contains("already"), "{past}");
    assert!(bench.expect(2, &["resume", "whole", "--until", "1 mm"]).err.contains("time"));
    // A stop on the way does not forget the end that was asked for.
    bench.expect(75, &["resume", "whole", "--until", "1.6 ms", "--threads", "1", "--time-limit", "2 ms"]);
    bench.expect(0, &["resume", "whole", "--threads", "1"]);
    let mut longer = wires.clone();
    longer.extend(["--set".into(), "stop.time=1.6 ms".into()]);
    assert_eq!(run(&bench, &longer, &["--out", "longer", "--threads", "1"]).code, Some(0));
    assert_eq!(summary(&bench.path("whole"))["state_hash"], summary(&bench.path("longer"))["state_hash"]);
    let old = bench.expect(4, &["resume", "longer/checkpoints"]).err;
    assert!(old.contains("not the output folder of a run"), "{old}");
}

#[test]
fn frames_that_were_tidied_away_do_not_end_a_run() {
    let bench = Bench::new();
    let wires = wires(&[]);
    let stopped = run(&bench, &wires, &["--out", "r", "--time-limit", "1 ms"]);
    assert_eq!(stopped.code, Some(75), "{}", stopped.err);
    std::fs::remove_dir_all(bench.path("r/frames")).unwrap();
    let resumed = bench.run(&["resume", "r"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    assert!(bench.path("r/frames/0006.vtp").exists());
}

#[test]
fn checkpoints_that_cannot_be_used_are_refused_with_the_reason() {
    let bench = Bench::new();
    let wires = wires(&["stop.time=4 ms", "output.checkpoint=0.01 s", "output.frames=Never", "output.pictures=false"]);
    unbroken(&bench, &wires);
    let hash = summary(&bench.path("whole"))["state_hash"].clone();
    let stopped = run(&bench, &wires, &["--out", "r", "--threads", "1", "--time-limit", "0.06 s"]);
    assert_eq!(stopped.code, Some(75), "{}", stopped.err);
    let folder = bench.path("r/checkpoints");
    let newest = folder.join("stopped.ckpt");
    let good = std::fs::read(&newest).unwrap();
    assert!(folder.join("a.ckpt").exists() && folder.join("b.ckpt").exists(), "the ring");
    let saved = bench.path("saved");
    copy(&bench.path("r"), &saved);
    let fresh = || {
        std::fs::remove_dir_all(bench.path("r")).unwrap();
        copy(&saved, &bench.path("r"));
    };

    // Damaged: an older one is used, and ends with the same bits.
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 4;
    for (bytes, reason) in [(flipped, "checksum"), (good[..good.len() - 100].to_vec(), "checksum"), (Vec::new(), "0 bytes long")] {
        fresh();
        std::fs::write(&newest, bytes).unwrap();
        let d = bench.expect(0, &["resume", "r"]);
        assert!(d.err.contains("stopped.ckpt") && d.err.contains("is damaged") && d.err.contains(reason), "{}", d.err);
        assert!(d.err.contains("an older checkpoint is used"), "{}", d.err);
        assert_same(&bench.path("whole"), &bench.path("r"), reason);
    }

    // Another version of the program or of the format, another scene: refused, an older one is offered.
    let scene = std::fs::read_to_string(folder.join("scene.ron")).unwrap();
    let other = |change: &dyn Fn(&mut Checkpoint)| {
        let mut c = Checkpoint::decode(&good, SceneHash::of(&scene)).unwrap();
        change(&mut c);
        c.encode().unwrap()
    };
    let mut format = good[..good.len() - 32].to_vec();
    format[8] = 99;
    let sum = *blake3::hash(&format).as_bytes();
    format.extend(sum);
    let cases = [
        (other(&|c| c.header.program = "99.0.0".into()), "written by braid-ecs 99.0.0"),
        (other(&|c| c.header.scene_hash = SceneHash::of("other")), "belongs to another scene"),
        (format, "format version 99"),
    ];
    for (bytes, reason) in cases {
        fresh();
        std::fs::write(&newest, bytes).unwrap();
        let before = program::outputs(&bench.path("r"));
        let d = bench.expect(4, &["resume", "r"]);
        assert!(d.err.contains("stopped.ckpt") && d.err.contains(reason), "{}", d.err);
        assert_eq!(program::outputs(&bench.path("r")), before, "a refusal changes nothing");
        let offered = d.err.split("--from ").nth(1).expect("an offer").trim().to_string();
        bench.expect(0, &["resume", "r", "--from", &offered]);
        assert_eq!(summary(&bench.path("r"))["state_hash"], hash);
    }

    // The scene of the folder was changed, or nothing is good.
    fresh();
    std::fs::write(folder.join("scene.ron"), scene.replace("0.3", "0.4")).unwrap();
    let d = bench.expect(4, &["resume", "r"]);
    assert!(d.err.contains("another scene"), "{}", d.err);
    fresh();
    for name in ["a.ckpt", "b.ckpt", "stopped.ckpt"] {
        std::fs::write(folder.join(name), b"braidckp").unwrap();
    }
    let d = bench.expect(4, &["resume", "r"]);
    assert!(d.err.contains("is damaged") && d.err.contains("start the run again"), "{}", d.err);
    // The history was cut.
    fresh();
    std::fs::write(bench.path("r/history.csv"), "# gone\n").unwrap();
    let d = bench.expect(4, &["resume", "r"]);
    assert!(d.err.contains("history.csv") && d.err.contains("its end is lost"), "{}", d.err);
}

#[test]
fn a_checkpoint_that_cannot_be_written_ends_the_run_and_spares_the_others() {
    let bench = Bench::new();
    let wires = wires(&["stop.time=3 ms", "output.checkpoint=0.02 s", "output.frames=Never", "output.pictures=false"]);
    unbroken(&bench, &wires);
    let stopped = run(&bench, &wires, &["--out", "r", "--threads", "1", "--time-limit", "5 ms"]);
    assert_eq!(stopped.code, Some(75), "{}", stopped.err);
    // Whatever comes next, its temporary file cannot be made.
    for name in ["a.ckpt.part", "b.ckpt.part"] {
        std::fs::create_dir(bench.path("r/checkpoints").join(name)).unwrap();
    }
    let d = bench.expect(4, &["resume", "r", "--threads", "1"]);
    assert!(d.err.contains("cannot write") && d.err.contains(".ckpt"), "{}", d.err);
    assert!(bench.expect(0, &["status", "r"]).out.contains("failed"));
    for name in ["a.ckpt.part", "b.ckpt.part"] {
        std::fs::remove_dir(bench.path("r/checkpoints").join(name)).unwrap();
    }
    bench.expect(0, &["resume", "r", "--threads", "1"]);
    assert_same(&bench.path("whole"), &bench.path("r"), "after the disk had room again");
}

fn wait_for(path: &Path) {
    let begin = Instant::now();
    while !path.exists() {
        assert!(begin.elapsed() < Duration::from_secs(20), "{} does not come", path.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn copy(from: &Path, to: &Path) {
    let mut folders: Vec<PathBuf> = vec![PathBuf::new()];
    while let Some(at) = folders.pop() {
        std::fs::create_dir_all(to.join(&at)).unwrap();
        for entry in std::fs::read_dir(from.join(&at)).unwrap() {
            let name = at.join(entry.unwrap().file_name());
            if from.join(&name).is_dir() {
                folders.push(name);
            } else {
                std::fs::copy(from.join(&name), to.join(&name)).unwrap();
            }
        }
    }
}
