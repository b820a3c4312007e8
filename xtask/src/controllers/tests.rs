//! From a plan to tables, with a program that trains in no time.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use serde_json::{Value, json};

use super::facts::tests::{facts, write_header};
use super::*;

/// Does what the program does, as far as the chore can tell: `train` saves a checkpoint, waits as long as there is a file
/// `slow`, and copies the controller that the test has made; settings are taken as they are.
const PROGRAM: &str = r#"#!/bin/sh
verb=$1; task=$2; shift
while [ $# -gt 0 ]; do
    case $1 in
        --out) out=$2 ;; --csv) csv=$2 ;; --settings) settings=$2 ;; --dry-run) verb=dry-run ;;
        --resume) echo resumed >> "$MISHANDLE_HOME/calls" ;; --action-noise) noise=$2 ;;
    esac
    shift
done
case $verb in
    -V) echo 'mishandle 0.1.0 (c0ffee)' ;;
    tasks) cat "$MISHANDLE_HOME/tasks.json" ;;
    dry-run)
        text=$(sed 's/$/\\\\n/' "$settings" | tr -d '\n')
        sed "s/SETTINGS/$text/" "$MISHANDLE_HOME/now.json" ;;
    train)
        echo "train $task" >> "$MISHANDLE_HOME/calls"
        printf '%s\n%s\n' "$(cat "$MISHANDLE_HOME/columns")" 512,1.0,-3.0,0.5,0.25,-2.0 > "$csv"
        trap 'exit 130' INT
        touch "$out.checkpoint"
        while [ -f "$MISHANDLE_HOME/slow" ]; do sleep 0.02; done
        echo 2048,4.0,-1.0,1.0,0.75,-1.0 >> "$csv"
        cp "$MISHANDLE_HOME/trained.safetensors" "$out" ;;
    curve) echo '{"training_time": {"control_steps": 64, "secs": 2.0}}' ;;
    evaluate)
        echo "evaluate $task $noise" >> "$MISHANDLE_HOME/calls"
        sed "s/NOISE/$noise/" "$MISHANDLE_HOME/found.json" ;;
    falsify) echo '{"trials": [1, 2], "falsified_trials": 1}'; exit 1 ;;
esac
"#;

const SETTINGS: &str = "[run]\ntotal_steps = 2048\n\n[episodes]\nenvironments = 16\n";

/// A home with one task and one settings file.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Bench {
        let bench = Bench { folder: tempfile::tempdir().unwrap() };
        let task = json!({ "name": "point-reaching", "variant_of": null, "success": "a", "strict": "b" });
        bench.write("tasks.json", &json!([task]).to_string());
        bench.task_hash("aa");
        bench.write("columns", &curve::COLUMNS.join(","));
        bench.finds(0.97, false);
        bench.write("experiments/training/point-reaching/ppo.toml", SETTINGS);
        bench.write("README.md", "<!-- figures: tasks -->\n<!-- end of figures -->\n");
        let marks = ["summary", "controllers", "noise", "training", "seeds", "further-seeds", "curves"];
        let page = marks.map(|name| format!("<!-- figures: {name} -->\n<!-- end of figures -->\n")).concat();
        bench.write("controllers/README.md", &page);
        bench.write("program", PROGRAM);
        fs::set_permissions(bench.path("program"), fs::Permissions::from_mode(0o755)).unwrap();
        bench.trained("trained.safetensors", |_| {});
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        home::write(&self.path(name), text.as_bytes()).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_default()
    }

    /// A task with this hash is what there is now.
    fn task_hash(&self, hash: &str) {
        let now = json!({
            "settings": "SETTINGS", "task_hash": hash, "layout_hash": "bb", "formats": { "gaussian": 2 },
        });
        self.write("now.json", &now.to_string());
    }

    /// Every evaluation finds this rate, and that starts were left out or not.
    fn finds(&self, rate: f64, leaves_out_starts: bool) {
        let estimate = json!({ "value": rate, "low": 0.85, "high": 0.98 });
        let found = json!({
            "action_noise": "NOISE", "success_rate": estimate, "strict_success_rate": estimate,
            "dangerous_behavior_rate": estimate, "task_completion_time": { "value": 14.0 },
            "leaves_out_starts": leaves_out_starts,
        });
        self.write("found.json", &found.to_string());
    }

    /// A controller as the settings ask for, but for what `change` does to it.
    fn trained(&self, name: &str, change: impl Fn(&mut Value)) {
        let mut facts = facts();
        facts["settings"] = SETTINGS.into();
        change(&mut facts);
        write_header(&self.path(name), &facts);
    }

    fn run_until(&self, line: &str, stop: &AtomicBool) -> Result<()> {
        let options = Options::parse(&line.split_whitespace().map(String::from).collect::<Vec<_>>())?;
        let home = Home::at(self.folder.path());
        let program = Program::at(&self.path("program"), &home)?;
        act(&measure::Bench { home: &home, program: &program, stop }, &options)
    }

    fn run(&self, line: &str) -> Result<()> {
        self.run_until(line, &AtomicBool::new(false))
    }

    /// How the trainings of these seeds stand.
    fn states(&self, seeds: &[usize]) -> Vec<String> {
        let home = Home::at(self.folder.path());
        let program = Program::at(&self.path("program"), &home).unwrap();
        let stop = AtomicBool::new(false);
        let bench = measure::Bench { home: &home, program: &program, stop: &stop };
        let options = Options::parse(&[]).unwrap();
        let tasks = program.tasks().unwrap();
        let standings = standings(&bench, &tasks, &options, &mut BTreeMap::new()).unwrap();
        let of = |seed: &usize| {
            let is_it = |standing: &&Standing| {
                standing.training.algorithm == "ppo" && standing.training.seed == *seed as u64
            };
            standings.iter().find(is_it).unwrap().state.to_string()
        };
        seeds.iter().map(of).collect()
    }
}

