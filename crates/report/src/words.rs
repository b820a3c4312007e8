//! The verdict in sentences.

use mishandle::evaluation::{SurvivalCurve, anytime_rate, wilson};
use mishandle::results::{Answer, Requirement};
use mishandle::store::TrialStatus;

use crate::html::{number, percent, short, text};
use crate::load::{RunReport, Trial};
use crate::{margin, metamorphic, risk, tables};

/// Names of tasks and controllers are cut to this length.
const NAME: usize = 60;

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

/// Returns the numbers of failing and of decided random simulations of an evaluation.
pub fn evaluated(report: &RunReport) -> (u64, u64) {
    let first = report.trials.first();
    first.map_or((0, 0), |trial| {
        let counts = trial.summary.counts;
        (counts.falsified, counts.simulations - counts.undecided)
    })
}

/// Returns the interval of the failure rate of an evaluation. If its results decided how many
/// simulations there are, it holds at any time.
pub fn failure_interval(report: &RunReport, failing: u64, decided: u64) -> Option<[f64; 2]> {
    if !report.stops_by_itself {
        let rate = wilson(failing, decided);
        return Some([rate.low?, rate.high?]);
    }
    let sequential = report.evaluation.as_ref().and_then(|found| found.sequential.as_ref());
    let success = match sequential {
        // What the rule found, which its earlier looks can narrow.
        Some(found) if found.interval.n == decided => found.interval,
        _ => anytime_rate(decided - failing, decided),
    };
    Some([1.0 - success.high?, 1.0 - success.low?])
}

/// Returns the numbers of falsified and of all trials.
pub fn falsified(report: &RunReport) -> (usize, usize) {
    let falsified = report.searches().filter(|trial| trial.first_failure.is_some()).count();
    (falsified, report.searches().count())
}

/// Returns the lowest robustness.
pub fn worst(report: &RunReport) -> Option<f64> {
    report.trials.iter().filter_map(|trial| trial.worst).map(|(_, rho)| rho).reduce(f64::min)
}

