//! `mishandle show` and `regress`: failure modes, exported counterexamples and regression suites.

use crate::bench;
use std::path::Path;
use std::process::Command;

use crate::bench::{Bench, text, unwrapped};
use mishandle::controllers::Policy;
use mishandle::store::{IfExists, RunFile, RunWriter};
use serde_json::Value;

/// Falsifies a toy and exports its counterexamples to `suite`.
fn suite() -> Bench {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --seed 2 --search nelder-mead --trials 3 --out run.sqlite", 1);
    bench.check("regress suite --add run.sqlite -k regress.all=true", 0);
    bench
}

fn read(bench: &Bench, name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(bench.path(name)).unwrap()).unwrap()
}

fn write(bench: &Bench, name: &str, document: &Value) {
    bench.write(name, &serde_json::to_string_pretty(document).unwrap());
}

/// Parses XML with Python, and returns the text of `expression` over the root `root`.
fn xml(path: &Path, expression: &str) -> String {
    let script = format!(
        "import sys, xml.etree.ElementTree as e\nroot = e.parse(sys.argv[1]).getroot()\nprint({expression})"
    );
    let output = Command::new("python3").args(["-c", &script]).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout).trim().to_string()
}

#[test]
fn modes_list_all_counterexamples_and_their_representative_is_one() {
    let bench = suite();
    let listed = bench.json("show run.sqlite --json", 0)["counterexamples"].clone();
    let modes = listed["modes"].as_array().unwrap();
    let failures: u64 = modes.iter().map(|mode| mode["failures"].as_u64().unwrap()).sum();
    assert_eq!((failures, &listed["failures"]), (3, &3.into()));
    let trial = &modes[0]["trial"];
    let simulation = &modes[0]["simulation"];
    let replayed =
        bench.json(&format!("replay run.sqlite --trial {trial} --simulation {simulation} --json"), 0);
    for key in ["robustness", "scenario", "seed"] {
        assert_eq!(modes[0][key], replayed[key]);
    }
    // The root mean square of x/2 and y/2, since nominal is 0 and the width 2 m.
    let at = |axis: &str| modes[0]["scenario"][axis].as_f64().unwrap() / 2.0;
    let distance = ((at("x").powi(2) + at("y").powi(2)) / 2.0).sqrt();
    assert!((modes[0]["distance_from_nominal"].as_f64().unwrap() - distance).abs() < 1e-12);
}

#[test]
fn a_replay_says_the_same_scenario_of_a_run_and_of_its_exported_counterexample() {
    let bench = Bench::new();
    let asked =
        "falsify point-reaching --controller ppo --space starts+faults-sensing --search random --trials 1";
    let said = bench.check(&format!("{asked} --budget 60 --seed 1 --out run.sqlite"), 1);
    assert!(
        unwrapped(&said)
            .contains("remains with half the physics step, another collision algorithm and the start"),
        "{said}"
    );
    let output = bench.run("regress suite --add run.sqlite -k regress.all=true");
    assert!(output.status.success(), "{}", text(&output.stderr));
    // Announced before they run.
    let message = text(&output.stderr);
    assert!(
        message.contains("checking the physics of 1 counterexample with at most 3 simulations"),
        "{message}"
    );
    let physics = &read(&bench, "suite/run-mode-1.json")["physics"];
    assert_eq!(physics["depends_on_solver"], false);
    let changes: Vec<&Value> =
        physics["simulations"].as_array().unwrap().iter().map(|simulation| &simulation["change"]).collect();
    assert_eq!(changes, ["half step", "other collider", "moved start"]);
    let scenario = |said: String| {
        let (_, from_axis) = said.split_once("target_x").unwrap();
        from_axis.to_string()
    };
    let of_run = scenario(bench.check("replay run.sqlite", 0));
    assert_eq!(scenario(bench.check("replay suite/run-mode-1.json", 0)), of_run);
    // The name of a category, and not its number.
    assert!(of_run.contains("sensor_fault_channel = all"), "{of_run}");
}

