use serde::{Deserialize, Serialize};

use crate::settings::{at_least_1, positive, share};
use crate::{
    ActionValueSettings, ActorSettings, EpisodeSettings, ReplaySettings, RunSettings, Settings, TrainingError,
};

/// Settings of SAC. As TOML, each is a key of its name, the last five are tables; a key that is left out has its
/// default, one that is not known is an error.
///
/// # Example
/// ```
/// use mishandle_training::{Settings, sac::SacConfig};
/// let config = SacConfig::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
/// assert_eq!((config.tau, config.episodes.environments), (0.01, 128));
/// assert_eq!(SacConfig::from_toml(&config.to_toml())?, config);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SacConfig {
    /// γ, the discount of a control step. Default 0.98.
    pub gamma: f64,
    /// τ, the targets' share of the networks in each update. Default 0.005.
    pub tau: f64,
    /// Deviation of each action, before squashing, of a Gaussian with the entropy that is aimed at. Default 0.2.
    pub target_std: f64,
    /// Control steps for which a simulation keeps the z that it draws its actions with: an arm hardly follows what changes
    /// each step. Default 1.
    pub exploration_hold: u64,
    /// α at the start. Default 0.01.
    pub initial_temperature: f64,
    /// Step length of the optimiser of log α. Default 0.001.
    pub temperature_learning_rate: f64,
    /// Control steps of each simulation in an iteration, after which it may be validated. Default 64.
    pub steps_per_iteration: usize,
    /// How long, and when to look.
    pub run: RunSettings,
    /// The simulations. By default there are 128.
    pub episodes: EpisodeSettings,
    /// What is remembered.
    pub replay: ReplaySettings,
    /// The policy.
    pub policy: ActorSettings,
    /// The critics.
    pub critic: ActionValueSettings,
}

impl Default for SacConfig {
    fn default() -> SacConfig {
        SacConfig {
            gamma: 0.98,
            tau: 0.005,
            target_std: 0.2,
            exploration_hold: 1,
            initial_temperature: 0.01,
            temperature_learning_rate: 1e-3,
            steps_per_iteration: 64,
            run: RunSettings::default(),
            episodes: EpisodeSettings { environments: 128, ..EpisodeSettings::default() },
            replay: ReplaySettings::default(),
            policy: ActorSettings::default(),
            critic: ActionValueSettings::default(),
        }
    }
}

impl Settings for SacConfig {
    const ALGORITHM: &'static str = "sac";

    fn run(&self) -> &RunSettings {
        &self.run
    }

    fn episodes(&self) -> &EpisodeSettings {
        &self.episodes
    }

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }

    fn check(&self) -> Result<(), TrainingError> {
        share("gamma", self.gamma)?;
        share("tau", self.tau)?;
        positive("target_std", self.target_std)?;
        at_least_1("exploration_hold", self.exploration_hold)?;
        positive("initial_temperature", self.initial_temperature)?;
        positive("temperature_learning_rate", self.temperature_learning_rate)?;
        at_least_1("steps_per_iteration", self.steps_per_iteration as u64)?;
        self.run.check()?;
        self.episodes.check()?;
        self.replay.check(&self.episodes)?;
        self.policy.check()?;
        self.critic.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_come_back_from_their_text() {
        let config = SacConfig::default();
        assert_eq!(SacConfig::from_toml(&config.to_toml()).unwrap(), config);
        assert_eq!(SacConfig::from_toml("").unwrap(), config);
    }

    #[test]
    fn wrong_values_are_refused() {
        for (text, told) in [
            ("target_std = 0", "`target_std` must be a number above 0, found 0"),
            ("initial_temperature = nan", "`initial_temperature` must be a number above 0, found NaN"),
            ("exploration_std = [0.1, 0.1]", "line 1: unknown field `exploration_std`"),
        ] {
            let refusal = SacConfig::from_toml(text).unwrap_err().to_string();
            assert!(refusal.contains(told), "{refusal}");
        }
    }
}
