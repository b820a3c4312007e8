//! Output of the results at the corners of the initial box.

use mishandle::results::{AxisFacts, BoxPoint, CornerPoint, Corners};
use mishandle_text::plural;

use super::output;

/// Kind of the axes of the initial state.
const START: &str = "start";

/// Text in place of a result that no simulation decides.
const NO_VERDICT: &str = "no verdict";

/// Number of failing points that a line lists.
const LISTED: usize = 2;

/// Returns the results as lines of text: success, strict and careful success, and the points that
/// do not count.
pub fn text(axes: &[AxisFacts], report: &Corners) -> String {
    let mut rows = vec![row("corners", axes, report, &|point| Some(point.successes))];
    if report.points.iter().any(|point| point.strict_successes.is_some()) {
        rows.push(row("strict", axes, report, &|point| point.strict_successes));
    }
    if report.points.iter().any(|point| point.careful_successes.is_some()) {
        rows.push(row("careful", axes, report, &|point| point.careful_successes));
    }
    rows.extend(without_verdict(axes, report).into_iter().map(|text| vec![String::new(), text]));
    for (why, starts) in [("unreachable", true), ("the target cannot start", false)] {
        let is_it = |point: &&CornerPoint| !point.counts && (point.started() > 0) == starts;
        let places: Vec<String> =
            report.points.iter().filter(is_it).map(|point| coordinates(axes, point)).collect();
        if !places.is_empty() {
            rows.push(vec![String::new(), format!("{why}, not counted: {}", listed(&places))]);
        }
    }
    rows.push(vec![String::new(), legend(axes)]);
    output::table(&rows)
}

/// Returns the points of a kind that count.
fn counted(report: &Corners, kind: BoxPoint) -> impl Iterator<Item = &CornerPoint> {
    report.points.iter().filter(move |point| point.kind == kind && point.counts)
}

/// Returns the center if it counts.
fn center(report: &Corners) -> Option<&CornerPoint> {
    report.points.iter().find(|point| point.kind == BoxPoint::Center && point.counts)
}

/// Describes the failed simulations at points that count whose failure is not a violation of the
/// formula.
fn without_verdict(axes: &[AxisFacts], report: &Corners) -> Vec<String> {
    let reasons = |point: &CornerPoint| {
        let ends = point.ends();
        let [diverged, invalid, failed, undecided] = ends.reasons();
        [diverged, invalid, failed, undecided, (ends.invalid_starts, "did not start")]
    };
    let points: Vec<_> = counted(report, BoxPoint::Corner)
        .chain(center(report))
        .map(|point| (coordinates(axes, point), reasons(point)))
        .collect();
    let describe = |kind: usize| {
        let ended: Vec<_> = points.iter().filter(|(_, reasons)| reasons[kind].0 > 0).collect();
        let (_, reason) = ended.first()?.1[kind];
        let places: Vec<String> = ended.iter().map(|(place, _)| place.clone()).collect();
        let total: u64 = ended.iter().map(|(_, reasons)| reasons[kind].0).sum();
        Some(format!("{} {reason} at {}", plural(total, "simulation"), listed(&places)))
    };
    (0..5).filter_map(describe).collect()
}

/// Names the coordinates of the points.
fn legend(axes: &[AxisFacts]) -> String {
    let name = |axis: &AxisFacts| format!("{} ({})", axis.name, axis.unit).replace(" ()", "");
    let starts: Vec<String> = axes.iter().filter(|axis| axis.kind == START).map(name).collect();
    let others = if starts.len() < axes.len() { "; other axes have their nominal values" } else { "" };
    format!("coordinates: {}{others}; --json lists all points", starts.join(", "))
}

