use serde::Serialize;

use crate::word::words;
use crate::{Number, Signal};

words! {
    /// Severity of a trap.
    pub enum TrapSeverity { Warning = "warning", Note = "note" }

    /// Source of an example.
    pub enum ExampleKind {
        Log = "log", Episode = "episode", Simulation = "simulation", Found = "found", Pattern = "pattern",
    }

    /// Verdict of a sub-formula at a sample.
    pub enum LaneState { Holds = "holds", Violated = "violated", Undecided = "undecided" }

    /// Kind of value of a parameter.
    pub enum ParameterKind { Condition = "condition", Signal = "signal", Number = "number", Time = "time" }

    /// Answer to the question for the tightest values.
    pub enum MiningOutcome {
        Found = "found", LoosestFails = "loosest-fails", TightestHolds = "tightest-holds",
        NoSupport = "no-support",
    }

    /// The direction in which a parameter is tighter.
    pub enum Tightest { Low = "low", High = "high" }
}

/// A formula: in words, its traps, and what it says about traces.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaDescription {
    /// Name of the pattern that it comes from; `null` without one.
    pub pattern: Option<String>,
    /// Formula.
    pub formula: String,
    /// The formula with parentheses around every operand, so that the precedence is visible.
    pub parenthesized: String,
    /// The formula in mathematical symbols.
    pub symbols: String,
    /// The formula in English, line by line; parts of a line above are indented. Empty if it has
    /// too many operators.
    pub words: Vec<String>,
    /// Signals that it reads, with their units.
    pub signals: Vec<Signal>,
    /// Sampling period in seconds; `null` if it is unknown.
    pub period: Option<Number>,
    /// The part of a trace that decides it at time 0; `null` if it depends on all samples up to the
    /// end.
    pub horizon: Option<FormulaHorizon>,
    /// The known traps in it.
    pub traps: Vec<FormulaTrap>,
    /// Its verdict on traces: the logs or the nominal episode, otherwise traces that were found for
    /// it.
    pub examples: Vec<FormulaExample>,
}

/// The part of a trace that decides a formula at time 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaHorizon {
    /// Number of samples; `null` if the sampling period is unknown and the formula has times, or if
    /// a bound does not fit the period.
    pub samples: Option<u64>,
    /// Time of the last one in seconds; `null` if the sampling period is unknown and the formula
    /// counts samples.
    pub seconds: Option<Number>,
}

/// A place of a formula that often means something else than its author thinks.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaTrap {
    /// Name of the trap, such as `vacuous-implication`.
    pub name: String,
    /// `warning`, or `note` for one that is often intended. `--strict` counts warnings.
    pub severity: TrapSeverity,
    /// Line of the text, from 1; `null` if it concerns the whole formula.
    pub line: Option<u64>,
    /// Column of the text in characters, from 1.
    pub column: Option<u64>,
    /// The sub-formula.
    pub formula: String,
    /// Its meaning, and why it is often not intended.
    pub why: String,
    /// Advice; `null` without a general one.
    pub instead: Option<String>,
}

impl FormulaTrap {
    /// Returns what happens at the first sample, and what to write for others.
    pub fn at_start(&self) -> String {
        let instead = self.instead.as_ref().map(|instead| format!("; for other samples, write {instead}"));
        format!("{}{}", self.why, instead.unwrap_or_default())
    }
}

/// A formula and its sub-formulas on a trace.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaExample {
    /// `log`, `episode` (of a target), `found` (by a search for an example), or `pattern` (that of
    /// a pattern).
    pub kind: ExampleKind,
    /// Name of the log or of the target; `satisfied` or `violated` for an example.
    pub name: String,
    /// Robustness at time 0.
    pub robustness: Number,
    /// Whether the formula is violated.
    pub violated: bool,
    /// Number of samples.
    pub samples: u64,
    /// Sampling period in seconds; `null` if it is unknown.
    pub period: Option<Number>,
    /// Values of the signals of the formula over time, for examples that were made for it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub values: Option<Vec<FormulaValues>>,
    /// The formula and its sub-formulas, depth first.
    pub lanes: Vec<FormulaLane>,
}

/// The values of a signal of an example.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaValues {
    /// Name.
    pub signal: String,
    /// Values, one for each sample.
    pub values: Vec<f64>,
}

