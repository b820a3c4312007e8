//! Ctrl-C in commands that write no run file: they finish the running simulations and say what is
//! kept and what is lost.

use std::process::Stdio;
use std::time::Duration;

use crate::bench::{Bench, signal, text};
use serde_json::Value;

/// Runs a command, sends it SIGINT, and returns stdout and the last line of stderr.
#[track_caller]
fn interrupted(bench: &Bench, arguments: &str) -> (String, String) {
    let mut command = bench.command(arguments);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(Duration::from_secs(2));
    signal(&child, "INT");
    let output = child.wait_with_output().unwrap();
    let out = text(&output.stdout);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "mishandle {arguments}\n{out}\n{err}");
    assert!(err.contains("finishing the running simulations"), "{err}");
    (out, err.lines().last().unwrap().to_string())
}

#[test]
fn risk_keeps_the_simulations_of_monte_carlo() {
    let bench = Bench::new();
    let command = "risk toy/sphere-2d --simulations 1e9 --json --out run.sqlite";
    let (out, said) = interrupted(&bench, command);
    let report: Value = serde_json::from_str(&out).unwrap();
    let n = report["simulations"].as_u64().unwrap();
    assert_eq!((&report["is_complete"], n > 0), (&Value::Bool(false), true));
    assert_eq!(report["monte_carlo"]["simulations"], n);
    assert!(said.contains("Resume with: mishandle risk --resume run.sqlite"), "{said}");
    bench.check("replay run.sqlite", 0);
    assert_eq!(bench.json("risk toy/sphere-2d --simulations 1000 --json", 1)["is_complete"], true);
}

#[test]
fn margin_keeps_the_witness_so_far() {
    let bench = Bench::new();
    let task = "margin ball-balancing --controller td3 --budget 1000000 --json --space starts+disturbance";
    let (out, said) = interrupted(&bench, &format!("{task} --out run.sqlite"));
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["is_complete"], false);
    assert!(said.contains("Resume with: mishandle margin --resume run.sqlite"), "{said}");
    let replay = format!("replay run.sqlite --simulation {} --json", found["witness"]["simulation"]);
    let replayed = bench.json(&replay, 0);
    assert_eq!(replayed["robustness"], found["witness"]["robustness"]);
    let (out, said) = interrupted(&bench, &format!("{task} --formula ball_speed>=-1 --out none.sqlite"));
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["witness"], Value::Null);
    assert_eq!(
        (&found["levels"][0]["is_complete"], &found["no_violation_up_to"]),
        (&false.into(), &Value::Null)
    );
    assert!(said.contains("Resume with: mishandle margin --resume none.sqlite"), "{said}");
}

#[test]
fn simulate_keeps_the_repeats_and_a_report_is_not_written() {
    let bench = Bench::new();
    let repeat = "simulate ball-balancing --controller ppo --action-noise 0.5 --repeat 1000000 --json";
    let (out, said) = interrupted(&bench, repeat);
    let found: Value = serde_json::from_str(&out).unwrap();
    let n = found["repeats"]["simulations"].as_u64().unwrap();
    assert!(
        (1..1_000_000).contains(&n) && said.contains(" of 1000000 repeats, the noise was not measured"),
        "{n}, {said}"
    );
    bench.check("falsify ball-balancing --controller ppo --space events --formula always(ball_speed<=0.1) --trials 1 --out r.sqlite", 1);
    let (_, said) = interrupted(&bench, "report r.sqlite -k report.probes=1000000 --out r.html");
    assert!(said.contains("r.html is not written") && !bench.path("r.html").exists(), "{said}");
    bench.check("evaluate ball-balancing --controller ppo --episodes 300 --out e.sqlite", 0);
    let (out, said) = interrupted(&bench, "show e.sqlite --masking=300 -k engine.skip-check=true");
    assert!(out.is_empty() && said.contains("the counts of the conjuncts are lost"), "{out}{said}");
}

/// Sets of up to four of 37 axes are more than 70,000 simulations.
#[test]
fn a_minimization_writes_the_scenario_so_far_but_no_part_of_a_suite() {
    let bench = Bench::new();
    let fast = "falsify ball-balancing --controller ppo --space starts+disturbance --formula always(ball_speed<=2.5)";
    bench.check(&format!("{fast} --search random --trials 1 --budget 50 --out r.sqlite"), 1);
    let minimize = "regress --add r.sqlite -k regress.minimize=true -k regress.budget=1000000";
    let (out, said) = interrupted(&bench, &format!("{minimize} --out failure.json --json"));
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(found["files"][0]["minimized"]["complete"], false);
    assert!(said.contains("the scenario so far is written"), "{said}");
    let replayed = bench.json("replay failure.json --json", 0);
    assert!(replayed["robustness"].as_f64().unwrap() < 0.0, "{replayed}");
    let (out, said) = interrupted(&bench, &minimize.replace("--add", "suite -k regress.all=true --add"));
    assert!(out.is_empty() && said.contains("no file is written"), "{out}{said}");
    assert!(!bench.path("suite").exists());
}

#[test]
fn a_regression_prints_the_finished_tests_and_writes_no_part_of_a_report() {
    let bench = Bench::new();
    let noisy = "--controller ppo --action-noise 0.5 --formula always(ball_speed<=0.1)";
    bench.check(&format!("falsify ball-balancing {noisy} --trials 1 --out r.sqlite"), 1);
    bench.check("regress --add r.sqlite --out suite/a.json", 0);
    bench.write("suite/b.json", &std::fs::read_to_string(bench.path("suite/a.json")).unwrap());
    let (out, said) = interrupted(&bench, "regress suite --repeat 1000000 --junit report.xml --json");
    let found: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&found["is_complete"], found["tests"].as_array().unwrap().len()), (&false.into(), 0));
    assert!(said.contains("the results of 0 of 2 counterexamples are printed"), "{said}");
    assert!(said.contains("the file of --junit is not written") && !bench.path("report.xml").exists());
    assert_eq!(bench.json("regress suite --json", 1)["is_complete"], true);
}