fn lines_of(page: &str, start: &str) -> Vec<String> {
    page.lines().filter(|line| line.starts_with(start)).map(String::from).collect()
}

#[test]
fn what_is_missing_is_trained_measured_and_shown_once() {
    let bench = Bench::new();
    assert_eq!(bench.states(&[0, 1]), ["to be trained: there is none"; 2]);
    bench.run("--seeds 0").unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    assert!(bench.path("controllers/point-reaching/ppo.safetensors").is_file());
    assert!(bench.path("controllers/curves/point-reaching/ppo-s0.csv").is_file());
    assert!(bench.read("controllers/curves/point-reaching.svg").contains("</svg>"));
    let left = fs::read_dir(bench.path("target/controllers")).unwrap().flatten();
    let left: Vec<String> = left.map(|entry| entry.file_name().into_string().unwrap()).collect();
    assert!(left.iter().all(|name| name.ends_with(".log") || name == "lock"), "{left:?}");
    let page = bench.read("controllers/README.md");
    let rows = lines_of(&page, "| `point-reaching` | `ppo` |");
    // The paper's PPO: SR 93, DBR 0.26, TCT 29.3; TT 10500.
    let figures = "97.0 [85.0, 98.0] | 97.0 [85.0, 98.0] | 97.00 [85.00, 98.00] | 14.0";
    assert_eq!(rows[0], format!("| `point-reaching` | `ppo` | {figures} | 93 | 0.26 | 29.3 |  | c0ffee |"));
    assert!(rows[1].contains("| 87 | 0.27 | 29.8 | 1 of 2 |"), "{}", rows[1]);
    assert_eq!(
        rows[2],
        "| `point-reaching` | `ppo` | 0 | 2048 | 1024 | 2 | 64 | 2 | 10500 | 4 | `mishandle train` | c0ffee |"
    );
    assert!(rows[3].ends_with("|  | 1, 2, 3, 4 |"), "{}", rows[3]);
    assert!(page.contains("| `point-reaching` | `ddpg` | not run |"));
    // Nothing is done twice.
    let calls = bench.read("calls");
    bench.run("--seeds 0").unwrap();
    assert_eq!(bench.read("calls"), calls);
    assert_eq!(bench.read("controllers/README.md"), page);
}

#[test]
fn what_has_changed_is_named_and_trained_again() {
    let bench = Bench::new();
    bench.run("--seeds 0").unwrap();
    let settings = "experiments/training/point-reaching/ppo.toml";
    bench.write(settings, &SETTINGS.replace("2048", "4096"));
    assert_eq!(bench.states(&[0]), ["to be trained: settings changed: run.total_steps"]);
    // The page says so, though the old figures stand.
    bench.run("--tables").unwrap();
    assert!(bench.read("controllers/README.md").contains("out of date (settings changed: run.total_steps)"));
    bench.write(settings, SETTINGS);
    assert_eq!(bench.states(&[0]), ["done"]);
    bench.task_hash("cc");
    assert_eq!(bench.states(&[0]), ["to be trained: task changed"]);
    bench.trained("trained.safetensors", |facts| facts["task_hash"] = "cc".into());
    bench.run("--seeds 0").unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    // Another formula is another measurement, not another training.
    let tasks = bench.read("tasks.json");
    bench.write("tasks.json", &tasks.replace("\"a\"", "\"c\""));
    assert_eq!(bench.states(&[0]), ["trained, to be measured"]);
    let trained = bench.read("calls").matches("train").count();
    bench.run("--seeds 0").unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    assert_eq!(bench.read("calls").matches("train").count(), trained);
}

