//! Units of small campaigns: their summaries and digests against the rows of the run files, their
//! files, and running them again.

use mishandle::stl::is_violated;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::ResolvedPlan;
use mishandle::campaign::{campaign_runs, create_campaign};
use mishandle::evaluation::{betting_mean, bootstrap_mean};
use mishandle::rollout::Seed;
use mishandle::run::{Engine, ask};
use mishandle::store::{RunFile, Simulation, TrialStatus};
use mishandle_studies::paper::{CampaignResults, Results, RunResults, Unit};
use sha2::{Digest, Sha256};

const FALSIFICATION: &str = "target = 'toy/sphere-2d'\nseed = 2\n[falsify]\nsearch = ['random', 'nelder-mead']\n\
    formula = 'always(distance >= 0.02)'\ntrials = 4\nbudget = 150\n";
const EVALUATION: &str =
    "target = 'point-reaching'\ncontroller = ['ppo']\naction-noise = 1.2\n[evaluate]\nepisodes = 103\n";

/// Runs a campaign, and returns its results.
fn campaign(text: &str, folder: &Path) -> CampaignResults {
    create_campaign(text, folder).unwrap();
    for run in campaign_runs(folder).unwrap() {
        let (file, resolved) = run.resume(Default::default()).unwrap();
        ask(&resolved, file, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    }
    CampaignResults::read(folder, Path::new("")).unwrap()
}

fn results(text: &str) -> Results {
    let folder = tempfile::tempdir().unwrap();
    Results { campaigns: vec![campaign(text, &folder.path().join("c"))], ..Results::default() }
}

/// Returns the rows of a unit from the run file.
fn rows(folder: &Path, run: &str, unit: &Unit) -> Vec<Simulation> {
    let file = RunFile::open(folder.join(format!("{run}.sqlite"))).unwrap();
    let numbers = unit.first..unit.first + unit.simulations;
    numbers.map(|number| file.simulation(unit.trial, number).unwrap()).collect()
}

/// Returns the SHA-256 of rows of which each completed its episode.
fn digest(rows: &[Simulation], verdicts: usize) -> String {
    let mut text = String::new();
    for row in rows {
        assert_eq!(row.end.name(), "completed");
        let robustness = row.robustness.unwrap();
        text += &format!("{},{},{},{robustness},completed,,,{}", row.trial, row.number, row.seed, row.steps);
        for value in row.scenario.iter().chain(&row.verdicts[..verdicts]) {
            text += &value.map_or(",".to_string(), |value| format!(",{value}"));
        }
        text += "\n";
    }
    Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn the_units_of_a_falsification_match_its_rows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("c");
    let campaign = campaign(FALSIFICATION, &folder);
    assert_eq!(campaign.runs.len(), 2);
    let mut found = Vec::new();
    for run in &campaign.runs {
        assert!(run.is_complete() && run.units.len() == 4 && run.evaluation.is_none());
        let file = RunFile::open(folder.join(format!("{}.sqlite", run.facts.name))).unwrap();
        assert_eq!(run.simulations() as u64, file.counts().unwrap().simulations);
        for unit in &run.units {
            let rows = rows(&folder, &run.facts.name, unit);
            let trial = file.trial(unit.trial).unwrap();
            assert_eq!((unit.seed, unit.status, unit.evaluated), (trial.seed, trial.status, None));
            let mut values: Vec<f64> = rows.iter().map(|row| row.robustness.unwrap()).collect();
            let violations = values.iter().filter(|rho| is_violated(**rho)).count();
            assert_eq!((unit.violations as usize, unit.stopped), (violations, 0));
            values.sort_by(f64::total_cmp);
            assert_eq!((unit.lowest, unit.highest), (values.first().copied(), values.last().copied()));
            assert_eq!(unit.sha256, digest(&rows, 0));
            found.push(unit.status);
        }
    }
    assert!(found.contains(&TrialStatus::Falsified) && found.contains(&TrialStatus::BudgetSpent));
}

#[test]
fn the_units_of_an_evaluation_match_its_rows() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("c");
    let run = &campaign(EVALUATION, &folder).runs[0];
    let starts: Vec<(u32, u32, u32)> =
        run.units.iter().map(|unit| (unit.trial, unit.first, unit.simulations)).collect();
    assert_eq!(starts[..2], [(1, 1, 100), (1, 101, 3)]);
    assert_eq!((starts[2].0, starts[2].1), (2, 1));
    let mut fractions = Vec::new();
    let mut steps = Vec::new();
    for unit in &run.units {
        let rows = rows(&folder, &run.facts.name, unit);
        assert_eq!(unit.sha256, digest(&rows, 4));
        let counts = unit.evaluated.unwrap();
        let successes: Vec<&Simulation> =
            rows.iter().filter(|row| row.verdicts[0].is_some_and(|rho| rho > 0.0)).collect();
        assert_eq!((counts.started, counts.successes), (rows.len() as u64, successes.len() as u64));
        let of_unit: Vec<f64> =
            rows.iter().map(|row| row.verdicts[2].unwrap() / f64::from(row.steps)).collect();
        let completed: Vec<f64> = successes.iter().filter_map(|row| row.verdicts[3]).collect();
        assert_eq!((counts.dangerous_n, counts.dangerous_sum), (of_unit.len() as u64, of_unit.iter().sum()));
        assert_eq!(
            (counts.completed, counts.completion_sum),
            (completed.len() as u64, completed.iter().sum())
        );
        if unit.trial == 1 {
            fractions.extend(of_unit);
            steps.extend(completed);
        }
    }
    let failures = run.units[0].evaluated.unwrap().started - run.units[0].evaluated.unwrap().successes;
    assert!((1..100).contains(&failures) && fractions.iter().any(|fraction| *fraction > 0.0), "{failures}");
    let summary = run.evaluation.unwrap();
    assert_eq!(summary.dangerous_behavior_rate, Some(betting_mean(&fractions)));
    assert_eq!(summary.task_completion_time, Some(bootstrap_mean(&steps, Seed(0))));
    let corners: Vec<Simulation> =
        run.units[2..].iter().flat_map(|unit| rows(&folder, &run.facts.name, unit)).collect();
    let failing: std::collections::BTreeSet<String> = corners
        .iter()
        .filter(|row| row.robustness.unwrap() <= 0.0)
        .map(|row| format!("{:?}", row.scenario))
        .collect();
    assert_eq!((summary.failing_corners as usize, summary.corners), (failing.len(), 9));
}

