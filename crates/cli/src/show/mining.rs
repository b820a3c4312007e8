//! Mined values of parameters, as text and as CSV.

use anyhow::Result;
use mishandle::results::{MinedParameter, MinedPoint, Mining, MiningOutcome, Number, Tightest};
use mishandle_text::{number_text, plural, short_number};

use super::{escape, output};

/// Largest number of logs whose own values are listed.
const MAX_LISTED: usize = 10;

fn unit(parameter: &MinedParameter) -> String {
    parameter.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"))
}

fn value_text(parameter: &MinedParameter, value: Number) -> String {
    format!("{}{}", number_text(value.0), unit(parameter))
}

/// Describes mined values.
pub fn text(found: &Mining, width: usize) -> String {
    let mut parts = Vec::new();
    let needed = if found.share.0 < 1.0 {
        format!("at least {} % of {}", number_text(found.share.0 * 100.0), plural(found.traces, "trace"))
    } else {
        format!("all of {}", plural(found.traces, "trace"))
    };
    let ranges: Vec<String> = found
        .parameters
        .iter()
        .map(|parameter| {
            let tight = if parameter.tightest == Tightest::Low { "smaller" } else { "greater" };
            let step =
                parameter.resolution.map(|step| format!(", in steps of {}", value_text(parameter, step)));
            format!(
                "  {} from {} to {}: {tight} is tighter{}",
                escape::name(&parameter.name),
                value_text(parameter, parameter.low),
                value_text(parameter, parameter.high),
                step.unwrap_or_default()
            )
        })
        .collect();
    parts.push(format!("{}\n{}", escape::name(&found.formula), ranges.join("\n")));
    parts.extend(found.traps.iter().map(|trap| format!("warning: {}", escape::name(trap))));
    match (found.outcome, found.points.as_slice()) {
        (MiningOutcome::LoosestFails, _) => {
            parts.push(format!(
                "Nothing was mined: with the loosest values, fewer than {needed} satisfy the formula. Widen the ranges, or lower \
                 the share."
            ));
        }
        (MiningOutcome::NoSupport, _) => parts.push(
            "Nothing was mined: no trace supports a value. In each trace, the condition of an implication never holds, or a \
             window of the formula is longer than the trace. Use other logs, or longer ones."
                .to_string(),
        ),
        (MiningOutcome::TightestHolds, [point]) => {
            let remedy = match point.cut {
                0 => "Widen the ranges.".to_string(),
                cut => format!(
                    "{cut} of them are shorter than the windows of the formula, which are cut at their end: wider ranges do not \
                     help, use longer logs or a range of shorter windows."
                ),
            };
            parts.push(format!(
                "The range decides: {needed} satisfy the formula even with the tightest values, so these are not mined. {remedy}"
            ));
            parts.push(one(found, point));
        }
        (_, [point]) if found.parameters.len() == 1 => parts.push(one(found, point)),
        (_, points) => parts.push(front(found, points, width)),
    }
    let failing = found.per_trace.iter().filter(|trace| trace.value.is_none()).count();
    if !found.per_trace.is_empty() && found.per_trace.len() > 1 {
        let mut each: Vec<_> = found.per_trace.iter().collect();
        let parameter = &found.parameters[0];
        let is_low = parameter.tightest == Tightest::Low;
        // The logs that need the loosest values first.
        let key = |value: Option<Number>| {
            value.map_or(f64::INFINITY, |value| if is_low { value.0 } else { -value.0 })
        };
        each.sort_by(|a, b| key(b.value).total_cmp(&key(a.value)));
        let mut rows = vec![vec!["trace".to_string(), format!("tightest {}", escape::name(&parameter.name))]];
        rows.extend(each.iter().take(MAX_LISTED).map(|trace| {
            let value = trace
                .value
                .map_or("violated with every value".to_string(), |value| value_text(parameter, value));
            let value = if trace.value.is_some() && !trace.supports {
                format!("{value} (no support)")
            } else {
                value
            };
            vec![escape::name(&trace.name), value]
        }));
        let mut table = output::table_in(&rows, width);
        if each.len() > MAX_LISTED {
            table +=
                &format!("\n{} more, which need less", plural((each.len() - MAX_LISTED) as u64, "trace"));
        }
        parts.push(table);
        if failing > 0 {
            parts.push(format!("With every value of the range, {failing} of them violate the formula."));
        }
    }
    parts.join("\n\n")
}

