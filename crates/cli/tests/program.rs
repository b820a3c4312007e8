//! End-to-end tests of the program.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::bench::{Bench, SMALL, signal, text, unwrapped, without_costs, without_run};

const FAST: &str = "--controller expert --seed 3";

/// A formula that the expert of point-reaching violates from some initial states.
const HARD: &str = "--formula 'always[22:300](finger_target_distance <= 0.12)'";

#[test]
fn the_help_of_every_command_has_examples() {
    let bench = Bench::new();
    for command in [
        "list",
        "init",
        "demo",
        "monitor",
        "train",
        "controller",
        "evaluate",
        "falsify",
        "margin",
        "risk",
        "compare",
        "replay",
        "render",
        "completions",
        "man",
    ] {
        let help = bench.check(&format!("{command} --help"), 0);
        let (_, examples) = help.split_once("Examples:\n").expect(command);
        for example in examples.lines().take_while(|line| !line.is_empty()) {
            assert!(example.starts_with("  mishandle "), "an example is broken into two lines: {example}");
        }
        assert!(help.contains(&format!("mishandle {command}")), "{command}");
    }
}

#[test]
fn tasks_lists_formulas_signals_box_and_controllers() {
    let bench = Bench::new();
    let tasks = bench.json("list tasks --json", 0)["tasks"].clone();
    let names: Vec<&str> =
        tasks.as_array().unwrap().iter().map(|task| task["name"].as_str().unwrap()).collect();
    assert_eq!(names[..3], ["point-reaching", "cube-stacking", "peg-in-hole"]);
    for task in tasks.as_array().unwrap() {
        for key in ["success", "strict", "safe", "completion", "signals", "initial_box", "controllers"] {
            assert!(!task[key].is_null(), "{key}");
        }
    }
    // The code's box differs from the paper's in its lower bound.
    let code = bench.json("list ball-balancing -k preset=code --json", 0);
    assert_eq!(code["tasks"][0]["initial_box"][0]["low"], 0.192);
    assert!(bench.check("list ball-pushing --all", 0).contains("Initial box"));
    bench.refuses("list ball-pusing", &["no target `ball-pusing`", "hint: did you mean `ball-pushing`?"]);
}

#[test]
fn a_description_fits_one_screen_unless_all_of_it_is_asked_for() {
    let bench = Bench::new();
    for name in ["", "ball-balancing", "peg-in-hole", "toy/car-following", "portfolio"] {
        let page = bench.check(&format!("list {name}"), 0);
        assert!(page.lines().count() <= 40, "{name}: {page}");
        assert!(bench.check(&format!("list {name} --all"), 0).len() >= page.len(), "{name}");
    }
    let all = bench.json("list --json", 0);
    for group in ["tasks", "targets", "searches", "controllers", "patterns"] {
        assert!(all[group].as_array().unwrap().len() > 5, "{group}");
        assert_eq!(bench.json(&format!("list {group} --json"), 0)[group], all[group]);
    }
    let one = bench.json("list ball-balancing --json", 0);
    assert_eq!(
        (&one["target"]["name"], &one["tasks"][0]["name"]),
        (&"ball-balancing".into(), &"ball-balancing".into())
    );
}

#[test]
fn searches_lists_the_options_of_each_search() {
    let bench = Bench::new();
    let searches = bench.json("list searches --json", 0)["searches"].clone();
    let names: Vec<&str> =
        searches.as_array().unwrap().iter().map(|search| search["name"].as_str().unwrap()).collect();
    let expected = [
        "random",
        "nelder-mead",
        "dual-annealing",
        "sobol",
        "corners",
        "line",
        "cross-entropy",
        "differential-evolution",
        "direct",
        "cma-es",
        "bayesian",
        "turbo",
        "portfolio",
    ];
    assert_eq!(names, expected);
    for search in searches.as_array().unwrap() {
        assert!(!search["summary"].as_str().unwrap().is_empty());
        assert!(!search["reference"].as_str().unwrap().is_empty());
        for option in search["options"].as_array().unwrap() {
            for key in ["name", "type", "default", "range", "meaning"] {
                assert!(option[key].is_string(), "{key} of {option}");
            }
        }
    }
    let options = |name: &str| -> Vec<String> {
        let search = bench.json(&format!("list {name} --json"), 0)["searches"].clone();
        let options = search[0]["options"].as_array().unwrap().clone();
        options.iter().map(|option| option["name"].as_str().unwrap().to_string()).collect()
    };
    assert!(options("random").is_empty());
    assert_eq!(
        options("nelder-mead"),
        [
            "start",
            "simplex-origin",
            "initial-simplex",
            "xatol",
            "fatol",
            "max-iterations",
            "max-evaluations",
            "adaptive",
            "restarts"
        ]
    );
    assert_eq!(
        options("dual-annealing"),
        [
            "start",
            "max-iterations",
            "initial-temperature",
            "restart-ratio",
            "visit",
            "accept",
            "local-search"
        ]
    );
    let page = bench.check("list dual-annealing --all", 0);
    assert!(page.contains("  visit: float, in (1, 3) [default: 2.62]\n    Parameter q"), "{page}");
    assert!(page.contains("Reference\n  Xiang"), "{page}");
    assert!(page.lines().all(|line| line.chars().count() <= 100), "{page}");
    let list = bench.check("list searches", 0);
    let line = list.lines().find(|line| line.starts_with("dual-annealing ")).unwrap();
    assert!(line.contains("  simulated annealing"), "{list}");
    bench.refuses("list nelder-meat", &["no target `nelder-meat`", "hint: did you mean `nelder-mead`?"]);
}

#[test]
fn search_options_come_from_the_plan_and_flags_override_it() {
    let bench = Bench::new();
    let falsify = |more: &str| {
        bench.document(&format!("falsify point-reaching {FAST} --trials 1 --budget 9 --json {more}"), 0)
    };
    let nelder_mead = "--search nelder-mead -k";
    let start = "start=[0.25,0.5,0.75]";
    let short =
        falsify(&format!("{nelder_mead} falsify.options.max-evaluations=5 -k falsify.options.{start}"));
    assert_eq!(short["search_options"]["max-evaluations"], 5);
    assert_eq!(
        (&short["trials"][0]["simulations"], &short["trials"][0]["end"]),
        (&5.into(), &"search ended".into())
    );
    bench.write(
        "plan.toml",
        "[falsify]\nsearch = \"nelder-mead\"\n[falsify.options]\nstart = [0.25, 0.5, 0.75]\nmax-evaluations = 7\n",
    );
    let planned = falsify("--plan plan.toml");
    assert_eq!(planned["trials"][0]["simulations"], 7);
    assert_eq!(falsify("--plan plan.toml -k falsify.options.max_evaluations=5"), short);
    // By default the budget is the limit.
    assert_eq!(falsify("--search nelder-mead")["trials"][0]["simulations"], 9);
    let simplex = "[[0.1, 0.1, 0.1], [0.2, 0.1, 0.1], [0.1, 0.2, 0.1], [0.1, 0.1, 0.2]]";
    let with_simplex = falsify(&format!("{nelder_mead} 'falsify.options.initial-simplex={simplex}'"));
    assert_ne!(falsify("--search nelder-mead")["trials"], with_simplex["trials"]);
}

