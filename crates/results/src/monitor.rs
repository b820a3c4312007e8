use schemars::JsonSchema;
use serde::Serialize;

use crate::{Number, RequirementVerdict};

/// Robustness of a formula on a recorded trace.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Monitor {
    /// Robustness at time 0.
    pub robustness: Number,
    /// Whether the formula is violated. At a robustness of 0, `<=`, `>=` and `==` hold, and `<`,
    /// `>` and `!=` do not.
    pub violated: bool,
    /// `cut`: windows are cut at the end of the trace, as in RTAMT; `whole` with
    /// `--strict-horizon`.
    pub windows: String,
    /// Whether `robustness` depends on a window that is cut.
    pub cuts_windows: bool,
    /// Robustness at each sample; with `--strict-horizon` at the first samples, those whose windows
    /// are inside the trace.
    pub robustness_signal: Vec<Number>,
    /// Each named requirement; missing without one. Without `--formula`, the other keys are those
    /// of the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirements: Option<Vec<RequirementVerdict>>,
}
