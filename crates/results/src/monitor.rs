use serde::Serialize;

use crate::word::words;
use crate::{Number, RequirementVerdict, Severity};

words! {
    /// Windows of operators at the end of a trace.
    pub enum Windows { Cut = "cut", Whole = "whole" }

    /// Reason for a line of `monitor --follow`.
    pub enum MonitorEvent {
        Verdict = "verdict", End = "end", Interrupted = "interrupted", Bounds = "bounds",
        NoVerdict = "no-verdict",
    }
}

/// Robustness of formulas on recorded logs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Monitor {
    /// Robustness at time 0 of the first formula; of several logs, in the worst one.
    pub robustness: Number,
    /// Whether the formula is violated. At a robustness of 0, `<=`, `>=` and `==` hold, and `<`,
    /// `>` and `!=` do not.
    pub violated: bool,
    /// Why the formula is satisfied and asks nothing of the log; `null` otherwise.
    pub asks_nothing: Option<String>,
    /// `cut`: windows are cut at the end of the trace, as in RTAMT; `whole` with
    /// `log.strict-horizon`.
    pub windows: Windows,
    /// Whether `robustness` depends on a window that is cut.
    pub cuts_windows: bool,
    /// Robustness at each sample, with `monitor.values`; with `log.strict-horizon` at the first
    /// samples, whose windows are inside the trace. With `log.dense`, at each breakpoint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robustness_signal: Option<Vec<Number>>,
    /// The times of `robustness_signal` in seconds, with `monitor.values`, if the log has
    /// times.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robustness_times: Option<Vec<Number>>,
    /// Each named requirement; missing without one. Without `--formula`, the other keys are those
    /// of the first. Missing with several logs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirements: Option<Vec<RequirementVerdict>>,
    /// The verdict of each formula on each log, worst first: violated formulas by their severity,
    /// then satisfied formulas.
    pub verdicts: Vec<LogVerdict>,
    /// Each formula on each log that has no verdict, which does not mean that it is satisfied.
    pub no_verdict: Vec<NoVerdict>,
}

/// A formula without a verdict on a log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct NoVerdict {
    /// File of the log, as in a verdict.
    pub log: String,
    /// Name of the requirement; `null` for that of `--formula`.
    pub name: Option<String>,
    /// `critical`, `error` or `warning`.
    pub severity: Severity,
    /// Formula.
    pub formula: String,
    /// Why it has no verdict, such as a signal that the log lacks.
    pub reason: String,
}

/// The verdict of a formula on a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LogVerdict {
    /// File of the log; of a log with several topics, their files.
    pub log: String,
    /// Name of the requirement; `null` for that of `--formula`.
    pub name: Option<String>,
    /// Description of the requirement; `null` without one.
    pub description: Option<String>,
    /// `critical`, `error` or `warning`: a violated formula with `warning` does not give exit
    /// code 1.
    pub severity: Severity,
    /// Formula.
    pub formula: String,
    /// Robustness at time 0.
    pub robustness: Number,
    /// Whether it is violated.
    pub violated: bool,
    /// Why it is satisfied and asks nothing of the log; `null` otherwise.
    pub asks_nothing: Option<String>,
    /// Parts that often mean something else than their author thinks: only the first sample counts.
    pub traps: Vec<String>,
    /// Whether the robustness depends on a window that is cut.
    pub cuts_windows: bool,
    /// Number of samples; `null` with `log.dense`.
    pub samples: Option<u64>,
    /// Number of missing values that `log.missing` held or left out.
    pub missing_values: u64,
    /// Instant of 0 s in nanoseconds, if times in this document are differences from it; `null` if
    /// they are those of the log.
    pub origin_ns: Option<i64>,
    /// When each part of the formula is violated, in the order of time. Parts are the operands of
    /// `and` below `always`.
    pub violations: Vec<LogViolation>,
    /// The part that is violated most, or nearest to it; `null` if the formula requires none inside
    /// the log.
    pub worst_part: Option<WorstPart>,
    /// The predicate that determines the robustness; `null` if no comparison does, as in an
    /// empty window.
    pub predicate: Option<LogPredicate>,
}

