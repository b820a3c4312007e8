//! The result of a falsification, as text and as JSON.

use std::collections::BTreeMap;

use mishandle::evaluation::{NotSmooth, RepeatReport, SmoothRegion};
use mishandle::falsification::{CampaignOutcome, Minimum, TrialEnd, TrialOutcome};
use mishandle::search::OptionValue;
use mishandle::{FalsifyPlan, ResolvedPlan, decimal, plural};
use serde_json::{Value, json};

use super::output::{self, number};
use super::{repeats, scenario, simulation, subject};

/// Repeated simulations of counterexamples, by trial.
pub type Repeats = BTreeMap<u32, RepeatReport>;

pub fn region_text(region: Result<SmoothRegion, NotSmooth>) -> String {
    match region {
        Ok(SmoothRegion { covered, .. }) if covered < 0.01 => {
            "\nno statement about the space between the samples: they are too far apart for such steep changes of the robustness".into()
        }
        Ok(SmoothRegion { slope, covered, .. }) => format!(
            "\nif the samples missed no cliff, the robustness changes by at most {} per width of the space (estimate, 95 % confidence); then \
             no scenario in {:.0} % of the space fails",
            decimal(slope, 4),
            // A share that was measured at random points is never 100 %.
            (100.0 * covered).floor().min(99.0)
        ),
        Err(reason) => format!("\nno statement about the space between the samples: {reason}"),
    }
}

pub fn region_document(region: Result<SmoothRegion, NotSmooth>) -> Value {
    match region {
        Ok(SmoothRegion { slope, largest_slope, covered }) => {
            json!({ "slope": slope, "largest_slope": largest_slope, "covered": covered, "refusal": Value::Null })
        }
        Err(reason) => {
            json!({ "slope": Value::Null, "largest_slope": Value::Null, "covered": Value::Null, "refusal": reason.to_string() })
        }
    }
}

/// Returns whether all trials of the plan have ended.
pub fn is_complete(resolved: &ResolvedPlan, found: &CampaignOutcome) -> bool {
    let trials = resolved.plan.falsify.as_ref().map_or(0, |falsify| falsify.trials);
    found.trials.iter().filter(|trial| trial.end.is_some()).count() == trials as usize
}

/// Returns the JSON document of the run.
pub fn document(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: &Repeats, path: &str) -> Value {
    output::joined(subject::document(resolved, path), results(resolved, found, repeats))
}

pub fn results(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: &Repeats) -> Value {
    let falsify = resolved.plan.falsify.clone().unwrap_or_default();
    let trials: Vec<Value> = found
        .trials
        .iter()
        .map(|trial| {
            let repeated = repeats.get(&trial.trial).map(repeats::document);
            output::joined(trial_document(resolved, trial), json!({ "repeats": repeated }))
        })
        .collect();
    json!({
        "is_complete": is_complete(resolved, found),
        "search": falsify.search,
        "search_options": search_options(&falsify),
        "formula": resolved.specification.requirement.to_string(),
        "budget": falsify.budget,
        "batch": falsify.batch,
        "early_stopping": falsify.early_stopping,
        "control_steps": found.control_steps,
        "falsified_trials": found.falsified_trials,
        "falsification_rate": output::estimate(&found.falsification_rate),
        "mean_simulations": found.mean_simulations,
        "median_simulations": found.median_simulations,
        "restricted_mean_simulations": found.restricted_mean_simulations,
        "smooth_region": Value::Null,
        "failure_rate_bound": mishandle::failure_rate_bound(resolved, found),
        "trials": trials,
    })
}

fn trial_document(resolved: &ResolvedPlan, trial: &TrialOutcome) -> Value {
    let minimum = trial.minimum.as_ref();
    json!({
        "trial": trial.trial,
        "falsified": trial.falsified(),
        "simulations": trial.simulations,
        "first_violation": trial.first_violation,
        "minimum_robustness": minimum.map_or(Value::Null, |minimum| number(minimum.robustness)),
        "initial_configuration": minimum.map(|minimum| minimum.scenario.values()),
        "scenario": minimum.map(|minimum| scenario::document(resolved.space.axes(), minimum.scenario.values())),
        "simulation": minimum.map(|minimum| minimum.number),
        "seed": minimum.map(|minimum| minimum.seed.0.to_string()),
        "end": trial.end.map(end),
        "diverged": trial.diverged,
        "invalid": trial.invalid,
        "failed": trial.failed,
        "undecided": trial.undecided,
    })
}

/// Returns the options that the plan sets, as JSON.
fn search_options(falsify: &FalsifyPlan) -> Value {
    let value = |value: &OptionValue| match value {
        OptionValue::Float(value) => number(*value),
        OptionValue::Integer(value) => json!(value),
        OptionValue::Boolean(value) => json!(value),
        OptionValue::Text(value) => json!(value),
        OptionValue::Point(value) => json!(value),
        OptionValue::Points(value) => json!(value),
    };
    falsify.options.iter().map(|(name, option)| (name.to_string(), value(option))).collect()
}

/// Returns the options that the plan sets, in parentheses.
fn options_text(falsify: &FalsifyPlan) -> String {
    let options: Vec<String> =
        falsify.options.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    if options.is_empty() { String::new() } else { format!(" ({})", options.join(", ")) }
}

