//! Evaluations and comparisons that stop by themselves, and control arms: in one go or in pieces,
//! with the same rows and the same answer.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::campaign::create_campaign;
use mishandle::plan::{AxisSetting, ComparePlan, EvaluatePlan, Measure, Until};
use mishandle::results::{Command, Control, Evaluation, Remedy};
use mishandle::run::{CONTROL_TRIAL, Engine, OpenRun, Opening, ask, create_run, evaluate_pairs};
use mishandle::store::{RunFile, RunWriter, Simulation, TrialStatus};
use mishandle::{Plan, ResolvedPlan};

fn plan(target: &str, space: &str, evaluate: EvaluatePlan) -> Plan {
    Plan { space: space.to_string(), evaluate: Some(evaluate), ..Plan::new(target, "") }
}

fn rows(path: &Path, trial: u32) -> Vec<Simulation> {
    RunFile::open(path).unwrap().trial_simulations(trial).map(Result::unwrap).collect()
}

/// Evaluates a plan and stops after each `pieces` batches, as a kill would.
fn evaluated(plan: &Plan, path: &Path, pieces: u64) -> Evaluation {
    let resolved = ResolvedPlan::new(plan).unwrap();
    let mut run = create_run(&resolved, Some(path)).unwrap();
    loop {
        let mut batches = 0;
        let answer = ask(&resolved, run, Engine::Direct, &mut |_| {
            batches += 1;
            if batches > pieces { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let found: Evaluation = answer.unwrap().try_into().unwrap();
        if found.is_complete {
            return found;
        }
        run = RunWriter::resume(path).unwrap();
    }
}

#[test]
fn an_evaluation_stops_at_the_first_look_that_decides_and_a_resumed_one_at_the_same() {
    let folder = tempfile::tempdir().unwrap();
    for (number, until) in [(1, Until::Width(0.1)), (2, Until::Decided)] {
        let rate = (until == Until::Decided).then_some(0.9);
        let table =
            EvaluatePlan { episodes: 5000, batch: 32, until: Some(until), rate, ..Default::default() };
        let plan = plan("toy/noisy", "", table);
        let whole = folder.path().join(format!("{number}a"));
        let pieces = folder.path().join(format!("{number}b"));
        let found = evaluated(&plan, &whole, u64::MAX);
        let sequential = found.sequential.clone().unwrap();
        let n = sequential.simulations;
        assert!(n < 5000 && n.is_multiple_of(32) && sequential.decision.is_some(), "{sequential:?}");
        assert_eq!(found.metrics.success_rate, sequential.interval);
        assert_eq!(rows(&whole, 1).len() as u64, n);

        let again = evaluated(&plan, &pieces, 1);
        assert_eq!(Evaluation { run: None, ..again }, Evaluation { run: None, ..found });
        assert_eq!(rows(&pieces, 1), rows(&whole, 1));

        // One look earlier, the rule had not decided.
        let shorter = EvaluatePlan { episodes: n - 32, ..plan.evaluate.clone().unwrap() };
        let path = folder.path().join(format!("{number}c"));
        let shorter = evaluated(&Plan { evaluate: Some(shorter), ..plan }, &path, u64::MAX);
        let sequential = shorter.sequential.unwrap();
        assert!(sequential.decision.is_none() && sequential.verdict.starts_with("Not"), "{sequential:?}");
    }
}

/// Runs a comparison of two seeds of noise, and stops after each `pieces` batches.
fn compared(folder: &Path, compare: ComparePlan, pieces: u64) -> mishandle::results::Comparison {
    let table = EvaluatePlan { episodes: 2000, batch: 32, ..EvaluatePlan::default() };
    let first = Plan { compare: Some(compare), evaluate: Some(table), ..Plan::new("point-reaching", "ppo") };
    let second = Plan { controller: "ddpg".to_string(), ..first.clone() };
    let plans = [first, second].map(|plan| ResolvedPlan::new(&plan).unwrap());
    let paths = ["a.sqlite", "b.sqlite"].map(|name| folder.join(name));
    let mut runs = [0, 1].map(|index| create_run(&plans[index], Some(&paths[index])).unwrap());
    let [a, b] = &plans;
    loop {
        let mut batches = 0;
        let answers = evaluate_pairs([a, b], runs, |_, _| {
            batches += 1;
            if batches > pieces { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        if answers.unwrap().iter().all(|answer| answer.is_complete) {
            break;
        }
        runs = paths.each_ref().map(|path| RunWriter::resume(path).unwrap());
    }
    let [a, b] = paths.map(|path| RunFile::open(path).unwrap());
    mishandle::inspect::compare(&a, &b, |_| String::new()).unwrap()
}

#[test]
fn the_pairs_of_a_comparison_end_together_and_a_resumed_one_is_the_same() {
    let rules = [
        ComparePlan { margin: Some(0.1), ..ComparePlan::default() },
        ComparePlan {
            measure: Measure::Robustness,
            robustness_bounds: Some([-0.2, 0.2]),
            ..ComparePlan::default()
        },
    ];
    for compare in rules {
        let folder = tempfile::tempdir().unwrap();
        let other = tempfile::tempdir().unwrap();
        let found = compared(folder.path(), compare, u64::MAX);
        let sequential = found.sequential.clone().unwrap();
        assert!(sequential.decision.is_some() && sequential.simulations < 2000, "{sequential:?}");
        for name in ["a.sqlite", "b.sqlite"] {
            assert_eq!(rows(&folder.path().join(name), 1).len() as u64, sequential.simulations);
        }
        let again = compared(other.path(), compare, 1);
        assert_eq!((again.sequential, again.success), (Some(sequential), found.success));
        for name in ["a.sqlite", "b.sqlite"] {
            assert_eq!(rows(&other.path().join(name), 1), rows(&folder.path().join(name), 1));
        }
        // One of the files alone cannot be continued.
        let path = folder.path().join("a.sqlite");
        let resolved =
            mishandle::resolve::recorded_plan(RunFile::open(&path).unwrap().header(), None).unwrap();
        let run = RunWriter::resume(&path).unwrap();
        let error = ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(()));
        let both = Remedy::Run(Command::ResumeComparison { is_python: false });
        assert_eq!(error.unwrap_err().remedies(), [both]);
    }
}

#[test]
fn a_pair_that_is_complete_but_undecided_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let compare = ComparePlan { margin: Some(0.01), ..ComparePlan::default() };
    let table = EvaluatePlan { episodes: 500, batch: 8, ..EvaluatePlan::default() };
    let plan = Plan { compare: Some(compare), ..plan("toy/noisy", "", table) };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let paths = ["a.sqlite", "b.sqlite"].map(|name| folder.path().join(name));
    let runs = paths.each_ref().map(|path| create_run(&resolved, Some(path)).unwrap());
    let both = [&resolved, &resolved];
    let answers = evaluate_pairs(both, runs, |_, _| ControlFlow::Break(())).unwrap();
    assert!(!answers.iter().any(|answer| answer.is_complete));
    let [mut a, b] = paths.map(|path| RunWriter::resume(&path).unwrap());
    a.end_trial(1, TrialStatus::BudgetSpent).unwrap();
    let error = evaluate_pairs(both, [a, b], |_, _| ControlFlow::Continue(())).unwrap_err();
    assert!(error.to_string().contains("recorded as complete"), "{error}");
}

#[test]
fn runs_that_rules_ended_are_compared_by_their_common_pairs_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, width: f64| {
        let until = Some(Until::Width(width));
        let table = EvaluatePlan { episodes: 3000, batch: 32, until, ..EvaluatePlan::default() };
        let path = folder.path().join(name);
        evaluated(&plan("toy/noisy", "", table), &path, u64::MAX);
        RunFile::open(&path).unwrap()
    };
    let short = run("short", 0.3);
    let long = run("long", 0.15);
    let found = mishandle::inspect::compare(&short, &long, |_| String::new()).unwrap();
    let n = rows(short.path(), 1).len() as u64;
    assert!(n < rows(long.path(), 1).len() as u64 && found.at_any_time);
    // The same target and seeds: no pair differs.
    let difference = found.success.difference;
    assert_eq!((found.pairs, difference.value, found.success.p_value), (n, Some(0.0), 1.0));
    let fixed =
        mishandle::evaluation::wilson((found.success.first.value.unwrap() * n as f64).round() as u64, n);
    assert!(found.success.first.low < fixed.low && fixed.high < found.success.first.high);
    let parts = mishandle::inspect::run_difference(&short, &long).unwrap();
    let rate = parts.results.iter().find(|result| result.name == "success rate").unwrap();
    let width = |found: Option<mishandle::evaluation::Estimate>| {
        let found = found.unwrap();
        found.high.unwrap() - found.low.unwrap()
    };
    // What the rules promise.
    assert!(width(rate.first) <= 0.3 && width(rate.second) <= 0.15);
}

#[test]
fn a_control_arm_has_the_same_starts_and_seeds_and_every_other_axis_at_nominal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let table = EvaluatePlan { episodes: 40, batch: 8, ..EvaluatePlan::default() };
    // The narrowed delay does not contain its nominal value, 0.
    let axes = [("reaction_delay".to_string(), AxisSetting::Range([6.0, 10.0]))].into();
    let plan = Plan { axes, ..plan("toy/car-following", "starts+dynamics+events", table) };
    let found = evaluated(&plan, &path, 1);
    let control: Control = found.control.unwrap();
    let random = rows(&path, 1);
    let arm = rows(&path, CONTROL_TRIAL);
    assert_eq!((random.len(), arm.len() as u64, control.simulations), (40, 40, 40));
    let names: Vec<&str> = found.subject.space_axes.iter().map(|axis| axis.name.as_str()).collect();
    let place = |name: &str| names.iter().position(|other| *other == name).unwrap();
    for (random, arm) in random.iter().zip(&arm) {
        assert_eq!((random.seed, random.number), (arm.seed, arm.number));
        for start in ["gap", "speed"] {
            assert_eq!(random.scenario[place(start)], arm.scenario[place(start)]);
        }
        let nominal = [("reaction_delay", 0.0), ("braking_scale", 1.0), ("brake_deceleration", 0.0)];
        assert!(nominal.iter().all(|(name, value)| arm.scenario[place(name)] == Some(*value)));
    }
    // Without braking, no start fails; the counts are those of the rows.
    let fails = |rows: &[Simulation]| rows.iter().filter(|row| row.is_violated()).count() as u64;
    assert_eq!((control.fails_only_in_space, fails(&arm)), (fails(&random), 0));
    assert!(control.fails_only_in_space > 0 && control.difference.high.unwrap() <= 0.0);
    assert_eq!(control.nominal, &names[2..]);
    // It is evidence like every other row, and no count of the run has it.
    let run = RunFile::open(&path).unwrap();
    for number in [1, 40] {
        let again = mishandle::replay::replay(&run, CONTROL_TRIAL, number, None).unwrap();
        assert_eq!(again.differences, Vec::<String>::new());
        let explained = mishandle::inspect::explain(&run, CONTROL_TRIAL, number, None).unwrap();
        assert_eq!(explained.recorded.trial, CONTROL_TRIAL);
    }
    assert!(run.simulations().all(|row| row.unwrap().trial < CONTROL_TRIAL));
    let recorded = mishandle::run::recorded_answer(&run, None).unwrap();
    let recorded: Evaluation = recorded.try_into().unwrap();
    assert_eq!(recorded.control, Some(control));

    let off = EvaluatePlan { control: false, ..plan.evaluate.clone().unwrap() };
    let path = folder.path().join("off.sqlite");
    let without = evaluated(&Plan { evaluate: Some(off), ..plan }, &path, u64::MAX);
    assert_eq!((without.control, rows(&path, CONTROL_TRIAL).len()), (None, 0));
    assert_eq!(without.metrics, found.metrics);
}

#[test]
fn starts_alone_have_no_control_arm_and_a_nominal_scenario_is_simulated_once() {
    let folder = tempfile::tempdir().unwrap();
    let table = EvaluatePlan { episodes: 20, batch: 8, ..EvaluatePlan::default() };
    let starts = evaluated(&plan("toy/car-following", "starts", table.clone()), &folder.path().join("a"), 9);
    assert_eq!(starts.control, None);
    let path = folder.path().join("b");
    let events = evaluated(&plan("toy/pits", "dynamics", table), &path, 1);
    let control = events.control.unwrap();
    assert_eq!((control.simulations, control.difference.n), (1, 20));
    assert_eq!(rows(&path, CONTROL_TRIAL).len(), 1);
}

#[test]
fn runs_of_a_campaign_that_differ_only_in_what_the_arm_fixes_share_its_simulations() {
    let folder = tempfile::tempdir().unwrap();
    let campaign = folder.path().join("campaign");
    let text = "target = \"toy/car-following\"\nspace = [\"starts+dynamics\", \"starts+events\"]\n\
                [evaluate]\nepisodes = 20\nbatch = 8\n";
    let runs = create_campaign(text, &campaign).unwrap();
    let mut arms = Vec::new();
    for run in &runs {
        let (file, resolved) = run.resume(Opening::default()).unwrap();
        let known = run.known_arm(&resolved, &runs);
        assert_eq!(known.is_some(), !arms.is_empty());
        let file = OpenRun { writer: file, known_arm: known };
        let answer = ask(&resolved, file, Engine::Direct, &mut |_| ControlFlow::Continue(()));
        assert!(answer.unwrap().is_complete());
        arms.push(rows(&run.path, CONTROL_TRIAL));
        // A copied row is what its own plan simulates.
        let recorded = RunFile::open(&run.path).unwrap();
        for number in [1, 20] {
            let again = mishandle::replay::replay(&recorded, CONTROL_TRIAL, number, None).unwrap();
            assert_eq!(again.differences, Vec::<String>::new());
        }
    }
    let robustness = |rows: &[Simulation]| rows.iter().map(|row| row.robustness).collect::<Vec<_>>();
    assert_eq!(robustness(&arms[0]), robustness(&arms[1]));
}
