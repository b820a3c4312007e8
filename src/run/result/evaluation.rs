use std::path::Path;

use mishandle_evaluation::{CornerCounter, ScreenedEvaluation, TwoPhase};
use mishandle_results::{
    Evaluation, Finding, Metrics, Named, ScreenedFailure, Screening, Seed, WithoutVerdict,
};

use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::facts::Facts;

/// Returns the result of a screened evaluation. `corners` are those of the target's system, `run`
/// is the path of its run file.
pub(in crate::run) fn screened_evaluation_result(
    resolved: &ResolvedPlan,
    report: &ScreenedEvaluation,
    corners: Option<&CornerCounter>,
    run: &Path,
) -> Evaluation {
    let finding =
        |counts: TwoPhase| Finding { flagged: counts.flagged_events, audit_sample: counts.sampled_events };
    let findings = [
        ("failure", Some(report.failures)),
        ("strict_failure", report.strict_failures),
        ("dangerous", report.dangerous),
    ];
    let findings = findings.into_iter().filter_map(|(name, counts)| Some((name, finding(counts?))));
    let failures = report.first_failures.iter().map(|failure| ScreenedFailure {
        number: failure.request.number,
        scenario: named_scenario(resolved.space.axes(), failure.request.scenario.values()),
        seed: Seed(failure.request.seed.0),
        robustness: failure.robustness.map(Into::into),
    });
    let ends = report.all_ends();
    Evaluation {
        without_verdict: WithoutVerdict {
            share: report.failures.share_without_verdict(report.ends),
            max_share: resolved.plan.max_without_verdict,
            ends,
        },
        metrics: Metrics {
            simulations: report.failures.trials,
            diverged: ends.diverged,
            invalid: ends.invalid,
            failed: ends.failed + ends.invalid_starts,
            invalid_starts: ends.invalid_starts,
            undecided: ends.undecided,
            strict_undecided: 0,
            careful_undecided: None,
            violations: report.violations,
            requirement_undecided: ends.total(),
            violation_rate: report.violation_rate(),
            success_rate: report.success_rate(),
            strict_success_rate: report.strict_success_rate(),
            careful_success_rate: None,
            dangerous_behavior_rate: None,
            dangerous_episode_rate: report.dangerous_episode_rate(),
            task_completion_time: None,
        },
        corners: corners.map(CornerCounter::report),
        screening: Some(Screening {
            confirmed_without_verdict: report.without_verdict,
            findings: Some(findings.collect::<Named<_>>()),
            ..super::risk::screening(
                &report.failures,
                report.screened_without_verdict,
                report.overflows,
                resolved,
            )
        }),
        failures: Some(failures.collect()),
        ..evaluation_result(&Facts::of(resolved), run, report.is_complete)
    }
}

/// Returns the result of an evaluation without what its simulations say. `run` is the path of its
/// run file.
pub(in crate::run) fn evaluation_result(facts: &Facts, run: &Path, is_complete: bool) -> Evaluation {
    let starts = facts.plan.evaluate.as_ref().map(|evaluate| evaluate.starts).unwrap_or_default();
    Evaluation {
        run: Some(run.to_string_lossy().into_owned()),
        subject: facts.subject.clone(),
        starts,
        leaves_out_starts: facts.leaves_out_starts,
        is_complete,
        without_verdict: WithoutVerdict::default(),
        metrics: Metrics::default(),
        asks_nothing: None,
        breaks: Vec::new(),
        corners: None,
        axis_rates: None,
        sequential: None,
        control: None,
        requirements: None,
        reasons: None,
        screening: None,
        failures: None,
    }
}
