//! Failures of an estimation of the failure probability as counterexamples.

use mishandle_risk::{Failure, Scenarios};
use mishandle_rollout::Request;

use crate::counterexample::Counterexample;
use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;

/// Simulates a failure of an estimation again and returns it as a counterexample.
///
/// # Errors
/// If the simulation cannot be run, or does not fail again because the target is not deterministic.
pub fn risk_counterexample(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    failure: &Failure,
) -> Result<Counterexample, MishandleError> {
    let request = Request::new(scenarios.scenario(&failure.draw.latent), failure.draw.seed);
    Counterexample::simulate(resolved, request)
}
