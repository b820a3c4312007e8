//! Output of the results at the corners of the initial box.

use mishandle::evaluation::{CornerReport, CornerResult};
use mishandle::plural;
use mishandle::rollout::{Axis, AxisKind};
use serde_json::{Value, json};

use super::{output, scenario, simulation};

/// Number of failing points that a line lists.
const LISTED: usize = 2;

/// Returns the results as JSON.
pub fn document(axes: &[Axis], report: &CornerReport) -> Value {
    let is_center = |index: usize| index + 1 == report.points.len();
    let point = |(index, point): (usize, &CornerResult)| {
        json!({
            "kind": if is_center(index) { "center" } else { "corner" },
            "scenario": scenario::document(axes, point.scenario.values()),
            "reachable": point.is_reachable,
            "counts": report.counts(point),
            "n": point.n,
            "successes": point.successes,
            "strict_successes": point.strict_successes,
            "diverged": point.diverged,
            "invalid": point.invalid,
            "failed": point.failed,
            "undecided": point.undecided,
        })
    };
    let count = |holds: &dyn Fn(&CornerResult) -> bool| report.corners().filter(|point| holds(point)).count();
    let has_strict = report.points.iter().any(|point| point.strict_successes.is_some());
    json!({
        "seeds": report.seeds,
        "n": report.corners().count(),
        "succeeding": count(&CornerResult::succeeds),
        "strictly_succeeding":
            has_strict.then(|| count(&|point| point.succeeds_strictly() == Some(true))),
        "center_succeeds": report.center().map(CornerResult::succeeds),
        "center_strictly_succeeds": report.center().and_then(CornerResult::succeeds_strictly),
        "points": report.points.iter().enumerate().map(point).collect::<Vec<_>>(),
    })
}

/// Returns the results as lines of text: success, strict success, and the points that do not count.
pub fn text(axes: &[Axis], report: &CornerReport) -> String {
    let mut rows = vec![row("corners", axes, report, &|point| Some(point.successes))];
    if report.points.iter().any(|point| point.strict_successes.is_some()) {
        rows.push(row("strict", axes, report, &|point| point.strict_successes));
    }
    rows.extend(without_verdict(axes, report).into_iter().map(|text| vec![String::new(), text]));
    let left_out: Vec<String> = report
        .points
        .iter()
        .filter(|point| !report.counts(point))
        .map(|point| coordinates(axes, point))
        .collect();
    if !left_out.is_empty() {
        let cells = [String::new(), format!("unreachable, not counted: {}", listed(&left_out))];
        rows.push(cells.to_vec());
    }
    rows.push(vec![String::new(), legend(axes)]);
    output::table(&rows)
}

/// Describes the failed simulations at points that count whose failure is no violation of the formula.
fn without_verdict(axes: &[Axis], report: &CornerReport) -> Vec<String> {
    type Count = fn(&CornerResult) -> u32;
    let reasons: [(Count, &str); 4] = [
        (|point| point.diverged, simulation::DIVERGED),
        (|point| point.invalid, simulation::INVALID),
        (|point| point.failed, simulation::FAILED),
        (|point| point.undecided, simulation::UNDECIDED),
    ];
    let describe = |(count, reason): (Count, &str)| {
        let points: Vec<&CornerResult> =
            report.corners().chain(report.center()).filter(|point| count(point) > 0).collect();
        let places: Vec<String> = points.iter().map(|point| coordinates(axes, point)).collect();
        let total: u32 = points.into_iter().map(count).sum();
        (total > 0).then(|| format!("{} {reason} at {}", plural(total, "simulation"), listed(&places)))
    };
    reasons.into_iter().filter_map(describe).collect()
}

/// Names the coordinates of the points.
fn legend(axes: &[Axis]) -> String {
    let name = |axis: &Axis| format!("{} ({})", axis.name, axis.unit).replace(" ()", "");
    let starts: Vec<String> = axes.iter().filter(|axis| axis.kind == AxisKind::Start).map(name).collect();
    let others = if starts.len() < axes.len() { "; other axes have their nominal values" } else { "" };
    format!("coordinates: {}{others}; --json lists all points", starts.join(", "))
}

/// Returns the cells of a line: how many corners succeed, whether the center does, and where simulations fail.
fn row(
    name: &str,
    axes: &[Axis],
    report: &CornerReport,
    successes: &dyn Fn(&CornerResult) -> Option<u32>,
) -> Vec<String> {
    let failures = |point: &CornerResult| point.n - successes(point).unwrap_or_default();
    let with_seeds = |point: &CornerResult| match point.n {
        0 | 1 => String::new(),
        n => format!(" with {} of {n} seeds", failures(point)),
    };
    let (done, total) =
        (report.corners().filter(|point| failures(point) == 0).count(), report.corners().count());
    let verb = if done == 1 { "succeeds" } else { "succeed" };
    let mut text = format!("{done} of {total} {verb}");
    if report.seeds > 1 {
        text += &format!(" with all of {} seeds", report.seeds);
    }
    if let Some(center) = report.center() {
        text += &match failures(center) {
            0 => ", the center succeeds".to_string(),
            _ => format!(", the center fails{}", with_seeds(center)),
        };
    }
    let mut failing: Vec<&CornerResult> = report.corners().filter(|point| failures(point) > 0).collect();
    failing.sort_by_key(|point| std::cmp::Reverse(failures(point)));
    if !failing.is_empty() {
        let places: Vec<String> =
            failing.iter().map(|point| coordinates(axes, point) + &with_seeds(point)).collect();
        text += &format!("; corners that fail: {}", listed(&places));
    }
    vec![name.to_string(), text]
}