impl LogVerdict {
    /// Returns the verdict in words.
    pub fn words(&self) -> &'static str {
        match (self.violated, &self.asks_nothing) {
            (true, _) => "violated",
            (false, Some(_)) => "satisfied: asks nothing",
            (false, None) => "satisfied",
        }
    }

    /// Returns whether the verdict gives exit code 1.
    pub fn fails(&self) -> bool {
        self.violated && self.severity != Severity::Warning
    }
}

/// A time in which a part of a formula is violated.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LogViolation {
    /// The part.
    pub formula: String,
    /// First time in seconds; `null` if the log has no times and no period.
    pub start: Option<Number>,
    /// Last time in seconds.
    pub end: Option<Number>,
    /// `end` minus `start`: 0 for a single sample.
    pub duration: Option<Number>,
    /// First sample, from 0; `null` with `log.dense`.
    pub start_sample: Option<u64>,
    /// Last sample.
    pub end_sample: Option<u64>,
    /// Least robustness of the part in this time.
    pub worst: Number,
}

/// The part of a formula that is violated most.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WorstPart {
    /// The part.
    pub formula: String,
    /// Its least robustness.
    pub robustness: Number,
    /// Its time in seconds; `null` if the log has no times and no period.
    pub time: Option<Number>,
    /// Its sample, from 0; `null` with `log.dense`.
    pub sample: Option<u64>,
}

/// The predicate that determines the robustness at time 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LogPredicate {
    /// The comparison.
    pub formula: String,
    /// The time in seconds; `null` if the log has no times and no period.
    pub time: Option<Number>,
    /// The sample, from 0; `null` with `log.dense`.
    pub sample: Option<u64>,
    /// Values of the two sides.
    pub values: [Number; 2],
    /// Its robustness.
    pub robustness: Number,
}

/// A line of `monitor --follow`: what the samples so far say about a formula.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MonitorChange {
    /// `verdict`: no continuation changes the verdict. `end`: the samples have ended before that,
    /// and the verdict is that of `monitor` without `--follow`. `interrupted`: a signal ended the
    /// command. `bounds`, with `monitor.bounds`: the bounds have changed. `no-verdict`: the
    /// requirement cannot be followed, or no longer.
    pub event: MonitorEvent,
    /// Name of the requirement; `null` for that of `--formula`.
    pub name: Option<String>,
    /// Number of samples so far.
    pub samples: u64,
    /// Time of the last sample in seconds; `null` if the log has no times and no period.
    pub time: Option<Number>,
    /// Instant of 0 s in nanoseconds, if times are differences from it; `null` if they are those of
    /// the log.
    pub origin_ns: Option<i64>,
    /// The least robustness at time 0 over all continuations.
    pub low: Number,
    /// The greatest robustness at time 0 over all continuations. With `end`, it is `low`.
    pub high: Number,
    /// Whether the formula is violated; `null` as long as this is not certain.
    pub violated: Option<bool>,
    /// Why it is satisfied and asks nothing of the log; `null` otherwise.
    pub asks_nothing: Option<String>,
    /// The first violation of a part of the formula that is known; `null` if the formula is not
    /// violated, and if none is known. Parts are the operands of `and` below `always`.
    pub violation: Option<FirstViolation>,
    /// With `end`: whether the robustness depends on a window that is cut.
    pub cuts_windows: bool,
    /// With `no-verdict`: why; missing otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// The first violation of a part of a formula.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FirstViolation {
    /// The part.
    pub formula: String,
    /// Its sample, from 0.
    pub sample: u64,
    /// Its time in seconds; `null` if the log has no times and no period.
    pub time: Option<Number>,
    /// The robustness of the part there.
    pub robustness: Number,
}
