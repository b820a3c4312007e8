//! Texts about a failure probability.

use mishandle::evaluation::Estimate;
use mishandle::risk::{
    Answer, Disagreement, FREQUENT, Failure, Importance, LARGEST_RATIO, Refusal, Report, Scenarios, Source,
    Splitting,
};
use mishandle::rollout::Axis;
use mishandle::{ResolvedPlan, decimal, plural};

use crate::{escape, output, run};

/// Largest number of axes with one distribution whose names are printed.
const NAMED: usize = 3;

/// Returns the answer, its parts and the failures.
pub fn text(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &Report) -> String {
    let mut text = format!(
        "{}\nformula {}\n{}\n\n{}\n\n{}",
        run::heading(resolved),
        escape::name(&resolved.specification.requirement.to_string()),
        distribution(scenarios),
        answer(report),
        output::table(&parts(report)),
    );
    for refusal in refusals(report) {
        text.push_str(&format!("\n\nno estimate: {refusal}"));
    }
    let undecided = report.monte_carlo.without_verdict;
    if undecided > 0 {
        text.push_str(&format!(
            "\n\n{} of Monte Carlo have no verdict and count as passed; if they fail, the probability is at most {} (97.5 %)",
            plural(undecided, "simulation"),
            probability(report.monte_carlo.bound_with_undecided().unwrap_or(1.0)),
        ));
    }
    if !report.failures.is_empty() {
        text.push_str("\n\nfailures, those nearest to the center of the distribution first:");
    }
    for failure in &report.failures {
        text.push_str(&format!("\n{}", failure_text(resolved, scenarios, failure)));
    }
    text
}

fn failure_text(resolved: &ResolvedPlan, scenarios: &Scenarios, failure: &Failure) -> String {
    let scenario = scenarios.scenario(&failure.draw.latent);
    format!(
        "  {}, seed {}: robustness {}",
        run::scenario_summary(resolved.space.axes(), scenario.values()),
        failure.draw.seed.0,
        decimal(failure.robustness, 4),
    )
}

/// Returns one line per distribution, with the axes that have it.
fn distribution(scenarios: &Scenarios) -> String {
    let mut groups: Vec<(String, Vec<&Axis>)> = Vec::new();
    for (axis, marginal) in scenarios.axes().filter(|(axis, _)| !axis.is_fixed()) {
        let unit = if axis.unit.is_empty() { String::new() } else { format!(" {}", axis.unit) };
        let text = format!("{marginal} from {} to {}{unit}", axis.low, axis.high);
        match groups.iter_mut().find(|(other, _)| *other == text) {
            Some((_, axes)) => axes.push(axis),
            None => groups.push((text, vec![axis])),
        }
    }
    let line = |(text, axes): &(String, Vec<&Axis>)| {
        let named: Vec<String> =
            axes.iter().take(NAMED).map(|axis| escape::name(&axis.name).to_string()).collect();
        let more = match axes.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        format!("distribution of {}{more}: {text}", named.join(", "))
    };
    let mut lines: Vec<String> = groups.iter().map(line).collect();
    if scenarios.depends_on_seed() {
        lines.push("the seed of each simulation is random, too".to_string());
    }
    lines.join("\n")
}

fn answer(report: &Report) -> String {
    let Answer { source, estimate, bounds: [low, high], .. } = &report.answer;
    let bounds = format!("from {} to {}", probability(*low), probability(*high));
    match source {
        None => format!(
            "probability of a violation: no estimate; {bounds} with 95 % confidence, which assumes nothing"
        ),
        Some(_) => {
            let value = format!(
                "probability of a violation: {}, 95 % interval {}",
                probability(estimate.value.unwrap_or(f64::NAN)),
                interval(estimate)
            );
            match assumption(report) {
                None => format!("{value}, which assumes nothing"),
                Some(assumption) => {
                    format!("{value}, if {assumption}\nwithout that assumption: {bounds} (95 %)")
                }
            }
        }
    }
}

/// Returns what the interval of the estimate assumes; `None` if nothing.
pub fn assumption(report: &Report) -> Option<&'static str> {
    match report.answer.source? {
        _ if !report.answer.has_assumption => None,
        Source::MonteCarlo => None,
        Source::Importance => Some("the failures outside of the regions found are negligible"),
        Source::Splitting => Some("the chains lost no failure mode"),
    }
}

/// Returns the name of the part that an estimate is from.
pub fn source(source: Source) -> &'static str {
    match source {
        Source::MonteCarlo => "monte-carlo",
        Source::Importance => "importance",
        Source::Splitting => "splitting",
    }
}