/// Describes the only point.
fn one(found: &Mining, point: &MinedPoint) -> String {
    let values: Vec<String> = found
        .parameters
        .iter()
        .zip(&point.values)
        .map(|(parameter, value)| {
            format!("{} = {}", escape::name(&parameter.name), value_text(parameter, *value))
        })
        .collect();
    let mut lines = vec![values.join(", "), format!("  {}", escape::name(&point.formula))];
    lines.push(format!(
        "  {} of {} satisfy it; robustness {}",
        point.satisfied,
        plural(found.traces, "trace"),
        short_number(point.robustness.0)
    ));
    if point.support < point.satisfied {
        let without = if point.satisfied - point.support > point.cut {
            ": in the others, the condition of an implication never holds"
        } else {
            ""
        };
        lines.push(format!("  {} of them support it{without}", point.support));
    }
    if point.cut > 0 {
        lines.push(format!(
            "  cut: {} shorter than the windows of the formula, not counted as support",
            plural(point.cut, "trace")
        ));
    }
    if let Some(name) = &point.decisive {
        let at = match (point.decisive_time, point.decisive_sample) {
            (Some(time), _) => format!(" at {} s", short_number(time.0)),
            (None, Some(sample)) => format!(" at sample {sample}"),
            (None, None) => String::new(),
        };
        lines.push(format!("  {} decides{at}", escape::name(name)));
    }
    for (parameter, violated) in found.parameters.iter().zip(&point.violated_if_tighter) {
        if let Some(violated) = violated {
            let step = match parameter.resolution {
                Some(step) => format!("{} tighter", value_text(parameter, step)),
                None => "the next number tighter".to_string(),
            };
            lines.push(format!("  {step}: {violated} more of them would violate it"));
        }
    }
    lines.join("\n")
}

fn front(found: &Mining, points: &[MinedPoint], width: usize) -> String {
    let names = found
        .parameters
        .iter()
        .map(|parameter| format!("{}{}", escape::name(&parameter.name), unit(parameter)));
    let mut rows = vec![
        names.chain(["satisfied", "support", "decides", "formula"].map(String::from)).collect::<Vec<_>>(),
    ];
    rows.extend(points.iter().map(|point| {
        let values = point.values.iter().map(|value| number_text(value.0));
        let rest = [
            format!("{} of {}", point.satisfied, found.traces),
            point.support.to_string(),
            point.decisive.as_deref().map(escape::name).unwrap_or_default(),
            escape::name(&point.formula),
        ];
        values.chain(rest).collect()
    }));
    let cut = match points.iter().map(|point| point.cut).max() {
        Some(cut) if cut > 0 => format!(
            "\n\nUp to {} shorter than the windows of a point: their windows are cut, which is not counted as support.",
            plural(cut, "trace")
        ),
        _ => String::new(),
    };
    format!(
        "{} of the Pareto front; a point with a tighter parameter than one of them has a looser one, too:\n\n{}{cut}",
        plural(points.len() as u64, "point"),
        output::table_in(&rows, width)
    )
}

/// Returns the points as CSV.
pub fn csv(found: &Mining) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let names = found.parameters.iter().map(|parameter| parameter.name.clone());
    writer.write_record(
        names.chain(["robustness", "satisfied", "support", "decisive", "formula"].map(String::from)),
    )?;
    for point in &found.points {
        let values = point.values.iter().map(|value| value.0.to_string());
        let rest = [
            point.robustness.0.to_string(),
            point.satisfied.to_string(),
            point.support.to_string(),
            point.decisive.clone().unwrap_or_default(),
            point.formula.clone(),
        ];
        writer.write_record(values.chain(rest))?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}
