//! The reward terms for the manner that the settings weigh.

use mishandle_rollout::Environment;
use mishandle_tasks::{MannerWeights, TaskEnvironment};
use mishandle_training::{AlgorithmSettings, RewardSettings};

/// Returns the environment with the reward terms for the manner that the settings weigh.
pub(super) fn with_terms(environment: TaskEnvironment, settings: &AlgorithmSettings) -> TaskEnvironment {
    let RewardSettings { contact_force, action_rate, speed, rest } = *settings.rewards();
    let weights = MannerWeights { contact_force, action_rate, speed, rest };
    if weights == MannerWeights::default() {
        return environment;
    }
    let steps = settings.episodes().time_limit.unwrap_or(environment.episode_steps());
    environment.with_manner_reward(weights, steps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_tasks::{Preset, Reward};

    fn terms(text: &str) -> Vec<String> {
        let task = mishandle_tasks::task("point-reaching").unwrap();
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
        let settings = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
        let own = environment.reward_terms().len();
        with_terms(environment, &settings).reward_terms()[own..].to_vec()
    }

    #[test]
    fn terms_with_a_weight_exist_under_the_names_of_their_settings() {
        let none: [&str; 0] = [];
        assert_eq!(terms(""), none);
        let all = "rewards = { contact_force = 1, action_rate = 1, speed = 1, rest = 1 }";
        assert_eq!(terms(all), ["contact_force", "action_rate", "speed", "rest"]);
        assert_eq!(terms("rewards.rest = 0.5"), ["rest"]);
    }
}
