//! The measures of an evaluation.

use mishandle_results::{
    AxisFacts, AxisRate, BoxPoint, Broken, Command, Control, CornerPoint, Corners, Estimate, Evaluation,
    RateBin, StartRegion, Violation,
};
use mishandle_text::{measured, p_value_phrase, plural, sample_time};

use super::axes::{axis_range, axis_text, shown};
use super::subject::{settings, tested};
use super::{Conclusion, Verdict, percent, undecided};

/// Largest number of axes, and of corners, that are named.
const NAMED: usize = 3;

pub(super) fn verdict(found: &Evaluation) -> Verdict {
    let metrics = &found.metrics;
    let rate = &metrics.violation_rate;
    let failing: Vec<&CornerPoint> = found.corners.iter().flat_map(failing_points).collect();
    let starts = match found.starts {
        StartRegion::Reachable => " from the reachable part of the box",
        StartRegion::Whole => "",
    };
    let scenarios = format!("{}{starts}", plural(rate.n, "random scenario"));
    let (conclusion, what) = match (rate.value, metrics.violations, failing.len()) {
        (None, ..) => (Conclusion::NoVerdict, "not tested".to_string()),
        (_, 0, 0) if found.without_verdict.is_too_large() => {
            (Conclusion::NoVerdict, format!("no violation in {scenarios}"))
        }
        (_, 0, 0) => (Conclusion::Holds, format!("in all of {scenarios}")),
        (_, 0, _) => {
            (Conclusion::Fails, format!("in none of {scenarios}, but at the box's corners or center"))
        }
        (_, violations, _) => (Conclusion::Fails, format!("in {violations} of {scenarios}")),
    };
    let is_violated = found.requirements.iter().flatten().any(|requirement| requirement.violated > 0);
    let conclusion = if is_violated { Conclusion::Fails } else { conclusion };
    let undecided = undecided(&found.without_verdict, "they do not count as successes");
    let interrupted = if found.is_complete { "" } else { "; interrupted" };
    let headline = format!("{undecided}{}: {what}{interrupted}", tested(&found.subject));
    let mut verdict = Verdict::new(conclusion, headline);
    if rate.value.is_none() {
        return verdict;
    }
    verdict.table = table(found);
    for broken in &found.breaks {
        verdict.add("breaks", breaks_text(broken, found.subject.control_dt));
    }
    verdict.add("axes", axes(found));
    verdict.add("corners", corners_text(found, &failing));
    verdict.add("nominal", found.control.as_ref().map_or(String::new(), control_text));
    verdict.add("rule", found.sequential.as_ref().map_or("", |rule| rule.verdict.as_str()));
    if let Some(run) = &found.run {
        verdict.then("look", Command::Report { run: run.clone() });
    }
    if conclusion != Conclusion::Fails {
        let target = found.subject.target.clone();
        let kept = settings(&found.subject);
        verdict.then("try", Command::Again { question: "falsify", target, kept, changed: Vec::new() });
    }
    verdict
}

/// Returns the points of the box that count and violate success.
fn failing_points(corners: &Corners) -> impl Iterator<Item = &CornerPoint> {
    corners.points.iter().filter(|point| point.counts && point.violations() > 0)
}

/// Returns a row for each formula and each other measure.
fn table(found: &Evaluation) -> Vec<Vec<String>> {
    let metrics = &found.metrics;
    let interval = if found.sequential.is_some() { "95 % at any time" } else { "95 % interval" };
    let mut rows = vec![["", "rate", interval, "n", "corners"].map(String::from).to_vec()];
    let corners = |succeeding: Option<u64>| match (&found.corners, succeeding) {
        (Some(corners), Some(succeeding)) if corners.n > 0 => format!("{succeeding} of {}", corners.n),
        _ => "-".to_string(),
    };
    let of = found.corners.as_ref();
    let formulas = [
        ("success", Some(&metrics.success_rate), of.map(|corners| corners.succeeding)),
        ("strict", metrics.strict_success_rate.as_ref(), of.and_then(|corners| corners.strictly_succeeding)),
        ("careful", metrics.careful_success_rate.as_ref(), of.and_then(|c| c.carefully_succeeding)),
    ];
    for (name, rate, succeeding) in formulas {
        let Some(rate) = rate else { continue };
        rows.push(row(name, rate, &percent, corners(succeeding)));
    }
    if let Some(control) = &found.control {
        let name = "success at nominal";
        rows.push(row(name, &control.success_rate, &percent, "-".to_string()));
    }
    let none = || "-".to_string();
    let shares = [
        ("steps in danger", &metrics.dangerous_behavior_rate),
        ("episodes in danger", &metrics.dangerous_episode_rate),
    ];
    for (name, rate) in shares {
        rows.extend(rate.iter().map(|rate| row(name, rate, &percent, none())));
    }
    let seconds = |steps: f64| format!("{} s", measured(steps * found.subject.control_dt));
    rows.extend(metrics.task_completion_time.iter().map(|time| row("completed at", time, &seconds, none())));
    rows
}

