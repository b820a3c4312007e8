use mishandle_rollout::{Episode, EpisodeEnd};

use crate::error::MishandleError;

/// Describes the end of an episode in words. `signals` are the names of the signals.
pub fn end_text(end: EpisodeEnd, signals: &[&str]) -> String {
    match end {
        EpisodeEnd::InvalidSignal { step, index } => {
            let name = signals.get(index).unwrap_or(&"unknown");
            format!("the signal `{name}` is not finite at sample {step}")
        }
        EpisodeEnd::InvalidAction { step, index } => {
            format!(
                "the controller returned an action that is not finite in control step {step} (index {index})"
            )
        }
        EpisodeEnd::InvalidObservation { step, index } => {
            format!("the observation is not finite at sample {step} (index {index})")
        }
        EpisodeEnd::InvalidReward { step, index } => {
            format!("the reward is not finite in control step {step} (term {index})")
        }
        EpisodeEnd::Undefined { step } => {
            format!("the formula has no finite value at sample {step}, so the simulation is undecided")
        }
        EpisodeEnd::Diverged { step } => format!("the physics diverged in control step {step}"),
        EpisodeEnd::Stopped { step } => format!("the monitor stopped it after control step {step}"),
        EpisodeEnd::Terminated { step } => format!("the target ended it after control step {step}"),
        EpisodeEnd::InvalidScenario => "the target cannot start from the scenario".to_string(),
        // At the reset, or anywhere in a simulation whose target returns its trace as a whole.
        EpisodeEnd::Crashed { step: 0 } => "the target or its controller failed".to_string(),
        EpisodeEnd::TimedOut { step: 0 } => "it took longer than its time limit".to_string(),
        EpisodeEnd::Crashed { step } => {
            format!("the target or its controller failed in control step {step}")
        }
        EpisodeEnd::TimedOut { step } => {
            format!("it took longer than its time limit in control step {step}")
        }
        EpisodeEnd::Completed => "it completed".to_string(),
    }
}

/// Says why a simulation with this end has no verdict.
pub(crate) fn open_text(end: EpisodeEnd, signals: &[&str]) -> String {
    match end {
        EpisodeEnd::Completed => "the formula has no finite value".to_string(),
        EpisodeEnd::Terminated { .. } => {
            format!("{}, which leaves the formula undecided", end_text(end, signals))
        }
        end => end_text(end, signals),
    }
}

/// Returns the error of an episode that has no verdict.
pub(crate) fn without_verdict_error(episode: &Episode) -> MishandleError {
    let signals: Vec<&str> = episode.trace.names().iter().map(String::as_str).collect();
    let why = open_text(episode.end, &signals);
    let reason = given(&episode.reason).map_or(String::new(), |reason| format!(": {reason}"));
    MishandleError::NoVerdict { why: why + &reason }
}

/// Returns a reason, if there is one.
pub(crate) fn given(reason: &str) -> Option<String> {
    (!reason.is_empty()).then(|| reason.to_string())
}