#[test]
fn an_exported_counterexample_replays_in_every_folder_and_a_changed_one_is_reported() {
    let bench = suite();
    let recorded = read(&bench, "suite/run-mode-1.json");
    let replayed = bench.json("replay suite/run-mode-1.json --json", 0);
    assert_eq!(replayed["robustness"], recorded["expected"]["robustness"]);
    let elsewhere = Bench::new();
    write(&elsewhere, "a.json", &recorded);
    elsewhere.check("replay a.json", 0);
    elsewhere.check("show a.json", 1);
    let change = |pointer: &str, to: Value| {
        let mut changed = recorded.clone();
        *changed.pointer_mut(pointer).unwrap() = to;
        write(&elsewhere, "b.json", &changed);
        elsewhere.run("replay b.json")
    };
    for (pointer, to, part) in [
        ("/expected/robustness", (-0.25).into(), "robustness: recorded -0.25"),
        ("/expected/steps", 2.into(), "number of control steps: recorded 2"),
        ("/expected/trace_digest", "0".repeat(32).into(), "digest of the trace"),
        ("/decisive/sample", 1.into(), "decisive predicate"),
        ("/target/hash", "41d0".into(), "target: recorded"),
        ("/scenario/0/unit", "km".into(), "scenario: recorded"),
        ("/scenario/0/axis", "z".into(), "the counterexample has the axes z, y"),
        ("/target/name", "cart-pole".into(), "runs of Python code"),
        ("/counterexample_format", 7.into(), "use a newer Mishandle"),
    ] {
        let output = change(pointer, to);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(part), "{message}");
    }
    let output = change("/build/git_commit", "0123".into());
    assert!(output.status.success() && text(&output.stderr).contains("recorded commit 0123, now"));
    elsewhere.refuses("replay a.json --trial 1", &["--trial and --simulation select"]);
    bench.refuses("regress --add run.sqlite --out suite/run-mode-1.json", &["exists already"]);
    bench.refuses(
        "regress --add run.sqlite -k regress.mode=99 --out a.json",
        &["there is no failure mode 99"],
    );
    bench.refuses(
        "regress --add run.sqlite -k regress.simulation=1 --out a.json",
        &["violates the requirement"],
    );
}

#[test]
fn a_minimized_counterexample_is_on_the_boundary_and_replays() {
    let bench = suite();
    let exported = bench.json("regress --add run.sqlite -k regress.minimize=true --json --out min.json", 0);
    let document = read(&bench, "min.json");
    let at = |index: usize| document["scenario"][index]["value"].as_f64().unwrap();
    // The requirement is a distance of 0.1 m from (0.3, -0.4), and 1 % of the width is 0.02 m.
    let distance = |x: f64, y: f64| (x - 0.3).hypot(y + 0.4);
    assert!(distance(at(0), at(1)) < 0.1);
    assert!(distance(at(0) - 0.02, at(1)) >= 0.1 && distance(at(0), at(1) + 0.02) >= 0.1, "{document}");
    let minimized = &exported["files"][0]["minimized"];
    assert_eq!(minimized["axes_off_nominal"], serde_json::json!([2, 2]));
    assert_eq!((&minimized["complete"], &minimized["repeats"]), (&true.into(), &Value::Null));
    assert_eq!(document["minimized_from"]["scenario"][0], minimized["scenario"]["x"]);
    bench.check("replay min.json", 0);
    let budget =
        bench.check("regress --add run.sqlite -k regress.minimize=true -k regress.budget=4 --out b.json", 0);
    assert!(budget.contains("the budget ended"), "{budget}");
}

/// Fails early from 0.7 on, and late from 0.3 to 0.5; nominal is 0.
const TWO_MODES: &str = r#"
import json, sys
HELLO = {"protocol": 1, "name": "two", "control_dt": 0.1, "steps": 10, "signals": [{"name": "m"}],
         "axes": [{"name": "x", "low": 0, "high": 1, "nominal": 0, "kind": "start"}],
         "formulas": [{"name": "success", "text": "always(m >= 0)"}]}
for line in sys.stdin:
    q = json.loads(line)
    x = q.get("scenario", {}).get("x", 0)
    first = 2 if x >= 0.7 else 8 if 0.3 <= x < 0.5 else 11
    answer = HELLO if q["type"] == "hello" else {"trace": {"m": [-1 if i >= first else 1 for i in range(11)]}}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

