//! The page about a hardening: a controller before and after.

use mishandle::results::{Estimate, HardenedMargin, HardenedMeasure, Hardening, ModeChange, Words};
use mishandle::rollout::Axis;
use mishandle_text::plural;

use crate::hardened_modes::{HardenedModes, ordered};
use crate::html::{number, p_value, percent, short, table, text};
use crate::load::RunReport;
use crate::page::Document;
use crate::space::value_text;
use crate::{section, words};

/// Entry of a campaign's index for a hardening.
#[derive(Clone, Debug)]
pub struct HardeningSummary {
    /// Name of the run.
    pub name: String,
    /// Link to its page.
    pub href: String,
    /// Its result; `None` if it is not finished.
    pub found: Option<Hardening>,
}

impl HardeningSummary {
    fn cells(&self) -> Vec<String> {
        let name = text(&self.name);
        let Some(found) = &self.found else {
            let missing = std::iter::repeat_n("–".to_string(), 4);
            return [name, "not finished".to_string()].into_iter().chain(missing).collect();
        };
        let accepted = if found.after.is_some() { "accepted" } else { "no round was accepted" };
        let worse = if found.worse.is_empty() { "–".to_string() } else { text(&found.worse.join(", ")) };
        vec![
            format!("<a class=\"whole\" href=\"{}\">{name}</a>", text(&self.href)),
            accepted.to_string(),
            estimated(found.failure_probability.first()),
            estimated(found.failure_probability.get(1)),
            worse,
            text(&found.verdict),
        ]
    }
}

/// Returns the table of a campaign's hardenings; empty without one.
pub(crate) fn hardenings(summaries: &[HardeningSummary]) -> String {
    if summaries.is_empty() {
        return String::new();
    }
    let head = ["run", "result", "failure probability before", "after", "worse", "verdict"];
    let rows: Vec<Vec<String>> = summaries.iter().map(HardeningSummary::cells).collect();
    table("Hardenings", &head, &rows)
}

/// Returns the page about a hardening, with failures of its modes, and sections about some of its
/// runs: one HTML file without scripts, which loads nothing. `up` is the address of the index of
/// its campaign.
pub fn hardening_page(
    found: &Hardening,
    failures: &HardenedModes,
    reports: &[RunReport],
    up: Option<&str>,
    words: Words,
) -> String {
    let target = text(&short(&found.target, 60));
    let mut out = format!(
        "<section>\n<h2>{target}: {}{}</h2>\n<p class=\"requirement\"><b>Before:</b> <code>{}</code>. <b>After:</b> {}. \
         <b>Space:</b> <code>{}</code>{}.{}</p>\n",
        text(&found.verdict),
        words::without_verdict(&found.without_verdict),
        text(&short(&found.before, 80)),
        found.after.as_ref().map_or("no round was accepted".to_string(), |path| format!(
            "<code>{}</code>",
            text(&short(path, 80))
        )),
        text(&short(&found.space, 80)),
        reports.first().map_or(String::new(), ranges),
        trainer(found),
    );
    out.push_str(&failures.lead());
    out.push_str(&tiles(found));
    out.push_str(&format!("<h3>Before and after</h3>\n{}{}{}", measures(found), others(found), NOTE));
    out.push_str(&format!("<h3>Failure modes</h3>\n{}{}", modes(found), failures.html(found, words)));
    out.push_str(&format!("<h3>Rounds</h3>\n{}", rounds(found)));
    out.push_str(&format!("<h3>What it cost</h3>\n<p>{}</p>\n</section>\n", cost(found)));
    for (id, report) in (1..).zip(reports) {
        out.push_str(&section::section(report, id));
    }
    let up = up.map(|up| (up, "all runs"));
    Document { title: &format!("hardening of {target}"), up, body: &out }.html()
}

/// Returns who trained, if it was not this program.
fn trainer(found: &Hardening) -> String {
    found.trainer.as_ref().map_or(String::new(), |command| {
        format!(" <b>Trained by:</b> <code>{}</code>.", text(&short(command, 120)))
    })
}

