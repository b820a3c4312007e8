//! Guards in plans.

use serde::{Deserialize, Serialize};

use super::read::read_guard;
use crate::error::MishandleError;

/// A guard of the controller: the table `[guard]` of a plan, and the file of `--guard`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct GuardPlan {
    /// Formula over quantities of the observation, such as `` `ball[2]` >= 0.1 ``, or over signals
    /// of the target if the guard is privileged.
    pub formula: String,
    /// Robustness of the formula below which the guard hands over, in the unit of the formula.
    pub threshold: f64,
    /// Robustness from which on it hands back; `None` if the fallback keeps the control.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub return_threshold: Option<f64>,
    /// Shortest time for which the fallback acts, s.
    pub dwell: f64,
    /// Who acts after the hand-over: `hold`, `retreat`, or a controller as `controller` of a plan.
    pub fallback: String,
    /// Duration of the motion that a retreat takes back, s.
    pub retreat: f64,
    /// Whether the formula reads signals of the target, which the controller does not see.
    pub privileged: bool,
    /// Meaning of the actions of a target in a file to `hold` and `retreat`: `increments` or
    /// `positions`. That of tasks is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub actions: Option<String>,
}

impl GuardPlan {
    /// Duration of the motion that a retreat takes back by default, s.
    const RETREAT: f64 = 1.0;

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

impl Default for GuardPlan {
    fn default() -> Self {
        GuardPlan {
            formula: String::new(),
            threshold: 0.0,
            return_threshold: None,
            dwell: 0.0,
            fallback: String::new(),
            retreat: GuardPlan::RETREAT,
            privileged: false,
            actions: None,
        }
    }
}