/// Returns the median number of simulations to the first failure.
pub fn median(report: &RunReport) -> Option<u32> {
    SurvivalCurve::new(&report.lifetimes()).median()
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

/// Returns the verdict: one or two sentences of HTML.
pub fn headline(report: &RunReport) -> String {
    match &report.answer {
        Some(Answer::Margin(found)) => return margin::headline(report, found),
        Some(Answer::Metamorphic(found)) => return metamorphic::headline(report, found),
        Some(Answer::Risk(found)) => return risk::headline(report, found),
        _ if report.has_answer() => return format!("{}: the answer is missing.", subject(report)),
        _ => {}
    }
    let subject = subject(report);
    let what = if is_of_target(report) { "the formula of the target" } else { "its requirement" };
    if report.is_evaluation() {
        let (failing, decided) = evaluated(report);
        let rate = wilson(failing, decided);
        let all = report.trials.first().map_or(0, |trial| trial.summary.counts.simulations);
        return match (failing, rate.value) {
            (_, None) => format!("No simulation of {subject} has a verdict."),
            (0, _) if decided < all => format!(
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
            (_, Some(value)) => format!(
                "{subject} violates {what} in {failing} of {decided} random scenarios ({}).",
                percent(value)
            ),
        };
    }
    let (found, trials) = falsified(report);
    match (found, trials) {
        (_, 0) => format!("No trial of {subject} has started."),
        (0, _) if report.counts.undecided == report.counts.simulations => {
            format!("No simulation of {subject} has a verdict.")
        }
        (0, _) => format!(
            "No violation of {subject} found in {} with {}.",
            mishandle_text::plural(trials as u64, "trial"),
            mishandle_text::plural(report.counts.simulations, "simulation")
        ),
        _ => {
            let first = match median(report) {
                Some(median) => format!(
                    "The first failure comes after a median of {}.",
                    mishandle_text::plural(u64::from(median), "simulation")
                ),
                None => "More than half of the trials end without a failure.".to_string(),
            };
            format!(
                "{subject} violates {what} in {found} of {}. {first}",
                mishandle_text::plural(trials as u64, "trial")
            )
        }
    }
}

fn of_all(decided: u64, all: u64) -> String {
    format!("{decided} of {}", mishandle_text::plural(all, "random scenario"))
}

/// Returns how much of an unfinished run is done; `None` if it is finished.
fn progress(report: &RunReport) -> Option<String> {
    let ended = |trial: &&Trial| trial.summary.trial.status != TrialStatus::Running;
    let ended = report.trials.iter().filter(ended).count();
    let plan = report.plan.as_ref()?;
    if report.is_evaluation() {
        let planned = plan.evaluate.as_ref()?.episodes;
        let done = report.trials.first().map_or(0, |trial| trial.summary.counts.simulations);
        // A rule may end it before, and then only the status of the trials says that it did.
        let has_fewer = done < planned && !(report.stops_by_itself && done > 0);
        return (has_fewer || ended < report.trials.len()).then(|| {
            format!(
                "<strong>The run is not finished</strong>: {} have been simulated.",
                of_all(done, planned)
            )
        });
    }
    let planned = plan.falsify.as_ref()?.trials as usize;
    (ended < planned).then(|| {
        format!(
            "<strong>The run is not finished</strong>: {ended} of {} have ended.",
            mishandle_text::plural(planned as u64, "trial")
        )
    })
}

/// Returns how often the random simulations of a falsification fail.
fn random_rate(report: &RunReport) -> Option<String> {
    let decided = report.counts.simulations - report.counts.undecided;
    let failing = report.counts.falsified;
    if failing == decided && decided > 1 {
        return Some(format!("<strong>All {decided} simulations fail.</strong>"));
    }
    let rate = wilson(failing, decided);
    let (Some(value), Some(low), Some(high)) = (rate.value, rate.low, rate.high) else {
        return None;
    };
    (report.header.search == "random").then(|| {
        format!(
            "Of the {decided} random simulations of this run, {failing} fail: <strong>{}</strong> ({} to {}, 95 % interval).",
            percent(value),
            percent(low),
            percent(high)
        )
    })
}

/// Returns what the verdict means, as sentences of HTML.
pub fn meaning(report: &RunReport) -> Vec<String> {
    match &report.answer {
        Some(Answer::Margin(found)) => return margin::meaning(found),
        Some(Answer::Metamorphic(found)) => return metamorphic::meaning(found),
        Some(Answer::Risk(found)) => return risk::meaning(found),
        _ if report.has_answer() => return Vec::new(),
        _ => {}
    }
    let mut sentences: Vec<String> = progress(report).into_iter().collect();
    let worst = worst(report);
    let (found, trials) = falsified(report);
    if report.is_evaluation() {
        let (failing, decided) = evaluated(report);
        if let Some([low, high]) = failure_interval(report, failing, decided) {
            sentences.push(format!(
                "Scenarios were drawn at random. The true failure rate is between {} and {} ({}).",
                percent(low),
                percent(high),
                tables::interval_head(report)
            ));
        }
    } else if found > 0 {
        sentences.extend(random_rate(report));
        sentences.push(
            format!(
                "A trial is an independent search{}, so the share of falsified trials says how easily a search finds a failure, not how \
                 often the controller fails.",
                if report.survey.is_some() { " that continues after its first failure" } else { " that ends at its first failure" }
            ),
        );
    } else if trials > 0 {
        let n = report.counts.simulations - report.counts.undecided;
        sentences.push(match report.header.search.as_str() {
            "random" if n > 0 => format!(
                "This is no proof. Of the scenarios of this space, at most {} fail (95 % confidence, from {n} random simulations).",
                percent(1.0 - 0.05_f64.powf(1.0 / n as f64))
            ),
            _ => "This is no proof: a search can miss failures.".to_string(),
        });
    }
    if let Some(worst) = worst {
        sentences.push(if worst < 0.0 { format!(
                "The worst violation has robustness {}. Robustness is the distance to the border between satisfied and \
                 violated; it is negative if the requirement is violated.",
                number(worst)
            ) } else { format!("The closest simulation has robustness {}; a violation would be below 0.", number(worst)) });
    }
    let repeats: Vec<_> =
        report.measured.iter().flat_map(|measured| measured.repeats.iter().flatten()).collect();
    if let Some(least) = repeats.iter().filter_map(|repeat| repeat.failure_rate.value).reduce(f64::min) {
        let most = repeats.iter().filter_map(|repeat| repeat.failure_rate.value).fold(least, f64::max);
        let share = if percent(least) == percent(most) {
            percent(least)
        } else {
            format!("{} to {}", percent(least), percent(most))
        };
        sentences.push(format!(
            "The target is random: with other seeds, the failing scenarios shown below fail in {share} of repeats."
        ));
    } else if !report.header.target.is_deterministic {
        sentences.push("The target is not deterministic: the same scenario can pass or fail.".to_string());
    }
    let undecided = report.counts.undecided;
    if undecided > 0 {
        sentences.push(format!(
            "{} without a verdict (diverged, crashed or undecided) {} not counted as failures.",
            mishandle_text::plural(undecided, "simulation"),
            if undecided == 1 { "is" } else { "are" }
        ));
    }
    sentences
}
