//! The result of a tuning.

use std::path::Path;

use mishandle_controllers::guard::Switch;
use mishandle_evaluation::{PairedCounts, paired_rates, wilson};
use mishandle_results::{AlarmLead, EndCounts, GuardAlarms, GuardTuning, PairedRates, Seed, WithoutVerdict};
use mishandle_rollout::Episode;
use mishandle_stl::is_violated;
use mishandle_store::RANDOM_TRIAL;
use mishandle_text::{path_text, plural};

use super::alarm::{Requirement, WatchedRun};
use super::threshold::Least;
use super::{Asked, CHOSEN};
use crate::error::MishandleError;
use crate::plan::{GuardPlan, TuneSettings};
use crate::run::rows;

/// The three evaluations on held-out scenarios.
pub(super) struct HeldOut {
    pub alone: Asked,
    pub guarded: Asked,
    pub fallback: Asked,
}

/// Returns the result of a tuning.
pub(super) fn tuning(
    settings: &TuneSettings,
    folder: &Path,
    guard: &GuardPlan,
    training: &Asked,
    trained: &WatchedRun,
    least: &Least,
    held_out: &HeldOut,
) -> Result<GuardTuning, MishandleError> {
    let switch = Switch::new(guard.threshold, None, 0)?;
    let tested = held_out.alone.watched()?;
    let training_alarms = alarms(training, trained, &switch)?;
    let held_out_alarms = alarms(&held_out.alone, &tested, &switch)?;
    let guarded = paired(&held_out.alone, &held_out.guarded)?;
    let fallback = paired(&held_out.alone, &held_out.fallback)?;
    let mut ends = EndCounts::default();
    for asked in [training, &held_out.alone, &held_out.guarded] {
        ends.add_all(asked.ends()?);
    }
    Ok(GuardTuning {
        subject: held_out.guarded.resolved.subject(),
        folder: path_text(folder),
        guard_file: path_text(&folder.join(CHOSEN)),
        requirement: training.requirement.formula.to_string(),
        false_alarm_limit: settings.false_alarms,
        without_verdict: WithoutVerdict::new(ends, training.resolved.plan.max_without_verdict),
        verdict: verdict(guard.threshold, &held_out_alarms, &guarded, &fallback),
        training: training_alarms,
        held_out: held_out_alarms,
        lead: lead(&tested, &switch, held_out.alone.resolved.target.control_dt),
        guarded,
        fallback,
        curve: least.curve(),
    })
}

/// Counts the alarms of a guard that only watched.
fn alarms(asked: &Asked, watched: &WatchedRun, switch: &Switch) -> Result<GuardAlarms, MishandleError> {
    let mut failures = 0;
    let mut missed = 0;
    let mut late = 0;
    let mut successes = 0;
    let mut false_alarms = 0;
    for found in &watched.simulations {
        let has_alarm = switch.is_active(0, found.least, true);
        if found.fails {
            failures += 1;
            missed += u64::from(!has_alarm);
            late += u64::from(!has_alarm && found.lead(switch).is_some());
        } else {
            successes += 1;
            false_alarms += u64::from(has_alarm);
        }
    }
    Ok(GuardAlarms {
        seed: Seed(asked.resolved.plan.seed),
        failures,
        successes,
        without_verdict: watched.without_verdict,
        missed: wilson(missed, failures),
        late,
        false_alarms: wilson(false_alarms, successes),
        area: Least::of(&watched.simulations).area(),
    })
}

/// Returns the times from alarms to certain failures, of alarms in time.
fn lead(watched: &WatchedRun, switch: &Switch, control_dt: f64) -> Option<AlarmLead> {
    let steps = |found: &super::alarm::Watched| found.lead(switch).filter(|steps| *steps > 0);
    let mut steps: Vec<i64> = watched.simulations.iter().filter_map(steps).collect();
    steps.sort_unstable();
    let last = steps.len().checked_sub(1)?;
    // The value at the nearest rank: a time that occurred.
    let at = |p: f64| steps[(p * last as f64).round() as usize] as f64 * control_dt;
    Some(AlarmLead { n: steps.len() as u64, median: at(0.5), low: at(0.1), high: at(0.9) })
}

/// Compares the successes of two evaluations of the same scenarios, pair by pair.
fn paired(first: &Asked, second: &Asked) -> Result<PairedRates, MishandleError> {
    let outcomes = |asked: &Asked| -> Result<Vec<Option<Outcome>>, MishandleError> {
        let run = asked.run()?;
        let rows = run.trial_simulations(RANDOM_TRIAL);
        rows.map(|row| Ok(outcome(&asked.requirement, &rows::episode(&row?, &asked.resolved)?))).collect()
    };
    let mut counts = PairedCounts::default();
    let mut verdicts = [0; 2];
    for (first, second) in outcomes(first)?.into_iter().zip(outcomes(second)?) {
        let Some((first, second)) = first.zip(second) else { continue };
        counts.add(first.succeeds, second.succeeds);
        verdicts[0] += u64::from(first.has_verdict);
        verdicts[1] += u64::from(second.has_verdict);
    }
    Ok(paired_rates(counts, verdicts))
}

/// Success or failure of an episode.
struct Outcome {
    succeeds: bool,
    has_verdict: bool,
}

/// Returns `None` if the target cannot start from the scenario.
fn outcome(requirement: &Requirement, episode: &Episode) -> Option<Outcome> {
    let fails = requirement.is_violated(episode);
    let found = Outcome { succeeds: fails == Some(false), has_verdict: fails.is_some() };
    episode.end.counts_in_rates().then_some(found)
}

/// Says in a few sentences what the held-out scenarios show.
fn verdict(threshold: f64, alarms: &GuardAlarms, guarded: &PairedRates, fallback: &PairedRates) -> String {
    let mut parts = Vec::new();
    if alarms.area.low.is_none_or(|low| is_violated(low - 0.5) || low == 0.5) {
        parts.push(
            "The formula does not tell failures from successes: its least robustness in failures is not \
             significantly lower."
                .to_string(),
        );
    }
    if threshold == f64::NEG_INFINITY {
        parts.push(
            "No threshold has an alarm before a failure within the limit of false alarms, so the guard never hands over."
                .to_string(),
        );
        return parts.join(" ");
    }
    let PairedRates { first_only: broken, second_only: saved, difference, .. } = guarded;
    let is = |low: Option<f64>| low.is_some_and(|low| low > 0.0);
    let judgment = match difference {
        found if is(found.low) => "the guarded controller succeeds more often",
        found if is(found.high.map(|high| -high)) => "the guarded controller succeeds less often",
        _ => "the success rates do not differ significantly",
    };
    parts.push(format!(
        "The guard saves {} that the controller alone fails in and breaks {broken} that it succeeds in: {judgment}.",
        plural(*saved, "scenario")
    ));
    if fallback.second.value > guarded.second.value {
        parts.push("The fallback alone succeeds more often than both.".to_string());
    }
    parts.join(" ")
}
