//! The result of an evaluation, as text.

use mishandle::results::{Estimate, Evaluation};
use mishandle_text::plural;

use super::{corners, output, reasons, requirements, screening, simulation, subject};

/// Returns the first line of the result.
fn heading(found: &Evaluation) -> String {
    let part = match found.starts.as_str() {
        "reachable" => ", initial states from the reachable part of the box",
        _ => "",
    };
    format!("{}{part}", subject::heading(&found.subject))
}

/// Returns the rates, and the corners; after a screening also the disagreements of the two engines.
pub fn text(found: &Evaluation) -> String {
    match &found.screening {
        Some(counts) => format!("{}\n\n{}", heading(found), screening::evaluation_text(found, counts)),
        None => direct_text(found),
    }
}

/// Returns the rates, and the corners.
fn direct_text(found: &Evaluation) -> String {
    let report = &found.metrics;
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
            |steps: f64| format!("{steps:.1} control steps ({:.2} s)", steps * found.subject.control_dt);
        cells(estimate, &value, &|steps| format!("{steps:.1}"))
    };
    let row = |name: &str, estimate: &Estimate, cells: &dyn Fn(&Estimate) -> [String; 2]| {
        let [value, interval] = cells(estimate);
        vec![name.to_string(), value, interval, estimate.n.to_string()]
    };
    let mut rows = vec![["", "value", "95 % interval", "n"].map(String::from).to_vec()];
    rows.push(row("success rate", &report.success_rate, &percent));
    rows.extend(report.strict_success_rate.iter().map(|rate| row("strict success rate", rate, &percent)));
    rows.extend(report.careful_success_rate.iter().map(|rate| row("careful success rate", rate, &percent)));
    rows.extend(
        report.dangerous_behavior_rate.iter().map(|rate| row("dangerous behavior rate", rate, &percent)),
    );
    rows.extend(
        report.dangerous_episode_rate.iter().map(|rate| row("episodes with any danger", rate, &percent)),
    );
    rows.extend(report.task_completion_time.iter().map(|time| row("task completion time", time, &steps)));
    let mut text = format!("{}\n\n{}", heading(found), output::table(&rows));
    if let Some(report) = &found.corners {
        text.push_str(&format!("\n\n{}", corners::text(&found.subject.space_axes, report)));
    }
    if let Some(counts) =
        simulation::without_verdict(report.diverged, report.invalid, report.failed, report.undecided)
    {
        text.push_str(&format!("\n\n{counts}; they do not count as successes"));
        let left_out = report.simulations - report.success_rate.n;
        if left_out > 0 {
            text.push_str(&format!(
                ". In no rate: {}, from whose scenario the target cannot start",
                plural(left_out, "simulation")
            ));
        }
    }
    text + &reasons::text(found.reasons.as_deref()) + &requirements::text(found.requirements.as_deref())
}
