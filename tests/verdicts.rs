//! Where a robustness is 0, every command counts the Boolean verdict.

use std::ops::ControlFlow;

use mishandle::plan::{EvaluatePlan, FalsifyPlan, MarginPlan, RiskPlan};
use mishandle::results::{Answer, Evaluation, Falsification, Margin};
use mishandle::run::Engine;
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};

/// Every trace has the robustness 0: the first formula holds, the second fails.
const HOLDS: &str = "always(0 * distance == 0)";
const FAILS: &str = "always(0 * distance < 0)";

/// Asks a question and returns its answer, the run and the plan.
fn ask(plan: &Plan) -> (Answer, RunFile, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    let answer =
        mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    (answer, RunFile::open(&path).unwrap(), folder)
}

fn falsify(formula: &str, search: &str) -> Plan {
    let falsify = FalsifyPlan {
        formula: Some(formula.to_string()),
        search: search.to_string(),
        trials: 2,
        budget: 20,
        ..FalsifyPlan::default()
    };
    Plan { falsify: Some(falsify), ..Plan::new("toy/sphere-2d", "") }
}

#[test]
fn a_trial_ends_at_the_first_violation_of_robustness_0() {
    for search in ["random", "portfolio"] {
        let (answer, run, _folder) = ask(&falsify(FAILS, search));
        let found: Falsification = answer.try_into().unwrap();
        assert_eq!((found.falsified_trials, found.simulations), (2, 2), "{search}");
        assert_eq!(found.failure_rate_bound, None);
        assert_eq!(run.counts().unwrap().falsified, 2);

        let (answer, run, _folder) = ask(&falsify(HOLDS, search));
        let found: Falsification = answer.try_into().unwrap();
        assert_eq!((found.falsified_trials, run.counts().unwrap().falsified), (0, 0), "{search}");
        // 40 uniform samples without a violation: the rate is below 1 - 0.05^(1/40).
        let bound = found.failure_rate_bound;
        assert_eq!(bound.is_some(), search == "random");
        assert!(bound.is_none_or(|bound| (bound - 0.0722).abs() < 1e-4), "{bound:?}");
    }
}

#[test]
fn a_failure_probability_counts_violations_of_robustness_0() {
    for (formula, failures) in [(HOLDS, 0), (FAILS, 200)] {
        let risk = RiskPlan {
            formula: Some(formula.to_string()),
            simulations: 200,
            method: "monte-carlo".to_string(),
            ..RiskPlan::default()
        };
        let (_, run, ..) = ask(&Plan { risk: Some(risk), ..Plan::new("toy/sphere-2d", "") });
        assert_eq!(run.counts().unwrap().falsified, failures, "{formula}");
    }
}

#[test]
fn a_margin_is_0_where_every_scenario_violates_with_robustness_0() {
    for (formula, is_violated) in [(HOLDS, false), (FAILS, true)] {
        let margin = MarginPlan { formula: Some(formula.to_string()), budget: 100, ..MarginPlan::default() };
        let plan =
            Plan { margin: Some(margin), space: "events".to_string(), ..Plan::new("toy/car-following", "") };
        let formula = formula.replace("distance", "gap");
        let margin = plan.margin.as_ref().map(|table| MarginPlan { formula: Some(formula), ..table.clone() });
        let (answer, ..) = ask(&Plan { margin, ..plan });
        let found: Margin = answer.try_into().unwrap();
        assert_eq!(found.witness.is_some(), is_violated);
    }
}

#[test]
fn each_named_requirement_has_a_verdict_of_its_own() {
    let requirements = [("holds", HOLDS), ("fails", FAILS)];
    let requirements = requirements.map(|(name, text)| (name.to_string(), text.to_string())).into();
    let evaluate = EvaluatePlan { episodes: 10, ..EvaluatePlan::default() };
    let plan = Plan { requirements, evaluate: Some(evaluate), ..Plan::new("toy/sphere-2d", "") };
    let (answer, ..) = ask(&plan);
    let found: Evaluation = answer.try_into().unwrap();
    let counts: Vec<_> =
        found.requirements.unwrap().into_iter().map(|it| (it.name, it.violated, it.simulations)).collect();
    assert_eq!(counts, [("fails".to_string(), 10, 10), ("holds".to_string(), 0, 10)]);
}