/// Joins the first texts and counts the rest.
fn listed(texts: &[String]) -> String {
    let shown = texts.iter().take(LISTED).cloned().collect::<Vec<_>>().join(", ");
    match texts.len().saturating_sub(LISTED) {
        0 => shown,
        more => format!("{shown}, and {more} more"),
    }
}

/// Formats the initial state of a point: `(0.85, 0.1)`.
fn coordinates(axes: &[Axis], point: &CornerResult) -> String {
    let values = axes.iter().zip(point.scenario.values());
    let starts = values.filter(|(axis, _)| axis.kind == AxisKind::Start);
    // Six decimals hide rounding errors of the center.
    let rounded = |value: f64| (value * 1e6).round() / 1e6;
    let texts: Vec<String> = starts.filter_map(|(_, value)| value.map(|v| rounded(v).to_string())).collect();
    format!("({})", texts.join(", "))
}

#[cfg(test)]
mod tests {
    use mishandle::evaluation::Corners;
    use mishandle::rollout::{Scenario, Seed, Space};

    use super::*;

    fn axes() -> Vec<Axis> {
        vec![Axis::start("x", "m", 0.75, 0.85), Axis::start("y", "m", -0.1, 0.1)]
    }

    /// Two seeds per point. All simulations succeed except those of the points in `failures`, with this many failures.
    fn report(failures: &[(usize, u32)], unreachable: Option<[f64; 2]>) -> CornerReport {
        let corners = Corners::new(&Space::new("starts", axes()).unwrap(), false, Seed(0)).unwrap();
        let is_reachable = |scenario: &Scenario| unreachable.map(|point| *scenario != Scenario::from(point));
        let mut report = corners.report(true, true, is_reachable);
        report.seeds = 2;
        for (index, point) in report.points.iter_mut().enumerate() {
            let failed = failures.iter().find(|(at, _)| *at == index).map_or(0, |(_, count)| *count);
            (point.n, point.successes, point.strict_successes) = (2, 2 - failed, Some(2 - failed));
        }
        report
    }

    #[test]
    fn failing_corners_are_listed_with_the_number_of_failing_seeds() {
        assert_eq!(
            text(&axes(), &report(&[(3, 2)], None)),
            "corners  3 of 4 succeed with all of 2 seeds, the center succeeds; corners that fail: (0.85, 0.1) with 2 of 2 \
             seeds\n\
             strict   3 of 4 succeed with all of 2 seeds, the center succeeds; corners that fail: (0.85, 0.1) with 2 of 2 \
             seeds\n         coordinates: x (m), y (m); --json lists all points"
        );
        // The corner with the most failures is first.
        let all = report(&[(0, 1), (1, 1), (2, 2), (3, 1), (4, 1)], None);
        let line = text(&axes(), &all).lines().next().unwrap().to_string();
        assert!(
            line.contains(
                "0 of 4 succeed with all of 2 seeds, the center fails with 1 of 2 seeds; corners that fail"
            ),
            "{line}"
        );
        assert!(
            line.ends_with(
                "fail: (0.85, -0.1) with 2 of 2 seeds, (0.75, -0.1) with 1 of 2 seeds, and 2 more"
            ),
            "{line}"
        );
    }

    #[test]
    fn simulations_without_a_verdict_are_named_apart_from_failures() {
        let mut report = report(&[(0, 1), (3, 2), (4, 1)], None);
        report.points[0].diverged = 1;
        report.points[3].diverged = 1;
        report.points[3].invalid = 1;
        report.points[4].undecided = 1;
        let lines = text(&axes(), &report);
        for line in [
            "\n         2 simulations diverged at (0.75, -0.1), (0.85, 0.1)\n",
            "\n         1 simulation ended in a value that is not finite at (0.85, 0.1)\n",
            "\n         1 simulation left the formula undecided at (0.8, 0)\n",
        ] {
            assert!(lines.contains(line), "{lines}");
        }
        let document = document(&axes(), &report);
        let counts = |index: usize| {
            ["diverged", "invalid", "undecided"].map(|key| document["points"][index][key].as_u64().unwrap())
        };
        assert_eq!(
            [counts(0), counts(1), counts(3), counts(4)],
            [[1, 0, 0], [0, 0, 0], [1, 1, 0], [0, 0, 1]]
        );
    }

    #[test]
    fn unreachable_corners_are_named_and_do_not_count() {
        let report = report(&[(3, 2)], Some([0.85, 0.1]));
        let lines = text(&axes(), &report);
        assert!(
            lines.starts_with("corners  3 of 3 succeed with all of 2 seeds, the center succeeds\n"),
            "{lines}"
        );
        assert!(lines.contains("unreachable, not counted: (0.85, 0.1)\n"), "{lines}");
        let document = document(&axes(), &report);
        assert_eq!((&document["n"], &document["succeeding"]), (&json!(3), &json!(3)));
        assert_eq!(
            (&document["points"][3]["reachable"], &document["points"][3]["counts"]),
            (&json!(false), &json!(false))
        );
        assert_eq!(document["points"][3]["scenario"], json!({"x": 0.85, "y": 0.1}));
        assert_eq!(document["points"][4]["kind"], "center");
    }
}