/// Only random search draws a sample of the space.
#[test]
fn without_a_failure_a_random_sample_bounds_the_failure_rate() {
    let bench = Bench::new();
    let safe = "falsify toy/sphere-2d --formula always(distance>=-1) --trials 2 --budget 149 --json --search";
    let bound = |search: &str| bench.json(&format!("{safe} {search}"), 0)["failure_rate_bound"].clone();
    // 1 - 0.05^(1/298)
    assert!(
        (bound("random").as_f64().unwrap() - 0.010_002_432_437_677_7).abs() < 1e-9,
        "{}",
        bound("random")
    );
    assert!(bound("sobol").is_null());
    let said = unwrapped(&bench.check(&safe.replace(" --json --search", " --search random"), 0));
    let bound = "fewer than 1.1 % of the scenarios of this space fail (95 % confidence, from 298 uniform random samples)";
    assert!(said.contains(bound), "{said}");
    let found = bench.json("falsify toy/sphere-2d --trials 2 --json", 1);
    assert!(found["failure_rate_bound"].is_null() && found["smooth_region"].is_null());
}

/// The robustness of the sphere is 1 plus a distance, in a square of 2 m: it changes by at most 2
/// per width of the space.
#[test]
fn without_a_failure_a_smooth_robustness_excludes_failures_between_the_samples() {
    let bench = Bench::new();
    let safe = "falsify toy/sphere-2d --formula always(distance>=-1) --trials 2 --budget 149 --search random";
    // It takes further simulations, so nobody gets it unasked.
    assert!(bench.json(&format!("{safe} --json"), 0)["smooth_region"].is_null());
    let safe = &format!("{safe} -k report.smooth-region=true");
    let region = bench.json(&format!("{safe} --json"), 0)["smooth_region"].clone();
    let slope = region["slope"].as_f64().unwrap();
    assert!(slope > 1.9 && slope < 3.0 && region["covered"].as_f64().unwrap() > 0.99, "{region}");
    let said = unwrapped(&bench.check(safe, 0));
    assert!(
        said.contains("if no part of the formula is steeper than the samples show")
            && said.contains("no scenario in 99 % of the space fails"),
        "{said}"
    );
    // The second predicate decides only within 0.05 m of the center, where few samples are. It is
    // 20 times as steep as the first one: 40 per width.
    let steep = "always((0.3*distance+0.5>=0)&(20*distance-0.5>=0))";
    let safe = format!(
        "falsify toy/sphere-2d --formula {steep} --trials 1 --budget 60 --search random --json -k report.smooth-region=true"
    );
    let mut bounded = 0;
    for seed in 0..10 {
        let region = bench.json(&format!("{safe} --seed {seed}"), 0)["smooth_region"].clone();
        if let Some(slope) = region["slope"].as_f64() {
            assert!(slope > 30.0 && region["predicates"] == 2, "{region}");
            bounded += 1;
        }
    }
    assert!(bounded > 0);
    for (target, reason) in [
        ("toy/noisy --formula always(height>=-9)", "random"),
        ("toy/sphere-2d --formula always(distance>=-1) -k falsify.early-stopping=true", "bounds"),
        (
            "point-reaching --controller expert --formula always(finger_target_distance>=-1) --space delay",
            "whole numbers",
        ),
    ] {
        let asked = "--trials 1 --budget 60 --search random --json -k report.smooth-region=true";
        let said = bench.json(&format!("falsify {target} {asked}"), 0);
        assert!(said["smooth_region"]["refusal"].as_str().unwrap().contains(reason), "{target}: {said}");
    }
}

#[test]
fn an_invalid_search_option_is_an_error_that_names_it() {
    let bench = Bench::new();
    let refuses = |options: &str, parts: &[&str]| {
        bench.refuses(&format!("falsify point-reaching --controller expert {options}"), parts);
    };
    refuses(
        "--search nelder-mead -k falsify.options.xtol=1",
        &["nelder-mead has no option `xtol`", "max-evaluations", "hint: did you mean `xatol`?"],
    );
    refuses(
        "--search random -k falsify.options.xatol=1",
        &["random has no option `xatol`; it has no options"],
    );
    refuses(
        "--search nelder-mead -k falsify.options.xatol=small",
        &["option `xatol` of nelder-mead is \"small\"; it must be a number, at least 0"],
    );
    refuses(
        "--search dual-annealing -k falsify.options.visit=3.5",
        &["option `visit` of dual-annealing is 3.5; it must be in (1, 3)"],
    );
    refuses(
        "--search nelder-mead -k falsify.options.start=[0.5]",
        &["`start`", "it must be 3 numbers in [0, 1]"],
    );
    refuses("--search nelder-mead -k falsify.options.xatol", &["KEY=VALUE"]);
    assert!(!bench.path("runs").exists(), "a run was created");
}

#[test]
fn export_writes_the_scene_of_a_task_as_mjcf() {
    let bench = Bench::new();
    bench.check("export ball-balancing --out scene.xml", 0);
    let xml = std::fs::read_to_string(bench.path("scene.xml")).unwrap();
    assert!(xml.starts_with("<mujoco") && xml.trim_end().ends_with("</mujoco>"));
    assert!(xml.contains("name=\"tray\"") && xml.contains("name=\"joint7\""));
}

