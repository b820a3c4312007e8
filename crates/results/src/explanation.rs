use serde::Serialize;

use crate::{AxisFacts, BoxPoint, GuardFacts, LogVerdict, NoVerdict, Number, Scenario, Seed, Signal};

/// When, where and by which predicate a simulation violates or satisfies the requirement. Samples
/// count from 0.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Explanation {
    /// Path of the run file; missing within the document of `simulate`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target of the run.
    pub target: String,
    /// Guard of the controller; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// Requirement.
    pub formula: String,
    /// Robustness of the requirement.
    pub robustness: Number,
    /// Whether the requirement is violated. At a robustness of 0, `<=`, `>=` and `==` hold, and
    /// `<`, `>` and `!=` do not.
    pub violated: bool,
    /// Why the simulation ended so, in the words of the target or its controller; missing if they
    /// said nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The cause of the verdict.
    #[serde(flatten)]
    pub decision: Decision,
    /// The failure with each axis alone at its nominal value; left out by other commands than
    /// `show`, if `report.axes` is 0, if the requirement is satisfied, and without an axis off
    /// nominal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axes_at_nominal: Option<AxesAtNominal>,
    /// `corner` or `center` for a simulation at the corners of the initial box, trial 2 of an
    /// evaluation; otherwise `null`.
    pub point: Option<BoxPoint>,
    /// The axes of the scenario space.
    pub space_axes: Vec<AxisFacts>,
    /// Time between two samples, s.
    pub control_dt: f64,
}

/// A failure simulated again with each axis alone at its nominal value and the same seed. What an
/// axis removes with others, and what it does with other seeds, is not in it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxesAtNominal {
    /// The simulated axes, that with the largest robustness first.
    pub axes: Vec<AxisAtNominal>,
    /// Number of axes off nominal that were left out because of the limit: those nearest to
    /// nominal.
    pub left_out: u64,
    /// Why the other axes were not simulated; missing if all were.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// A failure with one axis at its nominal value.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxisAtNominal {
    /// The axis.
    pub axis: String,
    /// Its value in the failure.
    pub value: f64,
    /// Its nominal value, with which the simulation was repeated.
    pub nominal: f64,
    /// Robustness of that simulation; `null` without a verdict.
    pub robustness: Option<Number>,
    /// Whether it still violates the requirement; `null` without a verdict.
    pub violated: Option<bool>,
}

/// The instants, predicates and parts that decide a requirement on a trace.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Decision {
    /// First sample after which nothing can change whether the requirement is satisfied; `null` if
    /// the trace does not decide it.
    pub decided: Option<Instant>,
    /// Decisive predicate; `null` if an operator has an empty window.
    pub predicate: Option<Predicate>,
    /// Samples at which the operator above evaluates the predicate; `null` without a predicate.
    pub window: Option<Window>,
    /// Sub-formulas from the requirement to the predicate.
    pub path: Vec<PathStep>,
    /// Conjuncts of the requirement.
    pub conjuncts: Vec<Conjunct>,
    /// The explanation in sentences.
    pub sentences: Vec<String>,
    /// Signals of the requirement at some samples; `null` without a predicate.
    pub signals: Option<SignalTable>,
}

/// When, where and by which predicate a log violates or satisfies formulas.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LogExplanations {
    /// Each formula on each log, worst first, as in the document of `monitor`.
    pub explanations: Vec<LogExplanation>,
    /// Each formula on each log that has no verdict, as in the document of `monitor`.
    pub no_verdict: Vec<NoVerdict>,
}

/// A verdict on a log and what decides it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LogExplanation {
    /// The verdict.
    pub verdict: LogVerdict,
    /// Time between two samples, s.
    pub period: f64,
    /// The cause of the verdict, with its times.
    #[serde(flatten)]
    pub decision: Decision,
}

/// A sample and its time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Instant {
    /// Sample, from 0.
    pub sample: u64,
    /// Its time, s.
    pub time: f64,
}

/// A decisive predicate at its sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Predicate {
    /// Text.
    pub formula: String,
    /// Decisive sample and its time.
    #[serde(flatten)]
    pub at: Instant,
    /// `<=`, `>=`, `<`, `>`, `==` or `!==`.
    pub comparison: String,
    /// Texts of its two sides.
    pub sides: [String; 2],
    /// Their values at the sample.
    pub values: [Number; 2],
    /// Robustness of the predicate at the sample.
    pub robustness: Number,
    /// Whether the formula requires the predicate to be false.
    pub negated: bool,
}

/// The samples at which an operator evaluates a predicate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Window {
    /// First and last of them.
    pub samples: [u64; 2],
    /// Number of them that violate the predicate and the whole operand of the operator.
    pub violated: u64,
    /// First of these; `null` if there are none.
    pub first_violated: Option<u64>,
    /// Last of these; `null` if there are none.
    pub last_violated: Option<u64>,
}

/// A sub-formula on the path to the decisive predicate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PathStep {
    /// Text.
    pub formula: String,
    /// Operator; `null` for a signal or a number.
    pub operator: Option<String>,
    /// Sample at which it is evaluated, and its time.
    #[serde(flatten)]
    pub at: Instant,
    /// First and last sample of its window; `null` without one.
    pub window: Option<[u64; 2]>,
    /// Robustness at the sample.
    pub robustness: Number,
}

/// A conjunct of a requirement.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Conjunct {
    /// Text.
    pub formula: String,
    /// Robustness of the requirement with this conjunct as the only operand of each `and` above it.
    pub robustness: Number,
    /// As `decided` of the explanation, for this conjunct.
    pub decided: Option<Instant>,
}

/// Values of signals at some samples: up to the decisive one, at the instant that decides the
/// requirement, and at the end.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SignalTable {
    /// The signals: up to four of those that the requirement reads, those of the predicate first.
    pub columns: Vec<Signal>,
    /// The samples.
    pub rows: Vec<SignalRow>,
}

/// Values of signals at a sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SignalRow {
    /// Sample, from 0.
    pub sample: u64,
    /// One value per column; `null` if the trace does not have it.
    pub values: Vec<Option<Number>>,
}

/// Which conjuncts of a requirement set the robustness of a run and which ones fail.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Masking {
    /// Path of the run file.
    pub run: String,
    /// Requirement.
    pub formula: String,
    /// Simulations that satisfy the requirement. None are evaluated if the target cannot be
    /// simulated.
    pub satisfied: EvaluatedCount,
    /// Simulations that violate the requirement.
    pub violated: EvaluatedCount,
    /// Conjuncts of the requirement.
    pub conjuncts: Vec<MaskedConjunct>,
}

/// How many simulations were evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EvaluatedCount {
    /// Number of evaluated simulations.
    pub evaluated: u64,
    /// Number of simulations of the run.
    pub total: u64,
}

/// A conjunct over the simulations of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MaskedConjunct {
    /// Text.
    pub formula: String,
    /// Number of satisfied simulations whose robustness it sets.
    pub sets_satisfied: u64,
    /// Number of violated simulations whose robustness it sets.
    pub sets_violated: u64,
    /// Number of simulations that violate the requirement with this conjunct as the only operand of
    /// each `and` above it.
    pub fails: u64,
}
