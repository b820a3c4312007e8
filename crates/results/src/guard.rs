use serde::Serialize;

use crate::{Estimate, Number, PairedRates, Seed, Subject, WithoutVerdict};

/// A guard whose threshold was chosen on training scenarios, measured on held-out ones.
///
/// An alarm is a robustness of the guard's formula below the threshold. Alarms are counted where
/// the guard only watches, so that they do not change what happens.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GuardTuning {
    /// Target, guarded controller, space, and the seed of the held-out scenarios.
    #[serde(flatten)]
    pub subject: Subject,
    /// Folder with the run files and the guard.
    pub folder: String,
    /// Path of the guard with the chosen threshold.
    pub guard_file: String,
    /// Formula whose violation is a failure.
    pub requirement: String,
    /// Largest allowed share of successful training scenarios with an alarm.
    pub false_alarm_limit: f64,
    /// The simulations without a verdict, in the training scenarios and in the held-out scenarios
    /// of the controller alone and of the guarded controller.
    pub without_verdict: WithoutVerdict,
    /// Conclusion from the held-out scenarios, in sentences.
    pub verdict: String,
    /// Alarms in the training scenarios, on which the threshold was chosen: they flatter the guard.
    pub training: GuardAlarms,
    /// Alarms in the held-out scenarios.
    pub held_out: GuardAlarms,
    /// Time from an alarm to the certain failure in the held-out scenarios; `null` without an alarm
    /// before a failure.
    pub lead: Option<AlarmLead>,
    /// Success in the held-out scenarios: A is the controller alone, B the guarded controller.
    /// `second_only` counts saved scenarios, `first_only` broken ones.
    pub guarded: PairedRates,
    /// Success in the held-out scenarios: A is the controller alone, B the fallback alone.
    pub fallback: PairedRates,
    /// Missed failures and false alarms of all thresholds in the training scenarios.
    pub curve: Vec<GuardCurvePoint>,
}

/// Alarms of a guard that only watches.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GuardAlarms {
    /// Seed of the evaluation.
    pub seed: Seed,
    /// Number of scenarios in which the controller alone violates the requirement.
    pub failures: u64,
    /// Number of scenarios in which it satisfies the requirement.
    pub successes: u64,
    /// Number of scenarios without a verdict, which count nowhere here.
    pub without_verdict: u64,
    /// Share of failures without an alarm before the failure is certain, with its Wilson interval.
    pub missed: Estimate,
    /// Number of these with a later alarm.
    pub late: u64,
    /// Share of successes with an alarm, with its Wilson interval.
    pub false_alarms: Estimate,
    /// Probability that the least robustness of a failure is below that of a success: 1 if all
    /// failures are below all successes, 0.5 by chance.
    pub area: Estimate,
}

/// Time from an alarm to the certain failure: the first sample at which no continuation satisfies
/// the requirement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AlarmLead {
    /// Number of failures with an alarm in time.
    pub n: u64,
    /// Median, s.
    pub median: f64,
    /// 10 % quantile, s.
    pub low: f64,
    /// 90 % quantile, s.
    pub high: f64,
}

/// A threshold, and its alarms in the training scenarios.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct GuardCurvePoint {
    /// Threshold, in the unit of the guard's formula.
    pub threshold: Number,
    /// Number of failures without an alarm in time.
    pub missed: u64,
    /// Number of successes with an alarm.
    pub false_alarms: u64,
}