/// A sub-formula over a trace.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FormulaLane {
    /// The sub-formula.
    pub formula: String,
    /// Its depth: 0 for the formula itself.
    pub depth: u64,
    /// When it holds, is violated, or is not decided, in the order of time.
    pub spans: Vec<LaneSpan>,
}

/// Samples of the same state.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LaneSpan {
    /// `holds`, `violated` (also with a window that is cut at the end), or `undecided`: not
    /// violated, but a window of the sub-formula reaches beyond the end of the trace.
    pub state: LaneState,
    /// First sample, from 0.
    pub first: u64,
    /// Last sample.
    pub last: u64,
}

/// A named pattern of requirements.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RequirementPattern {
    /// Name.
    pub name: String,
    /// The requirement in one sentence.
    pub summary: String,
    /// Formula, with its parameters in braces.
    pub formula: String,
    /// Its parameters.
    pub parameters: Vec<PatternParameter>,
    /// Where it comes from.
    pub source: String,
}

/// A parameter of a pattern.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PatternParameter {
    /// Name.
    pub name: String,
    /// `condition` (a formula), `signal` (a number over time), `number` or `time`.
    pub kind: ParameterKind,
    /// Default; `null` if it must be set.
    pub default: Option<String>,
    /// Meaning.
    pub meaning: String,
}

/// The tightest values of the parameters of a formula for which logs or runs satisfy it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Mining {
    /// Formula as given, with the names of its parameters.
    pub formula: String,
    /// The parameters.
    pub parameters: Vec<MinedParameter>,
    /// Number of traces.
    pub traces: u64,
    /// Share of the traces that must satisfy the formula.
    pub share: Number,
    /// `found`; `loosest-fails`: too few traces satisfy the formula with the loosest values;
    /// `tightest-holds`: they satisfy it with the tightest values, so that the ranges decide;
    /// `no-support`: no trace supports a value, because the condition of an implication never holds
    /// or a window is longer than the trace.
    pub outcome: MiningOutcome,
    /// The tightest values; with several parameters, the points of the Pareto front that a trace
    /// supports. Empty if the loosest values fail or no trace supports a value.
    pub points: Vec<MinedPoint>,
    /// Per trace, the tightest value of the only parameter. Empty with several parameters, or if no
    /// trace supports a value.
    pub per_trace: Vec<MinedTrace>,
    /// Which parts of the formula only the first sample of a trace decides, and what to write.
    pub traps: Vec<String>,
}

/// A parameter of a formula.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MinedParameter {
    /// Name.
    pub name: String,
    /// Least value of its range.
    pub low: Number,
    /// Greatest value of its range.
    pub high: Number,
    /// Unit of a bound of a window: `s`, `ms`, `us` or `ns`; `null` for a number, and for a bound
    /// that counts samples.
    pub unit: Option<String>,
    /// Whether the least or the greatest value is the tightest: `low` or `high`.
    pub tightest: Tightest,
    /// Step of the values; `null` if they are exact to the next number.
    pub resolution: Option<Number>,
}

/// Values of the parameters for which the traces satisfy the formula.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MinedPoint {
    /// Values, in the order of the parameters.
    pub values: Vec<Number>,
    /// Formula with these values.
    pub formula: String,
    /// Least robustness of the traces that satisfy it.
    pub robustness: Number,
    /// Number of traces that satisfy it.
    pub satisfied: u64,
    /// Number of those that support it: in the others, the condition of an implication never holds,
    /// or windows are cut.
    pub support: u64,
    /// Number of those that are shorter than the windows of the formula, which are cut at their
    /// end.
    pub cut: u64,
    /// The trace that decides the values: it satisfies the formula, and a tighter parameter
    /// violates it most; `null` if the ranges decide.
    pub decisive: Option<String>,
    /// The time at which it decides in seconds, or its sample if it has no times.
    pub decisive_time: Option<Number>,
    /// The sample at which it decides.
    pub decisive_sample: Option<u64>,
    /// For each parameter, how many traces more violate the formula if it alone is one step
    /// tighter; `null` at the end of its range.
    pub violated_if_tighter: Vec<Option<u64>>,
}

/// The tightest value of a parameter for one trace.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MinedTrace {
    /// Name of the trace.
    pub name: String,
    /// The value; `null` if the trace violates the formula with the loosest one.
    pub value: Option<Number>,
    /// Whether the trace contains the windows of the formula with the mined value, and the
    /// condition of each implication holds at some sample.
    pub supports: bool,
}
