//! The page of a hardening: a failure of each mode with the controllers before and after.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::counterexample::Counterexample;
use mishandle::harden::{ExampleSource, mode_examples};
use mishandle::inspect::{FailureMode, failure_modes};
use mishandle::plan::{AxisSetting, EvaluatePlan, FalsifyPlan, HardenPlan};
use mishandle::results::{
    Estimate, HardenedMeasure, HardenedMode, HardenedSearch, Hardening, HardeningRound, Seed as ResultSeed,
};
use mishandle::run::{Engine, ask, create_run};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
use mishandle_report::{HardenedModes, hardening_page};

/// Delays that break the shipped controllers of this task.
fn plan() -> Plan {
    let mut plan = Plan { space: "starts+delay".to_string(), ..Plan::new("point-reaching", "ppo") };
    plan.axes.insert("action_delay".to_string(), AxisSetting::Range([1.0, 3.0]));
    let table = HardenPlan { searches: vec!["random".to_string()], ..HardenPlan::default() };
    Plan { seed: 3, harden: Some(table), ..plan }
}

/// Writes the searches of a controller, whose files begin with `prefix`.
fn search(prefix: &Path, controller: &Path, seed: u64) {
    fs::create_dir_all(prefix.parent().unwrap()).unwrap();
    let base = Plan { controller: controller.to_string_lossy().into_owned(), seed, harden: None, ..plan() };
    let evaluate = EvaluatePlan { episodes: 6, ..EvaluatePlan::default() };
    let falsify = FalsifyPlan {
        search: "random".to_string(),
        trials: 1,
        budget: 6,
        keep_going: true,
        new_mode_rate: 0.0,
        isolate: Some(false),
        ..FalsifyPlan::default()
    };
    for (name, plan) in [
        ("corners", Plan { evaluate: Some(evaluate), ..base.clone() }),
        ("random", Plan { falsify: Some(falsify), ..base.clone() }),
    ] {
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let run = create_run(&resolved, Some(&file(prefix, name))).unwrap();
        ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    }
}

fn file(prefix: &Path, name: &str) -> PathBuf {
    PathBuf::from(format!("{}-{name}.sqlite", prefix.display()))
}

/// Writes the folder of a hardening with one accepted round.
fn folder(home: &Path) -> PathBuf {
    let folder = home.join("better.harden");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controllers/point-reaching");
    let (before, after) = (folder.join("before.safetensors"), folder.join("round-1/controller.safetensors"));
    fs::create_dir_all(folder.join("round-1")).unwrap();
    fs::copy(shipped.join("ppo.safetensors"), &before).unwrap();
    fs::copy(shipped.join("trpo.safetensors"), &after).unwrap();
    fs::write(folder.join("harden.toml"), plan().to_toml()).unwrap();
    search(&folder.join("round-1/search"), &before, 1);
    search(&folder.join("final/before-search"), &before, 2);
    search(&folder.join("final/after-search"), &after, 2);
    folder
}

/// Returns the failure mode with the most failures of the run of corners.
fn first_mode(folder: &Path, searches: &str) -> (RunFile, FailureMode) {
    let run = RunFile::open(file(&folder.join(searches), "corners")).unwrap();
    let mode = failure_modes(&run).unwrap().modes.remove(0);
    (run, mode)
}

fn named((run, mode): &(RunFile, FailureMode), change: &str, [before, after]: [u64; 2]) -> HardenedMode {
    let name = |axis: &usize| run.header().axes[*axis].name.clone();
    HardenedMode {
        predicate: mode.representative().predicate.clone(),
        axes: mode.axes.iter().map(name).collect(),
        change: change.to_string(),
        before,
        after,
    }
}

fn hardening(folder: &Path, modes: Vec<HardenedMode>) -> Hardening {
    let rate = |value| Estimate { value: Some(value), low: Some(value), high: Some(value), n: 10 };
    Hardening {
        target: "point-reaching".to_string(),
        space: "starts+delay".to_string(),
        seed: ResultSeed(3),
        before: "ppo".to_string(),
        after: Some("better.safetensors".to_string()),
        folder: folder.to_string_lossy().into_owned(),
        commit: "0123abcd".to_string(),
        verdict: "Better: fewer scenarios fail.".to_string(),
        worse: Vec::new(),
        measures: Vec::new(),
        corners: None,
        failure_probability: vec![rate(0.5), rate(0.25)],
        margin: Vec::new(),
        searches: vec![HardenedSearch { simulations: 12, failures: 6, modes: 1 }; 2],
        modes,
        archive: None,
        rounds: vec![HardeningRound {
            number: 1,
            failures: 6,
            environment_steps: 512,
            bound_before: Some(0.6),
            bound_after: Some(0.3),
            accepted: true,
            reason: "the bound fell".to_string(),
        }],
        environment_steps: 512,
        simulations: 36,
    }
}

