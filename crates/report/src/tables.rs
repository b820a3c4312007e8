//! Tables of trials, simulations, axes and corners, as HTML.

use mishandle::results::{Answer, BoxPoint, CornerPoint, Estimate, Requirement};
use mishandle::rollout::Axis;
use mishandle::store::TrialStatus;

use crate::html::{number, percent, short, table, text};
use crate::load::{Point, RunReport};
use crate::map::axis_label;
use crate::space::value_text;

/// Meanings of axes are cut to this length.
const MEANING: usize = 300;

/// Largest numbers of trials and axes in a table.
const MAX_TRIALS: usize = 100;
const MAX_AXES: usize = 60;

/// Largest number of axes whose values are columns.
const VALUE_COLUMNS: usize = 6;

/// Largest number of failing corners that are listed.
const MAX_CORNERS: usize = 20;

/// Returns the id of the row of a simulation.
pub fn row_id(run: usize, trial: u32, simulation: u32) -> String {
    format!("r{run}-t{trial}-s{simulation}")
}

/// Returns a link to a simulation: to its row, if the page has it.
pub fn link(report: &RunReport, run: usize, trial: u32, simulation: u32) -> String {
    let is_it = |point: &&Point| (point.trial, point.number) == (trial, simulation);
    if report.points.iter().find(is_it).is_some_and(|point| point.is_linked) {
        format!("<a href=\"#{}\">{simulation}</a>", row_id(run, trial, simulation))
    } else {
        simulation.to_string()
    }
}

/// Returns the table of the requirements with a verdict of their own; empty without one.
pub fn requirements(report: &RunReport) -> String {
    let row = |found: &Requirement| {
        vec![
            text(&found.name),
            format!("<code>{}</code>", text(&found.formula)),
            found.violated_text(),
            found.minimum_robustness.map_or("–".to_string(), |least| number(least.0)),
        ]
    };
    let rows: Vec<Vec<String>> = report.requirements.iter().map(row).collect();
    let head = ["requirement", "formula", "violated", "lowest robustness"];
    if rows.is_empty() {
        String::new()
    } else {
        table("Requirements, each with a verdict of its own", &head, &rows)
    }
}

/// Returns the table of the trials.
pub fn trials(report: &RunReport, run: usize) -> String {
    let status = |status: TrialStatus| match status {
        TrialStatus::Falsified => "<b class=\"fail\">✕ falsified</b>",
        TrialStatus::BudgetSpent => "<b class=\"pass\">• no failure</b>, budget spent",
        TrialStatus::Converged => "<b class=\"pass\">• no failure</b>, search ended",
        TrialStatus::Running => "not finished",
    };
    let rows: Vec<Vec<String>> = report
        .trials
        .iter()
        .take(MAX_TRIALS)
        .map(|trial| {
            let number_of = trial.summary.trial.number;
            let worst = trial.worst.map_or(["–".to_string(), "–".to_string()], |(simulation, rho)| {
                [number(rho), link(report, run, number_of, simulation)]
            });
            let [rho, simulation] = worst;
            let first =
                trial.first_failure.map_or("–".to_string(), |first| link(report, run, number_of, first));
            vec![
                number_of.to_string(),
                status(trial.summary.trial.status).to_string(),
                trial.summary.counts.simulations.to_string(),
                first,
                rho,
                simulation,
            ]
        })
        .collect();
    let head = ["trial", "result", "simulations", "first failure", "lowest robustness", "in simulation"];
    table("Trials", &head, &rows) + &more(report.trials.len(), MAX_TRIALS, "trials")
}

/// Returns the table of the rates of an evaluation; empty for another run.
pub fn rates(report: &RunReport) -> String {
    let rows = rate_rows(report);
    if rows.is_empty() {
        return String::new();
    }
    let head = ["mean over the random simulations", "value", interval_head(report), "simulations"];
    let notes = rate_notes(report);
    let notes = notes.iter().map(|note| format!("<p>{}</p>\n", text(note)));
    table("Rates", &head, &rows) + &notes.collect::<String>()
}

/// Returns what the intervals of the rates are.
pub fn interval_head(report: &RunReport) -> &'static str {
    if report.stops_by_itself() { "95 % interval at any time" } else { "95 % interval" }
}

