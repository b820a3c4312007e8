use super::Ddpg;
use crate::algorithm::Algorithm;
use crate::off_policy::OffPolicy;
use crate::off_policy::declare::off_policy_settings;
use crate::off_policy::deterministic::Exploration;
use crate::settings::setting::{AT_LEAST_1, DECAY, NOT_NEGATIVE_RANGE};
use crate::{ExplorationDecay, RunSettings, ScenarioSettings};

off_policy_settings! {
    /// Settings of DDPG. In TOML, each field is a key and the last seven are tables;
    /// [`TomlSettings`](crate::TomlSettings) describes missing keys.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::{TomlSettings, ddpg::DdpgSettings};
    /// let settings = DdpgSettings::from_toml("tau = 0.01\nepisodes.action_noise = 0.5")?;
    /// assert_eq!((settings.tau, settings.episodes.environments), (0.01, 128));
    /// assert_eq!(DdpgSettings::from_toml(&settings.to_toml())?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub struct DdpgSettings for "ddpg" {
        /// Initial standard deviations of the exploration noise in the first and in the last
        /// environment; linear between them.
        pub exploration_std: [f64; 2] = [0.05, 0.5], NOT_NEGATIVE_RANGE;
        /// Linear decay of the exploration noise over `steps` environment steps to the fraction
        /// `share`; no decay if not set.
        pub exploration_decay: Option<ExplorationDecay> = None, DECAY;
        /// Number of control steps for which an environment repeats its exploration noise. A robot
        /// arm hardly responds to noise that changes at each control step.
        pub exploration_hold: u64 = 1, AT_LEAST_1;
    }
}

impl DdpgSettings {
    pub(super) fn exploration(&self) -> Exploration {
        Exploration { std: self.exploration_std, decay: self.exploration_decay, hold: self.exploration_hold }
    }
}

impl Algorithm for DdpgSettings {
    const SUMMARY: &'static str =
        "deep deterministic policy gradient: off-policy, a deterministic policy with one critic";

    type Learner = OffPolicy<Ddpg>;

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
            (
                "exploration_std = [0.5, 0.1]",
                "`exploration_std` must be two numbers of at least 0 in ascending order",
            ),
            (
                "replay.capacity = 700",
                "`replay.capacity` must be at least `replay.n_steps` + 3 control steps",
            ),
            (
                "replay.updates_per_step = -1",
                "`replay.updates_per_step` must be a number of at least 0, found -1",
            ),
            ("critic.norm = true", "line 1: ddpg has no setting `critic.norm`"),
        ] {
            let error = DdpgSettings::from_toml(text).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
