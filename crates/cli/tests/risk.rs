//! The probability of a failure, with what it assumes.

use crate::bench;
use crate::bench::{Bench, unwrapped};
use serde_json::Value;

/// A disc with 7.9e-5 of the square: π 0.01² / 4.
const RARE: &str = "risk toy/sphere-2d --formula 'always(distance >= 0.01)' --simulations 10000";
const DISC: f64 = 7.853_981_633_974_483e-5;

#[test]
fn a_rare_failure_has_an_estimate_with_its_assumption_and_a_failure_that_replays() {
    let bench = Bench::new();
    let report = bench.json(&format!("{RARE} --out run.sqlite --json"), 1);
    let number = |key: &str| report["probability"][key].as_f64().unwrap();
    assert!((number("value") / DISC - 1.0).abs() < 0.2, "{}", report["probability"]);
    assert!(number("low") < DISC && DISC < number("high"));
    assert_eq!(
        (&report["probability"]["source"], &report["simulations"]),
        (&"importance".into(), &10000.into())
    );
    assert!(report["probability"]["assumption"].is_string());
    // Without the assumption, 2,500 simulations of Monte Carlo do not exclude 1e-3.
    assert!(report["bounds"][1].as_f64().unwrap() > 1e-3);
    let failure = &report["failures"][0];
    let replay = format!("replay run.sqlite --simulation {} --json", failure["simulation"]);
    let replayed = bench.json(&replay, 0);
    assert_eq!(replayed["robustness"], failure["robustness"]);
    assert_eq!(replayed["seed"], failure["seed"]);
    let again = bench.json("risk --resume run.sqlite --json", 1);
    assert_eq!(again, report);
    bench.refuses(&format!("{RARE} --out run.sqlite"), &["run.sqlite", "exists already"]);
}

/// Failures that a search misses make the estimate too low, never the bounds.
#[test]
fn bounds_that_assume_nothing_come_before_an_estimate_and_its_assumption() {
    let bench = Bench::new();
    let said = unwrapped(&bench.check(RARE, 1));
    let json = bench.check(&format!("{RARE} --json"), 1);
    let assumption = "the failures outside of the regions found are negligible";
    for (said, parts) in [
        (
            said,
            [
                "violation is from ",
                "with 95 % confidence, which assumes nothing",
                assumption,
                "95 % interval",
            ],
        ),
        (json, ["\"bounds\"", "\"probability\"", assumption, "\"value\""]),
    ] {
        let place = |part: &str| said.find(part).unwrap_or_else(|| panic!("no `{part}`: {said}"));
        assert!(parts.map(place).is_sorted(), "{said}");
    }
}

#[test]
fn a_frequent_failure_is_answered_by_monte_carlo_alone() {
    let bench = Bench::new();
    let said = unwrapped(&bench.check("risk toy/sphere-2d --simulations 20000 --verbose", 1));
    assert!(said.contains("assumes nothing") && said.contains("enough for an answer"), "{said}");
}

#[test]
fn the_declared_distribution_changes_the_probability_and_is_printed() {
    let bench = Bench::new();
    // At x = 0.3 and y around -0.4 with a standard deviation of 0.05, half a width of 0.1 fails:
    // 95.45 %.
    let command =
        "risk toy/sphere-2d --axis x=0.3 -k risk.distributions.y=normal:-0.4:0.05 --simulations 4000";
    let report = bench.json(&format!("{command} --json"), 1);
    let value = report["probability"]["value"].as_f64().unwrap();
    // Five standard errors.
    assert!((value - 0.9545).abs() < 0.0165, "{value}");
    let distribution = |axis: usize| report["distribution"][axis]["distribution"].clone();
    assert_eq!((distribution(0), distribution(1)), ("fixed".into(), "normal:-0.4:0.05".into()));
    let said = bench.check(&format!("{command} --verbose"), 1);
    assert!(said.contains("distribution of y: normal:-0.4:0.05 from -1 to 1 m"));
    bench.write(
        "plan.toml",
        "target = 'toy/sphere-2d'\n[axes]\nx = 0.3\n[risk]\nsimulations = 4000\n[risk.distributions]\ny = 'normal:-0.4:0.05'\n",
    );
    let planned = bench.json("risk --plan plan.toml --json", 1);
    assert_eq!(bench::without_run(planned), bench::without_run(report));
}