/// Returns the cells of a line: how many corners succeed, whether the center does, and where
/// simulations fail.
fn row(
    name: &str,
    axes: &[AxisFacts],
    report: &Corners,
    successes: &dyn Fn(&CornerPoint) -> Option<u32>,
) -> Vec<String> {
    let failures = |point: &CornerPoint| point.started() - successes(point).unwrap_or_default();
    let with_seeds = |point: &CornerPoint| match point.started() {
        0 | 1 => String::new(),
        n => format!(" with {} of {n} seeds", failures(point)),
    };
    let (tested, others): (Vec<&CornerPoint>, Vec<&CornerPoint>) =
        counted(report, BoxPoint::Corner).partition(|point| point.has_verdict());
    let done = tested.iter().filter(|point| failures(point) == 0).count();
    let verb = if done == 1 { "succeeds" } else { "succeed" };
    let mut text = match (tested.len(), others.len()) {
        (0, 0) => "none counts".to_string(),
        (0, _) => NO_VERDICT.to_string(),
        (total, _) => format!("{done} of {total} {verb}"),
    };
    if report.seeds > 1 && !tested.is_empty() {
        text += &format!(" with all of {} seeds", report.seeds);
    }
    if !others.is_empty() && !tested.is_empty() {
        text += &format!(", {} without a verdict", others.len());
    }
    if let Some(center) = center(report) {
        text += &match failures(center) {
            _ if !center.has_verdict() => ", the center has no verdict".to_string(),
            0 => ", the center succeeds".to_string(),
            _ => format!(", the center fails{}", with_seeds(center)),
        };
    }
    let mut failing: Vec<&CornerPoint> = tested.into_iter().filter(|point| failures(point) > 0).collect();
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
fn coordinates(axes: &[AxisFacts], point: &CornerPoint) -> String {
    let values = axes.iter().zip(point.scenario.values());
    let starts = values.filter(|(axis, _)| axis.kind == START);
    // Six decimals hide rounding errors of the center.
    let rounded = |value: f64| (value * 1e6).round() / 1e6;
    let texts: Vec<String> = starts.filter_map(|(_, value)| value.map(|v| rounded(v).to_string())).collect();
    format!("({})", texts.join(", "))
}

/// Corners for tests.
#[cfg(test)]
pub mod samples {
    use mishandle::results::{BoxPoint, CornerPoint, Corners, Scenario};

    /// Returns a point whose `n` simulations succeed.
    pub fn point(kind: BoxPoint, n: u32, scenario: Scenario) -> CornerPoint {
        CornerPoint {
            kind,
            scenario,
            reachable: None,
            counts: true,
            n,
            invalid_starts: 0,
            successes: n,
            strict_successes: None,
            careful_successes: None,
            diverged: 0,
            invalid: 0,
            failed: 0,
            undecided: 0,
        }
    }

    /// Lets one more simulation of a point end so: `violation`, `diverged`, `invalid`, `failed` or
    /// `undecided`.
    pub fn fail(point: &mut CornerPoint, end: &str) {
        point.successes -= 1;
        let others = [&mut point.diverged, &mut point.invalid, &mut point.failed, &mut point.undecided];
        for (name, count) in ["diverged", "invalid", "failed", "undecided"].into_iter().zip(others) {
            *count += u32::from(name == end);
        }
    }

    /// Returns the results of points.
    pub fn corners(seeds: u32, points: Vec<CornerPoint>) -> Corners {
        Corners {
            seeds,
            n: points.len() as u64,
            without_verdict: 0,
            succeeding: 0,
            strictly_succeeding: None,
            carefully_succeeding: None,
            center_succeeds: None,
            center_strictly_succeeds: None,
            center_carefully_succeeds: None,
            points,
        }
    }
}

#[cfg(test)]
mod tests {
    use mishandle::resolve::axis_facts;
    use mishandle::rollout::Axis;

    use super::samples::{corners, fail, point};
    use super::*;

    fn axes() -> Vec<AxisFacts> {
        [Axis::start("x", "m", 0.75, 0.85), Axis::start("y", "m", -0.1, 0.1)].iter().map(axis_facts).collect()
    }

    /// Two seeds per point. All simulations succeed except those of the points in `failures`, with
    /// this many failures.
    fn report(failures: &[(usize, u32)], unreachable: Option<[f64; 2]>) -> Corners {
        let places = [[0.75, -0.1], [0.75, 0.1], [0.85, -0.1], [0.85, 0.1], [0.8, 0.0]];
        let point = |(index, [x, y]): (usize, [f64; 2])| {
            let failed = failures.iter().find(|(at, _)| *at == index).map_or(0, |(_, count)| *count);
            let is_reachable = unreachable != Some([x, y]);
            let kind = if index < 4 { BoxPoint::Corner } else { BoxPoint::Center };
            let mut found = point(kind, 2, [("x", Some(x)), ("y", Some(y))].into_iter().collect());
            (0..failed).for_each(|_| fail(&mut found, "violation"));
            CornerPoint {
                reachable: Some(is_reachable),
                counts: is_reachable,
                strict_successes: Some(found.successes),
                ..found
            }
        };
        corners(2, places.into_iter().enumerate().map(point).collect())
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
    }

    #[test]
    fn points_without_a_verdict_neither_succeed_nor_fail() {
        let mut all = report(&[], None);
        let end = |point: &mut CornerPoint, n: u32| {
            (0..n).for_each(|_| fail(point, "failed"));
            point.strict_successes = Some(point.successes);
        };
        end(&mut all.points[1], 2);
        let first = |report: &Corners| text(&axes(), report).lines().next().unwrap_or_default().to_string();
        let line = first(&all);
        let expected =
            "corners  3 of 3 succeed with all of 2 seeds, 1 without a verdict, the center succeeds";
        assert_eq!(line, expected);
        // One of two seeds has a verdict: a crash is not a success.
        end(&mut all.points[0], 1);
        assert!(
            first(&all).ends_with("corners that fail: (0.75, -0.1) with 1 of 2 seeds"),
            "{}",
            first(&all)
        );
        let mut none = report(&[], None);
        none.points.iter_mut().for_each(|point| end(point, 2));
        assert_eq!(first(&none), "corners  no verdict, the center has no verdict");
        // The target rejects two corners. They are not among those that count.
        let mut rejected = report(&[], None);
        for index in [1, 3] {
            end(&mut rejected.points[index], 2);
            rejected.points[index].invalid_starts = 2;
            rejected.points[index].counts = false;
        }
        assert!(
            first(&rejected).starts_with("corners  2 of 2 succeed with all of 2 seeds, the center succeeds")
        );
        let lines = text(&axes(), &rejected);
        assert!(
            lines.contains("the target cannot start, not counted: (0.75, 0.1), (0.85, 0.1)\n"),
            "{lines}"
        );
        assert!(!lines.contains("unreachable"), "{lines}");
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
    }
}