fn row(name: &str, estimate: &Estimate, show: &dyn Fn(f64) -> String, corners: String) -> Vec<String> {
    // A single value has a mean, but no confidence interval.
    let interval =
        estimate.low.zip(estimate.high).map(|(low, high)| format!("{} to {}", show(low), show(high)));
    vec![
        name.to_string(),
        estimate.value.map_or("-".to_string(), show),
        interval.unwrap_or("-".to_string()),
        estimate.n.to_string(),
        corners,
    ]
}

/// Says which condition of a formula breaks first, and when, in the first simulation that violates
/// it.
fn breaks_text(broken: &Broken, control_dt: f64) -> String {
    let Violation { words, at, decided, .. } = &broken.violation;
    let when = at.or(*decided).map(|at| format!(" at {}", sample_time(at.sample as usize, control_dt)));
    format!(
        "{}: {words}{} (simulation {})",
        shown(&broken.formula),
        when.unwrap_or_default(),
        broken.simulation
    )
}

/// Names the parts of the ranges of axes in which the success rate differs.
fn axes(found: &Evaluation) -> String {
    // Simulations without a verdict count as no success, which says nothing about an axis.
    let Some(rates) = found.axis_rates.as_ref().filter(|_| found.without_verdict.ends.total() == 0) else {
        return String::new();
    };
    let fact = |name: &str| found.subject.space_axes.iter().find(|axis| axis.name == name);
    let mut named: Vec<String> = Vec::new();
    let mut more = 0;
    for axis in &rates.axes {
        let differing = axis.bins.iter().filter(|bin| bin.differs);
        let worst = differing.min_by(|a, b| lowest(a).total_cmp(&lowest(b)));
        let Some(bin) = worst else { continue };
        if named.len() == NAMED {
            more += 1;
        } else {
            named.push(bin_text(axis, bin, fact(&axis.axis)));
        }
    }
    let more = if more > 0 { format!("; and {more} more") } else { String::new() };
    named.join("; ") + &more
}

fn lowest(bin: &RateBin) -> f64 {
    bin.success_rate.value.unwrap_or(f64::INFINITY)
}

/// Formats the rate in a part of a range: `payload from 3 to 4 kg: 20 % succeed, 90 % elsewhere`.
fn bin_text(axis: &AxisRate, bin: &RateBin, fact: Option<&AxisFacts>) -> String {
    let place = match (&bin.values.name, bin.values.low == bin.values.high) {
        (Some(name), _) => format!("{} = {}", shown(&axis.axis), shown(name)),
        (None, true) => match fact {
            Some(fact) => axis_text(fact, Some(bin.values.low)),
            None => format!("{} = {}", shown(&axis.axis), measured(bin.values.low)),
        },
        (None, false) => {
            let [low, high] = [bin.values.low, bin.values.high].map(measured);
            axis_range(&axis.axis, [low, high], &axis.unit)
        }
    };
    let all = &axis.success_rate;
    let elsewhere = all.value.zip(bin.success_rate.value).and_then(|(all_rate, rate)| {
        let others = all.n.checked_sub(bin.success_rate.n).filter(|others| *others > 0)?;
        Some((all_rate * all.n as f64 - rate * bin.success_rate.n as f64) / others as f64)
    });
    let elsewhere = elsewhere.map_or(String::new(), |rate| format!(", {} elsewhere", percent(rate)));
    format!("{place}: {} succeed{elsewhere}", percent(bin.success_rate.value.unwrap_or(f64::NAN)))
}

/// Names the corners and the center that fail.
fn corners_text(found: &Evaluation, failing: &[&CornerPoint]) -> String {
    let Some(corners) = &found.corners else { return String::new() };
    let starts = |point: &CornerPoint| {
        let values = found.subject.space_axes.iter().zip(point.scenario.values());
        let starts = values.filter(|(axis, _)| axis.kind == "start");
        let texts: Vec<String> = starts.map(|(axis, value)| axis_text(axis, *value)).collect();
        let seeds = match point.started() {
            0 | 1 => String::new(),
            n => format!(" ({} of {n} seeds)", point.violations()),
        };
        let kind = if point.kind == BoxPoint::Center { "the center" } else { "" };
        let texts = texts.join(", ");
        format!("{}{seeds}", if kind.is_empty() { texts } else { format!("{kind}, {texts}") })
    };
    let places: Vec<String> = failing.iter().take(NAMED).map(|point| starts(point)).collect();
    let more = match failing.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let without = match corners.without_verdict {
        0 => String::new(),
        n => format!("{} without a verdict", plural(n, "corner")),
    };
    let fails =
        if failing.is_empty() { String::new() } else { format!("fails at {}{more}", places.join("; ")) };
    [fails, without].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Says what only the perturbations of the space cause.
fn control_text(control: &Control) -> String {
    match control.difference.value {
        None => "no simulation at nominal has a verdict".to_string(),
        Some(_) => format!(
            "of {} of the same start and seed, {} only in the space and {} only at nominal ({})",
            plural(control.difference.n, "pair"),
            fail(control.fails_only_in_space),
            fail(control.fails_only_in_control),
            p_value_phrase(control.p_value)
        ),
    }
}

fn fail(count: u64) -> String {
    if count == 1 { "1 fails".to_string() } else { format!("{count} fail") }
}
