//! The answer of a failure probability: estimate, interval, assumption, and the parts of the
//! estimation.

use mishandle::results::{AxisDistribution, Estimate, Probability, Risk, Screening};
use mishandle::rollout::AxisValues;
use mishandle_text::{plural, probability_text as probability};

use crate::html::{short, table, text};
use crate::load::RunReport;
use crate::space::value_text;
use crate::words;

/// Largest number of rows in the table of distributions.
const MAX_AXES: usize = 24;

/// Largest number of characters of a distribution: the rates of several faults are long.
const MAX_DISTRIBUTION: usize = 240;

/// Returns the verdict: one sentence of HTML.
pub fn headline(report: &RunReport, found: &Risk) -> String {
    let subject = words::subject(report);
    match found.without_assumption().value {
        Some(value) => format!("{subject} violates its requirement with probability {}.", probability(value)),
        None => format!(
            "{subject} violates its requirement with a probability of at most {}.",
            probability(found.bounds[1])
        ),
    }
}

/// Returns what the verdict means, as sentences of HTML.
pub fn meaning(found: &Risk) -> Vec<String> {
    let mut sentences = Vec::new();
    if !found.is_complete {
        sentences.push(
            "<strong>The run is not finished</strong>: the answer is that of the finished parts.".to_string(),
        );
    }
    let [low, high] = found.bounds.map(probability);
    match &found.probability {
        Some(Probability { low: Some(from), high: Some(to), assumption, source, .. }) => {
            let interval =
                format!("interval is {} to {} ({})", probability(*from), probability(*to), part(source));
            sentences.push(match assumption {
                None => format!("The 95 % {interval}. It assumes nothing."),
                Some(assumption) => format!(
                    "With 95 % confidence, the probability is from {low} to {high}, which assumes nothing. <strong>If {}</strong>, \
                     the {interval}.",
                    text(assumption)
                ),
            });
        }
        _ => sentences.push(format!(
            "There is no estimate. With 95 % confidence, the probability is from {low} to {high}, which assumes nothing."
        )),
    }
    let seeds = if found.seed_is_random { " and a random seed" } else { "" };
    sentences.push(format!(
        "It is the probability under the distribution below: a simulation is a random scenario{seeds}. Another distribution has \
         another probability."
    ));
    sentences.extend(found.refusals.iter().map(|refusal| format!("No estimate: {}.", text(refusal))));
    let invalid = found.monte_carlo.invalid_starts;
    if invalid > 0 {
        sentences.push(format!(
            "{} left out, because the target cannot start from the scenario: it is the probability among all others.",
            plural(invalid, "simulation")
        ));
    }
    sentences
}

/// Returns the name of a part of the estimation.
fn part(source: &str) -> &str {
    match source {
        "monte-carlo" => "Monte Carlo",
        "importance" => "importance sampling",
        "splitting" => "multilevel splitting",
        other => other,
    }
}

/// Returns the key numbers.
pub fn tiles(found: &Risk) -> Vec<(String, String)> {
    let value = found.without_assumption().value;
    let [low, high] = found.bounds.map(probability);
    vec![
        (value.map_or("–".to_string(), probability), "probability of a violation".into()),
        (format!("{low} to {high}"), "95 % interval".into()),
        (found.monte_carlo.failures.to_string(), "failures of Monte Carlo".into()),
        (found.simulations.to_string(), "simulations".into()),
    ]
}

/// Returns the parts of the estimation and the distribution as HTML.
pub fn section(report: &RunReport, found: &Risk, id: usize) -> String {
    let screening = found.screening.as_ref().map_or(String::new(), screening_text);
    format!(
        "<h3 id=\"r{id}-search\">How it was estimated</h3>\n{screening}{}<h3>Distribution</h3>\n{}",
        parts(found),
        distribution(report, found)
    )
}

fn parts(found: &Risk) -> String {
    let row = |name: &str, simulations: u64, estimate: Option<Estimate>, note: String| {
        let value = estimate.and_then(|estimate| estimate.value).map_or("–".to_string(), probability);
        let ends = estimate.and_then(|estimate| estimate.low.zip(estimate.high));
        let interval = ends.map_or("–".to_string(), |(low, high)| {
            format!("{} to {}", probability(low), probability(high))
        });
        vec![name.to_string(), simulations.to_string(), value, interval, note]
    };
    let monte_carlo = &found.monte_carlo;
    let failures = |n: u64| plural(n, "failure");
    let mut rows = vec![row(
        "Monte Carlo",
        monte_carlo.simulations,
        Some(monte_carlo.failure_rate),
        monte_carlo.counts_text(),
    )];
    if found.exploration.simulations > 0 {
        rows.push(row("search for failures", found.exploration.simulations, None, String::new()));
    }
    if let Some(splitting) = &found.splitting {
        let estimate = splitting.estimate.filter(|_| found.splitting_refusal.is_none());
        let estimate = estimate.map(|estimate| found.part(estimate));
        let chains = plural(splitting.chains.len() as u64, "chain");
        rows.push(row("multilevel splitting", splitting.simulations, estimate, chains));
    }
    if let Some(importance) = &found.importance {
        rows.push(row("fit of regions", importance.fitting_simulations, None, String::new()));
        let note = format!(
            "{} in {}; {} of Monte Carlo outside",
            failures(importance.failures),
            plural(importance.components, "region"),
            failures(importance.monte_carlo_outside)
        );
        // The regions have a probability among all scenarios.
        let estimate = Some(found.part(importance.regions)).filter(|_| monte_carlo.invalid_starts == 0);
        rows.push(row("importance sampling", importance.simulations, estimate, note));
    }
    table("Parts of the estimation", &["part", "simulations", "probability", "95 % interval", "found"], &rows)
}

fn screening_text(counts: &Screening) -> String {
    format!(
        "<p>{} were screened by another engine: {} were flagged. MuJoCo C repeated these and an audit sample of {} of the rest; only \
         its verdicts count.</p>\n",
        plural(counts.simulations, "simulation"),
        counts.flagged,
        counts.audit_sample
    )
}

fn distribution(report: &RunReport, found: &Risk) -> String {
    let varying: Vec<&AxisDistribution> =
        found.distribution.iter().filter(|axis| axis.distribution != "fixed").collect();
    let row = |axis: &&AxisDistribution| {
        let known = report.axes.iter().find(|known| known.name == axis.axis);
        let value = |value: f64| match known {
            Some(axis) => value_text(axis, Some(value)),
            None => value.to_string(),
        };
        let range = match known.map(|axis| &axis.values) {
            Some(AxisValues::Categorical(names)) => names.join(", "),
            _ => format!("{} to {}", value(axis.low), value(axis.high)),
        };
        [short(&axis.axis, 40), short(&axis.distribution, MAX_DISTRIBUTION), range]
            .iter()
            .map(|cell| text(cell))
            .collect()
    };
    let rows: Vec<Vec<String>> = varying.iter().take(MAX_AXES).map(row).collect();
    let more = if varying.len() > MAX_AXES {
        format!("<p class=\"notes\">{MAX_AXES} of {} axes are shown.</p>\n", varying.len())
    } else {
        String::new()
    };
    table("Axes that are drawn at random", &["axis", "distribution", "range"], &rows) + &more
}
