//! Rules that end simulations, and the settings of a comparison with such a rule.

use std::fmt;
use std::str::FromStr;

use mishandle_results::Measure;
use serde::{Deserialize, Serialize};

use super::declare::plan_table;
use super::keys;

/// When an evaluation or a comparison stops by itself: `decided`, or `width=W`.
///
/// # Example
/// ```
/// use mishandle::plan::Until;
/// assert_eq!("width=0.04".parse(), Ok(Until::Width(0.04)));
/// assert_eq!(Until::Decided.to_string(), "decided");
/// assert!("width=0".parse::<Until>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Until {
    /// The interval lies on one side of a rate; for a difference, it excludes 0 or lies within the
    /// margin.
    #[default]
    Decided,
    /// The interval is at most this wide.
    Width(f64),
}

impl FromStr for Until {
    type Err = String;

    fn from_str(text: &str) -> Result<Until, String> {
        let width = || text.strip_prefix("width=")?.trim().parse::<f64>().ok();
        match (text, width()) {
            ("decided", _) => Ok(Until::Decided),
            (_, Some(width)) if width > 0.0 && width.is_finite() => Ok(Until::Width(width)),
            (_, Some(_)) => Err(format!("`{text}`: expected a width above 0, such as width=0.04")),
            _ => Err(format!("`{text}`: expected decided, or a width such as width=0.04")),
        }
    }
}

impl fmt::Display for Until {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Until::Decided => f.write_str("decided"),
            Until::Width(width) => write!(f, "width={width}"),
        }
    }
}

impl TryFrom<String> for Until {
    type Error = String;

    fn try_from(text: String) -> Result<Until, String> {
        text.parse()
    }
}

impl From<Until> for String {
    fn from(until: Until) -> String {
        until.to_string()
    }
}

plan_table! {
    /// Settings of a comparison that stops by itself: the table `[compare]` of a plan.
    #[derive(Copy)]
    pub struct ComparePlan in "compare" {
        /// When it stops.
        pub until: Until = Until::default(), keys::UNTIL;
        /// Quantity that the rule watches.
        pub measure: Measure = Measure::default(), "\"success\" or \"robustness\"";
        /// The largest difference that counts as none. `None`: the comparison never finds that
        /// controllers are equivalent.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub margin: Option<f64> = None, "a number above 0";
        /// Bounds of the robustness: values beyond them count as the bound.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub robustness_bounds: Option<[f64; 2]> = None, "a list of two numbers, such as [-0.5, 0.5]";
    }
}