/// Warns about simulations that have no verdict because a value is not finite: the first one of up to `SHOWN` trials.
pub fn report_unevaluated(resolved: &ResolvedPlan, found: &CampaignOutcome) {
    const SHOWN: usize = 3;
    let first =
        found.trials.iter().filter_map(|trial| Some((trial.trial, trial.first_unevaluated.as_ref()?)));
    let mut shown = 0;
    for (trial, first) in first.take(SHOWN) {
        shown += 1;
        output::message(&format!(
            "warning: simulation {} of trial {trial} ({}, seed {}) has no verdict: {}",
            first.number,
            scenario::summary(resolved.space.axes(), first.scenario.values()),
            first.seed.0,
            simulation::end_text(first.end, &resolved.target.signals),
        ));
    }
    let affected = found.undefined + found.invalid + found.failed;
    if affected > shown {
        let more = plural(affected - shown, "more simulation");
        output::message(&format!("warning: no verdict either: {more}"));
    }
}

/// Returns the name of a trial's end.
fn end(end: TrialEnd) -> &'static str {
    match end {
        TrialEnd::Falsified => "falsified",
        TrialEnd::BudgetSpent => "budget spent",
        TrialEnd::ModesDriedUp => "modes dried up",
        TrialEnd::SearchEnded(_) => "search ended",
    }
}

pub fn text(resolved: &ResolvedPlan, found: &CampaignOutcome, repeats: &Repeats) -> String {
    let falsify = resolved.plan.falsify.clone().unwrap_or_default();
    let at = |minimum: &Minimum| scenario::summary(resolved.space.axes(), minimum.scenario.values());
    let mut header = vec!["trial", "result", "simulations", "min robustness", "scenario"];
    if !repeats.is_empty() {
        header.insert(4, "fails in repeats");
    }
    let mut rows = vec![header.into_iter().map(String::from).collect::<Vec<_>>()];
    for trial in &found.trials {
        let minimum = trial.minimum.as_ref();
        let mut row = vec![
            trial.trial.to_string(),
            trial.end.map_or("interrupted", end).to_string(),
            trial.simulations.to_string(),
            minimum.map_or("-".to_string(), |minimum| decimal(minimum.robustness, 4)),
            minimum.map_or(String::new(), at),
        ];
        if !repeats.is_empty() {
            let repeated = repeats.get(&trial.trial);
            row.insert(
                4,
                repeated.map_or("-".to_string(), |report| {
                    format!("{} of {}", report.failures, report.failure_rate.n)
                }),
            );
        }
        rows.push(row);
    }
    let mut text = format!(
        "{}\nsearch {}{}, at most {} per trial, seed {}\nformula {}\n\n{}\n\n{}",
        subject::heading(resolved),
        falsify.search,
        options_text(&falsify),
        plural(falsify.budget, "simulation"),
        resolved.plan.seed,
        resolved.specification.requirement,
        output::table(&rows),
        summary(found),
    );
    if falsify.early_stopping && found.simulations > 0 && found.screened == 0 {
        let whole = found.simulations * resolved.target.episode_steps as u64;
        text.push_str(&format!(
            "\nearly stopping: {:.0} % of {whole} control steps saved; robustness values of simulations that ended early are lower bounds",
            100.0 * (1.0 - found.control_steps as f64 / whole as f64)
        ));
    }
    if let Some(bound) = mishandle::failure_rate_bound(resolved, found) {
        text.push_str(&format!(
            "\nno violation in {} of the space: failure rate below {} (95 % confidence)",
            plural(found.simulations, "uniform random sample"),
            percent(bound)
        ));
    }
    let first = found.trials.iter().filter(|trial| trial.falsified());
    if let Some((trial, first)) =
        first.filter_map(|trial| Some((trial.trial, trial.minimum.as_ref()?))).next()
    {
        text.push_str(&format!(
            "\ncounterexample: {}, seed {} (trial {trial}, simulation {}): robustness {}",
            scenario::text(resolved.space.axes(), first.scenario.values()),
            first.seed.0,
            first.number,
            decimal(first.robustness, 4)
        ));
    }
    if !repeats.is_empty() {
        let sum = |of: fn(&RepeatReport) -> u64| repeats.values().map(of).sum::<u64>();
        let (failures, n) = (sum(|report| report.failures), sum(|report| report.failure_rate.n));
        text.push_str(&format!(
            "\nwith other seeds, the counterexamples fail in {failures} of {}",
            plural(n, "repeat")
        ));
    }
    if let Some(counts) =
        simulation::without_verdict(found.diverged, found.invalid, found.failed, found.undecided)
    {
        text.push_str(&format!("\n{counts}; they do not count as counterexamples"));
    }
    text
}

/// Formats a small rate in percent, rounded up to two digits.
fn percent(rate: f64) -> String {
    let percent = 100.0 * rate;
    let decimals = (1.0 - percent.log10().floor()).clamp(0.0, 12.0) as usize;
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$} %", (percent * scale).ceil() / scale)
}

/// Returns the number of falsified trials, and the simulations up to the counterexample.
fn summary(found: &CampaignOutcome) -> String {
    let ended = found.falsification_rate.n;
    let mut text = format!("falsified {} of {}", found.falsified_trials, plural(ended, "trial"));
    if let Some(mean) = found.mean_simulations {
        text.push_str(&format!("; simulations to a counterexample: mean {mean:.1} over falsified trials"));
    }
    match found.median_simulations {
        Some(median) => text.push_str(&format!(", median {median} over all trials")),
        None if found.falsified_trials > 0 && found.trials.iter().all(|trial| trial.end.is_some()) => {
            text.push_str(", median over all trials not reached within the budget");
        }
        None => {}
    }
    text
}
