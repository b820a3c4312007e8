//! The simulations that move a counterexample toward nominal count in nothing, and say which axes
//! cause it.

use std::ops::ControlFlow;

use mishandle::plan::{FalsifyPlan, ReportSettings};
use mishandle::results::Answer;
use mishandle::run::Engine;
use mishandle::store::{MAX_TRIALS, RunFile};
use mishandle::{Plan, ResolvedPlan};

/// Falsifies the car that follows another, whose gap shrinks if the other brakes long and hard.
fn falsified(isolate: Option<bool>) -> (Answer, RunFile, ResolvedPlan, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let falsify = FalsifyPlan { trials: 2, budget: 60, isolate, ..FalsifyPlan::default() };
    let plan =
        Plan { falsify: Some(falsify), space: "events".to_string(), ..Plan::new("toy/car-following", "") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    let go = |_: &_| ControlFlow::Continue(());
    let mut answer = mishandle::run::ask(&resolved, run, Engine::Direct, &mut { go }).unwrap();
    mishandle::inspect::further(&resolved, &mut answer, &ReportSettings::default(), |_, _, _| {
        ControlFlow::Continue(())
    })
    .unwrap();
    (answer, RunFile::open(&path).unwrap(), resolved, folder)
}

#[test]
fn they_count_in_no_number_and_replay() {
    let (with, run, ..) = falsified(Some(true));
    let (without, plain, ..) = falsified(Some(false));
    let (Answer::Falsification(with), Answer::Falsification(without)) = (with, without) else { panic!() };
    assert_eq!(run.counts().unwrap(), plain.counts().unwrap());
    assert_eq!((with.simulations, with.mean_simulations), (without.simulations, without.mean_simulations));
    assert!(
        plain.derived_trials().unwrap().is_empty()
            && without.trials.iter().all(|trial| trial.cause.is_none())
    );
    for trial in &with.trials {
        let rows: Vec<_> = run.derived_simulations(trial.trial).map(Result::unwrap).collect();
        let cause = trial.cause.as_ref().unwrap();
        assert_eq!(cause.simulations, rows.len() as u64);
        assert!(rows.len() <= 30);
        // The rate with other seeds is that of the scenario that the cause names.
        let others: Vec<_> = rows.iter().filter(|row| row.seed != trial.seed.unwrap().0).collect();
        assert_eq!(cause.other_seeds.as_ref().unwrap().n, others.len() as u64);
        let named: Vec<Option<f64>> = cause.scenario.values().copied().collect();
        assert!(!others.is_empty() && others.iter().all(|row| row.scenario == named));
        for row in &rows {
            let again = mishandle::replay::replay(&run, trial.trial + MAX_TRIALS, row.number, None).unwrap();
            assert_eq!(again.differences, Vec::<String>::new());
        }
    }
}

/// Braking needs both a duration and a deceleration: neither causes a failure alone, and without
/// either, nothing fails.
#[test]
fn the_axes_of_a_cause_are_those_without_which_nothing_fails() {
    let (answer, _, resolved, _folder) = falsified(Some(true));
    let Answer::Falsification(found) = answer else { panic!() };
    for trial in &found.trials {
        let cause = trial.cause.as_ref().unwrap();
        let expected = ["brake_duration".to_string(), "brake_deceleration".to_string()];
        assert_eq!(cause.axes, expected);
        assert_eq!(cause.necessary.as_deref().unwrap(), expected);
        assert_eq!(cause.sufficient.as_deref().unwrap(), [] as [String; 0]);
        // The scenario fails again with the seed of the counterexample.
        let scenario = mishandle::rollout::Scenario::new(cause.scenario.values().copied().collect());
        let seed = mishandle::rollout::Seed(trial.seed.unwrap().0);
        let request = mishandle::rollout::Request::new(scenario, seed);
        let episode = resolved.system().unwrap().rollout(&[request]).unwrap().remove(0);
        assert_eq!(episode.robustness(), Some(cause.robustness.0));
        assert!(episode.is_violated());
    }
}

/// A fault needs its kind and its duration. An axis without a meaning for the kind causes nothing,
/// and is nominal in every simulation.
#[test]
fn a_fault_is_caused_by_axes_that_have_a_meaning_for_its_kind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let falsify = FalsifyPlan { trials: 6, budget: 60, isolate: Some(true), ..FalsifyPlan::default() };
    let space = "faults-sensing+faults-actuation".to_string();
    let plan = Plan { falsify: Some(falsify), space, seed: 4, ..Plan::new("ball-balancing", "ppo") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    let go = |_: &_| ControlFlow::Continue(());
    let answer = mishandle::run::ask(&resolved, run, Engine::Direct, &mut { go }).unwrap();
    let Answer::Falsification(found) = answer else { panic!() };
    let run = RunFile::open(&path).unwrap();
    let recorded: Vec<_> = run.header().axes.iter().map(mishandle::run::recorded_axis).collect();
    for (axis, own) in recorded.iter().zip(resolved.space.axes()) {
        assert_eq!((&axis.conditions, &axis.values), (&own.conditions, &own.values), "{}", axis.name);
    }
    let derived = (1..=6).flat_map(|trial| run.derived_simulations(trial));
    for row in run.simulations().chain(derived) {
        let scenario = mishandle::rollout::Scenario::new(row.unwrap().scenario);
        assert!(resolved.space.ineffective(&scenario).is_empty(), "{scenario:?}");
    }
    let causes: Vec<_> = found.trials.iter().filter_map(|trial| trial.cause.as_ref()).collect();
    assert!(causes.len() >= 3, "the controller fails under most faults");
    for cause in causes {
        let has = |axis: &str| cause.axes.iter().any(|named| named == axis);
        let sides = ["sensor_fault", "actuator_fault"].into_iter().filter(|side| has(side));
        for side in sides.clone() {
            assert!(has(&format!("{side}_duration")), "{:?}", cause.axes);
        }
        assert!(sides.count() > 0, "{:?}", cause.axes);
        let scenario = mishandle::rollout::Scenario::new(cause.scenario.values().copied().collect());
        assert!(resolved.space.ineffective(&scenario).is_empty());
        // All of its simulations were run: none differs from the one that is asked about.
        assert!(cause.sufficient.is_some() && cause.necessary.is_some());
    }
}
