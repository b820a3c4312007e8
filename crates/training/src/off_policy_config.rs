//! The settings that all off-policy algorithms have.

/// Declares the settings of an off-policy algorithm: those that all of them have, with its own in their midst, each with
/// its default and its rule. The file `skrl-0.10.toml` beside it has to be its settings preset.
///
/// All are keys of one level, in this order. Serde can read one level into two structures (`flatten`), but then it
/// neither refuses keys that are not known nor tells the line of a mistake.
macro_rules! off_policy_config {
    (
        $(#[$about:meta])*
        pub struct $config:ident for $algorithm:literal {
            $($(#[doc = $doc:literal])* pub $own:ident: $kind:ty = $default:expr $(, $rule:expr)?;)*
        }
    ) => {
        $crate::declare::settings! {
            $(#[$about])*
            pub struct $config in "" {
                /// γ, the discount of a control step.
                pub gamma: f64 = 0.98, $crate::setting::SHARE;
                /// τ, the targets' share of the networks in each update.
                pub tau: f64 = 0.005, $crate::setting::SHARE;
                $($(#[doc = $doc])* pub $own: $kind = $default $(, $rule)?;)*
                /// Control steps of each simulation in an iteration, after which it may be validated.
                pub steps_per_iteration: usize = 64, $crate::setting::AT_LEAST_1;
            } tables {
                /// How long, and when to look.
                pub run: $crate::RunSettings = Default::default();
                /// The simulations. By default there are 128.
                pub episodes: $crate::EpisodeSettings =
                    $crate::EpisodeSettings { environments: 128, ..Default::default() };
                /// What is remembered.
                pub replay: $crate::ReplaySettings = Default::default();
                /// The policy.
                pub policy: $crate::ActorSettings = Default::default();
                /// The critic, or each of two.
                pub critic: $crate::ActionValueSettings = Default::default();
            }
        }

        impl $crate::Settings for $config {
            const ALGORITHM: &'static str = $algorithm;
            const PRESETS: &'static [(&'static str, &'static str)] =
                &[($crate::presets::SKRL_0_10, include_str!("skrl-0.10.toml"))];

            fn settings() -> Vec<$crate::Setting> {
                Self::described()
            }

            fn check(&self) -> Result<(), $crate::TrainingError> {
                self.check_rules()?;
                self.replay.check_sizes(&self.episodes)
            }
        }

        impl $crate::agent::Shared for $config {
            fn setup(&self) -> $crate::agent::Setup<'_> {
                $crate::agent::Setup {
                    gamma: self.gamma,
                    steps_per_iteration: self.steps_per_iteration,
                    run: &self.run,
                    episodes: &self.episodes,
                    replay: &self.replay,
                    policy: &self.policy,
                    critic: &self.critic,
                }
            }
        }
    };
}

pub(crate) use off_policy_config;
