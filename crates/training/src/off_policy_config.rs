//! The settings that all off-policy algorithms have.

/// Declares the settings of an off-policy algorithm: those that all of them have, with its own in their midst, each with
/// its default. A method `check_own` has to check its own; the file `skrl-0.10.toml` beside it has to be its preset.
///
/// All are keys of one level, in this order. Serde can read one level into two structures (`flatten`), but then it
/// neither refuses keys that are not known nor tells the line of a mistake.
macro_rules! off_policy_config {
    (
        $(#[$about:meta])*
        pub struct $config:ident for $algorithm:literal {
            $($(#[$about_own:meta])* pub $own:ident: $kind:ty = $default:expr,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $config {
            /// γ, the discount of a control step. Default 0.98.
            pub gamma: f64,
            /// τ, the targets' share of the networks in each update. Default 0.005.
            pub tau: f64,
            $($(#[$about_own])* pub $own: $kind,)*
            /// Control steps of each simulation in an iteration, after which it may be validated. Default 64.
            pub steps_per_iteration: usize,
            /// How long, and when to look.
            pub run: $crate::RunSettings,
            /// The simulations. By default there are 128.
            pub episodes: $crate::EpisodeSettings,
            /// What is remembered.
            pub replay: $crate::ReplaySettings,
            /// The policy.
            pub policy: $crate::ActorSettings,
            /// The critic, or each of two.
            pub critic: $crate::ActionValueSettings,
        }

        impl Default for $config {
            fn default() -> $config {
                $config {
                    gamma: 0.98,
                    tau: 0.005,
                    $($own: $default,)*
                    steps_per_iteration: 64,
                    run: Default::default(),
                    episodes: $crate::EpisodeSettings { environments: 128, ..Default::default() },
                    replay: Default::default(),
                    policy: Default::default(),
                    critic: Default::default(),
                }
            }
        }

        impl $crate::Settings for $config {
            const ALGORITHM: &'static str = $algorithm;
            const PRESETS: &'static [(&'static str, &'static str)] =
                &[($crate::presets::SKRL_0_10, include_str!("skrl-0.10.toml"))];

            fn check(&self) -> Result<(), $crate::TrainingError> {
                $crate::settings::share("gamma", self.gamma)?;
                $crate::settings::share("tau", self.tau)?;
                self.check_own()?;
                $crate::settings::at_least_1("steps_per_iteration", self.steps_per_iteration as u64)?;
                self.run.check()?;
                self.episodes.check()?;
                self.replay.check(&self.episodes)?;
                self.policy.check()?;
                self.critic.check()
            }
        }

        impl $crate::agent::Shared for $config {
            fn setup(&self) -> $crate::agent::Setup<'_> {
                $crate::agent::Setup {
                    gamma: self.gamma,
                    steps_per_iteration: self.steps_per_iteration,
                    episodes: &self.episodes,
                    replay: &self.replay,
                    policy: &self.policy,
                }
            }
        }
    };
}

pub(crate) use off_policy_config;