#[test]
fn monitor_prints_the_robustness_and_returns_1_for_a_violation() {
    let bench = Bench::new();
    bench.write("d.csv", "time,d\n0.0,0.2\n0.1,0.3\n0.2,0.1\n");
    // 0.35 - d = 0.15, 0.05, 0.25
    let found =
        bench.json("monitor --formula 'always[0:2](d <= 0.35)' d.csv --json -k monitor.values=true", 0);
    let rho = found["robustness"].as_f64().unwrap();
    let signal = found["robustness_signal"].as_array().unwrap();
    assert!((rho - 0.05).abs() < 1e-12);
    assert_eq!(signal.len(), 3);
    bench.check("monitor --formula 'always[0:2](d <= 0.25)' d.csv", 1);
    // 0.2 s are two samples of 0.1 s, also with RTAMT's default unit.
    for formula in
        ["--formula 'always[0:0.2s](d <= 0.35)'", "--formula 'always[0:0.2](d <= 0.35)' -k log.unit=s"]
    {
        let found = bench.json(&format!("monitor {formula} d.csv --json"), 0);
        assert!((found["robustness"].as_f64().unwrap() - 0.05).abs() < 1e-12, "{formula}");
    }
    let empty_window = bench.json("monitor --formula 'always[5:9](d <= 0.25)' d.csv --json", 2);
    assert_eq!(empty_window["robustness"], "inf");
    assert!(empty_window["asks_nothing"].as_str().unwrap().contains("no sample decides it"));
}

#[test]
fn strict_horizon_accepts_no_window_that_is_cut_under_an_unbounded_operator() {
    let bench = Bench::new();
    bench.write("late.csv", "x\n0\n1\n0\n5\n");
    bench.write("dip.csv", "x\n5\n5\n7\n0\n");
    let late = "monitor --formula 'eventually(always[0:2](x >= 4))' late.csv";
    let dip = "monitor --formula 'always(eventually[0:2](x >= 4))' dip.csv";
    for (command, cut, whole) in [(late, (1.0, 0), (-4.0, 1)), (dip, (-4.0, 1), (3.0, 0))] {
        let document = bench.json(&format!("{command} --json"), cut.1);
        assert_eq!((document["robustness"].as_f64(), &document["windows"]), (Some(cut.0), &"cut".into()));
        assert_eq!(document["cuts_windows"], true);
        let document = bench
            .json(&format!("{command} -k log.strict-horizon=true --json -k monitor.values=true"), whole.1);
        assert_eq!((document["robustness"].as_f64(), &document["windows"]), (Some(whole.0), &"whole".into()));
        assert_eq!(document["robustness_signal"].as_array().unwrap().len(), 2);
        assert_eq!(document["cuts_windows"], false);
    }
    let note = text(&bench.run(late).stderr);
    assert!(note.contains("cut there, as in RTAMT"), "{note}");
    bench.refuses(
        "monitor --formula 'eventually(always[0:4](x >= 4))' late.csv -k log.strict-horizon=true",
        &["needs 5 samples", "only 4"],
    );
}

/// The force reaches 40, and only the first sample is looked at.
#[test]
fn monitor_says_that_only_the_first_sample_counts() {
    let bench = Bench::new();
    bench.write("rig.csv", "time,force\n0,0\n0.5,40\n1,1\n");
    let says = |formula: &str| text(&bench.run(&format!("monitor --formula '{formula}' rig.csv")).stderr);
    let plain = says("force <= 2");
    assert!(
        plain.contains("only the first sample counts") && plain.contains("always(force <= 2)"),
        "{plain}"
    );
    let past = says("historically(force <= 2)");
    assert!(
        past.contains("looks back from the first sample") && past.contains("always(force <= 2)"),
        "{past}"
    );
    assert_eq!(says("always(force <= 2)"), "");
}

/// Columns of robots are called X and F: read as an operator, the formula would ask nothing.
#[test]
fn a_letter_of_a_column_is_no_operator() {
    let bench = Bench::new();
    bench.write("places.csv", "time,X,v\n0,10,1\n1,10,1\n");
    bench.refuses("monitor --formula 'always(X - 1 <= 2)' places.csv", &["needs backquotes: `X`"]);
    bench.refuses("monitor --formula 'always(X(v >= 0))' places.csv", &["backquotes for the signal: `X`"]);
    bench.refuses("monitor --formula 'always(1 <= 2)' places.csv", &["reads no signal"]);
    let found = bench.json("monitor --formula 'always(`X` - 1 <= 2)' places.csv --json", 1);
    assert_eq!(found["robustness"], -7.0);
}

#[test]
fn whole_windows_decide_a_formula_beside_a_conjunct_with_an_empty_one() {
    let bench = Bench::new();
    bench.write("z.csv", "x,z\n-1,0.5\n-1,0.5\n");
    let command = "monitor --formula 'prev(z >= 0) and x >= 0' z.csv -k log.strict-horizon=true --json";
    assert_eq!(bench.json(command, 1)["robustness"], -1.0);
}

#[test]
fn errors_of_monitor_name_cause_and_position() {
    let bench = Bench::new();
    bench.write("d.csv", "d,e\n0.2,1\n0.3,nan\n0.1,2\n");
    bench.write("text.csv", "d\n0.2\nabc\n");
    bench.write("twice.csv", "d,d\n1,2\n");
    bench.write("uneven.csv", "time,d\n0,1\n0.1,1\n0.3,1\n");
    bench.refuses("monitor --formula 'always[0:2](d <= )' d.csv", &["column 18", "^"]);
    bench.refuses("monitor --formula 'x > 1' d.csv", &["signal `x` is not in the trace", "d, e"]);
    bench.refuses("monitor --formula 'e > 0' d.csv", &["line 3: `e` is `nan`", "-k log.missing=hold|drop"]);
    bench.refuses("monitor --formula 'd > 0' text.csv", &["line 3", "`d` is `abc`"]);
    bench.refuses("monitor --formula 'd > 0' twice.csv", &["two columns are named `d`: 1 and 2"]);
    bench.refuses("monitor --formula 'd > 0' uneven.csv", &["evenly spaced", "0.15"]);
    bench.refuses("monitor --formula 'd > 0' missing.csv", &["missing.csv", "No such file"]);
    bench.refuses(
        "monitor --formula 'always[0:9](d > 0)' d.csv -k log.strict-horizon=true",
        &["needs 10 samples"],
    );
    bench.refuses(
        "monitor --formula 'once[1:2](d > 0)' d.csv -k log.strict-horizon=true",
        &["depends on no sample"],
    );
    // 2^64 and just below: the horizon neither overflows nor counts as unbounded.
    for bound in ["18446744073709551616", "18446744073709549568", "1e300"] {
        let formula = format!("always[0:{bound}](d > 0)");
        bench.refuses(
            &format!("monitor --formula '{formula}' d.csv -k log.strict-horizon=true"),
            &["more than any trace has"],
        );
    }
    bench.refuses("monitor --formula 'd = 0.1' d.csv", &["did you mean `==`"]);
    bench.refuses("monitor --formula 'dd > 1' d.csv", &["hint: did you mean `d`?"]);
    let chained = text(&bench.run("monitor --formula '0.2 <= d <= 0.3' d.csv").stderr);
    assert!(chained.contains("comparisons do not chain"), "{chained}");
    bench.refuses("monitor --formula 'always[0:0.5s](d > 0)' d.csv -k log.period=1", &["0.5 s", "1 s"]);
}