/// Returns the ranges of the axes of a run.
fn ranges(report: &RunReport) -> String {
    let range = |axis: &Axis| {
        let [low, high] = [axis.low, axis.high].map(|value| value_text(axis, Some(value)));
        format!("{} {} to {}", text(&short(&axis.name, 40)), text(&low), text(&high))
    };
    let mut ranges: Vec<String> = report.axes.iter().take(MAX_RANGES).map(range).collect();
    match report.axes.len().saturating_sub(MAX_RANGES) {
        0 => {}
        more => ranges.push(format!("and {more} more")),
    }
    format!(" ({})", ranges.join(", "))
}

/// Largest number of axes whose ranges stand at the top.
const MAX_RANGES: usize = 8;

/// Explains the numbers.
const NOTE: &str = "<p class=\"notes\">Simulated once, after the last decision, with scenarios and seeds that no search, training run or \
     decision used; the corners of the initial box are the same points everywhere. Rates: Wilson's interval, Newcombe's \
     interval for pairs, and the exact McNemar test with Holm's correction for all measures. Failure probability: Monte \
     Carlo with the exact interval.</p>\n";

fn tiles(found: &Hardening) -> String {
    let failing = |estimate: Option<&Estimate>| {
        estimate.and_then(|estimate| estimate.value).map_or("–".to_string(), percent)
    };
    let accepted = found.rounds.iter().filter(|round| round.accepted).count();
    let space = found.measures.iter().find(|measure| measure.name == "space");
    let pairs = space.filter(|space| space.after.is_some());
    let pairs = pairs.map(|space| format!("{} fixed, {} broken", space.fixed, space.broken));
    let after = found.failure_probability.get(1).map(|after| failing(Some(after)));
    let tiles = [
        (Some(failing(found.failure_probability.first())), "failure probability before"),
        (after, "failure probability after"),
        (pairs, "of the final scenarios in the space"),
        (Some(format!("{accepted} of {}", found.rounds.len())), "rounds accepted"),
    ];
    let tiles = tiles.into_iter().filter_map(|(value, name)| Some((value?, name)));
    let tile = |(value, name): (String, &str)| format!("<div><dd>{value}</dd><dt>{name}</dt></div>");
    format!("<dl class=\"tiles\">{}</dl>\n", tiles.map(tile).collect::<String>())
}

/// Returns an estimate with its interval.
fn estimated(estimate: Option<&Estimate>) -> String {
    match estimate {
        Some(Estimate { value: Some(value), low: Some(low), high: Some(high), .. }) => {
            format!("{} ({} to {})", percent(*value), percent(*low), percent(*high))
        }
        _ => "–".to_string(),
    }
}

fn measures(found: &Hardening) -> String {
    let row = |measure: &HardenedMeasure| {
        let HardenedMeasure { before, after, difference, broken, fixed, adjusted_p_value, .. } = measure;
        let points = |value: f64| number((1e4 * value).round() / 100.0);
        let difference = difference.and_then(|difference| {
            Some(format!(
                "{} ({} to {})",
                points(difference.value?),
                points(difference.low?),
                points(difference.high?)
            ))
        });
        vec![
            text(measure.label()),
            estimated(Some(before)),
            estimated(after.as_ref()),
            difference.unwrap_or("–".to_string()),
            after.map_or("–".to_string(), |_| format!("{fixed} fixed, {broken} broken")),
            adjusted_p_value.map_or("–".to_string(), p_value),
            before.n.to_string(),
        ]
    };
    let rows: Vec<Vec<String>> = found.measures.iter().map(row).collect();
    let head =
        ["measure", "before", "after", "difference, percentage points", "pairs", "p-value", "simulations"];
    table("Success before and after", &head, &rows)
}

