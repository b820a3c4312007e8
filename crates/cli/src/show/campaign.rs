//! The results of a campaign, as text: a table for each kind of question, and the broken relations.

use mishandle::results::{
    Answer, BoxPoint, Campaign, CornerPoint, Corners, Estimate, Evaluation, Falsification, Hardening, Margin,
    Risk,
};
use mishandle_text::{decimal, probability_text};

use super::{metamorphic, output};

/// Returns a table for each kind of question, and what breaks relations.
pub fn text(found: &Campaign) -> String {
    let headers: [&[&str]; 5] = [
        &["run", "falsified", "rate", "95 % interval", "mean simulations", "min robustness", "no verdict"],
        &[
            "run",
            "success rate",
            "95 % interval",
            "control",
            "difference",
            "95 % interval",
            "strict",
            "careful",
            "dangerous",
            "failing corners",
            "n",
            "no verdict",
        ],
        &["run", "smallest amplitude", "axes", "robustness", "fails in repeats", "simulations"],
        &["run", "failure probability", "95 % interval", "from", "simulations"],
        &["run", "accepted", "failures before", "95 % interval", "after", "95 % interval", "worse"],
    ];
    let mut tables = headers.map(|header| vec![header.iter().map(ToString::to_string).collect::<Vec<_>>()]);
    let mut relations = Vec::new();
    for run in &found.runs {
        let (table, cells) = match &run.result {
            Answer::Falsification(found) => (0, falsification_cells(found)),
            Answer::Evaluation(found) => (1, evaluation_cells(found)),
            Answer::Margin(found) => (2, margin_cells(found)),
            Answer::Risk(found) => (3, risk_cells(found)),
            Answer::Hardening(found) => (4, hardening_cells(found)),
            Answer::Metamorphic(found) => {
                relations.push((run.name.as_str(), &**found));
                continue;
            }
        };
        tables[table].push(std::iter::once(run.name.clone()).chain(cells).collect());
    }
    let mut parts: Vec<String> =
        tables.iter().filter(|rows| rows.len() > 1).map(|rows| output::table(rows)).collect();
    if !relations.is_empty() {
        parts.push(metamorphic::text(&relations));
    }
    parts.join("\n\n")
}

fn margin_cells(found: &Margin) -> Vec<String> {
    let witness = found.witness.as_ref();
    let number = |value: Option<f64>| value.map_or("-".to_string(), |value| decimal(value, 4));
    let repeats = witness.and_then(|witness| witness.repeats.as_ref());
    vec![
        number(witness.map(|witness| witness.norms.amplitude)),
        witness.map_or("-".to_string(), |witness| witness.axes.to_string()),
        number(witness.and_then(|witness| witness.robustness).map(|rho| rho.0)),
        repeats.map_or("-".to_string(), |found| format!("{} of {}", found.failures, found.failure_rate.n)),
        found.simulations.to_string(),
    ]
}

fn risk_cells(found: &Risk) -> Vec<String> {
    let answer = found.probability.as_ref();
    let [low, high] = found.bounds.map(probability_text);
    let source = match &found.screening {
        Some(_) => "screening",
        None => answer.map_or("-", |answer| answer.source.as_str()),
    };
    vec![
        found.without_assumption().value.map_or("-".to_string(), probability_text),
        format!("[{low}, {high}]"),
        source.to_string(),
        found.simulations.to_string(),
    ]
}

/// The failure probability in the space before and after, and the measures that got worse.
fn hardening_cells(found: &Hardening) -> Vec<String> {
    let estimate = |index: usize| {
        let estimate = found.failure_probability.get(index);
        let cells = estimate.map(|estimate| [percent(estimate), interval(estimate)]);
        cells.unwrap_or(["-".to_string(), "-".to_string()])
    };
    let accepted = if found.after.is_some() { "yes" } else { "no" };
    let worse = if found.worse.is_empty() { "-".to_string() } else { found.worse.join(", ") };
    [vec![accepted.to_string()], estimate(0).to_vec(), estimate(1).to_vec(), vec![worse]].concat()
}

fn falsification_cells(found: &Falsification) -> Vec<String> {
    let minima = found.trials.iter().filter_map(|trial| trial.minimum_robustness).map(|minimum| minimum.0);
    let minimum = minima.reduce(f64::min);
    vec![
        match found.falsification_rate.value {
            Some(_) => format!("{} of {}", found.falsified_trials, found.falsification_rate.n),
            None => "-".to_string(),
        },
        percent(&found.falsification_rate),
        interval(&found.falsification_rate),
        found.mean_simulations.map_or("-".to_string(), |mean| format!("{mean:.1}")),
        minimum.map_or("-".to_string(), |minimum| decimal(minimum, 4)),
        found.simulations_without_verdict().to_string(),
    ]
}

