use super::Td3;
use crate::algorithm::Algorithm;
use crate::deterministic::Exploration;
use crate::off_policy::OffPolicy;
use crate::off_policy_config::off_policy_config;
use crate::setting::{AT_LEAST_1, DECAY, NOT_NEGATIVE, RISING_FROM_0};
use crate::{ExplorationDecay, RunSettings};

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
        /// Deviations of the exploring noise: of the first simulation and of the last.
        pub exploration_std: [f64; 2] = [0.05, 0.5], RISING_FROM_0;
        /// How that noise falls, linearly, in the beginning: over how many environment steps, and to what share; it does not
        /// if left out.
        pub exploration_decay: Option<ExplorationDecay> = None, DECAY;
        /// Control steps for which a simulation keeps its noise: an arm hardly follows what changes each step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
        /// σ of the noise on the target's action.
        pub smoothing_std: f64 = 0.1, NOT_NEGATIVE;
        /// c, where that noise is clipped.
        pub smoothing_clip: f64 = 0.3, NOT_NEGATIVE;
        /// d, updates of the critics for one of the policy and the targets.
        pub policy_delay: u64 = 2, AT_LEAST_1;
    }
}

impl Td3Config {
    pub(super) fn exploration(&self) -> Exploration {
        Exploration { std: self.exploration_std, decay: self.exploration_decay, hold: self.exploration_hold }
    }
}

impl Algorithm for Td3Config {
    const SUMMARY: &'static str = "twin delayed DDPG: off-policy, a deterministic policy with two critics";

    type Learner = OffPolicy<Td3>;

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
            ("smoothing_std = -0.1", "`smoothing_std` must be a number of at least 0, found -0.1"),
            ("policy_delay = 0", "`policy_delay` must be a whole number from 1 to 10^12, found 0"),
            (
                "exploration_decay = { steps = 9 }",
                "`exploration_decay` must be { steps = N, share = X }, N being a whole number from 1 to 10^12, X a",
            ),
            ("[exploration_decay]\nsteps = 0\nshare = 0.5", "N being a whole number from 1 to 10^12"),
            ("exploration_decay = { steps = 9, share = 1.5 }", "X a number from 0 to 1, found [9.0, 1.5]"),
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
