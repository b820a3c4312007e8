//! The result of an evaluation, as text.

use mishandle::results::{Estimate, Evaluation, StartRegion};
use mishandle_text::{measured, plural};

use super::{corners, escape, output, reasons, requirements, screening, subject};

/// Largest number of axes of a control arm that the text names.
const MAX_AXES: usize = 4;

/// Returns what stands below the verdict: after a screening the disagreements of the two engines,
/// then reasons.
pub fn text(found: &Evaluation) -> String {
    let screening = found.screening.as_ref().map(|counts| screening::evaluation_text(found, counts));
    screening.unwrap_or_default() + &reasons::text(found.reasons.as_deref())
}

/// Returns what was evaluated, all rates with their intervals, the control arm, and all corners.
pub fn details(found: &Evaluation) -> String {
    let part = match found.starts {
        StartRegion::Reachable => ", initial states from the reachable part of the box",
        StartRegion::Whole => "",
    };
    let mut parts =
        vec![format!("{}{part}, seed {}", subject::heading(&found.subject), found.subject.seed.0)];
    if let Some(control) = &found.control {
        let shown: Vec<String> =
            control.nominal.iter().take(MAX_AXES).map(|name| escape::label(name)).collect();
        let axes = match control.nominal.len().saturating_sub(MAX_AXES) {
            0 => shown.join(", "),
            more => format!("{} and {more} more", shown.join(", ")),
        };
        let left_out = match control.left_out {
            0 => String::new(),
            n => format!("; left out: {}", plural(n, "pair")),
        };
        parts.push(format!(
            "at nominal: the same starts and seeds, with the nominal values of {axes}: {}; paired difference {}{left_out}",
            plural(control.simulations, "simulation"),
            points(&control.difference)
        ));
    }
    parts.extend(found.corners.as_ref().map(|report| corners::text(&found.subject.space_axes, report)));
    let wrapped = |part: &String| {
        part.lines().map(|line| output::folded(line, output::width())).collect::<Vec<_>>().join("\n")
    };
    let parts: Vec<String> = parts.iter().map(wrapped).collect();
    parts.join("\n\n") + &requirements::text(found.requirements.as_deref())
}

/// Formats a difference of rates in percentage points, with its interval.
fn points(difference: &Estimate) -> String {
    let text = |value: f64| measured(100.0 * value);
    match (difference.value, difference.low, difference.high) {
        (Some(value), Some(low), Some(high)) => {
            format!("{} points, {} to {}", text(value), text(low), text(high))
        }
        (Some(value), ..) => format!("{} points", text(value)),
        _ => "unknown".to_string(),
    }
}
