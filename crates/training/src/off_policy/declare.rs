//! Declaration of the settings that all off-policy algorithms have.

/// Declares the settings of an off-policy algorithm: the shared settings, with the algorithm's own
/// ones between them. The file `skrl-0.10.toml` in the algorithm's folder is its settings base.
///
/// Serde's `flatten` would also combine two structures into one table, but it accepts unknown keys
/// and loses the line numbers of errors.
macro_rules! off_policy_settings {
    (
        $(#[$about:meta])*
        pub struct $settings:ident for $algorithm:literal {
            $($(#[doc = $doc:literal])* pub $own:ident: $kind:ty = $default:expr $(, $constraint:expr)?;)*
        }
    ) => {
        $crate::settings::declare::settings! {
            $(#[$about])*
            pub struct $settings in "" {
                /// Discount factor γ per control step.
                pub gamma: f64 = 0.98, $crate::settings::setting::FRACTION;
                /// τ of the soft update of target networks.
                pub tau: f64 = 0.005, $crate::settings::setting::FRACTION;
                $($(#[doc = $doc])* pub $own: $kind = $default $(, $constraint)?;)*
                /// Control steps per environment in an iteration.
                pub steps_per_iteration: usize = 64, $crate::settings::setting::AT_LEAST_1;
            } tables {
                /// Length of the training run, validation, checkpoints.
                pub run: $crate::RunSettings = Default::default();
                /// The parallel environments; 128 by default.
                pub episodes: $crate::EpisodeSettings =
                    $crate::EpisodeSettings { environments: 128, ..Default::default() };
                /// The scenarios of the episodes.
                pub scenarios: $crate::ScenarioSettings = Default::default();
                /// Reward terms for the manner.
                pub rewards: $crate::RewardSettings = Default::default();
                /// The replay buffer and the number of updates.
                pub replay: $crate::ReplayBufferSettings = Default::default();
                /// The policy.
                pub policy: $crate::ActorSettings = Default::default();
                /// The critics.
                pub critic: $crate::QCriticSettings = Default::default();
            }
        }

        impl $crate::TomlSettings for $settings {
            const ALGORITHM: &'static str = $algorithm;
            const BASES: &'static [(&'static str, &'static str)] =
                &[($crate::settings::bases::SKRL_0_10, include_str!("skrl-0.10.toml"))];

            fn settings() -> Vec<$crate::Setting> {
                Self::described()
            }

            fn check(&self) -> Result<(), $crate::TrainingError> {
                self.check_constraints()?;
                self.scenarios.check_shares()?;
                self.replay.check_sizes(&self.episodes)
            }
        }

        impl $crate::off_policy::agent::HasOffPolicySettings for $settings {
            fn shared(&self) -> $crate::off_policy::settings::OffPolicySettings<'_> {
                $crate::off_policy::settings::OffPolicySettings {
                    gamma: self.gamma,
                    steps_per_iteration: self.steps_per_iteration,
                    run: &self.run,
                    episodes: &self.episodes,
                    scenarios: &self.scenarios,
                    rewards: &self.rewards,
                    replay: &self.replay,
                    policy: &self.policy,
                    critic: &self.critic,
                }
            }
        }
    };
}

pub(crate) use off_policy_settings;