/// Each mode keeps a test of its own: a minimized failure is at the edge of its band.
#[test]
fn a_minimized_counterexample_stays_in_its_mode() {
    let bench = Bench::new();
    bench.write("s.py", TWO_MODES);
    let keys = "-k falsify.keep-going=true --search random --trials 1 --budget 60";
    bench.check(&format!("falsify --command 'python3 s.py' {keys} --out run.sqlite"), 1);
    let add = "regress suite --add run.sqlite -k regress.all=true -k regress.minimize=true --json";
    let output = bench.command(add).env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
    let exported: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)));
    let files = exported["files"].as_array().unwrap();
    let mut edges: Vec<f64> = Vec::new();
    for file in files {
        let x = |scenario: &Value| scenario["x"].as_f64().unwrap();
        let edge = if x(&file["minimized"]["scenario"]) >= 0.7 { 0.7 } else { 0.3 };
        assert!((edge..edge + 0.011).contains(&x(&file["scenario"])) && file["file"].is_string(), "{file}");
        edges.push(edge);
    }
    edges.sort_by(f64::total_cmp);
    assert_eq!(edges, [0.3, 0.7]);
}

#[test]
fn junit_reports_passes_failures_and_errors_for_any_names() {
    let bench = suite();
    bench.refuses("regress .", &["there is no counterexample (*.json) in ."]);
    // A scenario that passes: the exported file claims a failure at a safe point.
    let mut safe = read(&bench, "suite/run-mode-1.json");
    safe["scenario"][0]["value"] = (-0.5).into();
    write(&bench, "suite/safe.json", &safe);
    let table = bench.check("regress suite --junit report.xml", 1);
    assert!(table.contains("1 pass, 1 still fail, 0 errors"), "{table}");
    let counts = "[root[0].get(k) for k in ('tests', 'failures', 'errors')]";
    assert_eq!(xml(&bench.path("report.xml"), counts), "['2', '1', '0']");
    let failure = xml(&bench.path("report.xml"), "root.find('.//failure').get('message')");
    assert!(failure.contains("distance >= 0.1 at step 0: distance is 0.0"), "{failure}");
    std::fs::remove_file(bench.path("suite/run-mode-1.json")).unwrap();
    bench.check("regress suite", 0);
    // Names and contents that are not XML.
    let name = "suite/<a>&\"b'\u{1b}[2J\u{202e}\n.json";
    bench.write(name, "{\"counterexample_format\": 1, \"\\u001b]]><\": 1}");
    let output = bench.run("regress suite --junit report.xml");
    assert_eq!(output.status.code(), Some(2));
    let printed = text(&output.stdout) + &text(&output.stderr);
    assert!(printed.contains("error") && !printed.contains('\u{1b}') && !printed.contains('\u{202e}'));
    assert_eq!(xml(&bench.path("report.xml"), counts), "['2', '0', '1']");
    let name = xml(&bench.path("report.xml"), "[c.get('name') for c in root.iter('testcase')][0]");
    assert_eq!(name, "<a>&\"b'\\u{1b}[2J\\u{202e}\\n");
}

#[test]
fn repeats_decide_a_test_of_a_random_target_by_its_failure_rate() {
    let bench = Bench::new();
    bench.check("falsify toy/noisy --trials 1 --budget 200 --seed 1 -k report.repeats=0 --out run.sqlite", 1);
    bench.check("regress --add run.sqlite --out suite.json", 0);
    std::fs::create_dir(bench.path("suite")).unwrap();
    std::fs::rename(bench.path("suite.json"), bench.path("suite/a.json")).unwrap();
    let tests =
        |flags: &str, code| bench.json(&format!("regress suite --json {flags}"), code)["tests"][0].clone();
    assert!(tests("", 1)["repeats"].is_null());
    let repeated = tests("--repeat 200", 1);
    let rate = repeated["repeats"]["failure_rate"]["value"].as_f64().unwrap();
    // The noise has a standard deviation of 0.1; the search found a place within three of it.
    assert!(rate > 0.0 && rate < 1.0, "{rate}");
    assert_eq!(tests(&format!("--repeat 200 -k regress.max-failure-rate={rate}"), 0)["result"], "passes");
    assert_eq!(tests("--repeat 200 -k regress.max-failure-rate=1", 0)["repeats"], repeated["repeats"]);
}

