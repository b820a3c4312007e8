//! Counterexample files.

use std::path::Path;

use mishandle::counterexample::Counterexample;
use mishandle::plan::FalsifyPlan;
use mishandle::rollout::{Request, Seed};
use mishandle::{Plan, ResolvedPlan};

/// Checks the laws:
/// - a counterexample that is read and written reads as the same counterexample;
/// - the scenario of a toy either runs or is an error. A file of a task can name a controller, so
///   it is not resolved here.
pub fn check(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(counterexample) = Counterexample::from_json(text) else { return };
    let written = counterexample.to_json();
    let again = Counterexample::from_json(&written).unwrap_or_else(|error| panic!("{error} in {written}"));
    assert_eq!(again.to_json(), written);
    // Compared as text, because a NaN differs from itself.
    assert_eq!(format!("{again:?}"), format!("{counterexample:?}"));
    let is_toy = counterexample.plan.target.starts_with("toy/") && counterexample.plan.controller.is_empty();
    if is_toy && let Ok(resolved) = counterexample.resolve(Path::new("."), None) {
        let _ = counterexample.replay(&resolved);
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    // Formulas that every scenario violates.
    let seed = |target: &str, space: &str, formula: &str| {
        let falsify = FalsifyPlan { formula: Some(formula.to_string()), ..FalsifyPlan::default() };
        let plan = Plan { space: space.to_string(), falsify: Some(falsify), ..Plan::new(target, "") };
        let resolved = ResolvedPlan::new(&plan).expect("the toy exists");
        let request = Request::new(resolved.space.nominal(), Seed(u64::MAX));
        let episode = resolved.system().expect("a toy").rollout(&[request]).expect("a scenario").remove(0);
        let counterexample = Counterexample::from_episode(&resolved, &episode).expect("a violation");
        counterexample.to_json().into_bytes()
    };
    vec![
        seed("toy/car-following", "starts+dynamics+events", "always[0:20](gap >= 1000 and speed >= 0)"),
        seed("toy/noisy", "starts+noise", "always(height >= 1000)"),
    ]
}
