//! Conversion between episodes and stored simulations. No other module does this.

use std::sync::Arc;

use mishandle_rollout::{Episode, EpisodeEnd, Request, Scenario, Seed, Verdict};
use mishandle_stl::{Trace, Vacuity};
use mishandle_store as store;
use mishandle_store::Simulation;

use crate::error::{MishandleError, changed};
use crate::resolve::ResolvedPlan;

/// Names of the verdicts that are stored in addition to the robustness. If the search needs
/// the parts of the robustness, they follow, then the robustness of each named requirement, and why
/// each asks nothing. The last one is why the formula of the question asks nothing.
const VERDICTS: [&str; 6] =
    ["success", "strict", "dangerous_steps", "completion_step", "total_reward", "careful"];

/// Start of the names of the verdicts of named requirements.
pub(crate) const REQUIREMENT: &str = "requirement_";

/// Start of the names of the verdicts that say why a named requirement asks nothing: the value is
/// that of [`Vacuity::code`].
pub(crate) const VACUITY: &str = "vacuity_";

/// Name of the same verdict of the formula of the question.
pub(crate) const SEARCH_VACUITY: &str = "vacuity";

/// Returns the names of all verdicts of a run.
pub(crate) fn verdict_names(resolved: &ResolvedPlan) -> Vec<String> {
    let parts = (1..=resolved.stored_parts).map(|i| format!("part_{i}"));
    let others = &resolved.specification.others;
    let named = |start: &'static str| others.iter().map(move |(name, _)| format!("{start}{name}"));
    let names = VERDICTS.map(String::from).into_iter().chain(parts);
    let own = [SEARCH_VACUITY.to_string()];
    names.chain(named(REQUIREMENT)).chain(named(VACUITY)).chain(own).collect()
}

/// Converts an episode of a plan to a stored simulation. Only a counterexample keeps its trace.
pub(crate) fn row(episode: &Episode, resolved: &ResolvedPlan) -> Simulation {
    let columns = (0..episode.trace.names().len()).map(|i| episode.trace.column(i).to_vec()).collect();
    let trace = store::StoredTrace { columns };
    let Episode { request, verdict, .. } = episode;
    let is_falsified = episode.is_violated();
    let parts = (0..resolved.stored_parts).map(|i| verdict.parts.get(i).copied());
    let verdicts = [
        verdict.success,
        verdict.strict,
        verdict.dangerous_steps.map(|steps| steps as f64),
        verdict.completion_step.map(|step| step as f64),
        episode.total_reward.is_finite().then_some(episode.total_reward),
        verdict.careful,
    ];
    // An episode without a verdict has none of them.
    let named = 0..resolved.specification.others.len();
    let others = named.clone().map(|i| verdict.others.get(i).copied().flatten());
    let code = |rho: Option<f64>, found: Option<Vacuity>| rho.map(|_| f64::from(Vacuity::code(found)));
    let vacuities = named.map(|i| {
        let rho = verdict.others.get(i).copied().flatten();
        code(rho, verdict.other_vacuities.get(i).copied().flatten())
    });
    let own = [code(verdict.robustness, verdict.vacuity)];
    // The value is a lower bound if the simulation stopped because it is above the threshold.
    let is_bound = matches!(episode.end, EpisodeEnd::Stopped { .. })
        && request.stop_threshold.is_some_and(|threshold| verdict.robustness > Some(threshold));
    Simulation {
        trial: request.trial,
        number: request.number,
        seed: request.seed.0,
        unit_point: request.unit_point.clone(),
        scenario: request.scenario.values().to_vec(),
        robustness: verdict.robustness,
        robustness_low: verdict.robustness,
        robustness_high: if is_bound { Some(f64::INFINITY) } else { verdict.robustness },
        stop_threshold: request.stop_threshold,
        end: stored_end(episode.end),
        steps: episode.steps as u32,
        verdicts: verdicts.into_iter().chain(parts).chain(others).chain(vacuities).chain(own).collect(),
        reason: episode.reason.clone(),
        trace_digest: Some(episode.trace_digest.unwrap_or_else(|| trace.digest())),
        trace: is_falsified.then_some(trace),
    }
}