#[test]
fn each_mode_has_a_failure_that_both_controllers_run() {
    let home = tempfile::tempdir().unwrap();
    let folder = folder(home.path());
    let (before, after) =
        (first_mode(&folder, "final/before-search"), first_mode(&folder, "final/after-search"));
    let modes = vec![named(&before, "vanished", [6, 0]), named(&after, "appeared", [0, 4])];
    let found = hardening(&folder, modes.clone());

    // Without a minimized failure: the worst one of the final searches.
    let examples = mode_examples(&folder, &found, &[&modes[0], &modes[1]]).unwrap().unwrap();
    for (example, (run, mode)) in examples.examples.iter().zip([&before, &after]) {
        let ExampleSource::Worst { run: path, trial, number } = &example.source else {
            panic!("{:?}", example.source)
        };
        let recorded = RunFile::open(path).unwrap().simulation(*trial, *number).unwrap();
        assert_eq!(recorded.scenario, example.request.scenario.values());
        let of_run = mode.failures.iter().map(|failure| failure.robustness).fold(f64::INFINITY, f64::min);
        assert!(recorded.robustness.unwrap() <= of_run, "{}", run.path().display());
    }
    assert_eq!(examples.examples.iter().map(|example| example.failing).collect::<Vec<_>>(), [0, 1]);

    // A minimized failure of the mode is taken instead, but not one of another controller's mode.
    let of_round = first_mode(&folder, "round-1/search");
    let smaller = of_round.1.representative();
    let json = Counterexample::from_run(&of_round.0, smaller.trial, smaller.number).unwrap().to_json();
    fs::create_dir_all(folder.join("round-1/failures")).unwrap();
    fs::write(folder.join("round-1/failures/mode-1.json"), json).unwrap();
    let mode = named(&of_round, "vanished", [6, 0]);
    let examples = mode_examples(&folder, &found, &[&mode]).unwrap().unwrap();
    let file = folder.join("round-1/failures/mode-1.json");
    assert_eq!(examples.examples[0].source, ExampleSource::Minimized { round: 1, file });
    assert_eq!(examples.examples[0].request.scenario.values(), smaller.scenario);

    let failures = HardenedModes::simulate(&folder, &found, || false).unwrap().unwrap();
    let html = hardening_page(&found, &failures, &[], None);
    let (appeared, vanished) = (html.find("<h4>Appeared: ").unwrap(), html.find("<h4>Vanished: ").unwrap());
    assert!(appeared < vanished);
    for part in ["1 mode appeared, 0 stayed, 1 vanished.", "<b>Before</b>: fails, robustness −"] {
        assert!(html.contains(part), "{part}: {html}");
    }
    // A build without a renderer, or a machine without OpenGL, says so.
    match html.matches("data:image/png;base64,").count() {
        0 => assert_eq!(html.matches("There are no pictures of the failures: ").count(), 1, "{html}"),
        pictures => assert_eq!(pictures, 4, "two of each mode"),
    }
    assert!(HardenedModes::simulate(&folder, &found, || true).unwrap().is_none(), "interrupted");

    // The page is made without the controllers, and says what it lacks.
    fs::remove_file(folder.join("round-1/controller.safetensors")).unwrap();
    let failures = HardenedModes::simulate(&folder, &found, || false).unwrap().unwrap();
    let html = hardening_page(&found, &failures, &[], None);
    assert!(html.contains("which take simulations, are missing: ") && !html.contains("<h4>"), "{html}");
}

#[test]
fn a_page_without_an_accepted_round_says_that_no_modes_are_compared() {
    let home = tempfile::tempdir().unwrap();
    let mut found = hardening(home.path(), Vec::new());
    found.after = None;
    found.rounds[0].accepted = false;
    found.failure_probability.truncate(1);
    found.measures.push(HardenedMeasure {
        name: "space".to_string(),
        before: found.failure_probability[0],
        after: None,
        difference: None,
        broken: 0,
        fixed: 0,
        p_value: None,
        adjusted_p_value: None,
    });
    let failures = HardenedModes::simulate(home.path(), &found, || false).unwrap().unwrap();
    let html = hardening_page(&found, &failures, &[], None);
    assert!(html.contains("there are no modes to compare") && html.contains("0 of 1"), "{html}");
    // Nothing was compared, so nothing was fixed or broken, not even 0.
    for absent in [" fixed, ", " broken", "failure probability after"] {
        assert!(!html.contains(absent), "{absent}: {html}");
    }
}