fn others(found: &Hardening) -> String {
    let row = |name: &str, before: String, after: String| vec![name.to_string(), before, after];
    let probability = &found.failure_probability;
    let mut rows = vec![row(
        "failure probability in the space",
        estimated(probability.first()),
        estimated(probability.get(1)),
    )];
    if let Some(corners) = &found.corners {
        let of = |count: u64| format!("{count} of {}", corners.corners);
        rows.push(row(
            "corners at which all simulations succeed",
            of(corners.before),
            corners.after.map_or("–".to_string(), of),
        ));
    }
    let margin = |margin: Option<&HardenedMargin>| match margin {
        None => "–".to_string(),
        Some(HardenedMargin { amplitude: Some(amplitude), .. }) => number(*amplitude),
        Some(HardenedMargin { without_failure: Some(level), .. }) => {
            format!("above {}", number(*level))
        }
        Some(_) => "none found".to_string(),
    };
    rows.push(row(
        "smallest disturbance that breaks it (amplitude)",
        margin(found.margin.first()),
        margin(found.margin.get(1)),
    ));
    let search = |index: usize| {
        found.searches.get(index).map_or("–".to_string(), |search| {
            format!(
                "{} of {}, in {}",
                search.failures,
                plural(search.simulations, "simulation"),
                plural(search.modes, "mode")
            )
        })
    };
    rows.push(row("failures that the searches find", search(0), search(1)));
    if let Some(archive) = &found.archive {
        let fixed = format!("{} of {} fixed", archive.fixed, plural(archive.failures, "failure"));
        rows.push(row("failures that training saw", "–".to_string(), fixed));
    }
    table("Other measures", &["measure", "before", "after"], &rows)
}

/// Returns the table of the failure modes, the new ones first.
fn modes(found: &Hardening) -> String {
    if found.after.is_none() {
        return "<p>No round was accepted, so there are no modes to compare. The section about the controller before says \
                what fails.</p>\n"
            .to_string();
    }
    if found.modes.is_empty() {
        return "<p>The final searches found no failure of either controller.</p>\n".to_string();
    }
    let rows: Vec<Vec<String>> = ordered(&found.modes)
        .into_iter()
        .map(|mode| {
            vec![
                mode.change.name().to_string(),
                format!("<code>{}</code>", text(&short(&mode.predicate, 120))),
                match mode.axes.as_slice() {
                    [] => "not known".to_string(),
                    axes => text(&axes.join(", ")),
                },
                mode.before.to_string(),
                mode.after.to_string(),
            ]
        })
        .collect();
    let count = |change: ModeChange| found.modes.iter().filter(|mode| mode.change == change).count();
    let head = ["change", "decisive predicate", "axes that matter", "failures before", "failures after"];
    format!(
        "<p>{} appeared, {} stayed, {} vanished.</p>\n{}<p class=\"notes\">Both controllers were searched with the same \
         budget. A mode that vanished can still exist: these searches did not find it. Axes are not known where a search \
         chose the scenarios: only random ones tell which axes matter.</p>\n",
        plural(count(ModeChange::Appeared) as u64, "mode"),
        count(ModeChange::Stayed),
        count(ModeChange::Vanished),
        table("Failure modes of the final searches", &head, &rows)
    )
}

fn rounds(found: &Hardening) -> String {
    let bound = |bound: Option<f64>| bound.map_or("–".to_string(), percent);
    // A trainer of the user does not say its steps.
    let steps = |steps: u64| if found.trainer.is_some() { "–".to_string() } else { steps.to_string() };
    let rows: Vec<Vec<String>> = found
        .rounds
        .iter()
        .map(|round| {
            vec![
                round.number.to_string(),
                if round.accepted { "accepted" } else { "rejected" }.to_string(),
                round.failures.to_string(),
                steps(round.environment_steps),
                bound(round.bound_before),
                bound(round.bound_after),
                text(&round.reason),
            ]
        })
        .collect();
    let head =
        ["round", "decision", "failures found", "environment steps", "bound before", "bound after", "reason"];
    table("Rounds, by the validation set", &head, &rows)
        + "<p class=\"notes\">The bound is the upper end of the 95 % interval of the failure rate in the space, on the \
           validation set.</p>\n"
}

fn cost(found: &Hardening) -> String {
    let steps = match found.trainer {
        Some(_) => "Training by the trainer".to_string(),
        None => format!("{} of training", plural(found.environment_steps, "environment step")),
    };
    format!(
        "{steps} and {}. Every simulation is a row in a run file of the folder <code>{}</code>. Seed {}, program {}.",
        plural(found.simulations, "simulation"),
        text(words::file_name(&found.folder)),
        found.seed.0,
        text(&found.commit)
    )
}
