//! Simulations keep their bits between versions: points, scenarios, seeds, robustness and traces of
//! seven tasks and three searches match those of an earlier commit. The golden file contains the
//! commit and the command that generated it.
//!
//! An intended change of physics, of a search or of a controller requires a new golden file.

use std::ops::ControlFlow;

use mishandle::plan::FalsifyPlan;
use mishandle::run::{Engine, ask};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
use serde_json::Value;

#[test]
fn simulations_are_bit_identical_to_an_earlier_commit() {
    let golden: Value = serde_json::from_str(include_str!("golden/bits.json")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (i, case) in golden["cases"].as_array().unwrap().iter().enumerate() {
        let task = case["task"].as_str().unwrap();
        let search = case["search"].as_str().unwrap();
        let expected = case["simulations"].as_array().unwrap();
        let falsify = FalsifyPlan {
            formula: Some("strict".to_string()),
            search: search.to_string(),
            trials: 1,
            // The budget limits the evaluations of nelder-mead, so it must be the budget of the
            // command.
            budget: 14,
            ..FalsifyPlan::default()
        };
        let plan = Plan { action_noise: 0.5, seed: 5, falsify: Some(falsify), ..Plan::new(task, "ppo") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let path = folder.path().join(format!("{i}.sqlite"));
        let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
        ask(&resolved, run, Engine::Direct, &mut |progress| {
            let is_done = progress.simulations as usize >= expected.len();
            if is_done { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
        .unwrap();
        let run = RunFile::open(&path).unwrap();
        let simulations: Vec<_> = run.simulations().map(Result::unwrap).collect();
        assert!(simulations.len() >= expected.len(), "{task} {search}");
        for (found, expected) in simulations.iter().zip(expected) {
            let hex = |value: f64| Value::from(format!("{:016x}", value.to_bits()));
            let place = format!("{task} {search} simulation {}", found.number);
            assert_eq!(expected["seed"], found.seed.to_string(), "{place}: seed");
            let point: Vec<Value> = found.unit_point.iter().copied().map(hex).collect();
            assert_eq!(expected["unit_point"], Value::from(point), "{place}: point of the search");
            let scenario: Vec<Value> = found.scenario.iter().flatten().copied().map(hex).collect();
            assert_eq!(expected["scenario"], Value::from(scenario), "{place}: scenario");
            assert_eq!(
                expected["robustness"],
                found.robustness.map_or(Value::Null, hex),
                "{place}: robustness"
            );
            let trace = format!("{:032x}", found.trace_digest.unwrap());
            assert_eq!(expected["trace"], trace, "{place}: trace");
        }
    }
}
