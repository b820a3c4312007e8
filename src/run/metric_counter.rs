use mishandle_evaluation::{FormulaRoles, MetricCounter};
use mishandle_store::RunHeader;

use crate::plan::Plan;

/// Returns a counter of the metrics that an evaluation with this header has.
pub fn metric_counter(header: &RunHeader) -> MetricCounter {
    let has = |name: &str| header.formulas.iter().any(|formula| formula.name == name);
    let roles = FormulaRoles {
        strict: has("strict"),
        careful: has("careful"),
        safe: has("safe"),
        completion: has("completion"),
    };
    let counts_failures = Plan::from_toml(&header.plan).is_ok_and(|plan| plan.preset == "code");
    MetricCounter::new(roles).with_completion_times_of_failures(counts_failures)
}