#[test]
fn a_unit_that_runs_again_agrees_and_a_changed_one_does_not() {
    for text in [FALSIFICATION, EVALUATION] {
        let results = results(text);
        let run = &results.campaigns[0].runs[0];
        let resolved = ResolvedPlan::new(&run.plan).unwrap();
        assert_eq!(run.differences(&resolved), Vec::<String>::new());
        for unit in [&run.units[1], run.units.last().unwrap()] {
            let again = unit.run_again(&resolved).unwrap().unwrap();
            assert_eq!(unit.differences(&again), Vec::<String>::new());
            let changed = Unit { sha256: "0".repeat(64), seed: unit.seed ^ 1, ..unit.clone() };
            let found = changed.differences(&again);
            assert!(found.len() == 2 && found[0].starts_with("seed: recorded"), "{found:?}");
            assert_eq!(found[1], format!("SHA-256: recorded {}, now {}", "0".repeat(64), unit.sha256));
        }
        let missing = Unit { trial: 9, ..run.units[0].clone() };
        assert_eq!(missing.run_again(&resolved).unwrap(), None);
        // Another seed gives other rows.
        let plan = mishandle::Plan { seed: 77, ..run.plan.clone() };
        let other = run.units[0].run_again(&ResolvedPlan::new(&plan).unwrap()).unwrap().unwrap();
        assert!(run.units[0].differences(&other).iter().any(|found| found.starts_with("SHA-256")));
    }
}

/// Writes the results, changes a file, and returns the error of reading them.
fn error(results: &Results, file: &str, change: impl Fn(&str) -> String) -> String {
    let folder = tempfile::tempdir().unwrap();
    results.write(folder.path()).unwrap();
    let path = folder.path().join(file);
    let text = fs::read_to_string(&path).unwrap();
    let changed = change(&text);
    assert_ne!(changed, text);
    fs::write(path, changed).unwrap();
    Results::read(folder.path()).unwrap_err().to_string()
}

#[test]
fn written_results_are_read_back_to_the_bit() {
    for text in [FALSIFICATION, EVALUATION] {
        let mut results = results(text);
        results.commit = Some("0123456789ab".to_string());
        // The smallest and the largest number, and a sign of zero.
        results.campaigns[0].runs[0].units[0].lowest = Some(5e-324);
        results.campaigns[0].runs[0].units[0].highest = Some(f64::MAX);
        results.campaigns[0].runs[0].units[1].lowest = Some(f64::NEG_INFINITY);
        let folder = tempfile::tempdir().unwrap();
        results.write(folder.path()).unwrap();
        assert_eq!(Results::read(folder.path()).unwrap(), results);
    }
}

#[test]
fn contradictions_are_errors() {
    let falsification = results(FALSIFICATION);
    let first = |text: &str, from: &str, to: &str| text.replacen(from, to, 1);
    let of_run = |change: &dyn Fn(&str) -> String| error(&falsification, "c/random.csv", change);
    let repeated = of_run(&|text| first(text, "\n2,1,", "\n1,1,"));
    assert!(repeated.contains("line 3: expected simulation") && repeated.contains("repeated"), "{repeated}");
    let budget = of_run(&|text| text.replace(",150,", ",151,"));
    assert!(budget.contains("151 simulations, expected at most 150"), "{budget}");
    let status = of_run(&|text| text.replace("falsified", "converged"));
    assert!(status.contains("the trial has 1 violations and the status `converged`"), "{status}");
    let unknown = of_run(&|text| text.replace("budget spent", "spent"));
    assert!(unknown.contains("trial status `spent`"), "{unknown}");
    let manifest = |from: &'static str, to: &'static str| {
        error(&falsification, "manifest.json", move |text| first(text, from, to))
    };
    let outside = manifest("\"name\":\"random\"", "\"name\":\"../random\"");
    assert!(outside.contains("`../random` is not in the folder"), "{outside}");
    let twice = manifest("\"name\":\"random\"", "\"name\":\"nelder-mead\"");
    assert!(twice.contains("the manifest lists the run `nelder-mead` twice"), "{twice}");
    let format = manifest("\"format\":2", "\"format\":1");
    assert!(format.contains("format 1, this program reads format 2"), "{format}");
    let evaluation = results(EVALUATION);
    let name = |run: &RunResults| format!("c/{}.csv", run.facts.name);
    let file = name(&evaluation.campaigns[0].runs[0]);
    let missing = error(&evaluation, &file, |text| first(text, "\n1,101,3,", "\n1,102,3,"));
    assert!(missing.contains("line 3: expected simulation 101 of trial 1, found 102"), "{missing}");
    let summary = error(&evaluation, "c/evaluations.csv", |text| text.replace("\nppo,", "\nother,"));
    assert!(summary.contains("it has no line for `ppo`"), "{summary}");
}
