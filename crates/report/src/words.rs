//! The verdict in sentences.

use mishandle::results::{Answer, Evaluation, Falsification, Metrics, Requirement, WithoutVerdict};
use mishandle::run::without_verdict_text;

use crate::html::{number, percent, short, text};
use crate::load::RunReport;
use crate::{margin, metamorphic, risk, tables};

/// Names of tasks and controllers are cut to this length.
const NAME: usize = 60;

/// Says how a bound counts simulations without a verdict.
pub const UNDECIDED: &str = "; the upper bound counts those without a verdict as failures";

/// Returns what was tested, as HTML: `ball-balancing with controller ppo`.
pub fn subject(report: &RunReport) -> String {
    let name = |name: &str| text(&short(name, NAME));
    let controller = report.header.components.iter().find(|component| component.role == "controller");
    let target = name(&report.header.target.name);
    match controller {
        Some(controller) => {
            let guard = report.header.components.iter().find(|component| component.role.ends_with("guard"));
            let guard = guard.map_or(String::new(), |guard| format!(" and a {}", guard.role));
            format!("{target} with controller {}{guard}", name(file_name(&controller.name)))
        }
        None => target,
    }
}

/// Returns the last part of a path.
pub fn file_name(path: &str) -> &str {
    path.rsplit('/').next().filter(|name| !name.is_empty()).unwrap_or(path)
}

/// Returns the number of trials that found a violation.
pub fn falsified(found: &Falsification) -> usize {
    found.trials.iter().filter(|trial| trial.falsified).count()
}

/// Returns the lowest robustness.
pub fn worst(report: &RunReport) -> Option<f64> {
    report.trials.iter().filter_map(|trial| trial.worst).map(|(_, rho)| rho).reduce(f64::min)
}

/// Returns whether the run has named requirements, and its own formula is none of them.
fn is_of_target(report: &RunReport) -> bool {
    !report.requirements.is_empty() && named(report).is_none()
}

/// Returns the name of the formula of the run, if it is a named requirement.
fn named(report: &RunReport) -> Option<&str> {
    let is_it = |named: &&Requirement| named.formula == report.header.formula;
    report.requirements.iter().find(is_it).map(|named| named.name.as_str())
}

/// Says what the formula of the run is.
pub fn formula_label(report: &RunReport) -> String {
    match named(report) {
        Some(name) => format!("Requirement {name}"),
        None if is_of_target(report) => "Formula of the target".to_string(),
        None => "Requirement".to_string(),
    }
}

/// Returns the verdict: a sentence of HTML, and one about simulations without a verdict.
pub fn headline(report: &RunReport) -> String {
    let found = report.answer.as_ref().map(Answer::without_verdict);
    let mut out = verdict(report) + &found.map_or(String::new(), without_verdict);
    if let Some(reason) = report.answer.as_ref().and_then(Answer::formula_asks_nothing) {
        out += &format!(" They ask nothing: {}.", text(reason));
    }
    out
}

/// Returns the sentence about simulations without a verdict after a space; empty if all have one.
pub fn without_verdict(found: &WithoutVerdict) -> String {
    let Some(text) = without_verdict_text(found) else { return String::new() };
    let (first, rest) = text.split_at(1);
    format!(" {}{rest}.", first.to_uppercase())
}

fn verdict(report: &RunReport) -> String {
    match &report.answer {
        Some(Answer::Evaluation(found)) => evaluated(report, found),
        Some(Answer::Falsification(found)) => searched(report, found),
        Some(Answer::Margin(found)) => margin::headline(report, found),
        Some(Answer::Metamorphic(found)) => metamorphic::headline(report, found),
        Some(Answer::Risk(found)) => risk::headline(report, found),
        Some(Answer::Hardening(_)) | None => format!("{}: the answer is missing.", subject(report)),
    }
}

/// Names the formula of the run within a sentence.
fn formula_name(report: &RunReport) -> &'static str {
    if is_of_target(report) { "the formula of the target" } else { "its requirement" }
}

fn evaluated(report: &RunReport, found: &Evaluation) -> String {
    let subject = subject(report);
    let what = formula_name(report);
    let Metrics { violation_rate: rate, requirement_undecided, .. } = &found.metrics;
    let all = rate.n;
    let decided = all - requirement_undecided;
    match (found.metrics.violations, rate.value) {
        (_, None) => format!("No simulation of {subject} has a verdict."),
        (0, _) if *requirement_undecided > 0 => format!(
            "{} of {subject} {} a verdict; no violation among them.",
            of_all(decided, all),
            if decided == 1 { "has" } else { "have" }
        ),
        (0, _) => format!(
            "{subject} meets {what} in {}.",
            if decided == 1 {
                "the only random scenario".to_string()
            } else {
                format!("all {decided} random scenarios")
            }
        ),
        (failing, Some(value)) => {
            format!("{subject} violates {what} in {failing} of {all} random scenarios ({}).", percent(value))
        }
    }
}