#[test]
fn a_controller_that_does_not_name_its_task_is_adopted_and_marked() {
    let bench = Bench::new();
    let shipped = "controllers/point-reaching/ppo.safetensors";
    bench.trained(shipped, |facts| facts["task_hash"] = "".into());
    assert_eq!(bench.states(&[0]), ["trained, to be measured"]);
    bench.run("--seeds 0").unwrap();
    assert!(!bench.read("calls").contains("train"));
    assert!(bench.read("controllers/README.md").contains("c0ffee, adopted |"));
    // From then on it is of that task.
    bench.task_hash("cc");
    assert_eq!(bench.states(&[0]), ["to be trained: task changed"]);
    bench.run("--seeds 0 --adopt --measure").unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    // One that is put there by hand has no curve.
    bench.write("controllers/curves/point-reaching/ppo-s0.csv", &bench.read("columns"));
    bench.trained(shipped, |facts| facts["task_hash"] = "cc".into());
    bench.run("--seeds 0").unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    assert!(!bench.path("controllers/curves/point-reaching/ppo-s0.csv").exists());
    // One that names another task is not adopted.
    bench.trained(shipped, |facts| facts["task_hash"] = "dd".into());
    assert_eq!(bench.states(&[0]), ["to be trained: task changed"]);
}

#[test]
fn a_training_that_is_stopped_or_killed_goes_on() {
    let bench = Bench::new();
    bench.write("slow", "");
    let stop = AtomicBool::new(false);
    let checkpoint = bench.path("target/controllers/point-reaching-ppo-s0.safetensors.checkpoint");
    let stopped = thread::scope(|scope| {
        let running = scope.spawn(|| bench.run_until("--seeds 0 --only point-reaching/ppo", &stop));
        while !checkpoint.exists() && !running.is_finished() {
            thread::sleep(Duration::from_millis(5));
        }
        stop.store(true, Ordering::Relaxed);
        running.join().unwrap()
    });
    assert!(stopped.unwrap_err().to_string().contains("interrupted with 0 of 1 done"));
    assert_eq!(bench.states(&[0]), ["to be trained: there is none; interrupted at 512 steps"]);
    // A checkpoint of other settings is of no use.
    let settings = "experiments/training/point-reaching/ppo.toml";
    bench.write(settings, &SETTINGS.replace("2048", "4096"));
    assert_eq!(bench.states(&[0]), ["to be trained: there is none"]);
    bench.write(settings, SETTINGS);
    fs::remove_file(bench.path("slow")).unwrap();
    // While another process trains it, its files are left alone.
    let lock = "target/controllers/point-reaching-ppo-s0.safetensors.lock";
    let other = home::lock(&bench.path(lock)).unwrap();
    assert!(bench.run("--seeds 0").unwrap_err().to_string().contains("1 of 1 failed"));
    assert!(checkpoint.exists());
    drop(other);
    bench.run("--seeds 0").unwrap();
    assert!(bench.read("calls").contains("resumed"));
    assert_eq!(bench.states(&[0]), ["done"]);
}

#[test]
fn further_seeds_keep_their_records_and_need_no_file() {
    let bench = Bench::new();
    for (seed, rate) in [(1, 0.97), (2, 0.9)] {
        bench.finds(rate, false);
        bench.trained("trained.safetensors", |facts| facts["seed"] = seed.into());
        bench.run(&format!("--seeds {seed}")).unwrap();
    }
    assert_eq!(bench.states(&[1, 2, 3]), ["done", "done", "to be trained: there is none"]);
    let page = bench.read("controllers/README.md");
    // Of two the interquartile mean is the mean. The bars of PPO are SR 95 and with noise the paper's 87, strict SR 90.
    let spread = "93.5 | 90.0 | 97.0";
    let row =
        format!("| `point-reaching` | `ppo` | 2 | {spread} | {spread} | {spread} | 2 (SR 95) | 0, 3, 4 |");
    assert!(page.contains(&row), "{page}");
    assert!(page.contains("| `point-reaching` | `ppo` | 2 | 2048 | 1024 |"), "{page}");
    // Four of PPO, four of TRPO, two of each of the others.
    let summary = "Of 14 further seeds of the plan 2 were run, and 1 of these reach every bar; the others miss: \
                   `point-reaching` `ppo-s2` (SR 95).";
    assert!(page.contains(summary), "{page}");
    assert!(!bench.path("controllers/point-reaching").exists());
    fs::remove_file(bench.path("target/controllers/point-reaching-ppo-s1.safetensors")).unwrap();
    assert_eq!(bench.states(&[1]), ["done"]);
    // Other formulas cannot be measured of a controller that is gone.
    let tasks = bench.read("tasks.json");
    bench.write("tasks.json", &tasks.replace("\"a\"", "\"c\""));
    let gone = "to be trained: the measurement has changed, and its controller was not kept";
    assert_eq!(bench.states(&[1, 2]), [gone, "trained, to be measured"]);
}

