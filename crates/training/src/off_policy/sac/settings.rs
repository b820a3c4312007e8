use super::Sac;
use super::distribution::Distribution;
use crate::algorithm::Algorithm;
use crate::off_policy::OffPolicy;
use crate::off_policy::declare::off_policy_settings;
use crate::settings::setting::{AT_LEAST_1, POSITIVE};
use crate::{RunSettings, ScenarioSettings};

off_policy_settings! {
    /// Settings of SAC. In TOML, each field is a key and the last seven are tables;
    /// [`TomlSettings`](crate::TomlSettings) describes missing keys.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{TomlSettings, sac::SacSettings};
    /// let settings = SacSettings::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((settings.tau, settings.episodes.environments), (0.01, 128));
    /// assert_eq!(SacSettings::from_toml(&settings.to_toml())?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct SacSettings for "sac" {
        /// Action distribution of the policy.
        pub distribution: Distribution = Distribution::Squashed;
        /// Target entropy, as the standard deviation of a Gaussian with this entropy, before
        /// squashing.
        pub target_std: f64 = 0.2, POSITIVE;
        /// Number of control steps for which an environment repeats its sampling noise z. A robot
        /// arm hardly responds to noise that changes at each control step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
        /// Initial temperature α.
        pub initial_temperature: f64 = 0.01, POSITIVE;
        /// Learning rate of log α.
        pub temperature_learning_rate: f64 = 1e-3, POSITIVE;
    }
}

impl Algorithm for SacSettings {
    const SUMMARY: &'static str =
        "soft actor-critic: off-policy, a stochastic policy with entropy regularization";

    type Learner = OffPolicy<Sac>;

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
            ("target_std = 0", "`target_std` must be a number above 0, found 0"),
            ("initial_temperature = nan", "`initial_temperature` must be a number above 0, found NaN"),
            ("exploration_std = [0.1, 0.1]", "line 1: sac has no setting `exploration_std`"),
        ] {
            let error = SacSettings::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
