use std::path::Path;

use mishandle_evaluation::TwoPhase;
use mishandle_results as results;
use mishandle_results::{
    AxisDistribution, Estimate, Exploration, Finding, MonteCarlo, Probability, RiskFailure, Screening, Seed,
    WithoutVerdict,
};
use mishandle_risk::{
    Failure, Importance, Marginal, Method, Refusal, Report, Scenarios, ScreenedReport, Splitting,
};
use mishandle_rollout::Axis;

use mishandle_text::probability_text;

use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::risk::ALL_PASS;
use crate::run::{risk_assumption, risk_refusals};

/// Returns the result of an estimation. `run` is the path of its run file.
pub(crate) fn risk_result(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    report: &Report,
    run: &Path,
) -> results::Risk {
    let Report { answer, monte_carlo, .. } = report;
    results::Risk {
        method: resolved.plan.risk.as_ref().map_or(String::new(), |risk| risk.method.clone()),
        simulations: report.simulations,
        is_complete: report.is_complete,
        probability: answer.source.map(|source| Probability {
            value: answer.estimate.value,
            low: answer.estimate.low,
            high: answer.estimate.high,
            source: source.name().to_string(),
            assumption: risk_assumption(report),
        }),
        without_verdict: WithoutVerdict::new(monte_carlo.ends, resolved.plan.max_without_verdict),
        bounds: answer.bounds,
        refusals: risk_refusals(report),
        splitting_refusal: answer.splitting_refusal.as_ref().map(|refusal| refusal_name(refusal).to_string()),
        monte_carlo: MonteCarlo {
            simulations: monte_carlo.simulations,
            failures: monte_carlo.failures,
            invalid_starts: monte_carlo.ends.invalid_starts,
            without_verdict: monte_carlo.ends.total(),
            bound_with_undecided: monte_carlo.bound_with_undecided().map(Into::into),
            failure_rate: monte_carlo.failure_rate(),
        },
        exploration: Exploration { simulations: report.exploration },
        importance: report.importance.as_ref().map(importance),
        splitting: report.splitting.as_ref().map(splitting),
        ..shared(resolved, scenarios, &report.failures, run)
    }
}

/// Returns the result of a screened estimation, which is that of plain Monte Carlo. `run` is the
/// path of its run file.
pub(crate) fn screened_risk_result(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    report: &ScreenedReport,
    run: &Path,
) -> results::Risk {
    let counts = report.counts;
    let estimate = report.estimate();
    let ends = report.all_ends();
    let finding = Finding { flagged: counts.flagged_events, audit_sample: counts.sampled_events };
    results::Risk {
        method: Method::MonteCarlo.name().to_string(),
        simulations: counts.trials,
        is_complete: report.is_complete,
        probability: estimate.value.map(|value| Probability {
            value: Some(value),
            low: estimate.low,
            high: estimate.high,
            source: Method::MonteCarlo.name().to_string(),
            assumption: (ends.total() > 0).then(|| ALL_PASS.to_string()),
        }),
        without_verdict: WithoutVerdict {
            share: counts.share_without_verdict(report.ends),
            max_share: resolved.plan.max_without_verdict,
            ends,
        },
        bounds: [estimate.low.unwrap_or(0.0), report.bound_with_undecided().unwrap_or(1.0)],
        monte_carlo: MonteCarlo {
            simulations: counts.trials,
            failures: counts.flagged_events + counts.sampled_events,
            invalid_starts: ends.invalid_starts,
            without_verdict: ends.total(),
            bound_with_undecided: report.bound_with_undecided().map(Into::into),
            failure_rate: Estimate { high: report.bound_with_undecided(), ..estimate },
        },
        screening: Some(Screening {
            confirmed_without_verdict: ends.total(),
            findings: Some([("failure", finding)].into_iter().collect()),
            ..screening(&counts, report.screened_without_verdict, report.overflows, resolved)
        }),
        ..shared(resolved, scenarios, &report.failures, run)
    }
}

/// Returns what both kinds of estimations say of the plan, and the failures.
fn shared(resolved: &ResolvedPlan, scenarios: &Scenarios, failures: &[Failure], run: &Path) -> results::Risk {
    let failure = |failure: &Failure| {
        let scenario = scenarios.scenario(&failure.draw.latent);
        RiskFailure {
            scenario: named_scenario(resolved.space.axes(), scenario.values()),
            simulation: failure.number,
            seed: Seed(failure.draw.seed.0),
            robustness: failure.robustness.into(),
        }
    };
    let distribution = |(axis, marginal): (&Axis, &Marginal)| AxisDistribution {
        axis: axis.name.clone(),
        distribution: if axis.is_fixed() { "fixed".to_string() } else { distribution_text(marginal) },
        low: axis.low,
        high: axis.high,
        unit: axis.unit.clone(),
    };
    results::Risk {
        run: Some(run.to_string_lossy().into_owned()),
        subject: resolved.subject(),
        formula: resolved.specification.requirement.to_string(),
        method: String::new(),
        distribution: scenarios.axes().map(distribution).collect(),
        seed_is_random: scenarios.depends_on_seed(),
        simulations: 0,
        is_complete: false,
        without_verdict: WithoutVerdict::default(),
        asks_nothing: None,
        probability: None,
        bounds: [0.0, 1.0],
        refusals: Vec::new(),
        splitting_refusal: None,
        monte_carlo: MonteCarlo::default(),
        exploration: Exploration { simulations: 0 },
        importance: None,
        splitting: None,
        failures: failures.iter().map(failure).collect(),
        reasons: None,
        screening: None,
    }
}

/// Returns a distribution as text. Rates of faults say what they mean for an episode.
fn distribution_text(marginal: &Marginal) -> String {
    match marginal.fault_probability() {
        None => marginal.to_string(),
        Some(probability) => format!(
            "{marginal} (at most one fault of this axis per episode, which has one with probability {})",
            probability_text(probability)
        ),
    }
}

fn importance(found: &Importance) -> results::Importance {
    results::Importance {
        fitting_simulations: found.fitting,
        simulations: found.simulations,
        failures: found.failures,
        effective_failures: found.effective_failures,
        components: found.components as u64,
        regions: found.regions,
        outside: found.outside,
        monte_carlo_inside: found.monte_carlo_inside,
        monte_carlo_outside: found.monte_carlo_outside,
    }
}

fn splitting(found: &Splitting) -> results::Splitting {
    results::Splitting {
        simulations: found.simulations,
        population: found.population,
        estimate: found.estimate().ok(),
        chains: found.chains.clone(),
    }
}

fn refusal_name(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::Budget { .. } => "budget",
        Refusal::InvalidStarts => "invalid-starts",
        Refusal::Chains(_) => "chains",
        Refusal::MonteCarlo => "monte-carlo",
        Refusal::BelowImportance => "below-importance",
        Refusal::AboveImportance => "above-importance",
    }
}

/// Returns the counts of the screened simulations and of those that MuJoCo C repeated.
pub(super) fn screening(
    counts: &TwoPhase,
    without_verdict: u64,
    overflows: u64,
    resolved: &ResolvedPlan,
) -> Screening {
    Screening {
        device: resolved.plan.screening.as_ref().map_or(String::new(), |screening| screening.device.clone()),
        simulations: counts.trials,
        flagged: counts.flagged,
        audit_sample: counts.sampled,
        without_verdict,
        overflows,
        ..Screening::default()
    }
}