/// Returns the rows of the rates of an evaluation: name, value, interval and number of simulations.
pub fn rate_rows(report: &RunReport) -> Vec<Vec<String>> {
    let Some(Answer::Evaluation(evaluation)) = &report.answer else { return Vec::new() };
    let found = &evaluation.metrics;
    let steps = |value: f64| format!("{} ({} s)", number(value), number(value * report.header.control_dt));
    let row = |(name, estimate, show): (&str, Option<Estimate>, &dyn Fn(f64) -> String)| {
        let estimate = estimate?;
        let cell = |value: Option<f64>| value.map_or("–".to_string(), show);
        let interval = match (estimate.low, estimate.high) {
            (Some(low), Some(high)) => format!("{} to {}", show(low), show(high)),
            _ => "–".to_string(),
        };
        Some(vec![name.to_string(), cell(estimate.value), interval, estimate.n.to_string()])
    };
    let rows = [
        ("success rate", Some(found.success_rate), &percent as &dyn Fn(f64) -> String),
        ("strict success rate", found.strict_success_rate, &percent),
        ("careful success rate", found.careful_success_rate, &percent),
        ("dangerous control steps", found.dangerous_behavior_rate, &percent),
        ("simulations with a dangerous step", found.dangerous_episode_rate, &percent),
        ("control steps until completion", found.task_completion_time, &steps),
    ];
    let mut rows: Vec<Vec<String>> = rows.into_iter().filter_map(row).collect();
    if let Some(control) = &evaluation.control {
        let points =
            |value: f64| format!("{}{} points", if value > 0.0 { "+" } else { "" }, number(1e2 * value));
        let of_control = [
            (
                "success rate of the control, at nominal",
                Some(control.success_rate),
                &percent as &dyn Fn(f64) -> String,
            ),
            ("paired difference of the success rates", Some(control.difference), &points),
        ];
        rows.splice(1..1, of_control.into_iter().filter_map(row));
    }
    rows
}

/// Returns sentences about the rates: what fails only under the perturbation, and what ended the
/// evaluation.
pub fn rate_notes(report: &RunReport) -> Vec<String> {
    let Some(Answer::Evaluation(found)) = &report.answer else { return Vec::new() };
    let control = found.control.iter().map(|control| {
        format!(
            "Of {}, {} fail only in the space and {} only in the control, which has the same starts and seeds and at nominal: {}.{}",
            mishandle_text::plural(control.difference.n, "pair"),
            control.fails_only_in_space,
            control.fails_only_in_control,
            control.nominal.join(", "),
            match control.left_out {
                0 => String::new(),
                n => format!(" Left out: {}.", mishandle_text::plural(n, "pair")),
            }
        )
    });
    control.chain(found.sequential.iter().map(|sequential| sequential.verdict.clone())).collect()
}

/// Says that a table is cut.
fn more(count: usize, shown: usize, what: &str) -> String {
    if count > shown { format!("<p>{shown} of {count} {what} are shown.</p>\n") } else { String::new() }
}

/// Returns the table of the simulations that marks of the charts lead to.
pub fn simulations(report: &RunReport, run: usize) -> String {
    let columns = report.axes.len().min(VALUE_COLUMNS);
    let mode_of = |point: &Point| {
        let is_in = |mode: &mishandle::inspect::FailureMode| {
            mode.failures.iter().any(|failure| (failure.trial, failure.number) == (point.trial, point.number))
        };
        report.modes.modes.iter().position(is_in)
    };
    let mut points: Vec<&Point> = report.points.iter().filter(|point| point.is_linked).collect();
    points.sort_by_key(|point| (!point.fails(), point.trial, point.number));
    let mut rows = String::new();
    for point in &points {
        let rho = point.robustness.map_or("–".to_string(), number);
        let mark = match (point.fails(), point.robustness) {
            (true, _) => "<b class=\"fail\">✕</b>",
            (false, Some(_)) => "<b class=\"pass\">•</b>",
            (false, None) => "–",
        };
        let mode = mode_of(point).map_or(String::new(), |index| {
            if index < report.representatives.len() {
                format!("<a href=\"#{}\">{}</a>", mode_id(run, index), index + 1)
            } else {
                (index + 1).to_string()
            }
        });
        let values: String = report
            .axes
            .iter()
            .zip(&point.scenario)
            .take(columns)
            .map(|(axis, value)| format!("<td>{}</td>", text(&value_text(axis, *value))))
            .collect();
        rows.push_str(&format!(
            "<tr id=\"{}\"{}><td>{mark}</td><td>{}</td><td>{}</td><td>{rho}</td><td>{mode}</td>{values}<td>{}</td><td \
             class=\"seed\">{}</td></tr>\n",
            row_id(run, point.trial, point.number),
            if point.fails() { "" } else { " class=\"passing\"" },
            point.trial,
            point.number,
            point.end,
            point.seed,
        ));
    }
    let named: String = report
        .axes
        .iter()
        .take(columns)
        .map(|axis| format!("<th scope=\"col\">{}</th>", text(&short(&axis.name, 30))))
        .collect();
    let shown = if (points.len() as u64) < report.counts.simulations {
        format!("{} of {}, failures first", points.len(), report.counts.simulations)
    } else {
        "all".to_string()
    };
    let rest = if report.axes.len() > columns {
        format!("<p>The first {columns} of {} axes are shown.</p>\n", report.axes.len())
    } else {
        String::new()
    };
    format!(
        "<div class=\"scroll tall\" tabindex=\"0\" role=\"region\" aria-label=\"Simulations\"><table><caption>Simulations: \
         {shown}</caption><thead><tr><th scope=\"col\"></th><th scope=\"col\">trial</th><th scope=\"col\">simulation</th><th \
         scope=\"col\">robustness</th><th scope=\"col\">mode</th>{named}<th scope=\"col\">end</th><th scope=\"col\">seed</th>\
         </tr></thead>\n<tbody>{rows}</tbody></table></div>\n{rest}"
    )
}

