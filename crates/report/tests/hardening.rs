//! The page of a hardening: a failure of each mode with the controllers before and after.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::counterexample::Counterexample;
use mishandle::harden::{ExampleSource, ModeExample, ModeExamples};
use mishandle::inspect::{FailureMode, failure_modes};
use mishandle::plan::{AxisSetting, EvaluatePlan, FalsifyPlan, HardenPlan};
use mishandle::results::{
    Estimate, HardenedMeasure, HardenedMode, HardenedSearch, Hardening, HardeningRound, ModeChange,
    Seed as ResultSeed, WithoutVerdict,
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
    let before = folder.join("before.safetensors");
    let after = folder.join("round-1/controller.safetensors");
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

fn named(run: &RunFile, mode: &FailureMode, [before, after]: [u64; 2]) -> HardenedMode {
    let name = |axis: &usize| run.header().axes[*axis].name.clone();
    HardenedMode {
        predicate: mode.representative().predicate.clone(),
        axes: mode.axes.iter().map(name).collect(),
        change: ModeChange::new(before, after),
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
        guard: None,
        trainer: None,
        after: Some("better.safetensors".to_string()),
        folder: folder.to_string_lossy().into_owned(),
        commit: "0123abcd".to_string(),
        without_verdict: WithoutVerdict::default(),
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
            file_hash: None,
            bound_before: Some(0.6),
            bound_after: Some(0.3),
            accepted: true,
            reason: "the bound fell".to_string(),
        }],
        environment_steps: 512,
        simulations: 36,
    }
}

fn example(folder: &Path, found: &Hardening, mode: &HardenedMode) -> Result<ModeExample, String> {
    let examples = ModeExamples::open(folder, found).unwrap().unwrap();
    examples.example(mode).map_err(|error| error.to_string())
}

#[test]
fn the_commands_of_a_failure_name_files_as_the_user_named_the_folder() {
    let home = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let folder = folder(home.path());
    let (run, mode) = first_mode(&folder, "final/before-search");
    let found = hardening(&folder, vec![named(&run, &mode, [6, 0])]);
    let here = std::env::current_dir().unwrap();
    let up: PathBuf = here.components().skip(1).map(|_| "..").collect();
    let relative = up.join(folder.strip_prefix("/").unwrap());
    let failures = HardenedModes::simulate(&relative, &found, false, || false).unwrap();
    let html = hardening_page(&found, &failures, &[], None, crate::data);
    let command = format!("run: &quot;{}/final/before-search-", relative.display());
    let controller = format!("controller: Some(&quot;{}/before.safetensors", relative.display());
    assert!(html.contains(&command) && html.contains(&controller), "{html}");
    assert!(!html.contains(&format!("&quot;{}", folder.display())), "{html}");
}

#[test]
fn each_mode_has_a_failure_that_both_controllers_run() {
    let home = tempfile::tempdir().unwrap();
    let folder = folder(home.path());
    let before = first_mode(&folder, "final/before-search");
    let after = first_mode(&folder, "final/after-search");
    let modes = vec![named(&before.0, &before.1, [6, 0]), named(&after.0, &after.1, [0, 4])];
    let found = hardening(&folder, modes.clone());

    // Without a minimized failure: the worst one of the final searches.
    for ((index, mode_of_result), (run, mode)) in (0..).zip(&modes).zip([&before, &after]) {
        let example = example(&folder, &found, mode_of_result).unwrap();
        let ExampleSource::Worst { run: path, trial, number } = &example.source else {
            panic!("{:?}", example.source)
        };
        let recorded = RunFile::open(path).unwrap().simulation(*trial, *number).unwrap();
        for simulation in &example.simulated {
            assert_eq!(recorded.scenario, simulation.episode.request.scenario.values());
        }
        assert!(example.simulated[index].episode.is_violated());
        let of_run = mode.failures.iter().map(|failure| failure.robustness).fold(f64::INFINITY, f64::min);
        assert!(recorded.robustness.unwrap() <= of_run, "{}", run.path().display());
    }

    // A minimized failure of the mode is taken instead, but not one of another controller's mode.
    let of_round = first_mode(&folder, "round-1/search");
    let smaller = of_round.1.representative();
    let json = Counterexample::from_run(&of_round.0, smaller.trial, smaller.number).unwrap().to_json();
    let mode = named(&of_round.0, &of_round.1, [6, 0]);
    let file = folder.join("round-1/failures/mode-1.json");
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    fs::write(&file, &json).unwrap();
    let keys = format!("modes = [[{:?}, {:?}]]", mode.predicate, mode.axes);
    fs::write(folder.join("round-1/modes.toml"), keys).unwrap();
    let chosen = example(&folder, &found, &mode).unwrap();
    assert_eq!(chosen.source, ExampleSource::Minimized { round: 1, file: file.clone() });
    assert_eq!(chosen.simulated[0].episode.request.scenario.values(), smaller.scenario);

    // A record that was edited is not shown as if it were a simulation.
    let robustness = format!("\"robustness\": {:?}", smaller.robustness);
    let edited = json.replacen(&robustness, "\"robustness\": -12.5", 1);
    assert_ne!(edited, json, "{json}");
    fs::write(&file, edited).unwrap();
    let error = example(&folder, &found, &mode).err().unwrap();
    assert!(error.contains("mode-1.json: recorded -12.5, simulated -"), "{error}");
    fs::write(&file, json).unwrap();

    let failures = HardenedModes::simulate(&folder, &found, false, || false).unwrap();
    let html = hardening_page(&found, &failures, &[], None, crate::data);
    let appeared = html.find("<h4>Appeared: ").unwrap();
    let vanished = html.find("<h4>Vanished: ").unwrap();
    assert!(appeared < vanished);
    for part in ["1 mode appeared, 0 stayed, 1 vanished.", "<b>Before</b>: fails, robustness −"] {
        assert!(html.contains(part), "{part}: {html}");
    }
    assert_eq!(
        html.matches("data:image/png;base64,").count(),
        6,
        "two of each mode, and the pair at the top"
    );
    assert!(HardenedModes::simulate(&folder, &found, false, || true).is_none(), "interrupted");

    // The page is made without the controllers, and says what it lacks.
    fs::remove_file(folder.join("round-1/controller.safetensors")).unwrap();
    let failures = HardenedModes::simulate(&folder, &found, false, || false).unwrap();
    let html = hardening_page(&found, &failures, &[], None, crate::data);
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
    let failures = HardenedModes::simulate(home.path(), &found, false, || false).unwrap();
    let html = hardening_page(&found, &failures, &[], None, crate::data);
    assert!(html.contains("there are no modes to compare") && html.contains("0 of 1"), "{html}");
    // Nothing was compared, so nothing was fixed or broken, not even 0.
    for absent in [" fixed, ", " broken", "failure probability after"] {
        assert!(!html.contains(absent), "{absent}: {html}");
    }
}