#[test]
fn an_evaluation_gives_the_same_document_for_every_number_of_threads() {
    let bench = Bench::new();
    let report =
        bench.document(&format!("evaluate point-reaching {FAST} --episodes 40 --threads 1 --json"), 0);
    let two = bench.document(&format!("evaluate point-reaching {FAST} --episodes 40 --threads 2 --json"), 0);
    assert_eq!(report.to_string(), two.to_string());
    assert_eq!(report["success_rate"]["value"], 1.0);
    for key in ["strict_success_rate", "dangerous_behavior_rate", "task_completion_time"] {
        for part in ["value", "low", "high", "n"] {
            assert!(report[key][part].is_number(), "{key} {part}");
        }
    }
    let noisy =
        bench.json(&format!("evaluate point-reaching {FAST} --episodes 40 --action-noise 0.5 --json"), 0);
    assert_ne!(noisy["task_completion_time"], report["task_completion_time"]);
}

#[test]
fn a_counterexample_is_found_stored_and_replayed() {
    let bench = Bench::new();
    for search in ["random", "nelder-mead", "dual-annealing"] {
        let run = format!("{search}.sqlite");
        let arguments = format!(
            "falsify point-reaching {FAST} {HARD} --search {search} --trials 3 --budget 60 --out {run}"
        );
        let found = bench.json(&format!("{arguments} --json"), 1);
        assert!(found["falsified_trials"].as_u64().unwrap() > 0, "{search}: {found}");
        for trial in found["trials"].as_array().unwrap() {
            let falsified = trial["falsified"].as_bool().unwrap();
            assert_eq!(falsified, trial["minimum_robustness"].as_f64().unwrap() < 0.0);
            assert!(trial["simulations"].as_u64().unwrap() <= 60);
            assert_eq!(trial["initial_configuration"].as_array().unwrap().len(), 3);
        }
        let again = bench.json(&format!("replay {run} --trace {search}.csv --json"), 0);
        assert_eq!(again["same"], true);
        assert!(again["robustness"].as_f64().unwrap() < 0.0);
        // The trace of the replay has exactly the recorded robustness.
        let formula = HARD.trim_start_matches("--formula ");
        let measured = bench.json(&format!("monitor --formula {formula} {search}.csv --json"), 1);
        assert_eq!(measured["robustness"], again["robustness"]);
        bench.refuses(&arguments, &["already"]);
        // A trace overwrites no file, in particular not the run.
        bench.refuses(
            &format!("replay {run} --trace {run}"),
            &[&format!("{run} exists already; choose another path")],
        );
    }
}

#[test]
fn a_campaign_without_counterexamples_returns_0() {
    let bench = Bench::new();
    let found = bench.json(&format!("falsify point-reaching {FAST} --trials 2 --budget 10 --json"), 0);
    assert_eq!(found["falsified_trials"], 0);
    assert!(found["mean_simulations"].is_null());
}

#[test]
fn a_killed_falsification_resumes_to_the_same_result() {
    let bench = Bench::new();
    // The formula holds, so every trial spends its budget and there is time to kill the process.
    let arguments = format!("falsify point-reaching {FAST} --search dual-annealing --trials 4 --budget 60");
    let whole = bench.document(&format!("{arguments} --out whole.sqlite --json"), 0);
    let mut child = bench.command(&format!("{arguments} --out killed.sqlite")).spawn().unwrap();
    wait_for_rows(&bench.path("killed.sqlite"), 40);
    child.kill().unwrap();
    child.wait().unwrap();
    let rows = simulations(&bench.path("killed.sqlite"));
    assert!((40..240).contains(&rows), "it was killed after {rows} simulations");
    let resumed = bench.document("falsify --resume killed.sqlite --json", 0);
    assert_eq!(resumed, whole);
    assert_eq!(simulations(&bench.path("killed.sqlite")), 240);
    let digest =
        |name: &str| mishandle::store::RunFile::open(bench.path(name)).unwrap().content_digest().unwrap();
    assert_eq!(digest("killed.sqlite"), digest("whole.sqlite"));
    // Resuming a finished run changes nothing.
    assert_eq!(bench.document("falsify --resume killed.sqlite --json", 0), whole);
}

#[test]
fn a_durable_run_stores_the_same_records() {
    let bench = Bench::new();
    let digest =
        |name: &str| mishandle::store::RunFile::open(bench.path(name)).unwrap().content_digest().unwrap();
    for (command, code) in [("falsify toy/sphere-2d --trials 2", 1), ("evaluate toy/sphere-2d", 0)] {
        let plain = bench.document(&format!("{command} --json --out plain.sqlite"), code);
        let durable =
            bench.document(&format!("{command} --json --out durable.sqlite -k engine.durable=true"), code);
        assert_eq!(durable, plain);
        assert_eq!(digest("durable.sqlite"), digest("plain.sqlite"));
        let verb = command.split(' ').next().unwrap();
        let resumed =
            bench.document(&format!("{verb} --resume durable.sqlite -k engine.durable=true --json"), code);
        assert_eq!(resumed, plain);
        for name in ["plain.sqlite", "durable.sqlite"] {
            std::fs::remove_file(bench.path(name)).unwrap();
        }
    }
}

fn simulations(path: &Path) -> u64 {
    mishandle::store::RunFile::open(path).and_then(|run| run.counts()).map_or(0, |counts| counts.simulations)
}

