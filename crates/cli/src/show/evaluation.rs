//! The result of an evaluation, as text and as JSON.

use mishandle::evaluation::Estimate;
use mishandle::{EvaluationOutcome, Plan, ResolvedPlan, StartRegion};
use serde_json::{Value, json};

use super::{corners, output, simulation, subject};

pub fn starts(plan: &Plan) -> StartRegion {
    plan.evaluate.as_ref().map_or(StartRegion::Whole, |evaluate| evaluate.starts)
}

/// Returns the JSON document of the run.
pub fn document(resolved: &ResolvedPlan, outcome: &EvaluationOutcome, path: &str) -> Value {
    let report = &outcome.report;
    let mut own = json!({
        "is_complete": outcome.is_complete,
        "simulations": report.simulations,
        "diverged": report.diverged,
        "invalid": report.invalid,
        "failed": report.failed,
        "undecided": report.undecided,
        "success_rate": output::estimate(&report.success_rate),
    });
    let optional = [
        ("strict_success_rate", &report.strict_success_rate),
        ("dangerous_behavior_rate", &report.dangerous_behavior_rate),
        ("dangerous_episode_rate", &report.dangerous_episode_rate),
        ("task_completion_time", &report.task_completion_time),
    ];
    for (key, estimate) in optional {
        if let Some(estimate) = estimate {
            own[key] = output::estimate(estimate);
        }
    }
    own["corners"] = outcome
        .corners
        .as_ref()
        .map_or(Value::Null, |report| corners::document(resolved.space.axes(), report));
    output::joined(subject::document(resolved, path), output::joined(region(resolved), own))
}

/// Returns the JSON of the region of the initial states.
pub fn region(resolved: &ResolvedPlan) -> Value {
    json!({ "box": starts(&resolved.plan), "leaves_out_starts": mishandle::rejects_scenarios(resolved) })
}

/// Returns the first line of the result.
pub fn heading(resolved: &ResolvedPlan) -> String {
    let part = match starts(&resolved.plan) {
        StartRegion::Whole => "",
        StartRegion::Reachable => ", initial states from the reachable part of the box",
    };
    format!("{}{part}", subject::heading(resolved))
}

pub fn text(resolved: &ResolvedPlan, outcome: &EvaluationOutcome) -> String {
    let report = &outcome.report;
    // A single value has a mean, but no confidence interval.
    let cells = |estimate: &Estimate, value: &dyn Fn(f64) -> String, end: &dyn Fn(f64) -> String| {
        let interval =
            estimate.low.zip(estimate.high).map(|(low, high)| format!("[{}, {}]", end(low), end(high)));
        [estimate.value.map_or("-".to_string(), value), interval.unwrap_or("-".to_string())]
    };
    let percentage = |rate: f64| format!("{:.2}", 100.0 * rate);
    let percent =
        |estimate: &Estimate| cells(estimate, &|rate| format!("{} %", percentage(rate)), &percentage);
    let steps = |estimate: &Estimate| {
        let value =
            |steps: f64| format!("{steps:.1} control steps ({:.2} s)", steps * resolved.target.control_dt);
        cells(estimate, &value, &|steps| format!("{steps:.1}"))
    };
    let row = |name: &str, estimate: &Estimate, cells: &dyn Fn(&Estimate) -> [String; 2]| {
        let [value, interval] = cells(estimate);
        vec![name.to_string(), value, interval, estimate.n.to_string()]
    };
    let mut rows = vec![["", "value", "95 % interval", "n"].map(String::from).to_vec()];
    rows.push(row("success rate", &report.success_rate, &percent));
    rows.extend(report.strict_success_rate.iter().map(|rate| row("strict success rate", rate, &percent)));
    rows.extend(
        report.dangerous_behavior_rate.iter().map(|rate| row("dangerous behavior rate", rate, &percent)),
    );
    rows.extend(
        report.dangerous_episode_rate.iter().map(|rate| row("episodes with any danger", rate, &percent)),
    );
    rows.extend(report.task_completion_time.iter().map(|time| row("task completion time", time, &steps)));
    let mut text = format!("{}\n\n{}", heading(resolved), output::table(&rows));
    if let Some(report) = &outcome.corners {
        text.push_str(&format!("\n\n{}", corners::text(resolved.space.axes(), report)));
    }
    if let Some(counts) =
        simulation::without_verdict(report.diverged, report.invalid, report.failed, report.undecided)
    {
        text.push_str(&format!("\n\n{counts}; they do not count as successes"));
    }
    text
}