/// Returns the shipped controller of point-reaching with the bias of its last layer changed.
fn worse(bench: &Bench, name: &str, bias: f32) {
    let mut file = mishandle::resolve::find_controller("point-reaching/ppo").unwrap().controller().unwrap();
    let mut network = file.policy.network().clone();
    let outputs = network.output_size();
    network.update(|parameters| {
        let from = parameters.len() - outputs;
        parameters[from..].iter_mut().for_each(|parameter| *parameter += bias);
    });
    let policy = &file.policy;
    let log_std = policy.log_std().to_vec();
    file.policy = Policy::new(policy.mean().to_vec(), policy.variance().to_vec(), network, log_std).unwrap();
    file.save(&bench.path(name)).unwrap();
}

#[test]
fn a_controller_made_worse_on_purpose_is_caught() {
    let bench = Bench::new();
    worse(&bench, "worse.safetensors", 1.0);
    bench.check(
        "falsify point-reaching --controller ./worse.safetensors --trials 2 --budget 64 --out run.sqlite",
        1,
    );
    bench.check("regress suite --add run.sqlite -k regress.all=true", 0);
    let shown = bench.run("show suite");
    assert!(text(&shown.stderr).contains("`mishandle regress suite`"), "{}", text(&shown.stderr));
    // The controller has the same file name in the suite, and no path of this machine is in it.
    let document = read(&bench, "suite/run-mode-1.json");
    assert_eq!(document["controller"], "./worse.safetensors");
    assert!(!document.to_string().contains(bench.path("").to_str().unwrap()));
    bench.refuses("replay suite/run-mode-1.json", &["suite/worse.safetensors", "-k engine.controller=FILE"]);
    bench.check("replay suite/run-mode-1.json -k engine.controller=./worse.safetensors", 0);
    std::fs::copy(bench.path("worse.safetensors"), bench.path("suite/worse.safetensors")).unwrap();
    bench.check("replay suite/run-mode-1.json", 0);
    bench.refuses(
        "replay suite/run-mode-1.json -k engine.controller=ppo",
        &["is not the controller of the run"],
    );
    // The shipped controller passes, the worse ones fail.
    bench.check("regress suite --controller ppo", 0);
    bench.check("regress suite", 1);
    let mut changed = document.clone();
    changed["target"]["hash"] = "41d0".into();
    write(&bench, "suite/run-mode-1.json", &changed);
    let warned = bench.run("regress suite --controller ppo");
    assert!(text(&warned.stderr).contains("the target has changed since"), "{}", text(&warned.stderr));
    write(&bench, "suite/run-mode-1.json", &document);
    worse(&bench, "other.safetensors", 1.05);
    bench.check("regress suite --controller ./other.safetensors", 1);
    let table = bench.check("regress suite --controller ball-balancing/ppo", 2);
    assert!(table.contains("0 pass, 0 still fail"), "{table}");
}

#[test]
fn modes_with_the_same_minimized_scenario_are_one_test() {
    let bench = Bench::new();
    let falsify = "falsify ball-balancing --controller ppo --space starts+delay+events --search random --trials 5 --budget 60 --seed 2";
    bench.check(&format!("{falsify} --out run.sqlite"), 1);
    let exported =
        bench.json("regress suite --add run.sqlite -k regress.all=true -k regress.minimize=true --json", 0);
    let files = exported["files"].as_array().unwrap();
    let written: Vec<&Value> = files.iter().filter(|file| !file["file"].is_null()).collect();
    assert!(written.len() < files.len(), "{exported}");
    assert_eq!(std::fs::read_dir(bench.path("suite")).unwrap().count(), written.len());
    for file in files.iter().filter(|file| file["file"].is_null()) {
        let same = written.iter().find(|written| written["file"] == file["same_as"]).unwrap();
        // The delays are whole numbers and the other axes nominal, so close scenarios are equal.
        assert_eq!(same["scenario"], file["scenario"]);
    }
    let subject = "simulate ball-balancing --controller ppo --space starts+delay+events";
    let nominal = bench.json(&format!("{subject} --json"), 0);
    for file in written {
        let values = file["scenario"].as_object().unwrap();
        let off = values.iter().filter(|(name, value)| nominal["scenario"][name.as_str()] != **value).count();
        assert_eq!(file["minimized"]["axes_off_nominal"][1], off);
        let at: Vec<String> = values.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let simulated = bench.json(&format!("{subject} --at {} --json", at.join(",")), 1);
        assert_eq!(simulated["robustness"], file["robustness"]);
    }
    // Another controller is not a change of the target. It still fails in one of the modes.
    let tests = bench.json("regress suite --controller sac --json", 1);
    assert_eq!(tests["tests"][0]["same_target"], true);
}

