//! Guards in plans.

use super::declare::plan_table;
use super::keys::{self, Within};
use super::read::read_guard;
use crate::error::MishandleError;

plan_table! {
    /// A guard of the controller: the table `[guard]` of a plan, and the file of `--guard`.
    pub struct GuardPlan in "guard" {
        /// Formula over quantities of the observation, such as `` `ball[2]` >= 0.1 ``, or over
        /// signals of the target if the guard is privileged.
        pub formula: String = String::new(),
            "a string, such as \"historically[0:0.5s](speed <= 1)\"";
        /// Robustness of the formula below which the guard hands over, in the unit of the formula.
        pub threshold: f64 = 0.0, "a number";
        /// Robustness from which on it hands back; `None` if the fallback keeps the control.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub return_threshold: Option<f64> = None, "a number, at least the threshold";
        /// Shortest time for which the fallback acts, s.
        pub dwell: f64 = 0.0, "a number of seconds from 0 on";
        /// Who acts after the hand-over: `hold`, `retreat`, or a controller as `controller` of a
        /// plan.
        pub fallback: String = String::new(),
            "\"hold\", \"retreat\", or a controller, such as \"expert\"";
        /// Duration of the motion that a retreat takes back, s.
        pub retreat: f64 = 1.0, "a number of seconds from 0 to 60";
        /// Whether the formula reads signals of the target, which the controller does not see.
        pub privileged: bool = false, keys::BOOLEAN;
        /// Meaning of the actions of a target in a file to `hold` and `retreat`: `increments` or
        /// `positions`. That of tasks is known.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub actions: Option<String> = None, "\"increments\" or \"positions\"";
    }
}

plan_table! {
    /// How the threshold of a guard is chosen: the table `[tune]`.
    pub struct TuneSettings in "tune" {
        /// Number of training scenarios.
        pub episodes: u64 = 500, keys::EPISODES => Within<1, 1_000_000_000>;
        /// Number of held-out scenarios.
        pub held_out: u64 = 500, keys::EPISODES => Within<1, 1_000_000_000>;
        /// Largest share of successful training scenarios with an alarm.
        pub false_alarms: f64 = 0.05, "a number from 0 to less than 1";
        /// Requirement whose violation is a failure: the name of a formula of the target, or the
        /// text of a formula. `None` selects the target's first formula.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub formula: Option<String> = None, keys::FORMULA;
    }
}

impl GuardPlan {
    /// Reads the keys of a guard from TOML.
    ///
    /// # Errors
    /// If the text is not TOML, or a key or a value is wrong, with its line.
    ///
    /// # Example
    /// ```
    /// use mishandle::plan::GuardPlan;
    /// let guard = GuardPlan::from_toml("formula = 'speed <= 1'\nfallback = 'hold'").unwrap();
    /// assert_eq!((guard.threshold, guard.return_threshold), (0.0, None));
    /// assert!(GuardPlan::from_toml("fallbak = 'hold'").is_err());
    /// ```
    pub fn from_toml(text: &str) -> Result<GuardPlan, MishandleError> {
        read_guard(text)
    }

    /// Returns the guard as TOML.
    pub fn to_toml(&self) -> String {
        // Cannot fail: it contains strings, numbers and booleans only.
        toml::to_string(self).unwrap_or_default()
    }
}