fn stored_end(end: EpisodeEnd) -> store::SimulationEnd {
    use store::SimulationEnd as End;
    match end {
        EpisodeEnd::Completed => End::Completed,
        EpisodeEnd::Terminated { step } => End::Terminated { step: step as u32 },
        EpisodeEnd::Stopped { step } => End::Stopped { step: step as u32 },
        EpisodeEnd::Diverged { step } => End::Diverged { step: step as u32 },
        EpisodeEnd::Undefined { step } => End::Undefined { step: step as u32 },
        EpisodeEnd::InvalidAction { step, index } => {
            End::InvalidAction { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidObservation { step, index } => {
            End::InvalidObservation { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidReward { step, index } => {
            End::InvalidReward { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidSignal { step, index } => {
            End::InvalidSignal { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidScenario => End::InvalidScenario,
        EpisodeEnd::Crashed { step } => End::Crashed { step: step as u32 },
        EpisodeEnd::TimedOut { step } => End::TimedOut { step: step as u32 },
    }
}

pub(crate) fn episode_end(end: store::SimulationEnd) -> EpisodeEnd {
    use store::SimulationEnd as End;
    match end {
        End::Completed => EpisodeEnd::Completed,
        End::Terminated { step } => EpisodeEnd::Terminated { step: step as usize },
        End::Stopped { step } => EpisodeEnd::Stopped { step: step as usize },
        End::Diverged { step } => EpisodeEnd::Diverged { step: step as usize },
        End::Undefined { step } => EpisodeEnd::Undefined { step: step as usize },
        End::InvalidAction { step, index } => {
            EpisodeEnd::InvalidAction { step: step as usize, index: index as usize }
        }
        End::InvalidObservation { step, index } => {
            EpisodeEnd::InvalidObservation { step: step as usize, index: index as usize }
        }
        End::InvalidReward { step, index } => {
            EpisodeEnd::InvalidReward { step: step as usize, index: index as usize }
        }
        End::InvalidSignal { step, index } => {
            EpisodeEnd::InvalidSignal { step: step as usize, index: index as usize }
        }
        End::InvalidScenario => EpisodeEnd::InvalidScenario,
        End::Crashed { step } => EpisodeEnd::Crashed { step: step as usize },
        End::TimedOut { step } => EpisodeEnd::TimedOut { step: step as usize },
    }
}

/// Converts a stored simulation of a plan to an episode, with a trace if the simulation has one.
///
/// # Errors
/// If the episode has too many steps.
pub(crate) fn episode(simulation: &Simulation, resolved: &ResolvedPlan) -> Result<Episode, MishandleError> {
    let target = &resolved.target;
    let episode_steps = target.episode_steps;
    let place = || format!("simulation {} of trial {}", simulation.number, simulation.trial);
    let stored = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name)?;
        simulation.verdicts.get(index).copied().flatten()
    };
    // A sample is taken before the first step, too.
    let samples = episode_steps as f64 + 1.0;
    let count = |name: &'static str, limit: f64, value: Option<f64>| {
        let is_count = |value: &f64| (0.0..=limit).contains(value) && value.fract() == 0.0;
        match value {
            Some(value) if !is_count(&value) => Err(changed(format!(
                "`{name}` of {} is {value}; it must be a whole number from 0 to {limit}",
                place()
            ))),
            value => Ok(value.map(|value| value as usize)),
        }
    };
    let dangerous_steps = count("dangerous_steps", samples, stored("dangerous_steps"))?;
    let completion_step = count("completion_step", samples, stored("completion_step"))?;
    let steps = count("steps", episode_steps as f64, Some(simulation.steps.into()))?;
    count("end_step", samples, simulation.end.step().map(f64::from))?;
    let end = episode_end(simulation.end);
    if !target.can_fail && (end.is_failed() || matches!(end, EpisodeEnd::Terminated { .. })) {
        let end = simulation.end;
        return Err(changed(format!("{} has the end {end:?}, which its target does not have", place())));
    }
    if let Some(problem) = contradiction(simulation, episode_steps) {
        return Err(changed(format!("{}: {problem}", place())));
    }
    let episode = recorded_episode(simulation);
    let further = simulation.verdicts.get(VERDICTS.len()..).unwrap_or_default();
    let (parts, others) = further.split_at(further.len().min(resolved.stored_parts));
    let others = &others[..others.len().min(resolved.specification.others.len())];
    // Either all parts are present or none, because a formula can have no finite value.
    let parts = parts.iter().copied().collect::<Option<Vec<f64>>>().unwrap_or_default();
    let request = Request { needs_parts: resolved.stored_parts > 0, ..episode.request };
    let verdict =
        Verdict { dangerous_steps, completion_step, parts, others: others.to_vec(), ..episode.verdict };
    let trace =
        simulation.trace.as_ref().map_or(episode.trace, |stored| trace(resolved.signal_names(), stored));
    Ok(Episode { request, trace, steps: steps.unwrap_or_default(), verdict, ..episode })
}

/// Returns a recorded trace with the names of its signals.
pub(crate) fn trace(names: Arc<[String]>, stored: &store::StoredTrace) -> Trace {
    let samples = stored.columns.first().map_or(0, Vec::len);
    let mut trace = Trace::with_capacity(names, samples);
    let mut sample = vec![0.0; stored.columns.len()];
    for step in 0..samples {
        sample.iter_mut().zip(&stored.columns).for_each(|(value, column)| *value = column[step]);
        trace.push(&sample);
    }
    trace
}

/// Converts a stored simulation to an episode without a trace and parts, and checks none of
/// its values.
///
/// It needs no target, so it reads runs whose target is not here, such as those of a Python system.
pub fn recorded_episode(simulation: &Simulation) -> Episode {
    let stored = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name)?;
        simulation.verdicts.get(index).copied().flatten()
    };
    let count = |name: &str| stored(name).map(|value| value as usize);
    Episode {
        request: request(simulation, false),
        end: episode_end(simulation.end),
        reason: simulation.reason.clone(),
        steps: simulation.steps as usize,
        verdict: Verdict {
            robustness: simulation.robustness,
            success: stored("success"),
            strict: stored("strict"),
            careful: stored("careful"),
            dangerous_steps: count("dangerous_steps"),
            completion_step: count("completion_step"),
            ..Verdict::default()
        },
        total_reward: stored("total_reward").unwrap_or(f64::NAN),
        trace: Trace::new([].into()),
        trace_digest: simulation.trace_digest,
    }
}

/// Describes how the end of a stored simulation contradicts its other values; `None` if it does
/// not.
fn contradiction(simulation: &Simulation, episode_steps: usize) -> Option<&'static str> {
    use store::SimulationEnd as End;
    let Simulation { end, steps, robustness, robustness_low, robustness_high, .. } = *simulation;
    let has_value = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name);
        index.and_then(|index| simulation.verdicts.get(index).copied().flatten()).is_some()
    };
    let bits = |value: Option<f64>| value.map(f64::to_bits);
    let can_have_verdict = matches!(end, End::Completed | End::Terminated { .. } | End::Stopped { .. });
    let stopped_at = match end {
        End::Terminated { step } | End::Stopped { step } => Some(step),
        _ => None,
    };
    let has_verdict = robustness.is_some() || ["success", "strict", "careful"].into_iter().any(has_value);
    if !can_have_verdict && has_verdict {
        Some("its end allows no verdict, but it has one")
    } else if end == End::Completed && (steps as usize) != episode_steps {
        Some("it completed, but with another number of control steps than an episode")
    } else if stopped_at.is_some_and(|step| step != steps) {
        Some("it ended after another control step than it took")
    } else if matches!(end, End::InvalidAction { step: 0, .. } | End::InvalidReward { step: 0, .. }) {
        Some("its end has control step 0, and control steps count from 1")
    } else if simulation.stop_threshold.is_none()
        && (bits(robustness_low), bits(robustness_high)) != (bits(robustness), bits(robustness))
    {
        Some("no stop rule applied, but the bounds of its robustness differ from the robustness")
    } else {
        None
    }
}

/// Returns the request of a stored simulation.
pub(crate) fn request(simulation: &Simulation, needs_parts: bool) -> Request {
    Request {
        trial: simulation.trial,
        number: simulation.number,
        unit_point: simulation.unit_point.clone(),
        scenario: Scenario::new(simulation.scenario.clone()),
        seed: Seed(simulation.seed),
        needs_parts,
        stop_threshold: simulation.stop_threshold,
    }
}
