use serde::{Deserialize, Serialize};

use crate::deterministic::Exploration;
use crate::settings::{at_least_1, share};
use crate::{
    ActionValueSettings, ActorSettings, EpisodeSettings, ReplaySettings, RunSettings, Settings, TrainingError,
};

/// Settings of DDPG. As TOML, each is a key of its name, the last five are tables; a key that is left out has its
/// default, one that is not known is an error.
///
/// # Example
/// ```
/// use mishandle_training::{Settings, ddpg::DdpgConfig};
/// let config = DdpgConfig::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
/// assert_eq!((config.tau, config.episodes.environments), (0.01, 128));
/// assert_eq!(DdpgConfig::from_toml(&config.to_toml())?, config);
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DdpgConfig {
    /// γ, the discount of a control step. Default 0.98.
    pub gamma: f64,
    /// τ, the targets' share of the networks in each update. Default 0.005.
    pub tau: f64,
    /// Deviations of the exploring noise: of the first simulation and of the last. Default `[0.05, 0.5]`.
    pub exploration_std: [f64; 2],
    /// Control steps for which a simulation keeps its noise: an arm hardly follows what changes each step. Default 1.
    pub exploration_hold: u64,
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
    /// The critic.
    pub critic: ActionValueSettings,
}

impl Default for DdpgConfig {
    fn default() -> DdpgConfig {
        DdpgConfig {
            gamma: 0.98,
            tau: 0.005,
            exploration_std: [0.05, 0.5],
            exploration_hold: 1,
            steps_per_iteration: 64,
            run: RunSettings::default(),
            episodes: EpisodeSettings { environments: 128, ..EpisodeSettings::default() },
            replay: ReplaySettings::default(),
            policy: ActorSettings::default(),
            critic: ActionValueSettings::default(),
        }
    }
}

impl Settings for DdpgConfig {
    const ALGORITHM: &'static str = "ddpg";

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
        Exploration(self.exploration_std).check()?;
        at_least_1("exploration_hold", self.exploration_hold)?;
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
        let config = DdpgConfig::default();
        assert_eq!(DdpgConfig::from_toml(&config.to_toml()).unwrap(), config);
        assert_eq!(DdpgConfig::from_toml("").unwrap(), config);
    }

    #[test]
    fn wrong_values_are_refused() {
        for (text, told) in [
            ("exploration_std = [0.5, 0.1]", "`exploration_std` must be two finite numbers, above 0 and not"),
            ("replay.capacity = 700", "`replay.capacity` must be enough for `n_steps` + 3 control steps"),
            ("replay.updates_per_step = -1", "`updates_per_step` must be a number of at least 0, found -1"),
            ("critic.norm = true", "line 1: unknown field `norm`"),
        ] {
            let refusal = DdpgConfig::from_toml(text).unwrap_err().to_string();
            assert!(refusal.contains(told), "{refusal}");
        }
    }
}
