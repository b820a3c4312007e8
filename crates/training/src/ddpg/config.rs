use super::Ddpg;
use crate::algorithm::Algorithm;
use crate::deterministic::Exploration;
use crate::off_policy::OffPolicy;
use crate::off_policy_config::off_policy_config;
use crate::setting::{AT_LEAST_1, DECAY, RISING_FROM_0};
use crate::{ExplorationDecay, RunSettings};

off_policy_config! {
    /// Settings of DDPG. As TOML, each is a key of its name, the last five are tables; see [`Settings`](crate::Settings)
    /// for keys left out.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{Settings, ddpg::DdpgConfig};
    /// let config = DdpgConfig::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((config.tau, config.episodes.environments), (0.01, 128));
    /// assert_eq!(DdpgConfig::from_toml(&config.to_toml())?, config);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct DdpgConfig for "ddpg" {
        /// Deviations of the exploring noise: of the first simulation and of the last.
        pub exploration_std: [f64; 2] = [0.05, 0.5], RISING_FROM_0;
        /// How that noise falls, linearly, in the beginning: over how many environment steps, and to what share; it does not
        /// if left out.
        pub exploration_decay: Option<ExplorationDecay> = None, DECAY;
        /// Control steps for which a simulation keeps its noise: an arm hardly follows what changes each step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
    }
}

impl DdpgConfig {
    pub(super) fn exploration(&self) -> Exploration {
        Exploration { std: self.exploration_std, decay: self.exploration_decay, hold: self.exploration_hold }
    }
}

impl Algorithm for DdpgConfig {
    const SUMMARY: &'static str =
        "deep deterministic policy gradient: off-policy, a deterministic policy with one critic";

    type Learner = OffPolicy<Ddpg>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;

    #[test]
    fn wrong_values_are_refused() {
        for (text, told) in [
            (
                "exploration_std = [0.5, 0.1]",
                "`exploration_std` must be two finite numbers, at least 0 and not",
            ),
            (
                "replay.capacity = 700",
                "`replay.capacity` must be enough for `replay.n_steps` + 3 control steps",
            ),
            (
                "replay.updates_per_step = -1",
                "`replay.updates_per_step` must be a number of at least 0, found -1",
            ),
            ("critic.norm = true", "line 1: ddpg has no setting `critic.norm`"),
        ] {
            let refusal = DdpgConfig::from_toml(text).unwrap_err().to_string();
            assert!(refusal.contains(told), "{refusal}");
        }
    }
}