/// Returns the id of the description of a failure mode.
pub fn mode_id(run: usize, index: usize) -> String {
    format!("r{run}-mode{}", index + 1)
}

/// Returns the table of the axes.
pub fn axes(report: &RunReport) -> String {
    let rows: Vec<Vec<String>> = report
        .axes
        .iter()
        .zip(&report.header.axes)
        .take(MAX_AXES)
        .map(|(axis, record)| {
            let of = |value: f64| text(&value_text(axis, Some(value)));
            vec![
                axis_label(axis),
                format!("{} to {}", of(axis.low), of(axis.high)),
                text(&value_text(axis, axis.nominal)),
                text(&short(&record.kind, 30)),
                text(&short(&record.meaning, MEANING)),
            ]
        })
        .collect();
    let head = ["axis", "range", "nominal", "kind", "meaning"];
    table("Axes of the space", &head, &rows) + &more(report.axes.len(), MAX_AXES, "axes")
}

/// Returns what happens at the corners and the center of the initial box; `None` if they were not
/// simulated.
pub fn corners(report: &RunReport) -> Option<String> {
    let found = match &report.answer {
        Some(Answer::Evaluation(found)) => found.corners.as_ref(),
        _ => report.measured.as_ref().and_then(|measured| measured.corners.as_ref()),
    }?;
    // An interrupted evaluation has not simulated all of them.
    let points: Vec<&CornerPoint> = found.points.iter().filter(|point| point.counts && point.n > 0).collect();
    let (corners, center): (Vec<&CornerPoint>, Vec<&CornerPoint>) =
        points.iter().copied().partition(|point| point.kind == BoxPoint::Corner);
    let n = corners.len();
    let without_verdict = corners.iter().filter(|point| !point.has_verdict()).count();
    let failing_corners = corners.iter().filter(|point| point.violations() > 0).count();
    let seeds = found.seeds;
    let each = if seeds > 1 { format!(" in at least one of {seeds} simulations") } else { String::new() };
    let verb = if failing_corners == 1 { "fails" } else { "fail" };
    let center = match center.first() {
        None => "was not simulated",
        Some(center) if center.verdicts() == 0 => "has no verdict",
        Some(center) if center.violations() == 0 => "does not",
        Some(_) => "fails",
    };
    let is_tested = without_verdict < n;
    let what = if is_tested {
        let rest = match without_verdict {
            0 => String::new(),
            n => format!(" {} without a verdict.", mishandle_text::plural(n as u64, "corner")),
        };
        let manners = [("strictly", found.strictly_succeeding), ("carefully", found.carefully_succeeding)];
        let manner = manners.into_iter().filter_map(|(name, all)| {
            Some(format!(" All simulations succeed {name} at {} of {n} corners.", all?))
        });
        format!(
            "{failing_corners} of the {n} corners of the initial box {verb}{each}; its center {center}.{rest}{}",
            manner.collect::<String>()
        )
    } else {
        format!("No simulation at the corners of the initial box has a verdict; its center {center}.")
    };
    let intro = format!("<p>{what} Random scenarios hardly ever meet a corner.</p>\n");
    let row = |point: &&CornerPoint| {
        let values = report.axes.iter().zip(point.scenario.values().copied());
        let named = values.filter(|(axis, value)| *value != axis.nominal || axis.nominal.is_none());
        let value = |(axis, value): (&Axis, Option<f64>)| {
            format!("{} = {}", text(&short(&axis.name, 30)), text(&value_text(axis, value)))
        };
        let values: Vec<String> = named.take(VALUE_COLUMNS).map(value).collect();
        let place = if values.is_empty() { "center".to_string() } else { values.join(", ") };
        let failures = point.violations();
        let started = point.started();
        let share = percent(f64::from(failures) / f64::from(started.max(1)));
        vec![place, format!("{failures} of {started} ({share})")]
    };
    let failing = points.iter().filter(|point| point.violations() > 0);
    let rows: Vec<Vec<String>> = failing.take(MAX_CORNERS).map(row).collect();
    if rows.is_empty() {
        return Some(intro);
    }
    Some(intro + &table("Failing corners", &["place", "failures"], &rows))
}
