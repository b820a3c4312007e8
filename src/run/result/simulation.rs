use mishandle_results::{Explanation, Noise, Repeats, RequirementVerdict, Simulation};
use mishandle_rollout::{Episode, Scenario};
use mishandle_stl::{Formula, is_violated};

use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::{end_text, given};

/// Returns the result of one simulation of a scenario, with its explanation if it has a verdict.
pub fn simulation_result(
    resolved: &ResolvedPlan,
    episode: &Episode,
    explanation: Option<Explanation>,
) -> Simulation {
    let signals: Vec<&str> = resolved.signals.iter().map(|signal| signal.name.as_str()).collect();
    Simulation {
        end: Some(end_text(episode.end, &signals)),
        reason: given(&episode.reason),
        steps: Some(episode.steps as u64),
        robustness: episode.robustness().map(Into::into),
        violated: episode.robustness().map(is_violated),
        explanation,
        requirements: requirements(resolved, episode),
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

/// Returns the verdicts of the named requirements; `None` without one.
fn requirements(resolved: &ResolvedPlan, episode: &Episode) -> Option<Vec<RequirementVerdict>> {
    let others = &resolved.specification.others;
    let verdict = |(index, (name, formula)): (usize, &(String, Formula))| {
        let robustness = episode.verdict.others.get(index).copied().flatten();
        RequirementVerdict {
            name: name.clone(),
            formula: formula.to_string(),
            robustness: robustness.map(Into::into),
            violated: robustness.map(is_violated),
            asks_nothing: episode
                .verdict
                .other_vacuities
                .get(index)
                .and_then(|found| found.map(|found| found.reason(formula))),
        }
    };
    (!others.is_empty()).then(|| others.iter().enumerate().map(verdict).collect())
}

fn empty(resolved: &ResolvedPlan, scenario: &Scenario) -> Simulation {
    Simulation {
        subject: resolved.subject(),
        scenario: named_scenario(resolved.space.axes(), scenario.values()),
        formula: resolved.specification.requirement.to_string(),
        end: None,
        reason: None,
        steps: None,
        robustness: None,
        violated: None,
        explanation: None,
        requirements: None,
        repeats: None,
        noise: None,
    }
}
