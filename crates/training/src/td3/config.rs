use crate::deterministic::Exploration;
use crate::off_policy_config::off_policy_config;
use crate::settings::{at_least_1, not_negative};
use crate::{ExplorationDecay, TrainingError};

off_policy_config! {
    /// Settings of TD3. As TOML, each is a key of its name, the last five are tables; see [`Settings`](crate::Settings)
    /// for keys left out.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{Settings, td3::Td3Config};
    /// let config = Td3Config::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((config.tau, config.episodes.environments), (0.01, 128));
    /// assert_eq!(Td3Config::from_toml(&config.to_toml())?, config);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct Td3Config for "td3" {
        /// Deviations of the exploring noise: of the first simulation and of the last. Default `[0.05, 0.5]`.
        pub exploration_std: [f64; 2] = [0.05, 0.5],
        /// How that noise falls, `{ steps, share }`; it does not if left out.
        pub exploration_decay: Option<ExplorationDecay> = None,
        /// Control steps for which a simulation keeps its noise: an arm hardly follows what changes each step. Default 1.
        pub exploration_hold: u64 = 1,
        /// σ of the noise on the target's action. Default 0.1.
        pub smoothing_std: f64 = 0.1,
        /// c, where that noise is clipped. Default 0.3.
        pub smoothing_clip: f64 = 0.3,
        /// d, updates of the critics for one of the policy and the targets. Default 2.
        pub policy_delay: u64 = 2,
    }
}

impl Td3Config {
    pub(super) fn exploration(&self) -> Exploration {
        Exploration { std: self.exploration_std, decay: self.exploration_decay, hold: self.exploration_hold }
    }

    fn check_own(&self) -> Result<(), TrainingError> {
        self.exploration().check()?;
        not_negative("smoothing_std", self.smoothing_std)?;
        not_negative("smoothing_clip", self.smoothing_clip)?;
        at_least_1("policy_delay", self.policy_delay)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Settings;

    #[test]
    fn wrong_values_are_refused() {
        for (text, told) in [
            ("smoothing_std = -0.1", "`smoothing_std` must be a number of at least 0, found -0.1"),
            ("policy_delay = 0", "`policy_delay` must be at least 1, found 0"),
            (
                "exploration_std = [-0.1, 0.1]",
                "`exploration_std` must be two finite numbers, at least 0 and not",
            ),
        ] {
            let refusal = Td3Config::from_toml(text).unwrap_err().to_string();
            assert!(refusal.contains(told), "{refusal}");
        }
    }
}
