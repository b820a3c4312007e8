//! Failure modes, as text and as JSON.

use mishandle::store::{AxisRecord, RunHeader};
use mishandle::{FailureMode, FailureModes, decimal, plural};
use serde_json::{Value, json};

use super::output::{self, number};
use super::{escape, scenario};

/// Number of axes in the text that describes the region of a mode.
const REGION_AXES: usize = 4;

/// Returns the modes as JSON.
pub fn documents(header: &RunHeader, found: &FailureModes) -> Vec<Value> {
    let time = |sample: usize| sample as f64 * header.control_dt;
    let named = |values: Vec<Value>| -> Value {
        header.axes.iter().map(|axis| axis.name.clone()).zip(values).collect()
    };
    let mode = |(index, mode): (usize, &FailureMode)| {
        let failure = mode.representative();
        let (first, last) = mode.samples;
        json!({
            "mode": index + 1,
            "failures": mode.failures.len(),
            "predicate": failure.predicate,
            "samples": [first, last],
            "times": [time(first), time(last)],
            "axes": mode.axes.iter().filter_map(|index| header.axes.get(*index)).map(|axis| axis.name.clone()).collect::<Vec<_>>(),
            "region": named(mode.region.iter().map(|range| json!(range.map(<[f64; 2]>::from))).collect()),
            "trial": failure.trial,
            "simulation": failure.number,
            "seed": failure.seed.to_string(),
            "scenario": named(failure.scenario.iter().map(|value| json!(value)).collect()),
            "robustness": number(failure.robustness),
            "distance_from_nominal": failure.distance_from_nominal,
        })
    };
    found.modes.iter().enumerate().map(mode).collect()
}

/// Describes the modes: their number, a table, and their regions.
pub fn text(header: &RunHeader, found: &FailureModes) -> String {
    let FailureModes { modes, failures, not_grouped } = found;
    let mut parts =
        vec![format!("{} in {}", plural(*failures, "failure"), plural(modes.len(), "failure mode"))];
    if !modes.is_empty() {
        parts.push(output::table(&table(header, modes)));
        let lines =
            modes.iter().zip(1..).map(|(mode, index)| format!("mode {index}: {}", region(header, mode)));
        parts.push(lines.collect::<Vec<_>>().join("\n"));
    }
    if *not_grouped > 0 {
        parts.push(format!(
            "{} in no mode: without a recorded trace, or above the limit of grouped failures",
            plural(*not_grouped, "failure")
        ));
    }
    parts.join("\n\n")
}

fn table(header: &RunHeader, modes: &[FailureMode]) -> Vec<Vec<String>> {
    let columns = [
        "mode",
        "failures",
        "decisive predicate",
        "final at",
        "representative",
        "robustness",
        "distance from nominal",
    ];
    let time = |sample: usize| mishandle::instant(sample, header.control_dt);
    let row = |(index, mode): (usize, &FailureMode)| {
        let failure = mode.representative();
        let (first, last) = mode.samples;
        let times = if first == last { time(first) } else { format!("{} to {}", time(first), time(last)) };
        let predicate = if failure.predicate.is_empty() { "none" } else { &failure.predicate };
        vec![
            (index + 1).to_string(),
            mode.failures.len().to_string(),
            predicate.to_string(),
            times,
            format!("trial {}, simulation {}", failure.trial, failure.number),
            decimal(failure.robustness, 4),
            format!("{:.0} % of the widths", 100.0 * failure.distance_from_nominal),
        ]
    };
    let rows = modes.iter().enumerate().map(row);
    std::iter::once(columns.map(String::from).to_vec()).chain(rows).collect()
}

/// Describes the ranges of a mode on the axes that matter, the narrowest first.
fn region(header: &RunHeader, mode: &FailureMode) -> String {
    if mode.axes.is_empty() {
        return "no axis distinguishes these failures from the other simulations".to_string();
    }
    let range = |index: &usize| {
        let range = mode.region.get(*index).copied().flatten()?;
        Some((header.axes.get(*index)?, range.into()))
    };
    let mut ranges: Vec<(&AxisRecord, [f64; 2])> = mode.axes.iter().filter_map(range).collect();
    let width = |(axis, [low, high]): &(&AxisRecord, [f64; 2])| (high - low) / (axis.high - axis.low);
    // Stable, so axes of equal width stay in the order of the space.
    ranges.sort_by(|a, b| width(a).total_cmp(&width(b)));
    let more = ranges.len().saturating_sub(REGION_AXES);
    let shown = ranges.iter().take(REGION_AXES).map(|(axis, [low, high])| {
        let recorded = mishandle::recorded_axis(axis);
        let value = |value: &f64| scenario::value_text(&recorded, Some(*value));
        let range = if low == high { value(low) } else { format!("{} to {}", value(low), value(high)) };
        scenario::axis_value(&escape::name(&axis.name), &range, &escape::name(&axis.unit))
    });
    let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
    shown.collect::<Vec<_>>().join(", ") + &rest
}
