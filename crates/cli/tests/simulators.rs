//! Simulators that are programs, from the command line: permission, folders, resuming, exports, and
//! what is left of a command that is killed.

use crate::bench;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::bench::{Bench, signal, text};

/// A tank whose level overflows with the highest inflows, and that rejects some.
const TANK: &str = r#"
import json, os, sys, time
HELLO = {"protocol": 1, "name": "tank", "version": "2.1", "control_dt": 0.1, "steps": 20, "files": ["data.txt"],
  "axes": [{"name": "inflow", "unit": "m/s", "low": 0.0, "high": 1.0, "nominal": 0.1},
           {"name": "outlet", "values": ["open", "blocked"], "nominal": "open", "kind": "event"}],
  "signals": [{"name": "level", "unit": "m"}],
  "formulas": [{"name": "no_overflow", "text": "always(level <= 1)"}]}
open("processes", "a").write("%d\n" % os.getpid())
for line in sys.stdin:
    q = json.loads(line)
    if q["type"] == "hello": a = HELLO
    elif q["type"] != "simulate": a = {"error": "unknown type"}
    else:
        s = q["scenario"]
        time.sleep(float(os.environ.get("SLOW", 0)))
        if s["outlet"] == "blocked" and s["inflow"] > 0.95: sys.exit("the pump is too hot")
        rate = s["inflow"] if s["outlet"] == "blocked" else s["inflow"] - 0.5
        a = {"trace": {"level": [max(0.1 * k * rate, 0) for k in range(21)]}}
    print(json.dumps({"id": q["id"], **a}), flush=True)
"#;

const COMMAND: &str = "--command 'python3 tank.py'";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("tank.py", TANK);
    bench.write("data.txt", "1");
    bench
}

/// Runs the program with the permission to start programs that files name.
#[track_caller]
fn allowed(bench: &Bench, folder: &Path, arguments: &str, code: i32) -> String {
    let mut command = bench.command(arguments);
    let output = command.current_dir(folder).env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
    let out = text(&output.stdout);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "mishandle {arguments}\n{out}\n{err}");
    out + &err
}

#[test]
fn a_run_of_a_typed_command_is_replayed_from_any_folder_with_permission() {
    let bench = bench();
    bench.check(&format!("falsify {COMMAND} --trials 2 --out run.sqlite"), 1);
    let run = bench.path("run.sqlite");
    let replay = format!("replay {}", run.display());
    bench.refuses(&replay, &["the program `python3 tank.py`", "MISHANDLE_ALLOW_PROGRAMS=1"]);
    let elsewhere = tempfile::tempdir().unwrap();
    let said = allowed(&bench, elsewhere.path(), &replay, 0);
    assert!(said.contains("bit-identical to the record"), "{said}");
    // A counterexample has its trace, so that nothing is started.
    assert!(bench.check("show run.sqlite --simulation first", 1).contains("Decisive: level <= 1"));
    // A file that the simulator names is a part of it.
    bench.write("data.txt", "2");
    let said = allowed(&bench, elsewhere.path(), &replay, 2);
    assert!(said.contains("simulator `tank`"), "{said}");
}

#[test]
fn a_command_in_a_file_needs_permission_and_a_typed_one_does_not() {
    let bench = bench();
    bench.write("plan.toml", "target = \"process:python3 tank.py\"\n[evaluate]\nepisodes = 5\n");
    bench.write("tank.toml", "process = [\"python3\", \"tank.py\"]\n");
    for arguments in ["evaluate --plan plan.toml", "evaluate tank.toml", "list tank.toml"] {
        bench.refuses(arguments, &["MISHANDLE_ALLOW_PROGRAMS=1"]);
        allowed(&bench, bench.path("").as_path(), arguments, 0);
    }
    assert!(!bench.path("processes").exists() || bench.path("runs").exists());
    bench.check("evaluate 'process:python3 tank.py' --episodes 5 --out a.sqlite", 0);
    bench.check("evaluate --plan plan.toml --command 'python3 tank.py' --episodes 5 --out b.sqlite", 0);
    assert!(bench.check(&format!("list {COMMAND} --all"), 0).contains("open, blocked"));
    bench.write("wrong.toml", "process = [\"python3\", \"tank.py\"]\n\nmodel = \"tank.xml\"\n");
    bench.refuses("evaluate wrong.toml", &["wrong.toml, line 3: ", "`model`"]);
    bench.refuses("evaluate tank.py", &["tank.py is not a target file", "--command"]);
    let train = "train tank.toml --algorithm ppo --out a.safetensors";
    bench.refuses(train, &["tank.toml, line 1: ", "names a simulator"]);
    bench.refuses(&format!("evaluate {COMMAND} --controller a.onnx"), &["contains its own controller"]);
}