#[test]
fn what_was_trained_elsewhere_is_checked_as_if_it_were_ours() {
    let bench = Bench::new();
    let folder = bench.path("elsewhere");
    let import = format!("--import {}", folder.display());
    let rows = |last: u64| {
        format!("{}\n512,1.0,-3.0,0.5,0.25,-2.0\n{last},4.0,-1.0,1.0,0.75,-1.0\n", curve::COLUMNS.join(","))
    };
    let others = SETTINGS.replace("16", "32");
    for (key, value, last) in [
        ("seed", json!(3), 2048),
        ("task_hash", json!("cc"), 2048),
        ("settings", json!(others), 2048),
        ("command", json!("an unfinished one"), 1024),
    ] {
        bench.trained("elsewhere/point-reaching-ppo-s0.safetensors", |facts| facts[key] = value.clone());
        bench.write("elsewhere/point-reaching-ppo-s0.csv", &rows(last));
        let error = bench.run(&import).unwrap_err().to_string();
        assert!(error.starts_with("1 of the trainings"), "{key}: {error}");
        assert_eq!(bench.states(&[0]), ["to be trained: there is none"], "{key}");
        assert!(!bench.path("controllers/point-reaching").exists(), "{key}");
    }
    bench.write("elsewhere/point-reaching-ppo-s0.csv", &rows(2048));
    bench.run(&import).unwrap();
    assert_eq!(bench.states(&[0]), ["done"]);
    assert!(!bench.read("calls").contains("train"));
    // One that is there is taken in again for its curve alone, if that is missing.
    let (kept, calls) = (bench.path("controllers/curves/point-reaching/ppo-s0.csv"), bench.read("calls"));
    let measured = |calls: &str| calls.matches("evaluate").count();
    bench.run(&import).unwrap();
    assert_eq!(measured(&bench.read("calls")), measured(&calls));
    fs::remove_file(&kept).unwrap();
    bench.run(&import).unwrap();
    assert!(kept.is_file());
    assert!(Path::new(&folder).join("point-reaching-ppo-s0.safetensors").is_file(), "it is not taken away");
}

#[test]
fn where_starts_are_left_out_the_whole_box_is_shown_too() {
    let bench = Bench::new();
    bench.finds(0.97, true);
    bench.run("--seeds 0").unwrap();
    let page = bench.read("controllers/README.md");
    assert_eq!(lines_of(&page, "| `point-reaching` | `ppo`, whole box | 97.0 [85.0, 98.0] |").len(), 2);
    assert_eq!(bench.read("calls").matches("evaluate").count(), 4);
}

#[test]
fn a_training_that_fails_is_named_and_ends_no_other() {
    let bench = Bench::new();
    bench.write("experiments/training/point-reaching/trpo.toml", SETTINGS);
    // What the program gives is PPO's.
    let error = bench.run("--seeds 0 --jobs 1").unwrap_err().to_string();
    assert_eq!(error, "1 of 2 failed; the others are done");
    assert_eq!(bench.states(&[0]), ["done"]);
}

#[test]
fn an_expert_is_measured_once_and_trained_never() {
    let bench = Bench::new();
    bench.run("--only point-reaching/expert").unwrap();
    bench.run("--only point-reaching/expert").unwrap();
    assert_eq!(bench.read("calls").lines().count(), measure::NOISE.len());
    let rows = lines_of(&bench.read("controllers/README.md"), "| `point-reaching` | `expert` | 97.0");
    assert_eq!(rows.len(), measure::NOISE.len());
    assert!(
        bench.run("--only point-reaching/expret").unwrap_err().to_string().contains("nothing in the plan")
    );
}