#[test]
fn counterexamples_of_a_python_target_are_listed_and_exported_but_not_simulated() {
    let bench = suite();
    let run = RunFile::open(bench.path("run.sqlite")).unwrap();
    let mut header = run.header().clone();
    header.target.kind = "python".to_string();
    header.target.name = "cart".to_string();
    header.plan = header.plan.replace("toy/sphere-2d", "cart");
    let mut writer = RunWriter::create(bench.path("python.sqlite"), &header, IfExists::Refuse).unwrap();
    for trial in run.trials().unwrap() {
        writer.start_trial(trial.trial.number, trial.trial.seed).unwrap();
        writer.end_trial(trial.trial.number, trial.trial.status).unwrap();
    }
    for simulation in run.simulations() {
        let found = simulation.unwrap();
        writer.record(&[run.simulation(found.trial, found.number).unwrap()]).unwrap();
    }
    writer.close().unwrap();
    let listed = |run: &str| bench.json(&format!("show {run} --json"), 0)["counterexamples"]["modes"].clone();
    assert_eq!(listed("python.sqlite"), listed("run.sqlite"));
    bench.check("regress --add python.sqlite --out suite/python.json", 0);
    assert_eq!(read(&bench, "suite/python.json")["target"]["name"], "cart");
    bench.refuses(
        "regress --add python.sqlite -k regress.minimize=true --out a.json",
        &["target `cart`", "Python"],
    );
    bench.refuses("replay suite/python.json", &["target `cart`", "Python"]);
    let output = bench.run("regress suite");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stdout).contains("0 pass, 1 still fail, 1 error"), "{}", text(&output.stdout));
}

#[test]
fn a_shipped_controller_given_by_path_has_its_name_in_the_file() {
    let bench = Bench::new();
    let shipped = mishandle::resolve::find_controller("ball-balancing/ppo").unwrap();
    std::fs::write(bench.path("ppo.safetensors"), shipped.bytes().unwrap()).unwrap();
    let falsify = "falsify ball-balancing --space delay --trials 1 --budget 5 --controller ./ppo.safetensors";
    bench.check(&format!("{falsify} --out run.sqlite"), 1);
    bench.check("regress --add run.sqlite -k regress.minimize=true --out a.json", 0);
    let document = read(&bench, "a.json");
    assert_eq!(document["controller"], "ppo");
    std::fs::remove_file(bench.path("ppo.safetensors")).unwrap();
    bench.check("replay a.json", 0);
}

