//! How two runs differ, as text.

use mishandle::results::{ChangedVerdict, DifferingRun, Estimate, Number, Quantity, RunDifference};
use mishandle_text::{decimal, plural, probability_text, without_middle};

use super::{escape, output};

/// Largest number of changed verdicts in the text. The JSON document lists up to 100.
const MAX_LISTED: usize = 10;

/// Largest number of characters of a fact.
const MAX_FACT: usize = 60;

/// Returns the facts and results of both runs, and the simulations that changed.
pub fn text(found: &RunDifference) -> String {
    let name = |run: &DifferingRun| format!("{} ({})", escape::name(&run.run), run.facts.kind);
    let mut parts =
        vec![format!("A: {}\nB: {}\n{}", name(&found.first), name(&found.second), verdict(found))];
    if !found.facts.is_empty() {
        let mut rows = vec![["", "A", "B"].map(String::from).to_vec()];
        let cell = |fact: &Option<String>| fact.as_deref().map_or("-".to_string(), short);
        let facts = found.facts.iter();
        rows.extend(facts.map(|fact| vec![escape::name(&fact.name), cell(&fact.first), cell(&fact.second)]));
        parts.push(output::table(&rows));
    }
    parts.push(output::table(&results(found)));
    parts.extend(found.notes.iter().map(|note| format!("note: {}", escape::name(note))));
    parts.push(simulations(found));
    if !found.simulations.changes.is_empty() {
        parts.push(changes(found));
    }
    parts.join("\n\n")
}

fn verdict(found: &RunDifference) -> String {
    match (found.same_records, found.facts.is_empty()) {
        (true, true) => format!("same to the bit: digest {}", found.first.digest),
        (true, false) => format!(
            "all trials, simulations and traces are the same to the bit: digest {}; the files differ in what is below",
            found.first.digest
        ),
        (false, _) => {
            format!("different: digest {} of A, {} of B", found.first.digest, found.second.digest)
        }
    }
}

/// Returns a fact in one line. Of a long one, the start and the end, because paths end differently.
fn short(fact: &str) -> String {
    without_middle(&escape::name(fact), MAX_FACT)
}

fn results(found: &RunDifference) -> Vec<Vec<String>> {
    let mut rows = vec![["", "A", "B"].map(String::from).to_vec()];
    let a = &found.first.facts;
    let b = &found.second.facts;
    let mut count =
        |name: &str, a: u64, b: u64| rows.push(vec![name.to_string(), a.to_string(), b.to_string()]);
    count("trials", a.trials, b.trials);
    count("simulations", a.simulations, b.simulations);
    count("failing simulations", a.failures, b.failures);
    let robustness = |value: Option<Number>| value.map_or("-".to_string(), |rho| decimal(rho.0, 4));
    rows.push(vec![
        "lowest robustness".to_string(),
        robustness(a.minimum_robustness),
        robustness(b.minimum_robustness),
    ]);
    let complete = |is_complete: bool| if is_complete { "yes" } else { "no" }.to_string();
    rows.push(vec!["finished".to_string(), complete(a.is_complete), complete(b.is_complete)]);
    for result in &found.results {
        let cell =
            |found: Option<Estimate>| found.map_or("-".to_string(), |found| estimate(found, result.quantity));
        rows.push(vec![escape::name(&result.name), cell(result.first), cell(result.second)]);
    }
    rows
}

fn estimate(found: Estimate, quantity: Quantity) -> String {
    let show = |value: f64| match quantity {
        Quantity::Share if value > 0.0 && value < 1e-4 => probability_text(value),
        Quantity::Share => format!("{:.2} %", 100.0 * value),
        Quantity::Difference => format!("{:+.2} points", 100.0 * value),
        Quantity::Number => decimal(value, 4),
    };
    let Some(value) = found.value else { return "-".to_string() };
    match (found.low, found.high) {
        (Some(low), Some(high)) => format!("{} [{}, {}]", show(value), show(low), show(high)),
        _ => show(value),
    }
}

fn simulations(found: &RunDifference) -> String {
    let counts = &found.simulations;
    let shared = plural(counts.shared, "simulation");
    let mut lines = vec![match counts.shared {
        0 => "No simulation has the same scenario and seed in both.".to_string(),
        _ => format!(
            "{shared} with the same scenario and seed in both: {} the same to the bit, {} with another verdict, {} with \
             other values",
            counts.same,
            counts.changed,
            counts.shared - counts.same - counts.changed,
        ),
    }];
    if counts.other_scenarios > 0 {
        lines.push(format!("{} with other scenarios or seeds", plural(counts.other_scenarios, "simulation")));
    }
    for (name, only) in [("A", counts.first_only), ("B", counts.second_only)] {
        if only > 0 {
            lines.push(format!("{} only in {name}", plural(only, "simulation")));
        }
    }
    lines.join("\n")
}

fn changes(found: &RunDifference) -> String {
    let counts = &found.simulations;
    let shown = counts.changes.len().min(MAX_LISTED);
    let mut rows = vec![["trial", "simulation", "A", "B", "seed"].map(String::from).to_vec()];
    let cell = |verdict: &str, robustness: Option<Number>| match robustness {
        Some(rho) => format!("{verdict} ({})", decimal(rho.0, 4)),
        None => verdict.to_string(),
    };
    let row = |change: &ChangedVerdict| {
        vec![
            change.trial.to_string(),
            change.simulation.to_string(),
            cell(&change.first, change.first_robustness),
            cell(&change.second, change.second_robustness),
            change.seed.0.to_string(),
        ]
    };
    rows.extend(counts.changes.iter().take(shown).map(row));
    let title = if counts.changed > shown as u64 {
        format!("Verdicts that changed, the first {shown} of {}:", counts.changed)
    } else {
        "Verdicts that changed:".to_string()
    };
    format!("{title}\n{}", output::table(&rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The difference of the rates 90.5 % and 95 % is 4.5 points, not 4.5 %.
    #[test]
    fn a_difference_of_two_shares_is_in_points() {
        let estimate =
            |value: f64, quantity| estimate(Estimate { value: Some(value), ..Estimate::default() }, quantity);
        assert_eq!(estimate(0.905 - 0.95, Quantity::Difference), "-4.50 points");
        assert_eq!(estimate(0.905, Quantity::Share), "90.50 %");
    }
}
