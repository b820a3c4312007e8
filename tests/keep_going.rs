//! Runs whose trials continue after their first violation: records, resumption, replay and the
//! survey of their modes.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::inspect::mode_survey;
use mishandle::plan::FalsifyPlan;
use mishandle::replay::replay;
use mishandle::run::{Engine, ask, create_run};
use mishandle::store::{RunFile, RunWriter, Simulation, TrialStatus};
use mishandle::{Plan, ResolvedPlan};

fn resolved(batch: u32) -> ResolvedPlan {
    let falsify = FalsifyPlan {
        search: "turbo".to_string(),
        trials: 3,
        budget: 400,
        batch,
        keep_going: true,
        new_mode_rate: 0.02,
        ..FalsifyPlan::default()
    };
    ResolvedPlan::new(&Plan { falsify: Some(falsify), seed: 4, ..Plan::new("toy/pits", "") }).unwrap()
}

/// Runs until at least `limit` simulations are recorded.
fn run(resolved: &ResolvedPlan, run: RunWriter, limit: u64) {
    let flow = |done: u64| if done < limit { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    ask(resolved, run, Engine::Direct, &mut |progress| flow(progress.simulations)).unwrap();
}

/// Returns all simulations with their traces, and the status of each trial.
fn records(path: &Path) -> (Vec<Simulation>, Vec<TrialStatus>) {
    let run = RunFile::open(path).unwrap();
    let with_trace = |found: Simulation| run.simulation(found.trial, found.number).unwrap();
    let simulations = run.simulations().map(|found| with_trace(found.unwrap())).collect();
    (simulations, run.trials().unwrap().iter().map(|trial| trial.trial.status).collect())
}

#[test]
fn a_resumed_run_has_the_records_of_an_uninterrupted_one_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, parts] = ["whole", "parts"].map(|name| folder.path().join(format!("{name}.sqlite")));
    run(&resolved(64), create_run(&resolved(64), Some(&whole)).unwrap(), u64::MAX);
    let setup = resolved(5);
    run(&setup, create_run(&setup, Some(&parts)).unwrap(), 30);
    run(&setup, RunWriter::resume(&parts).unwrap(), 400);
    run(&setup, RunWriter::resume(&parts).unwrap(), u64::MAX);
    let expected = records(&whole);
    assert_eq!(records(&parts), expected);
    assert_eq!(expected.1, [TrialStatus::Falsified; 3]);
    // Resuming a complete run changes nothing.
    run(&setup, RunWriter::resume(&parts).unwrap(), u64::MAX);
    assert_eq!(records(&parts), expected);

    let file = RunFile::open(&whole).unwrap();
    let last = expected.0.iter().rfind(|row| row.robustness < Some(0.0)).unwrap();
    let result = replay(&file, last.trial, last.number, None).unwrap();
    assert!(result.differences.is_empty(), "{:?}", result.differences);
}

#[test]
fn the_survey_counts_modes_trials_and_cells() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    run(&resolved(64), create_run(&resolved(64), Some(&path)).unwrap(), u64::MAX);
    let survey = mode_survey(&RunFile::open(&path).unwrap()).unwrap();
    let (rows, _) = records(&path);
    let failing: Vec<&Simulation> = rows.iter().filter(|row| row.robustness < Some(0.0)).collect();
    assert_eq!(survey.modes.failures, failing.len());
    for (mode, first) in survey.modes.modes.iter().zip(&survey.first) {
        let trials: BTreeSet<u32> = mode.failures.iter().map(|failure| failure.trial).collect();
        assert_eq!(trials, first.keys().copied().collect());
        for failure in &mode.failures {
            assert!(first[&failure.trial] <= failure.number);
        }
    }
    // The curve of a trial starts with its first violation.
    for trial in 1..=3 {
        let first = failing.iter().filter(|row| row.trial == trial).map(|row| row.number).min();
        assert_eq!(survey.curve(trial).first().copied(), first);
    }
    let cell = |row: &&Simulation| [0, 1].map(|axis| ((10.0 * row.unit_point[axis]) as usize).min(9));
    let cells: BTreeSet<[usize; 2]> = failing.iter().map(cell).collect();
    assert_eq!((survey.coverage.cells, survey.coverage.failing), (100, cells.len() as u64));
    assert_eq!(survey.unseen.unwrap().trials, 3);
}