#[test]
fn a_repeat_without_a_verdict_leaves_the_test_without_one() {
    let bench = Bench::new();
    // The formula has a value only if the height is not negative. At x = 0.8 that is so for 84 % of
    // the seeds.
    let falsify = "falsify toy/noisy --trials 1 --budget 200 --seed 1 -k report.repeats=0 --formula";
    let output =
        bench.command(falsify).arg("sqrt(height) >= 10").args(["--out", "run.sqlite"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    std::fs::create_dir(bench.path("suite")).unwrap();
    bench.check("regress --add run.sqlite --out suite/a.json", 0);
    let mut document = read(&bench, "suite/a.json");
    document["scenario"][0]["value"] = 0.8.into();
    write(&bench, "suite/a.json", &document);
    let output = bench.run("regress suite --repeat 50 -k regress.max-failure-rate=1 --json");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let test = &found["tests"][0];
    let without = test["repeats"]["without_verdict"].as_u64().unwrap();
    assert!(0 < without && without < 50, "{test}");
    let reason = format!("{without} of 50 repeats without a verdict");
    assert_eq!((&test["result"], &test["reason"]), (&"no verdict".into(), &reason.as_str().into()));
    assert!(text(&output.stderr).contains(&reason), "{}", text(&output.stderr));
}

#[test]
fn a_baseline_tells_new_failures_from_old_ones() {
    let bench = Bench::new();
    worse(&bench, "old.safetensors", 1.0);
    worse(&bench, "same.safetensors", 1.0);
    worse(&bench, "worse.safetensors", 1.5);
    let falsify =
        "falsify point-reaching --controller ./old.safetensors --trials 2 --budget 64 --out run.sqlite";
    bench.check(falsify, 1);
    bench.check("regress suite --add run.sqlite -k regress.all=true", 0);
    let regress = |new: &str, old: &str, code: i32| {
        let flags = format!("--controller {new} --baseline {old} --junit report.xml");
        (
            bench.json(&format!("regress suite {flags} --json"), code),
            bench.check(&format!("regress suite {flags}"), code),
        )
    };
    let attributes = |junit: &Bench| {
        xml(&junit.path("report.xml"), "[root[0].get(k) for k in ('failures', 'errors', 'skipped')]")
    };
    // As bad as the old one: nothing is new.
    let (found, table) = regress("./same.safetensors", "./old.safetensors", 0);
    let n = found["tests"].as_array().unwrap().len();
    assert_eq!((&found["fails"], &found["new_failures"], &found["fixed"]), (&n.into(), &0.into(), &0.into()));
    assert_eq!(found["tests"][0]["result"], "still fails");
    assert_eq!(found["tests"][0]["baseline"]["robustness"], found["tests"][0]["robustness"]);
    assert!(
        table.contains(&format!("lower than with the baseline in 0, higher in 0, equal in {n}")),
        "{table}"
    );
    assert_eq!(attributes(&bench), format!("['0', '0', '{n}']"));
    // Worse on purpose, although every test fails with both.
    let (found, table) = regress("./worse.safetensors", "./old.safetensors", 0);
    assert_eq!(found["fails"], n);
    assert!(
        table.contains("lower than with the baseline in") && !table.contains("in 0, higher in 0"),
        "{table}"
    );
    // The shipped controller passes, so it fixes the old one, and the worse one has new failures
    // against it.
    let (found, _) = regress("ppo", "./old.safetensors", 0);
    assert_eq!((&found["fixed"], &found["passes"]), (&n.into(), &n.into()));
    assert_eq!(found["tests"][0]["result"], "fixed");
    let (found, table) = regress("./worse.safetensors", "ppo", 1);
    assert_eq!((&found["new_failures"], &found["tests"][0]["result"]), (&n.into(), &"new failure".into()));
    assert!(table.contains("baseline robustness") && table.contains("new failure"), "{table}");
    assert_eq!(attributes(&bench), format!("['{n}', '0', '0']"));
    let (found, _) = regress("ppo", "ppo", 0);
    assert_eq!(found["tests"][0]["result"], "passes");
    bench.check("regress suite --controller ppo --baseline ./missing.safetensors", 2);
}

#[test]
fn a_report_never_replaces_a_counterexample_and_an_export_is_whole_or_absent() {
    let bench = suite();
    bench.refuses(
        "regress suite --junit suite/run-mode-1.json",
        &["--junit is suite/run-mode-1.json", "same file"],
    );
    assert_eq!(read(&bench, "suite/run-mode-1.json")["counterexample_format"], 1);
    bench.refuses("regress suite --junit run.sqlite", &["run.sqlite is a run file"]);
    // The same command is refused before the simulations, and repeated with --force.
    let export = "regress suite --add run.sqlite -k regress.all=true";
    bench.refuses(export, &["run-mode-1.json exists already", "--force"]);
    std::fs::write(bench.path("suite/run-mode-1.json"), "old").unwrap();
    bench.check(&format!("{export} --force"), 0);
    assert_eq!(read(&bench, "suite/run-mode-1.json")["counterexample_format"], 1);
    // One that cannot be written leaves none of the others, and no folder.
    bench.refuses(
        "regress run.sqlite/suite --add run.sqlite -k regress.all=true",
        &["cannot create the folder"],
    );
    bench.check("regress --add run.sqlite --out new/folder/a.json", 0);
}

#[test]
fn an_interrupted_export_leaves_nothing() {
    let bench = Bench::new();
    let falsify =
        "falsify ball-balancing --controller ppo --space delay --trials 1 --budget 5 --out run.sqlite";
    bench.check(falsify, 1);
    let export = "regress failures --add run.sqlite -k regress.all=true -k regress.minimize=true -k regress.budget=300";
    let mut child = bench.command(export).stderr(std::process::Stdio::null()).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    bench::signal(&child, "INT");
    let status = child.wait().unwrap();
    // It may have finished before the signal.
    assert_eq!(bench.path("failures").exists(), status.success());
    bench.check(&format!("{export} --force"), 0);
}
