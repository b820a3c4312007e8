//! The result of an evaluation, as text.

use mishandle::results::{Control, Estimate, Evaluation, StartRegion, WithoutVerdict};
use mishandle::run::without_verdict_text;
use mishandle_text::{p_value_text, plural};

use super::{answer, corners, escape, output, reasons, requirements, screening, subject};

/// Largest number of axes of a control arm that the text names.
const MAX_AXES: usize = 4;

/// Returns the first lines of the result.
fn heading(found: &Evaluation) -> String {
    let part = match found.starts {
        StartRegion::Reachable => ", initial states from the reachable part of the box",
        StartRegion::Whole => "",
    };
    let without_verdict = answer::without_verdict(&found.without_verdict, "they do not count as successes");
    format!("{without_verdict}{}{part}", subject::heading(&found.subject))
}

/// Returns the rates, and the corners; after a screening also the disagreements of the two engines.
pub fn text(found: &Evaluation) -> String {
    match &found.screening {
        Some(counts) => {
            format!("{}\n\n{}", heading(found), screening::evaluation_text(found, counts))
        }
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
    let interval = match &found.sequential {
        Some(_) => "95 % interval at any time",
        None => "95 % interval",
    };
    let mut rows = vec![["", "value", interval, "n"].map(String::from).to_vec()];
    rows.push(row("success rate", &report.success_rate, &percent));
    if let Some(control) = &found.control {
        rows.push(row("control, at nominal", &control.success_rate, &percent));
        let points = |points: f64| format!("{:+.2}", 100.0 * points);
        let signed =
            |estimate: &Estimate| cells(estimate, &|value| format!("{} points", points(value)), &points);
        rows.push(row("paired difference", &control.difference, &signed));
    }
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
    if let Some(sequential) = &found.sequential {
        text.push_str(&format!("\n\n{}", sequential.verdict));
    }
    if let Some(control) = &found.control {
        text.push_str(&format!("\n\n{}", control_text(control)));
    }
    if let Some(report) = &found.corners {
        text.push_str(&format!("\n\n{}", corners::text(&found.subject.space_axes, report)));
    }
    text + &reasons::text(found.reasons.as_deref()) + &requirements::text(found.requirements.as_deref())
}

/// Says what only the perturbations cause, and what the control arm is.
fn control_text(control: &Control) -> String {
    let shown: Vec<String> = control.nominal.iter().take(MAX_AXES).map(|name| escape::name(name)).collect();
    let axes = match control.nominal.len().saturating_sub(MAX_AXES) {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    };
    let p = control.difference.value.map_or(String::new(), |_| match p_value_text(control.p_value) {
        small if small.starts_with('<') => format!(" (p {small})"),
        value => format!(" (p = {value})"),
    });
    let once = match control.simulations {
        1 if control.difference.n + control.left_out > 1 => {
            ": one simulation, because all of them are the same"
        }
        _ => "",
    };
    let found = match control.difference.value {
        Some(_) => format!(
            "of {}, {} only in the space and {} only in the control{p}",
            plural(control.difference.n, "pair"),
            fail(control.fails_only_in_space),
            fail(control.fails_only_in_control),
        ),
        None => "no simulation of the control has a verdict".to_string(),
    };
    let left_out = match control.left_out {
        0 => String::new(),
        n => format!("\nleft out: {}", plural(n, "pair")),
    };
    let ends = without_verdict_text(&WithoutVerdict::new(control.without_verdict, 1.0));
    let ends = ends.map_or(String::new(), |ends| format!("\nin the control: {ends}"));
    format!("{found}{left_out}{ends}\ncontrol: the same starts and seeds, and at nominal {axes}{once}")
}

fn fail(count: u64) -> String {
    if count == 1 { "1 fails".to_string() } else { format!("{count} fail") }
}