#[test]
fn a_resumed_run_has_the_records_of_an_uninterrupted_one() {
    let bench = bench();
    let evaluate = format!("evaluate {COMMAND} --episodes 300 -k evaluate.batch=8 --json --out");
    let whole = bench.document(&format!("{evaluate} whole.sqlite"), 0);
    let mut command = bench.command(&format!("{evaluate} part.sqlite"));
    let child = command.env("SLOW", "0.02").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    bench.refuses("evaluate --resume part.sqlite", &["MISHANDLE_ALLOW_PROGRAMS=1"]);
    let said = allowed(&bench, bench.path("").as_path(), "evaluate --resume part.sqlite --json", 0);
    let document = said.split_inclusive("\n}").next().unwrap();
    assert_eq!(bench::without_run(serde_json::from_str(document).unwrap()), whole);
    assert_no_process(&bench);
}

#[test]
fn no_simulator_outlives_a_killed_command() {
    let bench = bench();
    let mut command = bench.command(&format!("evaluate {COMMAND} --episodes 1000"));
    let mut child: Child =
        command.env("SLOW", "0.1").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    signal(&child, "KILL");
    child.wait().unwrap();
    assert_no_process(&bench);
}

/// Waits until no process of a simulator is left.
#[track_caller]
fn assert_no_process(bench: &Bench) {
    let processes = std::fs::read_to_string(bench.path("processes")).unwrap();
    let start = Instant::now();
    for process in processes.lines() {
        let command = format!("/proc/{process}/cmdline");
        while std::fs::read_to_string(&command).is_ok_and(|words| words.contains("tank.py")) {
            assert!(start.elapsed() < Duration::from_secs(600), "process {process} is still running");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    assert!(processes.lines().count() > 0);
}

#[test]
fn the_reason_of_a_crash_is_in_the_text_the_document_the_replay_and_the_report() {
    let bench = bench();
    let set = "--axis outlet=blocked --axis inflow=0.9:1.0";
    let said = bench.check(&format!("evaluate {COMMAND} {set} --episodes 20 --out run.sqlite"), 0);
    assert!(said.contains("failed: ") && said.contains("the pump is too hot"), "{said}");
    let found = bench.json(&format!("evaluate {COMMAND} {set} --episodes 20 --json"), 0);
    let reasons = found["reasons"].as_array().unwrap();
    assert_eq!(reasons.len(), 1);
    let failed = found["metrics"]["failed"].as_u64().or(found["failed"].as_u64()).unwrap();
    assert!(reasons[0]["simulations"].as_u64().unwrap() >= failed && failed > 0);
    let number = &reasons[0]["simulation"];
    let replay = format!("replay run.sqlite --simulation {number}");
    let said = allowed(&bench, bench.path("").as_path(), &replay, 0);
    assert!(said.contains("reason: ") && said.contains("the pump is too hot"), "{said}");
    bench.refuses(&format!("show run.sqlite --simulation {number}"), &["the pump is too hot"]);
    bench.check("report run.sqlite --out run.html", 0);
    assert!(std::fs::read_to_string(bench.path("run.html")).unwrap().contains("the pump is too hot"));
}

#[test]
fn a_counterexample_stands_with_the_files_of_the_simulator() {
    let bench = bench();
    bench.check(&format!("falsify {COMMAND} --trials 1 --out run.sqlite"), 1);
    allowed(&bench, bench.path("").as_path(), "regress --add run.sqlite --out suite/a.json", 0);
    for name in ["a.json", "tank.py", "data.txt"] {
        assert!(bench.path("suite").join(name).exists(), "{name}");
    }
    // The suite is moved, and the simulator that made it is gone.
    let elsewhere = tempfile::tempdir().unwrap();
    let suite = elsewhere.path().join("suite");
    std::fs::rename(bench.path("suite"), &suite).unwrap();
    std::fs::remove_file(bench.path("tank.py")).unwrap();
    let said = allowed(&bench, elsewhere.path(), "replay suite/a.json", 0);
    assert!(said.contains("bit-identical"), "{said}");
    allowed(&bench, elsewhere.path(), "regress suite", 1);
    bench.refuses(&format!("replay {}", suite.join("a.json").display()), &["MISHANDLE_ALLOW_PROGRAMS=1"]);
}

#[test]
fn margins_probabilities_and_campaigns_take_a_simulator() {
    let bench = bench();
    let margin = bench.json(&format!("margin {COMMAND} --axis outlet=blocked --budget 200 --json"), 1);
    assert_eq!(margin["space"], "disturbance");
    bench.check(&format!("risk {COMMAND} -k risk.method=monte-carlo --simulations 300"), 1);
    bench.check(&format!("simulate {COMMAND} --at inflow=1 --axis outlet=open"), 0);
    bench.write(
        "grid.toml",
        "target = \"process:python3 tank.py\"\nseed = [1, 2]\n[falsify]\ntrials = 1\nbudget = 20\n",
    );
    bench.refuses("run grid.toml --out made", &["MISHANDLE_ALLOW_PROGRAMS=1"]);
    allowed(&bench, bench.path("").as_path(), "run grid.toml --out made", 1);
}

/// Simulators of one axis, the start `t0` with the nominal value 20, and of what `level` follows.
fn room(answer: &str) -> String {
    format!(
        "import json, sys\n\
         for line in sys.stdin:\n\
        \x20   q = json.loads(line)\n\
        \x20   if q['type'] == 'hello': a = {{'protocol': 1, 'name': 'room', 'control_dt': 1.0, 'steps': 1,\n\
        \x20       'axes': [{{'name': 't0', 'unit': 'degC', 'low': 10.0, 'high': 25.0, 'nominal': 20.0, 'kind': 'start'}}],\n\
        \x20       'signals': [{{'name': 'temp', 'unit': 'degC'}}],\n\
        \x20       'formulas': [{{'name': 'warm', 'text': 'always(temp >= 16)'}}]}}\n\
        \x20   elif q['type'] == 'simulate': t0 = q['scenario']['t0']; {answer}\n\
        \x20   else: a = {{'error': 'unknown type'}}\n\
        \x20   print(json.dumps({{'id': q['id'], **a}}), flush=True)\n"
    )
}

#[test]
fn a_counterexample_of_a_start_moves_toward_nominal() {
    let bench = Bench::new();
    bench.write("room.py", &room("a = {'trace': {'temp': [t0, t0]}}"));
    let said = bench.check("falsify --command 'python3 room.py' --trials 1 --seed 1 --out run.sqlite", 1);
    let moved = said.lines().find(|line| line.starts_with("cause ")).expect(&said);
    let value = moved.split("t0 = ").nth(1).and_then(|rest| rest.split(' ').next()).expect(moved);
    // It fails below 16, and the search found it at the bound 10.
    let value: f64 = value.parse().unwrap();
    assert!((15.5..16.0).contains(&value), "{said}");
}

#[test]
fn a_nominal_scenario_that_crashes_is_a_warning_with_its_reason() {
    let bench = Bench::new();
    bench.write("room.py", &room("sys.exit('no license for the solver')"));
    let output = bench.run("evaluate --command 'python3 room.py' --episodes 3 --out run.sqlite");
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(said.contains("the nominal scenario has no verdict"), "{said}");
    assert!(said.contains("no license for the solver"), "{said}");
}
