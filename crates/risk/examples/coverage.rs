//! Measures how often the intervals contain the known failure probabilities: the table of
//! studies/notebook/2026-11-23-risk.md.
//!
//! ```sh
//! cargo run --release -p mishandle-risk --example coverage -- [replications [simulations [method]]]
//! ```

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example prints, and may panic")]

#[path = "../tests/systems/mod.rs"]
mod systems;

use std::ops::ControlFlow;

use mishandle_random::Seed;
use mishandle_risk::{Method, Report, Settings, Source, risk};
use systems::{Known, systems};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, default| arguments.get(index).map_or(default, |text| text.parse().unwrap());
    let replications = number(0, 200);
    let simulations = number(1, 20_000);
    let method = arguments.get(2).map_or(Method::Auto, |name| name.parse().unwrap());
    println!(
        "{replications} replications of {simulations} simulations, method {}\n\n\
         | system | estimates | bias | error | 95 % covers | bounds cover | importance | regions cover | splitting | its bias | covers | refused: chains, MC, below, above |\n\
         |---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|",
        method.name()
    );
    for known in systems() {
        let mut reports = Vec::new();
        for seed in 1..=replications {
            let (mut system, scenarios) = known.system();
            let settings = Settings { simulations, method, seed: Seed(seed), batch: 64 };
            let report = risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(())).unwrap();
            assert_eq!(report.simulations, simulations);
            assert_eq!(system.simulations() as u64, simulations);
            reports.push(report);
        }
        row(&known, &reports);
    }
}

fn percent(count: usize, n: usize) -> String {
    if n == 0 { "-".to_string() } else { format!("{:.0} %", 100.0 * count as f64 / n as f64) }
}

fn row(known: &Known, reports: &[Report]) {
    let p = known.probability;
    let covers =
        |estimate: &mishandle_evaluation::Estimate| estimate.low <= Some(p) && estimate.high >= Some(p);
    let answers: Vec<_> = reports.iter().map(|report| &report.answer).collect();
    let stated: Vec<_> = answers.iter().filter(|answer| answer.source.is_some()).collect();
    let ratios: Vec<f64> = stated.iter().map(|answer| answer.estimate.value.unwrap() / p).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let error = mean(&ratios.iter().map(|ratio| (ratio - 1.0).powi(2)).collect::<Vec<_>>()).sqrt();
    let weighted: Vec<_> = reports.iter().filter_map(|report| report.importance.as_ref()).collect();
    let from = |source| stated.iter().filter(|answer| answer.source == Some(source)).count();
    let splits: Vec<_> = reports.iter().filter_map(|report| report.splitting.as_ref()).collect();
    let agreed: Vec<_> = splits.iter().filter_map(|splitting| splitting.estimate().ok()).collect();
    let kinds = |kind: &str| {
        let refused = answers.iter().filter_map(|answer| answer.splitting_refusal.as_ref());
        refused.filter(|refusal| format!("{refusal:?}").starts_with(kind)).count()
    };
    println!(
        "| {} | {} | {:+.0} % | {:.0} % | {} | {} | {} | {} | {} | {:+.0} % | {} | {}, {}, {}, {} |",
        known.name,
        percent(stated.len(), reports.len()),
        100.0 * (mean(&ratios) - 1.0),
        100.0 * error,
        percent(stated.iter().filter(|answer| covers(&answer.estimate)).count(), stated.len()),
        percent(
            answers.iter().filter(|answer| answer.bounds[0] <= p && p <= answer.bounds[1]).count(),
            reports.len()
        ),
        percent(from(Source::Importance), reports.len()),
        percent(weighted.iter().filter(|importance| covers(&importance.regions)).count(), weighted.len()),
        percent(from(Source::Splitting), reports.len()),
        100.0 * (mean(&agreed.iter().map(|estimate| estimate.value.unwrap() / p).collect::<Vec<_>>()) - 1.0),
        percent(agreed.iter().filter(|estimate| covers(estimate)).count(), agreed.len()),
        kinds("Chains"),
        kinds("MonteCarlo"),
        kinds("BelowImportance"),
        kinds("AboveImportance"),
    );
}