#[test]
fn a_system_without_failures_has_an_upper_bound_and_no_estimate() {
    let bench = Bench::new();
    let command = "risk toy/sphere-2d --formula 'always(distance >= -1)' --simulations 3000";
    let report = bench.json(&format!("{command} --json"), 0);
    assert_eq!((&report["probability"], &report["failures"]), (&Value::Null, &Value::Array(Vec::new())));
    // The searches do not count.
    let n = report["monte_carlo"]["simulations"].as_f64().unwrap();
    assert!(n < 3000.0);
    let bound = 1.0 - 0.025_f64.powf(1.0 / n);
    assert!((report["bounds"][1].as_f64().unwrap() / bound - 1.0).abs() < 1e-9);
    let said = unwrapped(&bench.check(command, 0));
    assert!(said.starts_with("NOTHING FOUND toy/sphere-2d"), "{said}");
    assert!(said.contains("the probability of a violation is from 0 to 0.001"), "{said}");
}

#[test]
fn results_do_not_depend_on_threads_or_batches() {
    let bench = Bench::new();
    let of = |flags: &str| bench::without_run(bench.json(&format!("{RARE} --json {flags}"), 1));
    let report = of("--threads 1");
    assert_eq!(report, of("--threads 2 -k risk.batch=7"));
    assert_ne!(report, of("--seed 1"));
}

#[test]
fn impossible_requests_are_errors() {
    let bench = Bench::new();
    for (flags, parts) in [
        ("-k risk.distributions.z=uniform", &["no axis `z`", "x, y"][..]),
        ("-k risk.distributions.x=gamma:1", &["`gamma:1` is unknown", "triangular:MODE"]),
        ("-k risk.distributions.x=normal:1:-1", &["the axis x", "the standard deviation positive"]),
        ("-k risk.distributions.x=normal:900:1", &["almost no probability from -1 to 1"]),
        (
            "-k risk.distributions.x=uniform -k risk.distributions.x=uniform",
            &["risk.distributions.x is set twice"],
        ),
        ("-k risk.distributions.x=log-uniform", &["its lower bound is not positive"]),
        ("-k risk.distributions.x=weights:1:2", &["its values are not discrete"]),
        ("-k risk.distributions.x", &["KEY=VALUE"]),
        ("--simulations 0", &["too small"]),
        ("-k risk.method=exact", &["no method `exact`", "splitting"]),
        ("-k risk.method=sequence", &["the method `sequence` is for tasks only"]),
        ("--axis x=0 --axis y=0", &["without a fixed value", "`mishandle simulate TARGET --at x=0,y=0`"]),
        ("--out failure.json", &["a run file is SQLite"]),
    ] {
        bench.refuses(&format!("risk toy/sphere-2d {flags}"), parts);
    }
}

#[test]
fn a_method_that_was_not_run_is_named_before_the_answer() {
    let bench = Bench::new();
    let said = unwrapped(&bench.check("risk toy/sphere-2d -k risk.method=splitting --simulations 2000", 1));
    let place = |text: &str| said.find(text).unwrap_or_else(|| panic!("no `{text}`: {said}"));
    assert!(
        place("no estimate: multilevel splitting: its part of the budget")
            < place("probability of a violation"),
        "{said}"
    );
    // With the default method, the other parts were to answer, too.
    let said = unwrapped(&bench.check("risk toy/hidden-corner --simulations 2000", 1));
    let place = |text: &str| said.find(text).unwrap_or_else(|| panic!("no `{text}`: {said}"));
    assert!(
        place("no estimate: multilevel splitting: its part of the budget")
            > place("probability of a violation"),
        "{said}"
    );
}

#[test]
fn a_normal_distribution_whose_mean_is_outside_of_the_bounds_is_warned_of() {
    let bench = Bench::new();
    let said = |distribution: &str| {
        let arguments = format!("risk toy/sphere-2d --simulations 100 -k risk.distributions.{distribution}");
        bench::text(&bench.run(&arguments).stderr)
    };
    let warning = "warning: the mean of the distribution normal:1.5:1 of x is outside of its bounds, -1 to 1";
    assert!(said("x=normal:1.5:1").contains(warning), "{}", said("x=normal:1.5:1"));
    for inside in ["x=normal:1:0.5", "x=normal:0:3", "x=uniform"] {
        assert!(!said(inside).contains("warning"), "{inside}");
    }
}

#[test]
fn screening_with_the_plain_program_says_what_to_install() {
    for command in ["risk", "evaluate", "falsify"] {
        let command = format!("{command} point-reaching --controller ppo -k screening.device=gpu");
        let bench = Bench::new();
        bench.refuses(&command, &["pip install '.[gpu]' in a clone"]);
        assert!(!bench.path("runs").exists(), "an empty run file is left");
    }
    for command in ["risk", "evaluate", "falsify"] {
        let run_file = format!("{command} point-reaching --controller ppo --out run.json");
        Bench::new().refuses(&run_file, &["--out ends with .json", "run.sqlite"]);
    }
}
