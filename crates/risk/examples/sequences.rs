//! Measures how often the intervals of the method `sequence` contain known failure probabilities:
//! the table of studies/notebook/2026-11-27-risk-of-sequences.md.
//!
//! ```sh
//! cargo run -p mishandle-risk --example sequences -- \
//!     [method [simulations [first seed [replications [part of the name]]]]]
//! ```

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::unwrap_used,
    reason = "an example prints, and may panic"
)]

#[path = "../tests/sequences/mod.rs"]
mod sequences;

use std::ops::ControlFlow;

use mishandle_evaluation::Estimate;
use mishandle_random::Seed;
use mishandle_risk::{Method, Report, Settings, Source, risk};
use sequences::{PROCESSES, Process};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, default| arguments.get(index).map_or(default, |text| text.parse().unwrap());
    let method = arguments.first().map_or(Method::Sequence, |name| name.parse().unwrap());
    let simulations = number(1, 20_000);
    let first = number(2, 1);
    let replications = number(3, 100);
    let part = arguments.get(4).map_or("", String::as_str);
    println!(
        "method {}, {simulations} simulations, seeds {first} to {}\n\n\
         | process | estimates | of importance | bias | error | interval covers | bounds cover | effective failures | components |\n\
         |---|--:|--:|--:|--:|--:|--:|--:|--:|",
        method.name(),
        first + replications - 1
    );
    for process in PROCESSES.iter().filter(|process| process.name.contains(part)) {
        let report = |seed| {
            let (mut system, scenarios) = process.system();
            let settings = Settings { simulations, method, seed: Seed(seed), batch: 256 };
            let report = risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(())).unwrap();
            assert_eq!(report.simulations, simulations);
            // A long measurement that is interrupted has its results so far.
            let Estimate { value, low, high, .. } = report.answer.estimate;
            let ratio = |value: Option<f64>| value.map_or(f64::NAN, |value| value / process.probability);
            let [value, low, high] = [value, low, high].map(ratio);
            eprintln!(
                "{}; seed {seed}; {:?}; {value:.4} [{low:.4}, {high:.4}]; bounds [{:.3e}, {:.3e}]",
                process.name, report.answer.source, report.answer.bounds[0], report.answer.bounds[1]
            );
            report
        };
        let reports: Vec<Report> = (first..first + replications).map(report).collect();
        row(process, &reports);
    }
}

fn percent(count: usize, n: usize) -> String {
    if n == 0 { "-".to_string() } else { format!("{:.0} %", 100.0 * count as f64 / n as f64) }
}

fn row(process: &Process, reports: &[Report]) {
    let p = process.probability;
    let covers = |estimate: &Estimate| estimate.low <= Some(p) && estimate.high >= Some(p);
    let answers: Vec<_> = reports.iter().map(|report| &report.answer).collect();
    let stated: Vec<_> = answers.iter().filter(|answer| answer.source.is_some()).collect();
    let ratios: Vec<f64> = stated.iter().map(|answer| answer.estimate.value.unwrap() / p).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let error = mean(&ratios.iter().map(|ratio| (ratio - 1.0).powi(2)).collect::<Vec<_>>()).sqrt();
    let weighted: Vec<_> = reports.iter().filter_map(|report| report.importance.as_ref()).collect();
    let of_importance = stated.iter().filter(|answer| answer.source == Some(Source::Importance)).count();
    let bounded = answers.iter().filter(|answer| answer.bounds[0] <= p && p <= answer.bounds[1]).count();
    let effective: Vec<f64> = weighted.iter().map(|found| found.effective_failures).collect();
    let components: Vec<f64> = weighted.iter().map(|found| found.components as f64).collect();
    println!(
        "| {} | {} | {} | {:+.1} % | {:.1} % | {} | {} | {:.0} | {:.1} |",
        process.name,
        percent(stated.len(), reports.len()),
        percent(of_importance, reports.len()),
        100.0 * (mean(&ratios) - 1.0),
        100.0 * error,
        percent(stated.iter().filter(|answer| covers(&answer.estimate)).count(), stated.len()),
        percent(bounded, reports.len()),
        mean(&effective),
        mean(&components),
    );
}
