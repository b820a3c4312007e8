use super::Sac;
use crate::RunSettings;
use crate::algorithm::Algorithm;
use crate::distribution::Distribution;
use crate::off_policy::OffPolicy;
use crate::off_policy_config::off_policy_config;
use crate::setting::{AT_LEAST_1, POSITIVE};

off_policy_config! {
    /// Settings of SAC. As TOML, each is a key of its name, the last five are tables; see [`Settings`](crate::Settings)
    /// for keys left out.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{Settings, sac::SacConfig};
    /// let config = SacConfig::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((config.tau, config.episodes.environments), (0.01, 128));
    /// assert_eq!(SacConfig::from_toml(&config.to_toml())?, config);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct SacConfig for "sac" {
        /// What the policy draws from.
        pub distribution: Distribution = Distribution::Squashed;
        /// Deviation of each action, before squashing, of a Gaussian with the entropy that is aimed at.
        pub target_std: f64 = 0.2, POSITIVE;
        /// Control steps for which a simulation keeps the z that it draws its actions with: an arm hardly follows what
        /// changes each step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
        /// α at the start.
        pub initial_temperature: f64 = 0.01, POSITIVE;
        /// Step length of the optimiser of log α.
        pub temperature_learning_rate: f64 = 1e-3, POSITIVE;
    }
}

impl Algorithm for SacConfig {
    const SUMMARY: &'static str =
        "soft actor-critic: off-policy, a stochastic policy with entropy regularization";

    type Learner = OffPolicy<Sac>;

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
            ("target_std = 0", "`target_std` must be a number above 0, found 0"),
            ("initial_temperature = nan", "`initial_temperature` must be a number above 0, found NaN"),
            ("exploration_std = [0.1, 0.1]", "line 1: sac has no setting `exploration_std`"),
        ] {
            let refusal = SacConfig::from_toml(text).unwrap_err().to_string();
            assert!(refusal.contains(told), "{refusal}");
        }
    }
}
