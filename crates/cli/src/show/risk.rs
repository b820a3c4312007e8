//! Texts about a failure probability.

use mishandle::evaluation::Estimate;
use mishandle::risk::{
    Answer, FREQUENT, Failure, Importance, Method, Refusal, Report, Scenarios, ScreenedReport, Splitting,
};
use mishandle::rollout::Axis;
use mishandle::{ResolvedPlan, decimal, plural, probability_text as probability};

use super::{escape, output, scenario, simulation, subject};

/// Largest number of axes with one distribution whose names are printed.
const NAMED: usize = 3;

/// Returns the answer, its parts and the failures.
pub fn text(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &Report) -> String {
    let refusals: String = mishandle::risk_refusals(report)
        .iter()
        .map(|refusal| format!("no estimate: {refusal}\n\n"))
        .collect();
    // The chosen method was not run: the answer is that of another one.
    let is_leading = resolved.plan.risk.as_ref().is_some_and(|risk| risk.method == Method::Splitting.name())
        && matches!(report.answer.splitting_refusal, Some(Refusal::Budget { .. }));
    let (before, after) = if is_leading { (refusals.as_str(), "") } else { ("", refusals.as_str()) };
    let mut text = format!(
        "{}\nformula {}\n{}\n\n{}{before}{}\n\n{}\n\n{after}",
        subject::heading(resolved),
        escape::name(&resolved.specification.requirement.to_string()),
        distribution(scenarios),
        if report.is_complete { "" } else { "interrupted: the answer is that of the simulations so far\n\n" },
        answer(report),
        output::table(&parts(report)),
    );
    text.truncate(text.trim_end().len());
    let undecided = report.monte_carlo.without_verdict;
    if undecided > 0 {
        text.push_str(&format!(
            "\n\n{} of Monte Carlo have no verdict and count as passed; if they fail, the probability is at most {} (97.5 %)",
            plural(undecided, "simulation"),
            probability(report.monte_carlo.bound_with_undecided().unwrap_or(1.0)),
        ));
    }
    text.push_str(&failures_text(resolved, scenarios, &report.failures));
    text
}

/// Returns the answer of a screened estimation, the disagreements of the two engines, and the failures.
pub fn screened_text(resolved: &ResolvedPlan, scenarios: &Scenarios, report: &ScreenedReport) -> String {
    let (counts, estimate) = (report.counts, report.estimate());
    let bound = |bound: Option<f64>| bound.map_or("-".to_string(), probability);
    let repeated = |name: &str, screened: u64, repeated: u64, failures: u64| {
        [name.to_string(), screened.to_string(), repeated.to_string(), failures.to_string()].to_vec()
    };
    let rows = [
        ["screening by MuJoCo Warp", "simulations", "repeated by MuJoCo C", "confirmed failures"]
            .map(String::from)
            .to_vec(),
        repeated("flagged (violated or no verdict)", counts.flagged, counts.flagged, counts.flagged_events),
        repeated(
            "not flagged (audit sample)",
            counts.trials - counts.flagged,
            counts.sampled,
            counts.sampled_events,
        ),
    ];
    let mut text = format!(
        "{}\nformula {}\n{}\n\n{}failure probability: {} [{}, {}] (95 %, from simulations of MuJoCo C; assumes nothing of \
         MuJoCo Warp)\n\n{}",
        subject::heading(resolved),
        escape::name(&resolved.specification.requirement.to_string()),
        distribution(scenarios),
        if report.is_complete { "" } else { "interrupted: the answer is that of the simulations so far\n\n" },
        bound(estimate.value),
        bound(estimate.low),
        bound(estimate.high),
        output::table(&rows),
    );
    text.push_str(&simulation::without_gpu_verdict(report.screened_without_verdict, report.overflows));
    if report.without_verdict > 0 {
        let undecided = plural(report.without_verdict, "simulation");
        text.push_str(&format!("\n\n{undecided} of MuJoCo C without a verdict count as passed"));
    }
    text.push_str(&failures_text(resolved, scenarios, &report.failures));
    text
}

fn failures_text(resolved: &ResolvedPlan, scenarios: &Scenarios, failures: &[Failure]) -> String {
    if failures.is_empty() {
        return String::new();
    }
    let lines = failures.iter().map(|failure| format!("\n{}", failure_text(resolved, scenarios, failure)));
    format!(
        "\n\nfailures, those nearest to the center of the distribution first:{}",
        lines.collect::<String>()
    )
}

fn failure_text(resolved: &ResolvedPlan, scenarios: &Scenarios, failure: &Failure) -> String {
    let scenario = scenarios.scenario(&failure.draw.latent);
    format!(
        "  {}, seed {}: robustness {}",
        scenario::summary(resolved.space.axes(), scenario.values()),
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
            match mishandle::risk_assumption(report) {
                None => format!("{value}, which assumes nothing"),
                Some(assumption) => {
                    format!("{value}, if {assumption}\nwithout that assumption: {bounds} (95 %)")
                }
            }
        }
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

fn interval(estimate: &Estimate) -> String {
    let end = |value: Option<f64>| value.map_or("-".to_string(), probability);
    format!("[{}, {}]", end(estimate.low), end(estimate.high))
}
