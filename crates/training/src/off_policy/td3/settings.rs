use super::Td3;
use crate::algorithm::Algorithm;
use crate::off_policy::OffPolicy;
use crate::off_policy::declare::off_policy_settings;
use crate::off_policy::deterministic::Exploration;
use crate::settings::setting::{AT_LEAST_1, DECAY, NOT_NEGATIVE, NOT_NEGATIVE_RANGE};
use crate::{ExplorationDecay, RunSettings, ScenarioSettings};

off_policy_settings! {
    /// Settings of TD3. In TOML, each field is a key and the last seven are tables;
    /// [`TomlSettings`](crate::TomlSettings) describes missing keys.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{TomlSettings, td3::Td3Settings};
    /// let settings = Td3Settings::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((settings.tau, settings.episodes.environments), (0.01, 128));
    /// assert_eq!(Td3Settings::from_toml(&settings.to_toml())?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct Td3Settings for "td3" {
        /// Initial standard deviations of the exploration noise in the first and in the last
        /// environment; linear between them.
        pub exploration_std: [f64; 2] = [0.05, 0.5], NOT_NEGATIVE_RANGE;
        /// Linear decay of the exploration noise over `steps` environment steps to the fraction
        /// `share`; no decay if not set.
        pub exploration_decay: Option<ExplorationDecay> = None, DECAY;
        /// Number of control steps for which an environment repeats its exploration noise. A robot
        /// arm hardly responds to noise that changes at each control step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
        /// Standard deviation σ of target policy smoothing.
        pub smoothing_std: f64 = 0.1, NOT_NEGATIVE;
        /// Clip range c of the smoothing noise.
        pub smoothing_clip: f64 = 0.3, NOT_NEGATIVE;
        /// Policy delay d: critic updates per update of the policy and the target networks.
        pub policy_delay: u64 = 2, AT_LEAST_1;
    }
}

impl Td3Settings {
    pub(super) fn exploration(&self) -> Exploration {
        Exploration { std: self.exploration_std, decay: self.exploration_decay, hold: self.exploration_hold }
    }
}

impl Algorithm for Td3Settings {
    const SUMMARY: &'static str = "twin delayed DDPG: off-policy, a deterministic policy with two critics";

    type Learner = OffPolicy<Td3>;

    fn run_mut(&mut self) -> &mut RunSettings {
        &mut self.run
    }

    fn scenarios_mut(&mut self) -> &mut ScenarioSettings {
        &mut self.scenarios
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TomlSettings;

    #[test]
    fn errors_for_wrong_values_name_the_allowed_values() {
        for (text, expected) in [
            ("smoothing_std = -0.1", "`smoothing_std` must be a number of at least 0, found -0.1"),
            ("policy_delay = 0", "`policy_delay` must be a whole number from 1 to 10^12, found 0"),
            (
                "exploration_decay = { steps = 9 }",
                "`exploration_decay` must be { steps = N, share = X } with a whole number N from 1 to 10^12 and",
            ),
            ("[exploration_decay]\nsteps = 0\nshare = 0.5", "with a whole number N from 1 to 10^12"),
            ("exploration_decay = { steps = 9, share = 1.5 }", "a number X from 0 to 1, found [9.0, 1.5]"),
            (
                "exploration_std = [-0.1, 0.1]",
                "`exploration_std` must be two numbers of at least 0 in ascending order",
            ),
        ] {
            let error = Td3Settings::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
