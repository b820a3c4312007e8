use mishandle_rollout::EpisodeEnd;

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

/// Returns a reason, if there is one.
pub(crate) fn given(reason: &str) -> Option<String> {
    (!reason.is_empty()).then(|| reason.to_string())
}
