use mishandle_results::{Explanation, Noise, Repeats, Simulation};
use mishandle_rollout::{Episode, Scenario};
use mishandle_stl::is_violated;

use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::end_text;

/// Returns the result of one simulation of a scenario, with its explanation if it has a verdict.
pub fn simulation_result(
    resolved: &ResolvedPlan,
    episode: &Episode,
    explanation: Option<Explanation>,
) -> Simulation {
    let signals: Vec<&str> = resolved.target.signals.iter().map(|signal| signal.name.as_str()).collect();
    Simulation {
        end: Some(end_text(episode.end, &signals)),
        steps: Some(episode.steps as u64),
        robustness: episode.robustness().map(Into::into),
        violated: episode.robustness().map(is_violated),
        explanation,
        ..empty(resolved, &episode.request.scenario)
    }
}

/// Returns the result of repeated simulations of a scenario.
pub(crate) fn repeated_result(
    resolved: &ResolvedPlan,
    scenario: &Scenario,
    repeats: Repeats,
    noise: Option<Noise>,
) -> Simulation {
    Simulation { repeats: Some(repeats), noise, ..empty(resolved, scenario) }
}

fn empty(resolved: &ResolvedPlan, scenario: &Scenario) -> Simulation {
    Simulation {
        subject: resolved.subject(),
        scenario: named_scenario(resolved.space.axes(), scenario.values()),
        formula: resolved.specification.requirement.to_string(),
        end: None,
        steps: None,
        robustness: None,
        violated: None,
        explanation: None,
        repeats: None,
        noise: None,
    }
}
