use std::path::Path;

use mishandle_evaluation::{CornerReport, CornerResult, ScreenedEvaluation, TwoPhase};
use mishandle_results::{
    CornerPoint, Corners, Evaluation, Finding, Metrics, Named, ScreenedFailure, Screening, Seed,
};
use mishandle_rollout::Axis;

use crate::plan::StartRegion;
use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::facts::Facts;

/// Returns the result of a screened evaluation. `corners` are those of the target's system, `run`
/// is the path of its run file.
pub(in crate::run) fn screened_evaluation_result(
    resolved: &ResolvedPlan,
    report: &ScreenedEvaluation,
    corners: Option<&CornerReport>,
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
    Evaluation {
        metrics: Metrics {
            simulations: report.failures.trials,
            diverged: report.ends.diverged,
            invalid: report.ends.invalid,
            failed: report.ends.failed,
            undecided: report.ends.undecided,
            strict_undecided: 0,
            careful_undecided: None,
            success_rate: report.success_rate(),
            strict_success_rate: report.strict_success_rate(),
            careful_success_rate: None,
            dangerous_behavior_rate: None,
            dangerous_episode_rate: report.dangerous_episode_rate(),
            task_completion_time: None,
        },
        corners: corners.map(|report| corners_result(resolved.space.axes(), report)),
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
    let starts = match starts {
        StartRegion::Whole => "whole",
        StartRegion::Reachable => "reachable",
    };
    Evaluation {
        run: Some(run.to_string_lossy().into_owned()),
        subject: facts.subject.clone(),
        starts: starts.to_string(),
        leaves_out_starts: facts.leaves_out_starts,
        is_complete,
        metrics: Metrics::default(),
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

/// Returns the results at the corners and the center of the initial box.
pub(in crate::run) fn corners_result(axes: &[Axis], report: &CornerReport) -> Corners {
    let last = report.points.len().saturating_sub(1);
    let point = |(index, point): (usize, &CornerResult)| CornerPoint {
        kind: if index == last { "center" } else { "corner" }.to_string(),
        scenario: named_scenario(axes, point.scenario.values()),
        reachable: point.is_reachable,
        counts: report.counts(point),
        n: point.n,
        invalid_starts: point.invalid_starts,
        successes: point.successes,
        strict_successes: point.strict_successes,
        careful_successes: point.careful_successes,
        diverged: point.diverged,
        invalid: point.invalid,
        failed: point.failed,
        undecided: point.undecided,
    };
    let count =
        |holds: &dyn Fn(&CornerResult) -> bool| report.corners().filter(|point| holds(point)).count() as u64;
    let all = |holds: fn(&CornerResult) -> Option<bool>| count(&|point| holds(point) == Some(true));
    let has_strict = report.points.iter().any(|point| point.strict_successes.is_some());
    let has_careful = report.points.iter().any(|point| point.careful_successes.is_some());
    Corners {
        seeds: report.seeds,
        n: report.corners().count() as u64,
        without_verdict: count(&|point| point.succeeds().is_none()),
        succeeding: all(CornerResult::succeeds),
        strictly_succeeding: has_strict.then(|| all(CornerResult::succeeds_strictly)),
        carefully_succeeding: has_careful.then(|| all(CornerResult::succeeds_carefully)),
        center_succeeds: report.center().and_then(CornerResult::succeeds),
        center_strictly_succeeds: report.center().and_then(CornerResult::succeeds_strictly),
        center_carefully_succeeds: report.center().and_then(CornerResult::succeeds_carefully),
        points: report.points.iter().enumerate().map(point).collect(),
    }
}