fn evaluation_cells(found: &Evaluation) -> Vec<String> {
    let report = &found.metrics;
    let control = found.control.as_ref();
    let points = |difference: &Estimate| {
        difference.value.map_or("-".to_string(), |value| format!("{:+.2} points", 100.0 * value))
    };
    let optional = |rate: &Option<Estimate>| rate.as_ref().map_or("-".to_string(), percent);
    let without = match &found.screening {
        Some(counts) => counts.confirmed_without_verdict,
        None => report.diverged + report.invalid + report.failed + report.undecided,
    };
    vec![
        percent(&report.success_rate),
        interval(&report.success_rate),
        control.map_or("-".to_string(), |control| percent(&control.success_rate)),
        control.map_or("-".to_string(), |control| points(&control.difference)),
        control.map_or("-".to_string(), |control| interval(&control.difference)),
        optional(&report.strict_success_rate),
        optional(&report.careful_success_rate),
        optional(&report.dangerous_behavior_rate),
        found.corners.as_ref().map_or("-".to_string(), failing_corners),
        report.success_rate.n.to_string(),
        without.to_string(),
    ]
}

/// Returns how many of the corners with a verdict fail; the center is none.
fn failing_corners(corners: &Corners) -> String {
    let is_tested =
        |point: &&CornerPoint| point.kind == BoxPoint::Corner && point.counts && point.has_verdict();
    let tested: Vec<&CornerPoint> = corners.points.iter().filter(is_tested).collect();
    if tested.is_empty() {
        return "-".to_string();
    }
    let failing = tested.iter().filter(|point| point.successes < point.started()).count();
    format!("{failing} of {}", tested.len())
}

fn percent(rate: &Estimate) -> String {
    rate.value.map_or("-".to_string(), |rate| format!("{:.2} %", 100.0 * rate))
}

fn interval(rate: &Estimate) -> String {
    let ends = rate.low.zip(rate.high);
    ends.map_or("-".to_string(), |(low, high)| format!("[{:.2}, {:.2}]", 100.0 * low, 100.0 * high))
}

#[cfg(test)]
mod tests {
    use mishandle::results::{CampaignRun, Scenario};

    use super::super::corners::samples;
    use super::*;

    /// Each point has one simulation, which succeeds, violates the formula or has no verdict.
    fn corners(ends: &[&str]) -> Corners {
        let point = |end: &&str| {
            let mut point = samples::point(BoxPoint::Corner, 1, Scenario::default());
            if *end != "success" {
                samples::fail(&mut point, end);
            }
            point
        };
        samples::corners(1, ends.iter().map(point).collect())
    }

    #[test]
    fn corners_without_a_verdict_are_no_failing_corners() {
        for end in ["diverged", "invalid", "failed", "undecided"] {
            assert_eq!(failing_corners(&corners(&[end, end])), "-", "{end}");
            assert_eq!(failing_corners(&corners(&["success", "violation", end])), "1 of 2", "{end}");
        }
    }

    #[test]
    fn the_center_is_no_corner() {
        for ends in [["success"; 3], ["success", "violation", "violation"]] {
            let mut corners = corners(&ends);
            let expected = failing_corners(&corners);
            for end in ["success", "violation"] {
                let mut center = samples::point(BoxPoint::Center, 1, Scenario::default());
                if end != "success" {
                    samples::fail(&mut center, end);
                }
                corners.points.push(center);
                assert_eq!(failing_corners(&corners), expected);
            }
        }
    }

    #[test]
    fn an_evaluation_without_any_verdict_has_no_success_rate() {
        let unknown = Estimate { n: 3, ..Estimate::default() };
        assert_eq!([percent(&unknown), interval(&unknown)], ["-", "-"]);
    }

    #[test]
    fn a_hardening_has_a_row_with_both_failure_probabilities_and_what_got_worse() {
        let estimate = |value: f64, low: f64, high: f64| Estimate {
            value: Some(value),
            low: Some(low),
            high: Some(high),
            n: 100,
        };
        let before = Hardening { failure_probability: vec![estimate(0.6, 0.5, 0.7)], ..Hardening::default() };
        let mut after = Hardening { after: Some("b.safetensors".to_string()), ..before.clone() };
        after.failure_probability.push(estimate(0.2, 0.125, 0.3));
        after.worse = vec!["careful".to_string(), "corners".to_string()];
        let run = |name: &str, found: Hardening| CampaignRun {
            name: name.to_string(),
            kind: "harden".to_string(),
            result: Answer::Hardening(Box::new(found)),
        };
        let runs = vec![run("a", before), run("b", after)];
        let text = text(&Campaign { folder: String::new(), is_complete: true, runs });
        let rows: Vec<Vec<&str>> = text
            .lines()
            .map(|line| line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).collect())
            .collect();
        assert_eq!(
            rows[0],
            ["run", "accepted", "failures before", "95 % interval", "after", "95 % interval", "worse"]
        );
        assert_eq!(rows[1], ["a", "no", "60.00 %", "[50.00, 70.00]", "-", "-", "-"]);
        assert_eq!(
            rows[2],
            ["b", "yes", "60.00 %", "[50.00, 70.00]", "20.00 %", "[12.50, 30.00]", "careful, corners"]
        );
    }
}