fn searched(report: &RunReport, found: &Falsification) -> String {
    let subject = subject(report);
    let trials = found.trials.len() as u64;
    match falsified(found) {
        _ if found.simulations == 0 => format!("No trial of {subject} has started."),
        0 if report.counts.undecided == report.counts.simulations => {
            format!("No simulation of {subject} has a verdict.")
        }
        0 => format!(
            "No violation of {subject} found in {} with {}.",
            mishandle_text::plural(trials, "trial"),
            mishandle_text::plural(found.simulations, "simulation")
        ),
        falsified => {
            let first = match found.median_simulations {
                Some(median) => format!(
                    " The first failure comes after a median of {}.",
                    mishandle_text::plural(u64::from(median), "simulation")
                ),
                None if found.is_complete => {
                    " More than half of the trials end without a failure.".to_string()
                }
                None => String::new(),
            };
            format!(
                "{subject} violates {} in {falsified} of {}.{first}",
                formula_name(report),
                mishandle_text::plural(trials, "trial")
            )
        }
    }
}

fn of_all(decided: u64, all: u64) -> String {
    format!("{decided} of {}", mishandle_text::plural(all, "random scenario"))
}

/// Returns how much of an unfinished run is done; `None` if it is finished.
pub fn progress(report: &RunReport) -> Option<String> {
    let plan = report.plan.as_ref()?;
    let done = match report.answer.as_ref().filter(|answer| !answer.is_complete())? {
        Answer::Evaluation(found) => {
            let planned = plan.evaluate.as_ref()?.episodes;
            format!("{} have been simulated", of_all(found.metrics.simulations, planned))
        }
        Answer::Falsification(found) => {
            let ended = found.trials.iter().filter(|trial| trial.end.is_some()).count();
            let planned = plan.falsify.as_ref()?.trials;
            format!("{ended} of {} have ended", mishandle_text::plural(planned, "trial"))
        }
        _ => return None,
    };
    Some(format!("<strong>The run is not finished</strong>: {done}."))
}

/// Returns how many random simulations of a falsification fail, of those that started.
fn random_failures(report: &RunReport, found: &Falsification) -> Option<String> {
    let started = found.without_verdict.ends.simulations;
    let failing = report.counts.falsified;
    if failing == started && started > 1 {
        return Some(format!("<strong>All {started} simulations fail.</strong>"));
    }
    let is_random = report.header.search == "random";
    is_random.then(|| format!("Of the {started} random simulations of this run, {failing} fail."))
}

/// Returns what the verdict means, as sentences of HTML.
pub fn meaning(report: &RunReport) -> Vec<String> {
    let mut sentences: Vec<String> = progress(report).into_iter().collect();
    let worst = worst(report);
    match &report.answer {
        Some(Answer::Margin(found)) => return margin::meaning(found),
        Some(Answer::Metamorphic(found)) => return metamorphic::meaning(found),
        Some(Answer::Risk(found)) => return risk::meaning(found),
        Some(Answer::Hardening(_)) | None => return Vec::new(),
        Some(Answer::Evaluation(found)) => {
            let Metrics { violation_rate: rate, requirement_undecided, .. } = &found.metrics;
            if let Some((low, high)) = rate.low.zip(rate.high) {
                sentences.push(format!(
                    "Scenarios were drawn at random. The true failure rate is between {} and {} ({}{}).",
                    percent(low),
                    percent(high),
                    tables::interval_head(report),
                    if *requirement_undecided > 0 { UNDECIDED } else { "" }
                ));
            }
        }
        Some(Answer::Falsification(found)) if falsified(found) > 0 => {
            sentences.extend(random_failures(report, found));
            sentences.push(
                format!(
                    "A trial is an independent search{}, so the share of falsified trials says how easily a search finds a failure, not how \
                     often the controller fails.",
                    if report.survey.is_some() { " that continues after its first failure" } else { " that ends at its first failure" }
                ),
            );
        }
        Some(Answer::Falsification(_)) => return sentences,
    }
    if let Some(worst) = worst {
        sentences.push(if worst < 0.0 { format!(
                "The worst violation has robustness {}. Robustness is the distance to the border between satisfied and \
                 violated; it is negative if the requirement is violated.",
                number(worst)
            ) } else { format!("The closest simulation has robustness {}; a violation would be below 0.", number(worst)) });
    }
    if !report.header.target.is_deterministic {
        sentences.push("The target is not deterministic: the same scenario can pass or fail.".to_string());
    }
    sentences
}
