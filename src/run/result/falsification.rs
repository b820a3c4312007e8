use std::path::Path;

use mishandle_falsification::{FalsificationOutcome, ScreenedCounts, TrialEnd, TrialOutcome, Unevaluated};
use mishandle_results as results;
use mishandle_results::{Falsification, Named, Screening, SearchValue, Seed, Trial, WithoutVerdict};
use mishandle_search::OptionValue;

use crate::plan::{FalsifyPlan, Plan};
use crate::resolve::named_scenario;
use crate::run::end_text;
use crate::run::facts::Facts;

/// Returns the result of a falsification, without the repeats of its counterexamples, the smooth
/// region and the failure modes. `counts` are those of its screening, `run` is the path of its run
/// file.
pub(in crate::run) fn falsification_result(
    facts: &Facts,
    found: &FalsificationOutcome,
    counts: Option<&ScreenedCounts>,
    run: &Path,
) -> Falsification {
    let falsify = facts.plan.falsify.clone().unwrap_or_default();
    Falsification {
        run: Some(run.to_string_lossy().into_owned()),
        subject: facts.subject.clone(),
        is_complete: found.trials.iter().filter(|trial| trial.end.is_some()).count()
            == falsify.trials as usize
            && !found.is_interrupted,
        search_options: search_options(&falsify),
        formula: facts.formula.clone(),
        budget: falsify.budget,
        batch: falsify.batch,
        fixed_seed: falsify.fixed_seed.map(Seed),
        early_stopping: falsify.early_stopping,
        search: falsify.search,
        simulations: found.simulations,
        without_verdict: WithoutVerdict::default(),
        control_steps: found.control_steps,
        surplus: found.surplus,
        falsified_trials: found.falsified_trials,
        falsification_rate: found.falsification_rate,
        mean_simulations: found.mean_simulations,
        median_simulations: found.median_simulations,
        restricted_mean_simulations: found.restricted_mean_simulations,
        smooth_region: None,
        failure_rate_bound: None,
        asks_nothing: None,
        warnings: Vec::new(),
        trials: found.trials.iter().map(|found| trial(facts, found)).collect(),
        requirements: None,
        reasons: None,
        modes: None,
        screening: counts.map(|counts| screening(&facts.plan, found, counts)),
    }
}

fn trial(facts: &Facts, found: &TrialOutcome) -> Trial {
    let minimum = found.minimum.as_ref();
    let axes = facts.space.axes();
    let signals: Vec<&str> = facts.signals.iter().map(String::as_str).collect();
    let unevaluated = |found: &Unevaluated| results::Unevaluated {
        simulation: found.number,
        scenario: named_scenario(axes, found.scenario.values()),
        seed: Seed(found.seed.0),
        end: end_text(found.end, &signals),
    };
    Trial {
        trial: found.trial,
        falsified: found.falsified(),
        simulations: found.simulations,
        first_violation: found.first_violation,
        minimum_robustness: minimum.map(|minimum| minimum.robustness.into()),
        initial_configuration: minimum.map(|minimum| minimum.scenario.values().to_vec()),
        scenario: minimum.map(|minimum| named_scenario(axes, minimum.scenario.values())),
        simulation: minimum.map(|minimum| minimum.number),
        seed: minimum.map(|minimum| Seed(minimum.seed.0)),
        end: found.end.map(end),
        diverged: found.diverged,
        invalid: found.invalid,
        failed: found.failed,
        undecided: found.undecided,
        undefined: found.undefined,
        first_unevaluated: found.first_unevaluated.as_ref().map(unevaluated),
        repeats: None,
        physics: None,
        violation: None,
        cause: None,
    }
}

/// Returns the end of a trial as a result.
fn end(end: TrialEnd) -> results::TrialEnd {
    match end {
        TrialEnd::Falsified => results::TrialEnd::Falsified,
        TrialEnd::BudgetSpent => results::TrialEnd::BudgetSpent,
        TrialEnd::ModesDriedUp => results::TrialEnd::ModesDriedUp,
        TrialEnd::SearchEnded(_) => results::TrialEnd::SearchEnded,
    }
}

/// Returns the options that the plan sets.
fn search_options(falsify: &FalsifyPlan) -> Named<SearchValue> {
    let value = |value: &OptionValue| match value {
        OptionValue::Float(value) => SearchValue::Float((*value).into()),
        OptionValue::Integer(value) => SearchValue::Integer(*value),
        OptionValue::Boolean(value) => SearchValue::Boolean(*value),
        OptionValue::Text(value) => SearchValue::Text(value.clone()),
        OptionValue::Point(value) => SearchValue::Point(value.clone()),
        OptionValue::Points(value) => SearchValue::Points(value.clone()),
    };
    falsify.options.iter().map(|(name, option)| (name, value(option))).collect()
}

fn screening(plan: &Plan, found: &FalsificationOutcome, counts: &ScreenedCounts) -> Screening {
    let reasons = [
        ("violated", counts.violated),
        ("without_verdict", counts.without_verdict),
        ("lowest", counts.minima),
        ("audit_sample", counts.sampled),
    ];
    let without_verdict = found.diverged + found.invalid + found.failed + found.undecided;
    Screening {
        device: plan.screening.as_ref().map_or(String::new(), |screening| screening.device.clone()),
        simulations: found.simulations,
        flagged: counts.violated.simulations + counts.without_verdict.simulations + counts.minima.simulations,
        audit_sample: counts.sampled.simulations,
        without_verdict: counts.without_verdict.simulations,
        overflows: counts.overflows,
        confirmed_without_verdict: without_verdict,
        findings: None,
        reasons: Some(reasons.into_iter().collect()),
    }
}