/// Returns the parts of the estimation as a table.
fn parts(report: &Report) -> Vec<Vec<String>> {
    let row = |name: &str, n: u64, estimate: Option<Estimate>, notes: String| {
        let value = estimate.and_then(|estimate| estimate.value).map_or("-".to_string(), probability);
        let interval = estimate.map_or("-".to_string(), |estimate| interval(&estimate));
        vec![name.to_string(), n.to_string(), value, interval, notes]
    };
    let monte_carlo = &report.monte_carlo;
    let failures = |n: u64| plural(n, "failure");
    let mut rows =
        vec![["part", "simulations", "probability", "95 % interval", ""].map(String::from).to_vec()];
    let note = match monte_carlo.failures >= FREQUENT {
        true => format!("{}; enough for an answer", failures(monte_carlo.failures)),
        false => failures(monte_carlo.failures),
    };
    rows.push(row("Monte Carlo", monte_carlo.simulations, Some(monte_carlo.estimate()), note));
    if report.exploration > 0 {
        rows.push(row("search for failures", report.exploration, None, String::new()));
    }
    if let Some(splitting) = &report.splitting {
        let estimate = splitting.estimate().ok().filter(|_| report.answer.splitting_refusal.is_none());
        rows.push(row("multilevel splitting", splitting.simulations, estimate, splitting_note(splitting)));
    }
    if let Some(importance) = &report.importance {
        let Importance { fitting, simulations, components, monte_carlo_outside, .. } = importance;
        let regions = plural(*components as u64, "region");
        rows.push(row("fit of regions", *fitting, None, String::new()));
        let note = format!(
            "failures in {regions}; Monte Carlo: {}, {monte_carlo_outside} outside",
            failures(monte_carlo.failures)
        );
        rows.push(row("importance sampling", *simulations, Some(importance.regions), note));
    }
    rows
}

fn splitting_note(splitting: &Splitting) -> String {
    let chains: Vec<String> = splitting
        .chains
        .iter()
        .map(|chain| match chain.is_complete || chain.probability == 0.0 {
            true => probability(chain.probability),
            false => "unfinished".to_string(),
        })
        .collect();
    let acceptance: f64 = splitting.chains.iter().map(|chain| chain.acceptance).sum();
    let mean = 100.0 * acceptance / splitting.chains.len().max(1) as f64;
    format!("chains: {}; {mean:.0} % of moves accepted", chains.join(", "))
}

/// Returns why parts have no estimate.
pub fn refusals(report: &Report) -> Vec<String> {
    let answer = &report.answer;
    let splitting = answer.splitting_refusal.as_ref().map(|refusal| match refusal {
        Refusal::Chains(Disagreement::Incomplete { complete }) => format!(
            "multilevel splitting: {} of {} chains reached a failure within the budget; a larger budget lets all of them",
            complete,
            chains(report)
        ),
        Refusal::Chains(Disagreement::Extinct { extinct }) => format!(
            "multilevel splitting: {extinct} of {} chains found no failure, because all their particles have the same robustness",
            chains(report)
        ),
        Refusal::Chains(Disagreement::Spread { ratio }) => format!(
            "multilevel splitting: the chains disagree by a factor of {ratio:.0}; more than {LARGEST_RATIO} is refused"
        ),
        Refusal::MonteCarlo => {
            "multilevel splitting: the exact interval of Monte Carlo (99 %) contradicts the chains".to_string()
        }
        Refusal::BelowImportance => {
            "multilevel splitting: the failures of importance sampling alone are more probable; the chains lost a failure mode"
                .to_string()
        }
        Refusal::AboveImportance => {
            "importance sampling and multilevel splitting: the chains agree on a larger probability than that of the regions, \
             so a failure mode was missed, or the chains are wrong"
                .to_string()
        }
    });
    let importance = report.importance.as_ref().filter(|importance| !importance.is_reliable()).map(|importance| {
        format!(
            "importance sampling: its failures are worth {:.0} equally weighted ones, and {} of the probability is \
             estimated outside of the regions",
            importance.effective_failures,
            probability(importance.outside)
        )
    });
    splitting.into_iter().chain(importance).collect()
}

fn chains(report: &Report) -> usize {
    report.splitting.as_ref().map_or(0, |splitting| splitting.chains.len())
}

fn interval(estimate: &Estimate) -> String {
    let end = |value: Option<f64>| value.map_or("-".to_string(), probability);
    format!("[{}, {}]", end(estimate.low), end(estimate.high))
}

/// Formats a probability with three digits.
fn probability(p: f64) -> String {
    match p {
        0.0 => "0".to_string(),
        0.001.. => decimal(p, 5),
        _ => format!("{p:.2e}"),
    }
}
