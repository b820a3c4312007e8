//! The setting of a single axis in a plan.

use serde::{Deserialize, Serialize};

/// The setting of an axis in a plan: the table `[axes]`, and the flags `--axis` and `--set`.
///
/// # Example
/// ```
/// use mishandle::Plan;
/// use mishandle::plan::AxisSetting;
/// let plan = Plan::from_toml("target = \"ball-balancing\"\n[axes]\nball_x = [0.2, 0.3]\naction_delay = 2\n")?;
/// assert_eq!(plan.axes["ball_x"], AxisSetting::Range([0.2, 0.3]));
/// assert_eq!(plan.axes["action_delay"], AxisSetting::Value(2.0));
/// # Ok::<(), mishandle::MishandleError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum AxisSetting {
    /// The axis has this value in every scenario.
    Value(f64),
    /// The values are between these bounds.
    Range([f64; 2]),
    /// The axis has the category with this name in every scenario.
    Category(String),
}
