//! The signals of the manner are computed where something reads them, and nowhere else.

use std::ops::ControlFlow;

use mishandle::counterexample::Counterexample;
use mishandle::plan::{EvaluatePlan, FalsifyPlan, RiskPlan, ScreeningPlan};
use mishandle::results::Evaluation;
use mishandle::rollout::{Episode, Request, Seed};
use mishandle::run::{Engine, ask};
use mishandle::store::RunFile;
use mishandle::tasks::MANNER;
use mishandle::{Plan, ResolvedPlan};

/// Returns the plan of an evaluation and of a falsification of a formula.
fn evaluation() -> Plan {
    let evaluate = EvaluatePlan { episodes: 2, ..EvaluatePlan::default() };
    Plan { evaluate: Some(evaluate), ..Plan::new("point-reaching", "expert") }
}

fn falsification(formula: &str) -> Plan {
    let falsify = FalsifyPlan { formula: Some(formula.to_string()), ..FalsifyPlan::default() };
    Plan { falsify: Some(falsify), ..Plan::new("point-reaching", "expert") }
}

fn resolved(plan: &Plan) -> ResolvedPlan {
    ResolvedPlan::new(plan).unwrap()
}

/// Returns the undisturbed episode of a plan.
fn episode(resolved: &ResolvedPlan) -> Episode {
    let request = Request::new(resolved.space.nominal(), Seed(0));
    resolved.system().unwrap().rollout(&[request]).unwrap().remove(0)
}

#[test]
fn a_trace_has_the_signals_of_the_manner_if_a_formula_reads_one() {
    let own = mishandle::resolve::task("point-reaching").unwrap().definition().signals.len();
    for (plan, has_manner) in [
        (evaluation(), true),
        (falsification("careful"), true),
        (falsification("always(tool_speed <= 1.7)"), true),
        (falsification("success"), false),
        (falsification("strict"), false),
        (Plan::new("point-reaching", "expert"), false),
    ] {
        let resolved = resolved(&plan);
        let episode = episode(&resolved);
        let expected = own + if has_manner { MANNER.len() } else { 0 };
        assert_eq!(episode.trace.names().len(), expected, "{:?}", plan.falsify);
        assert_eq!(resolved.signal_names(), *episode.trace.names());
        assert_eq!(episode.verdict.careful.is_some(), has_manner);
        // What nothing reads costs nothing and changes nothing.
        let plain = self::episode(&self::resolved(&falsification("success")));
        for signal in 0..own {
            assert_eq!(episode.trace.column(signal), plain.trace.column(signal));
        }
        assert_eq!(episode.verdict.success, plain.verdict.success);
    }
}

/// A counterexample asks another question than an evaluation, but its trace is the recorded one.
#[test]
fn a_failure_of_an_evaluation_is_exported_and_replays_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let evaluate = EvaluatePlan { episodes: 20, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), action_noise: 2.0, ..Plan::new("point-reaching", "ppo") };
    let resolved = resolved(&plan);
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let run = RunFile::open(&path).unwrap();
    let (trial, number) = mishandle::replay::select_simulation(&run, None, None).unwrap().unwrap();
    let exported = Counterexample::from_run(&run, trial, number).unwrap();
    let again = exported.resolve(folder.path(), None).unwrap();
    assert_eq!(exported.replay(&again).unwrap().differences, Vec::<String>::new());
}

#[test]
fn a_plan_may_ask_for_careful_success() {
    let plan = Plan { careful: true, ..falsification("success") };
    assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap(), plan);
    assert!(episode(&resolved(&plan)).verdict.careful.is_some());
}

#[test]
fn a_screening_leaves_careful_out_unless_its_formula_reads_the_manner() {
    let careful = |plan: Plan| {
        let plan = Plan { screening: Some(ScreeningPlan::default()), ..plan };
        resolved(&plan).specification.careful.is_some()
    };
    assert!(!careful(evaluation()));
    assert!(!careful(falsification("success")));
    let risk = RiskPlan { formula: Some("always(fixture_force <= 140)".to_string()), ..RiskPlan::default() };
    let risk = Plan { risk: Some(risk), ..Plan::new("point-reaching", "expert") };
    for plan in [falsification("careful"), risk] {
        assert!(careful(plan));
    }
}

#[test]
fn a_run_with_the_signals_replays_to_the_same_bits_and_a_full_trace_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = resolved(&evaluation());
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    let answer = ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let found: Evaluation = answer.try_into().unwrap();
    // The expert reaches every point carefully.
    let rate = found.metrics.careful_success_rate.unwrap();
    assert_eq!((rate.value, rate.n), (Some(1.0), 2));
    let run = RunFile::open(&path).unwrap();
    assert!(run.header().signals.iter().any(|signal| signal.name == "tool_speed" && signal.unit == "m/s"));
    let (replayed, trajectory) = mishandle::picture::replay_states(&run, 1, 1, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new());
    assert_eq!(trajectory.states.len(), 301);

    // A full trace has the same numbers, although its episode has no signals of the manner.
    let plain = self::resolved(&falsification("success"));
    let request = replayed.episode.request.clone();
    let episode = plain.system().unwrap().rollout(&[request]).unwrap().remove(0);
    let columns = mishandle::picture::full_trace(&plain, &episode).unwrap();
    let names = replayed.episode.trace.names();
    for signal in MANNER {
        let column = columns.iter().find(|column| column.name == signal.name).unwrap();
        let index = names.iter().position(|name| name == signal.name).unwrap();
        let expected: Vec<Option<f64>> =
            replayed.episode.trace.column(index).iter().copied().map(Some).collect();
        assert_eq!((&column.values, column.unit.as_str()), (&expected, signal.unit), "{}", signal.name);
    }
    // An episode that has them already gets no second column.
    let columns = mishandle::picture::full_trace(&resolved, &replayed.episode).unwrap();
    assert!(columns.iter().all(|column| column.name != "tool_speed"));
}
