//! The reward terms for the manner that the settings weigh.

use mishandle_rollout::Environment;
use mishandle_tasks::{MannerWeights, TaskEnvironment};
use mishandle_training::{AlgorithmSettings, RewardSettings};

use crate::error::MishandleError;

/// Returns the environment with the reward terms for the manner that the settings weigh.
///
/// # Errors
/// If a term needs contact forces, which the engine of a GPU does not compute.
pub(super) fn with_terms(
    environment: TaskEnvironment,
    settings: &AlgorithmSettings,
    device: &str,
) -> Result<TaskEnvironment, MishandleError> {
    let RewardSettings { contact_force, action_rate, speed, rest } = *settings.rewards();
    if device == "gpu" && contact_force > 0.0 {
        return Err(MishandleError::InvalidValue {
            what: "the setting `rewards.contact_force`",
            value: contact_force.to_string(),
            expected: "0 with --device gpu, which computes no contact forces; train with --device cpu, or use the \
                       other terms of [rewards]",
        });
    }
    let weights = MannerWeights { contact_force, action_rate, speed, rest };
    if weights == MannerWeights::default() {
        return Ok(environment);
    }
    let steps = settings.episodes().time_limit.unwrap_or(environment.episode_steps());
    Ok(environment.with_manner_reward(weights, steps))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_tasks::{Preset, Reward};

    fn terms(text: &str, device: &str) -> Result<Vec<String>, String> {
        let task = mishandle_tasks::task("point-reaching").unwrap();
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
        let settings = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
        let own = environment.reward_terms().len();
        let with = with_terms(environment, &settings, device).map_err(|error| error.to_string())?;
        Ok(with.reward_terms()[own..].to_vec())
    }

    #[test]
    fn terms_with_a_weight_exist_under_the_names_of_their_settings() {
        let none: [&str; 0] = [];
        assert_eq!(terms("", "cpu").unwrap(), none);
        let all = "rewards = { contact_force = 1, action_rate = 1, speed = 1, rest = 1 }";
        assert_eq!(terms(all, "cpu").unwrap(), ["contact_force", "action_rate", "speed", "rest"]);
        assert_eq!(terms("rewards.rest = 0.5", "gpu").unwrap(), ["rest"]);
    }

    #[test]
    fn a_gpu_has_no_contact_forces() {
        let error = terms("rewards = { contact_force = 0.5, speed = 1 }", "gpu").unwrap_err();
        let expected =
            "the setting `rewards.contact_force` is 0.5; it must be 0 with --device gpu, which computes";
        assert!(error.starts_with(expected), "{error}");
    }
}
