//! Falsification by an adversary: its simulations are recorded as scenarios that replay without it.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::plan::FalsifyPlan;
use mishandle::run::{Answer, Engine, Progress};
use mishandle::store::{RunFile, RunWriter, Simulation};
use mishandle::{Plan, ResolvedPlan};

/// An adversary of a shipped controller.
fn plan(space: &str, falsify: FalsifyPlan) -> Plan {
    let falsify = FalsifyPlan { search: FalsifyPlan::ADVERSARY.to_string(), ..falsify };
    Plan { falsify: Some(falsify), space: space.to_string(), seed: 3, ..Plan::new("ball-balancing", "ppo") }
}

fn ask(
    resolved: &ResolvedPlan,
    run: RunWriter,
    watch: impl FnMut(&Progress) -> ControlFlow<()> + Send,
) -> Answer {
    mishandle::run::ask(resolved, run, Engine::Direct, &mut { watch }).unwrap()
}

fn new_run(resolved: &ResolvedPlan, path: &Path) -> Answer {
    let run = mishandle::run::create_run(resolved, Some(path)).unwrap();
    ask(resolved, run, |_| ControlFlow::Continue(()))
}

fn simulations(path: &Path) -> Vec<Simulation> {
    RunFile::open(path).unwrap().simulations().map(Result::unwrap).collect()
}

#[test]
fn every_simulation_replays_to_the_bit_without_the_adversary() {
    for fixed_seed in [None, Some(11)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        // A formula that always holds: the trials spend their budgets.
        let formula = Some("always(ball_tray_horizontal_distance >= -1)".to_string());
        let falsify = FalsifyPlan { trials: 1, budget: 12, fixed_seed, formula, ..FalsifyPlan::default() };
        let resolved =
            ResolvedPlan::new(&plan("starts+delay+timing+disturbance+drift+events", falsify)).unwrap();
        let Answer::Falsification(found, _) = new_run(&resolved, &path) else { panic!() };
        assert_eq!((found.simulations, found.falsified_trials, found.surplus), (12, 0, 0));
        let run = RunFile::open(&path).unwrap();
        let rows = simulations(&path);
        for row in &rows {
            let again = mishandle::replay::replay(&run, row.trial, row.number, None).unwrap();
            assert_eq!(again.differences, Vec::<String>::new());
        }
        let push = resolved.space.axes().iter().position(|axis| axis.name == "push_force_x").unwrap();
        let pushed = rows.iter().filter(|row| row.scenario[push] != Some(0.0)).count();
        assert!(pushed > 3, "{pushed} of 12 simulations have a push");
        let mut seeds: Vec<u64> = rows.iter().map(|row| row.seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), if fixed_seed.is_some() { 1 } else { 12 });
    }
}

#[test]
fn a_counterexample_is_isolated_as_that_of_any_search() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let falsify = FalsifyPlan { trials: 1, budget: 300, isolate: Some(true), ..FalsifyPlan::default() };
    let resolved = ResolvedPlan::new(&plan("disturbance", falsify)).unwrap();
    let answer = new_run(&resolved, &path);
    let go = |_, _| ControlFlow::Continue(());
    let result = mishandle::inspect::whole_result(&resolved, &answer, &path, Some(0), go).unwrap();
    let mishandle::results::Answer::Falsification(found) = result else { panic!() };
    assert_eq!(found.falsified_trials, 1);
    assert!(found.trials[0].cause.is_some());
    // Seven joints in each of the five seconds of an episode.
    let adversary = found.adversary.unwrap();
    assert_eq!((adversary.axes, adversary.decisions), (35, 5));
    let steps: u64 = simulations(&path).iter().map(|row| u64::from(row.steps)).sum();
    assert_eq!(found.control_steps, steps);
}

#[test]
fn a_run_that_was_interrupted_goes_on_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, resumed] = ["whole.sqlite", "resumed.sqlite"].map(|name| folder.path().join(name));
    let falsify = FalsifyPlan { trials: 2, budget: 25, early_stopping: true, ..FalsifyPlan::default() };
    let formula = Some("always[50:200](ball_tray_horizontal_distance >= -1)".to_string());
    let resolved = ResolvedPlan::new(&plan("disturbance", FalsifyPlan { formula, ..falsify })).unwrap();
    let Answer::Falsification(expected, _) = new_run(&resolved, &whole) else { panic!() };
    let mut run = mishandle::run::create_run(&resolved, Some(&resumed)).unwrap();
    // Interrupted in the first trial, and again in the second.
    for end in [15, 40] {
        let answer = ask(&resolved, run, |progress| match progress.simulations >= end {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        });
        assert!(!answer.is_complete());
        run = RunWriter::resume(&resumed).unwrap();
    }
    let Answer::Falsification(found, _) = ask(&resolved, run, |_| ControlFlow::Continue(())) else {
        panic!()
    };
    assert_eq!(found, expected);
    assert_eq!(simulations(&resumed), simulations(&whole));
}

#[test]
fn an_adversary_needs_something_to_decide_and_a_system_that_it_can_interrupt() {
    let error = |plan: &Plan| ResolvedPlan::new(plan).unwrap_err().to_string();
    let starts = error(&plan("starts", FalsifyPlan::default()));
    assert!(starts.contains("`disturbance`"), "{starts}");
    let toy = Plan {
        target: "toy/car-following".to_string(),
        controller: String::new(),
        ..plan("disturbance", FalsifyPlan::default())
    };
    assert!(error(&toy).contains("whole simulations"), "{}", error(&toy));
    let on = FalsifyPlan { keep_going: true, ..FalsifyPlan::default() };
    assert!(error(&plan("disturbance", on)).contains("keep-going"));
}
