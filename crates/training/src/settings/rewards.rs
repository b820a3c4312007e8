//! `[rewards]`: reward terms for the manner.

use super::declare::settings;
use super::setting::NOT_NEGATIVE;

settings! {
    /// `[rewards]`: weights of reward terms for the manner, besides those of a task. With a weight
    /// of 0, a term does not exist.
    pub struct RewardSettings in "rewards." {
        /// Weight of contact forces of the robot. In each control step, the weight times
        /// F / (F + 140 N) is subtracted, where F is the sum of the largest forces that careful
        /// success limits. It is half the weight at 140 N and never more than the weight, so one
        /// impact does not dominate.
        pub contact_force: f64 = 0.0, NOT_NEGATIVE;
        /// Weight of changes of the actions that the robot gets. In each control step, the weight
        /// times the mean of ((a - b) / 2)² over the actions a is subtracted, where b is the action
        /// of the control step before.
        pub action_rate: f64 = 0.0, NOT_NEGATIVE;
        /// Weight of the speed. In each control step, the weight times s - 0.8, between 0 and 1, is
        /// subtracted, where s is the largest speed of a joint or of the tool as a share of its
        /// limit in careful success.
        pub speed: f64 = 0.0, NOT_NEGATIVE;
        /// Weight of motion at the end. In each control step of the second half of an episode
        /// (`episodes.time_limit`), the weight times v / (v + 0.05 rad/s) is subtracted, where v is
        /// the speed of the fastest joint of the arm. It is half the weight at the speed below
        /// which the robot counts as being at rest.
        pub rest: f64 = 0.0, NOT_NEGATIVE;
    }
}

impl RewardSettings {
    /// Returns the name and the weight of each term.
    pub(crate) fn weights(&self) -> [(&'static str, f64); 4] {
        let RewardSettings { contact_force, action_rate, speed, rest } = *self;
        [("contact_force", contact_force), ("action_rate", action_rate), ("speed", speed), ("rest", rest)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ALGORITHMS;

    #[test]
    fn every_algorithm_reads_the_weights_and_has_none_by_default() {
        for entry in ALGORITHMS {
            let default = (entry.default)();
            assert!(default.rewards().weights().iter().all(|(_, weight)| *weight == 0.0));
            let settings = (entry.from_toml)("rewards = { contact_force = 0.5, rest = 2 }").unwrap();
            let expected = RewardSettings { contact_force: 0.5, rest: 2.0, ..RewardSettings::default() };
            assert_eq!(settings.rewards(), &expected);
            assert_eq!((entry.from_toml)(&settings.to_toml()).unwrap(), settings);
            for text in ["speed = -1", "speed = nan", "speed = inf"] {
                let error = (entry.from_toml)(&format!("[rewards]\n{text}")).unwrap_err().to_string();
                assert!(error.contains("`rewards.speed` must be a number of at least 0"), "{error}");
            }
        }
    }

    #[test]
    fn weights_have_the_names_of_their_settings() {
        let names: Vec<&str> = RewardSettings::described().iter().map(|setting| setting.name).collect();
        let terms = RewardSettings::default().weights().map(|(term, _)| format!("rewards.{term}"));
        assert_eq!(names, terms);
    }
}