fn wait_for_rows(path: &Path, rows: u64) {
    let start = Instant::now();
    while !path.exists() || simulations(path) < rows {
        assert!(start.elapsed() < Duration::from_secs(600), "no {rows} simulations within ten minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_killed_evaluation_resumes_to_the_same_result() {
    let bench = Bench::new();
    let arguments = format!("evaluate point-reaching {FAST} --episodes 200");
    let whole = bench.document(&format!("{arguments} --out whole.sqlite --json"), 0);
    let mut child = bench.command(&format!("{arguments} --out killed.sqlite")).spawn().unwrap();
    wait_for_rows(&bench.path("killed.sqlite"), 32);
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(simulations(&bench.path("killed.sqlite")) < 200);
    assert_eq!(bench.document("evaluate --resume killed.sqlite --json", 0), whole);
}

#[test]
fn a_plan_and_the_equivalent_flags_give_the_same_result() {
    let bench = Bench::new();
    bench.write(
        "plan.toml",
        "target = \"point-reaching\"\ncontroller = \"expert\"\nseed = 3\n[evaluate]\nepisodes = 20\n",
    );
    let planned = bench.document("evaluate --plan plan.toml --json", 0);
    assert_eq!(planned, bench.document(&format!("evaluate point-reaching {FAST} --episodes 20 --json"), 0));
    // Flags override the plan.
    let edited = bench.json("evaluate --plan plan.toml --seed 4 --json", 0);
    assert_eq!(edited["seed"], "4");
    bench.write("wrong.toml", "target = \"point-reaching\"\ncontroler = \"expert\"\n");
    bench.refuses(
        "evaluate --plan wrong.toml",
        &["wrong.toml: line 2 of the plan: there is no key `controler`", "hint: did you mean `controller`?"],
    );
    bench.write("newer.toml", "format = 9\ntarget = \"point-reaching\"\ncontroller = \"expert\"\n");
    bench.refuses("evaluate --plan newer.toml", &["format 9", "newer Mishandle"]);
    bench.write("older.toml", "format = 1\ntask = \"point-reaching\"\ncontroller = \"expert\"\n");
    bench.refuses(
        "evaluate --plan older.toml",
        &["format 1, this program reads format 2", "docs/reference/plans.md"],
    );
}

#[test]
fn flags_complete_a_plan_and_missing_keys_have_defaults() {
    let bench = Bench::new();
    bench.write("plan.toml", "seed = 3\n[evaluate]\nepisodes = 20\nbox = \"reachable\"\n");
    bench.refuses(
        "evaluate --plan plan.toml",
        &["there is no target: name one in the plan or as an argument"],
    );
    bench.refuses(
        "evaluate point-reaching --plan plan.toml",
        &["point-reaching needs a controller", "expert", "pass --controller NAME|FILE"],
    );
    let flags = "point-reaching --plan plan.toml --controller expert --json";
    let found = bench.json(&format!("evaluate {flags}"), 0);
    assert_eq!((&found["simulations"], &found["seed"]), (&20.into(), &"3".into()));
    // The plan has no table [falsify].
    let found = bench.json(&format!("falsify {flags} --trials 1 --budget 2"), 0);
    assert_eq!((&found["search"], &found["budget"]), (&"portfolio".into(), &2.into()));
}

#[test]
fn an_interrupted_run_prints_the_command_that_resumes_it_to_the_same_result() {
    let bench = Bench::new();
    for (command, name) in [
        (format!("falsify point-reaching {FAST} --trials 4 --budget 50"), "INT"),
        (format!("evaluate point-reaching {FAST} --episodes 200"), "TERM"),
    ] {
        let verb = command.split(' ').next().unwrap();
        let whole = bench.document(&format!("{command} --out {verb}.sqlite --json"), 0);
        let run = format!("it's {verb}.sqlite");
        let mut child = bench.command(&command);
        let child =
            child.arg("--out").arg(&run).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        wait_for_rows(&bench.path(&run), 32);
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        let err = without_costs(&text(&output.stderr));
        assert_eq!(output.status.code(), Some(130), "{err}");
        assert!(err.starts_with("finishing the running simulations; press Ctrl-C again"), "{err}");
        assert!(output.stdout.is_empty());
        let quoted = format!(r"Resume with: mishandle {verb} --resume 'it'\''s {verb}.sqlite'");
        assert!(err.contains(&quoted), "{err}");
        assert!(simulations(&bench.path(&run)) < 200);
        let resumed = bench.command(&format!("{verb} --json")).arg("--resume").arg(&run).output().unwrap();
        assert_eq!(without_run(serde_json::from_slice(&resumed.stdout).unwrap()), whole);
    }
}

#[test]
fn an_interrupted_run_prints_the_document_of_its_finished_simulations() {
    let bench = Bench::new();
    for (command, count) in [
        (format!("falsify point-reaching {FAST} --trials 4 --budget 75 --json"), 300),
        (format!("evaluate point-reaching {FAST} --episodes 300 --json"), 300),
    ] {
        let verb = command.split(' ').next().unwrap();
        let run = format!("{verb}.sqlite");
        let mut child = bench.command(&command);
        let child = child.args(["--out", &run]).stderr(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        wait_for_rows(&bench.path(&run), 32);
        signal(&child, "INT");
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{verb}");
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(found["is_complete"], false, "{found}");
        let recorded = simulations(&bench.path(&run));
        let reported = match verb {
            "evaluate" => found["simulations"].as_u64().unwrap(),
            _ => {
                let trials = found["trials"].as_array().unwrap();
                assert!(trials.iter().any(|trial| trial["end"].is_null()), "{found}");
                trials.iter().map(|trial| trial["simulations"].as_u64().unwrap()).sum()
            }
        };
        assert!((32..count).contains(&reported) && reported == recorded, "{reported} of {recorded}");
        assert_eq!(bench.json(&format!("{verb} --resume {run} --json"), 0)["is_complete"], true);
    }
}

#[test]
fn a_replay_says_that_a_simulation_is_at_a_corner_or_the_center() {
    let bench = Bench::new();
    bench.check("evaluate toy/car-following --episodes 1 --out e.sqlite", 0);
    // Two axes have four corners and the center, with 20 seeds each.
    for (simulation, point) in [(1, "corner"), (80, "corner"), (81, "center"), (100, "center")] {
        let replay = format!("replay e.sqlite --trial 2 --simulation {simulation}");
        let text = bench.check(&replay, 0);
        assert!(text.starts_with(&format!("trial 2 ({point}), simulation {simulation}, gap = ")), "{text}");
        assert_eq!(bench.json(&format!("{replay} --json"), 0)["point"], point);
    }
    assert!(bench.json("replay e.sqlite --trial 1 --json", 0)["point"].is_null());
    bench.check("falsify toy/car-following --trials 2 --budget 2 --out f.sqlite", 0);
    assert!(bench.json("replay f.sqlite --trial 2 --json", 0)["point"].is_null());
    let text = bench.check("replay f.sqlite --trial 2", 0);
    assert!(text.starts_with("trial 2, simulation "), "{text}");
}

#[test]
fn resuming_a_run_with_the_other_command_names_the_right_one() {
    let bench = Bench::new();
    bench.check("evaluate toy/sphere-2d --episodes 3 --out e.sqlite", 0);
    bench.check("falsify toy/sphere-2d --search random --trials 1 --out f.sqlite", 0);
    bench.refuses(
        "evaluate --resume f.sqlite",
        &["f.sqlite is a run of `falsify`, not of `evaluate`; resume it with: mishandle falsify --resume f.sqlite"],
    );
    bench.refuses(
        "falsify --resume e.sqlite",
        &["e.sqlite is a run of `evaluate`, not of `falsify`; resume it with: mishandle evaluate --resume e.sqlite"],
    );
    bench.check("falsify --resume f.sqlite", 0);
    // A resumed run takes everything else from its plan.
    for flag in ["--episodes 5", "--seed 1", "--out g.sqlite", "--space starts"] {
        bench.refuses(&format!("evaluate --resume e.sqlite {flag}"), &["cannot be used with"]);
    }
    for flag in ["--trials 5", "--budget 5", "--search random", "--formula x", "--plan p.toml"] {
        bench.refuses(&format!("falsify --resume f.sqlite {flag}"), &["cannot be used with"]);
    }
    bench.refuses(
        "evaluate --resume e.sqlite -k evaluate.box=whole",
        &["evaluate.box is part of the question"],
    );
    bench.refuses("falsify --resume f.sqlite -k falsify.options.a=1", &["is part of the question"]);
}

/// Returns the processor time of a process, in ticks of 10 ms.
fn processor_ticks(child: &Child) -> u64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    // The fields behind the name of the program; the user time is field 14 of the line.
    let fields = stat.rsplit_once(')').unwrap().1;
    fields.split_whitespace().nth(11).unwrap().parse().unwrap()
}

#[test]
fn a_second_signal_stops_a_long_batch_immediately() {
    let bench = Bench::new();
    // A batch of cloth-placing takes much longer than this test.
    let mut command =
        bench.command("evaluate cloth-placing --controller expert --episodes 64 --threads 1 --out a.sqlite");
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    let start = Instant::now();
    while !bench.path("a.sqlite").exists() {
        assert!(start.elapsed() < Duration::from_secs(600));
        std::thread::sleep(Duration::from_millis(5));
    }
    // The batch starts soon after the file exists. A signal before it would end the program in an
    // orderly way.
    let ticks = processor_ticks(&child);
    while processor_ticks(&child) < ticks + 100 {
        assert!(start.elapsed() < Duration::from_secs(600));
        std::thread::sleep(Duration::from_millis(5));
    }
    signal(&child, "INT");
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while without_costs(&line).is_empty() {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0);
    }
    assert!(line.starts_with("finishing the running simulations"), "{line}");
    signal(&child, "INT");
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let mut rest = String::new();
    stderr.read_to_string(&mut rest).unwrap();
    assert_eq!(rest, "", "the program continued");
    assert_eq!(simulations(&bench.path("a.sqlite")), 0);
}

#[test]
fn an_evaluation_reports_the_region_of_its_initial_states() {
    let bench = Bench::new();
    let evaluate = format!("evaluate point-reaching {FAST} --episodes 4 -k");
    let note = "no initial state was rejected as unreachable";
    for (part, named) in [("reachable", true), ("whole", false)] {
        let output = bench.run(&format!("{evaluate} evaluate.box={part}"));
        let out = text(&output.stdout);
        let err = text(&output.stderr);
        let said = unwrapped(&out);
        assert_eq!(said.contains("random scenarios from the reachable part of the box"), named, "{said}");
        assert_eq!(err.contains(note), named, "{err}");
        assert_eq!(bench.json(&format!("{evaluate} evaluate.box={part} --json"), 0)["box"], part);
    }
}

#[test]
fn a_run_accepts_the_new_path_of_a_moved_controller() {
    let bench = Bench::new();
    bench.write("ppo.toml", SMALL);
    bench.check("train point-reaching --settings ppo.toml --steps 256 --out a.safetensors", 0);
    bench.check("train point-reaching --settings ppo.toml --steps 256 --seed 1 --out other.safetensors", 0);
    let whole = bench
        .json("evaluate point-reaching --controller a.safetensors --episodes 4 --out a.sqlite --json", 0);
    std::fs::create_dir(bench.path("moved")).unwrap();
    std::fs::rename(bench.path("a.safetensors"), bench.path("moved/b.safetensors")).unwrap();
    for command in ["replay a.sqlite", "evaluate --resume a.sqlite"] {
        bench.refuses(
            command,
            &[
                "a.safetensors",
                "cannot load the run's controller",
                "-k engine.controller=FILE",
                "No such file",
            ],
        );
        bench.refuses(
            &format!("{command} -k engine.controller=other.safetensors"),
            &["is not the controller of the run"],
        );
    }
    assert_eq!(
        bench.json("replay a.sqlite -k engine.controller=moved/b.safetensors --json", 0)["same"],
        true
    );
    let resumed = bench.json("evaluate --resume a.sqlite -k engine.controller=moved/b.safetensors --json", 0);
    assert_eq!(resumed["success_rate"], whole["success_rate"]);
}

#[test]
fn simulations_without_a_finite_robustness_do_not_stop_a_campaign() {
    let bench = Bench::new();
    // The square root is undefined for initial states farther than 0.5 m from the target.
    let formula = "--formula 'always(sqrt(0.5 - finger_target_distance) <= 9)'";
    let arguments =
        format!("falsify point-reaching {FAST} {formula} --trials 2 --budget 30 --out a.sqlite --json");
    let output = bench.run(&arguments);
    let out = text(&output.stdout);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{err}");
    let found: Value = serde_json::from_str(&out).unwrap();
    let undecided: u64 =
        found["trials"].as_array().unwrap().iter().map(|t| t["undecided"].as_u64().unwrap()).sum();
    assert!((1..60).contains(&undecided), "{undecided}");
    assert_eq!(simulations(&bench.path("a.sqlite")), 60);
    assert!(err.contains("no finite value at sample 0") && err.contains("(target_x = "), "{err}");
    assert_eq!(bench.json("falsify --resume a.sqlite --json", 0), found);
    // An undecided simulation can be replayed.
    let file = mishandle::store::RunFile::open(bench.path("a.sqlite")).unwrap();
    let undefined =
        file.simulations().map(Result::unwrap).find(|simulation| simulation.robustness.is_none()).unwrap();
    let replay =
        format!("replay a.sqlite --trial {} --simulation {} --json", undefined.trial, undefined.number);
    assert_eq!(bench.json(&replay, 0)["same"], true);
}

#[test]
fn a_single_episode_gives_means_without_intervals() {
    let bench = Bench::new();
    let table = bench.check(&format!("evaluate point-reaching {FAST} --episodes 1"), 0);
    let row = table.lines().find(|line| line.starts_with("completed at")).unwrap();
    let cells: Vec<&str> = row.split_whitespace().collect();
    assert!(row.contains(" s ") && cells[cells.len() - 3..] == ["-", "1", "-"], "{row}");
}

#[test]
fn an_output_that_cannot_be_written_is_an_error_and_leaves_no_file() {
    let bench = Bench::new();
    bench.check(&format!("evaluate point-reaching {FAST} --episodes 1 --out a.sqlite"), 0);
    // The shell limits files to 512 bytes; ignoring SIGXFSZ turns the limit into a write error.
    for (arguments, path) in
        [("replay a.sqlite --trace t.csv", "t.csv"), ("export ball-balancing --out scene.xml", "scene.xml")]
    {
        let limited = format!("ulimit -f 1; exec '{}' {arguments}", env!("CARGO_BIN_EXE_mishandle"));
        let output = Command::new("sh").args(["-c", &limited]).current_dir(bench.path(".")).output().unwrap();
        let err = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{err}");
        assert!(err.contains(&format!("cannot write {path}")), "{err}");
        assert!(!bench.path(path).exists(), "{path} exists");
    }
    bench.refuses("replay a.sqlite --trial 3", &["has no trial 3"]);
}

#[test]
fn a_run_that_exceeds_the_limit_on_file_sizes_is_one_error_and_can_be_resumed() {
    let bench = Bench::new();
    let evaluate = "evaluate toy/noisy --episodes 2000 -k evaluate.batch=16";
    let whole = bench.document(&format!("{evaluate} --json --out whole.sqlite"), 0);
    // Ignoring SIGXFSZ turns the limit, in blocks of 512 bytes, into a write error.
    for (blocks, out) in [(0, "none.sqlite"), (800, "part.sqlite")] {
        let program = env!("CARGO_BIN_EXE_mishandle");
        let limited = format!("ulimit -f {blocks}; exec '{program}' {evaluate} --out {out}");
        let output = Command::new("sh").args(["-c", &limited]).current_dir(bench.path(".")).output().unwrap();
        let err = without_costs(&text(&output.stderr));
        assert_eq!(output.status.code(), Some(2), "{err}");
        assert!(err.starts_with(&format!("error: cannot write {out}: ")), "{err}");
        assert_eq!(err.matches("I/O error").count(), 1, "{err}");
        assert!(err.contains("hint: is a quota or the limit on file sizes (`ulimit -f`) reached?"), "{err}");
    }
    assert!(!bench.path("none.sqlite").exists());
    assert!((1..2000).contains(&simulations(&bench.path("part.sqlite"))));
    assert_eq!(bench.document("evaluate --resume part.sqlite --json", 0), whole);
}

#[test]
fn invalid_arguments_are_errors_before_any_simulation() {
    let bench = Bench::new();
    bench.write("junk.safetensors", "this is not a controller");
    bench.write("junk.sqlite", "this is not a run");
    let falsify = "falsify point-reaching --controller expert";
    bench.refuses("evaluate point-reaching --controller nobody", &["no controller `nobody`", "expert"]);
    bench.refuses(
        "evaluate point-reaching --controller junk.safetensors",
        &["junk.safetensors", "not a controller"],
    );
    bench.refuses(
        "evaluate point-reaching --controller ./none.safetensors",
        &["none.safetensors", "No such file", "a controller is the path of a file"],
    );
    for (command, parts) in [
        ("evaluate a.onnx", ["no such file: a.onnx; a target is a name", "a target file (.toml)"]),
        ("evaluate junk.safetensors", ["is not a target file", "--controller junk.safetensors"]),
        ("evaluate junk.sqlite", ["junk.sqlite is not a target file", "--command"]),
        ("evaluate tooy/needle", ["no such file: tooy/needle", "did you mean `toy/needle`?"]),
        ("train a.onnx", ["no such file: a.onnx", "a target file (.toml)"]),
    ] {
        bench.refuses(command, &parts);
        assert!(!text(&bench.run(command).stderr).contains("choose from"), "{command}");
    }
    bench.refuses(&format!("{falsify} --search anealing"), &["no search `anealing`", "dual-annealing"]);
    bench.refuses(
        &format!("{falsify} --formula 'always[0:301](finger_twist < 9)'"),
        &["301", "no episode can decide it"],
    );
    bench.refuses(
        &format!("{falsify} --formula 'finger_twst < 9'"),
        &["finger_twst", "did you mean `finger_twist`?"],
    );
    bench.refuses(&format!("{falsify} --formula strikt"), &["`strikt`", "did you mean `strict`?"]);
    bench.refuses(
        &format!("{falsify} --action-noise -1"),
        &["'-1' for '--action-noise <STD>'", "from 0 to 10"],
    );
    bench.refuses(
        &format!("{falsify} --action-noise nan"),
        &["'nan' for '--action-noise <STD>'", "from 0 to 10"],
    );
    bench.refuses(&format!("{falsify} --trials 0"), &["0"]);
    bench.refuses(
        &format!("{falsify} --trials 1000000000"),
        &["'1000000000'", "the value is too large", "from 1 to 1000000,"],
    );
    bench.refuses(
        "evaluate point-reaching --controller expert --episodes 9999999999",
        &["9999999999", "from 1 to"],
    );
    bench
        .refuses("evaluate point-reaching --controller expert --episodes -5", &["'-5' for '--episodes <N>'"]);
    bench.refuses(&format!("{falsify} --formula '-finger_twst <= 1'"), &["`finger_twist`"]);
    let elsewhere = |arguments: &str| {
        let output = bench.command(arguments).env("MISHANDLE_HOME", "/nowhere").output().unwrap();
        text(&output.stderr)
    };
    for arguments in ["evaluate point-reaching --controller ppo", "train point-reaching"] {
        let err = elsewhere(arguments);
        assert!(err.contains("MISHANDLE_HOME is `/nowhere`"), "{err}");
    }
    bench.refuses(&format!("{falsify} --threads 0"), &["'0' for '--threads <N>'", "from 1 to 1024"]);
    bench.refuses(
        &format!("{falsify} -k preset=papper"),
        &["no task preset `papper`", "did you mean `paper`?"],
    );
    bench.refuses(
        &format!("{falsify} --search nelder-mead -k falsify.options.xatol=1 -k falsify.options.xatol=2"),
        &["falsify.options.xatol is set twice"],
    );
    let toy = "toy/sphere-2d";
    bench.refuses(&format!("falsify {toy} -k preset=code"), &["does not support a task preset"]);
    bench.refuses(&format!("falsify {toy} -k falsify.new-mode-rate=0.1"), &["falsify.keep-going"]);
    bench.refuses(
        &format!("evaluate {toy} -k evaluate.box=reachable"),
        &["does not support `evaluate.box = \"reachable\"`"],
    );
    bench.refuses(
        "evaluate point-reaching --controller expert -k evaluate.box=reachable --space delay",
        &["the space is delay", "`starts`"],
    );
    bench.refuses(&format!("{falsify} --space noise"), &["no space `noise`", "--action-noise"]);
    bench.refuses(&format!("train {toy}"), &["is a toy, not a task"]);
    bench.refuses("replay junk.sqlite", &["junk.sqlite"]);
    bench.refuses("replay missing.sqlite", &["missing.sqlite"]);
    bench.refuses("falsify --resume junk.sqlite", &["junk.sqlite"]);
    assert!(!bench.path("runs").exists(), "a run was created");
}

#[test]
fn tasks_describes_a_task_from_its_definition() {
    let bench = Bench::new();
    let page = bench.check("list point-reaching --all", 0);
    let words = page.split_whitespace().collect::<Vec<_>>().join(" ");
    let sentence = "at every step from 50 to 300 (0.83 s to 5 s): finger_target_distance is at most 0.12 m";
    assert!(words.contains(sentence), "{page}");
    for line in [
        "□[50:300](finger_target_distance ≤ 0.12)",
        "  0-8    joint_positions",
        "  18-20  target",
        "mishandle render point-reaching --out point-reaching.png",
    ] {
        assert!(page.contains(line), "the page has no `{line}`:\n{page}");
    }
    // The page shows boxes and differing formulas of both task presets.
    let page = bench.check("list ball-balancing --all", 0);
    assert!(page.contains("[0.2, 0.5]") && page.contains("[0.192, 0.492]"), "{page}");
    assert!(
        page.contains("task preset code: always[50:300](ball_tray_horizontal_distance <= 0.25)"),
        "{page}"
    );
}

#[test]
fn notes_on_a_task_are_in_its_page_in_json_and_in_the_documentation() {
    let bench = Bench::new();
    let documentation = include_str!("../../tasks/src/ball_balancing/page.md");
    let page = bench.check("list ball-balancing --all", 0).split_whitespace().collect::<Vec<_>>().join(" ");
    let tasks = bench.json("list ball-balancing --json", 0);
    let notes = tasks["tasks"][0]["notes"].as_array().unwrap();
    for topic in ["paper", "physics", "success", "weaknesses"] {
        let own = |note: &&Value| note["topic"] == topic && note["every_task"] == false;
        let note = notes.iter().find(own).unwrap_or_else(|| panic!("no note on {topic}"));
        let text = note[if topic == "paper" { "here" } else { "fact" }].as_str().unwrap();
        assert!(page.contains(text) && documentation.contains(text), "{text}");
    }
    // The notes on every task follow those on the task.
    assert!(page.contains("time unit (every task)"), "{page}");
    // A variant has the notes of its base task.
    let of = |task: &str| bench.json(&format!("list {task} --json"), 0)["tasks"][0]["notes"].clone();
    assert_eq!(of("cloth-placing-7x7"), of("cloth-placing"));
}

#[test]
fn a_shipped_controller_shows_its_known_weaknesses() {
    let bench = Bench::new();
    let page = bench.check("show ball-balancing/ppo", 0);
    assert!(page.contains("known; `mishandle list ball-balancing --all` describes them"), "{page}");
    let weaknesses = bench.json("show ball-balancing/ppo --json", 0)["weaknesses"].clone();
    let texts: Vec<&str> = weaknesses.as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(texts.iter().any(|text| text.contains("observation noise of 0.01")), "{texts:?}");
}

#[test]
fn policies_of_other_tools_run_and_replay() {
    let bench = Bench::new();
    let exported = bench.check("controller point-reaching/ppo --out ppo.onnx", 0);
    assert!(exported.is_empty(), "{exported}");
    let run = "evaluate point-reaching --episodes 4 --seed 1 --json";
    let model = bench.json(&format!("{run} --controller ./ppo.onnx --out a.sqlite"), 0);
    let own = bench.json(&format!("{run} --controller ppo --out b.sqlite"), 0);
    assert_eq!(model["metrics"]["success_rate"], own["metrics"]["success_rate"]);
    assert_ne!(model["controller_hash"], own["controller_hash"]);
    bench.check("replay a.sqlite --trial 1", 0);
    // Another model at the same path is not the controller of the run.
    std::fs::remove_file(bench.path("ppo.onnx")).unwrap();
    bench.check("controller point-reaching/trpo --out ppo.onnx", 0);
    bench.refuses("replay a.sqlite --trial 1", &["is not the controller of the run"]);
    bench.refuses(
        "evaluate ball-balancing --controller ./ppo.onnx",
        &["the ONNX model is for point-reaching, not for ball-balancing"],
    );
    bench.refuses(
        "evaluate point-reaching --controller ./ppo.onnx -k stochastic=true",
        &["an ONNX model is deterministic"],
    );
    bench.refuses("controller point-reaching/ppo --out ppo.onnx", &["exists already"]);
    for (arguments, said) in [
        ("--out a.pt", "expected a path that ends in .onnx or .safetensors, found: a.pt"),
        ("--out a.safetensors", "--task is missing"),
        ("--out a.onnx --task point-reaching", "a controller knows its task"),
        ("--task point-reaching", "--out"),
    ] {
        bench.refuses(&format!("controller point-reaching/ppo {arguments}"), &[said]);
    }

    let linear = concat!(env!("CARGO_MANIFEST_DIR"), "/../interchange/tests/data/point_reaching.pt");
    bench.refuses(
        &format!("evaluate point-reaching --controller '{linear}'"),
        &["zip archive", "mishandle controller FILE --task TASK --out controller.safetensors"],
    );
    let import = format!("controller '{linear}' --task point-reaching --out i.safetensors");
    bench.refuses(&import, &["pass -k import.output-activation=elu|relu|tanh"]);
    bench.check(&format!("{import} -k import.output-activation=tanh"), 0);
    bench.check("evaluate point-reaching --controller ./i.safetensors --episodes 2 --out i.sqlite", 0);
    let small = linear.replace("point_reaching.pt", "sb3_ppo.zip");
    bench.refuses(
        &format!("controller '{small}' --task point-reaching --out s.safetensors"),
        &["the policy does not fit point-reaching: it has 2 numbers per observation, but the task has 27"],
    );
    bench.write("stats.json", r#"{"mean": [0], "variance": [1, 2]}"#);
    bench.refuses(
        &format!("{import} -k import.normalizer=stats.json"),
        &["1 means and 2 variances", "docs/guide/import.md"],
    );
}

/// The exit code of a run that finds a counterexample is 1, or 141 if the reader of stdout is gone:
/// never 0, which would say that nothing failed.
#[test]
fn a_closed_pipe_does_not_end_with_success() {
    let bench = Bench::new();
    let mut child = bench
        .command("falsify toy/sphere-2d --trials 1 --budget 50 --json")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(141));
}
