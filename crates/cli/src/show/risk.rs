//! The failure probability, as text.

use mishandle::results::{
    AxisDistribution, AxisFacts, AxisValues, Estimate, Importance, Risk, RiskFailure, Splitting,
};
use mishandle::risk::FREQUENT;
use mishandle_text::{measured, number_text, plural, probability_text as probability};

use super::{escape, output, reasons, scenario, screening, simulation, subject};

/// Largest number of axes with one distribution whose names are printed.
const NAMED: usize = 3;

/// Returns what stands below the verdict: after a screening the disagreements of the two engines,
/// and reasons.
pub fn text(found: &Risk) -> String {
    let screening = found.screening.as_ref().map(|counts| {
        format!(
            "from simulations of MuJoCo C: it assumes nothing of MuJoCo Warp\n\n{}{}",
            screening::engines(
                counts,
                &[("failure", "failures there")],
                ["violated or no verdict", "satisfied"]
            ),
            simulation::without_gpu_verdict(counts.without_verdict, counts.overflows)
        )
    });
    screening.unwrap_or_default() + &reasons::text(found.reasons.as_deref())
}

/// Returns the distribution, the parts of the estimation, and the failures.
pub fn details(found: &Risk) -> String {
    let mut parts = vec![format!(
        "{}\nformula {}\n{}",
        subject::heading(&found.subject),
        escape::name(&found.formula),
        distribution(found)
    )];
    if found.screening.is_none() {
        parts.push(output::table_in(&self::parts(found), output::width()));
    }
    if !found.failures.is_empty() {
        parts.push(failures_text(found));
    }
    parts.join("\n\n")
}

fn failures_text(found: &Risk) -> String {
    let failure = |RiskFailure { scenario, seed, robustness, .. }: &RiskFailure| {
        format!(
            "\n  {}, seed {}: robustness {}",
            scenario::summary(&found.subject.space_axes, scenario),
            seed.0,
            measured(robustness.0),
        )
    };
    format!(
        "failures, those nearest to the center of the distribution first:{}",
        found.failures.iter().map(failure).collect::<String>()
    )
}

/// Returns the values of an axis: the names of its categories, or its bounds.
fn range(found: &Risk, axis: &AxisDistribution) -> String {
    let known = found.subject.space_axes.iter().find(|known| known.name == axis.axis);
    if let Some(AxisFacts { values: AxisValues::Categories(names), .. }) = known {
        let names: Vec<String> = names.iter().map(|name| escape::label(name)).collect();
        return format!("over {}", names.join(", "));
    }
    let unit = if axis.unit.is_empty() { String::new() } else { format!(" {}", axis.unit) };
    format!("from {} to {}{unit}", number_text(axis.low), number_text(axis.high))
}

/// Returns one line per distribution, with the axes that have it.
fn distribution(found: &Risk) -> String {
    let mut groups: Vec<(String, Vec<&AxisDistribution>)> = Vec::new();
    for axis in found.distribution.iter().filter(|axis| axis.low != axis.high) {
        let text = format!("{} {}", axis.distribution, range(found, axis));
        match groups.iter_mut().find(|(other, _)| *other == text) {
            Some((_, axes)) => axes.push(axis),
            None => groups.push((text, vec![axis])),
        }
    }
    let line = |(text, axes): &(String, Vec<&AxisDistribution>)| {
        let named: Vec<String> = axes.iter().take(NAMED).map(|axis| escape::label(&axis.axis)).collect();
        let more = match axes.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        format!("distribution of {}{more}: {text}", named.join(", "))
    };
    let mut lines: Vec<String> = groups.iter().map(line).collect();
    if found.seed_is_random {
        lines.push("the seed of each simulation is random, too".to_string());
    }
    lines.join("\n")
}

/// Returns the parts of the estimation as a table.
fn parts(found: &Risk) -> Vec<Vec<String>> {
    let row = |name: &str, n: u64, estimate: Option<Estimate>, notes: String| {
        let value = estimate.and_then(|estimate| estimate.value).map_or("-".to_string(), probability);
        let interval = estimate.map_or("-".to_string(), |Estimate { low, high, .. }| interval(low, high));
        vec![name.to_string(), n.to_string(), value, interval, notes]
    };
    let monte_carlo = &found.monte_carlo;
    let failures = |n: u64| plural(n, "failure");
    let mut rows =
        vec![["part", "simulations", "probability", "95 % interval", ""].map(String::from).to_vec()];
    let enough = if monte_carlo.failures >= FREQUENT { "; enough for an answer" } else { "" };
    let note = format!("{}{enough}", monte_carlo.counts_text());
    rows.push(row("Monte Carlo", monte_carlo.simulations, Some(monte_carlo.failure_rate), note));
    if found.exploration.simulations > 0 {
        rows.push(row("search for failures", found.exploration.simulations, None, String::new()));
    }
    if let Some(splitting) = &found.splitting {
        let estimate = splitting.estimate.filter(|_| found.splitting_refusal.is_none());
        let estimate = estimate.map(|estimate| found.part(estimate));
        rows.push(row("multilevel splitting", splitting.simulations, estimate, splitting_note(splitting)));
    }
    if let Some(importance) = &found.importance {
        let Importance { fitting_simulations, simulations, components, monte_carlo_outside, .. } = importance;
        let regions = plural(*components, "region");
        rows.push(row("fit of regions", *fitting_simulations, None, String::new()));
        let note = format!(
            "failures in {regions}; Monte Carlo: {}, {monte_carlo_outside} outside",
            failures(monte_carlo.failures)
        );
        // The regions have a probability among all scenarios.
        let estimate = Some(found.part(importance.regions)).filter(|_| monte_carlo.invalid_starts == 0);
        rows.push(row("importance sampling", *simulations, estimate, note));
    }
    rows
}

fn splitting_note(splitting: &Splitting) -> String {
    let chains: Vec<String> = splitting
        .chains
        .iter()
        .map(|chain| {
            if chain.is_complete || chain.probability == 0.0 {
                probability(chain.probability)
            } else {
                "unfinished".to_string()
            }
        })
        .collect();
    let acceptance: f64 = splitting.chains.iter().map(|chain| chain.acceptance).sum();
    let mean = 100.0 * acceptance / splitting.chains.len().max(1) as f64;
    format!("chains: {}; {mean:.0} % of moves accepted", chains.join(", "))
}

fn interval(low: Option<f64>, high: Option<f64>) -> String {
    let ends = low.zip(high);
    ends.map_or("-".to_string(), |(low, high)| format!("[{}, {}]", probability(low), probability(high)))
}
