//! The results that Mishandle prints and returns: one type per document.
//!
//! Each result is defined here and nowhere else. From these types come the output of `--json`, the
//! text output, the classes of the Python package, the reference page of the documents and their
//! JSON Schemas. The doc comment of a field is its description on that page.
//!
//! - [`Subject`]: what was asked about: target, controller, noise, space. Most documents start with
//!   it.
//! - [`Evaluation`], [`Falsification`], [`Margin`], [`Metamorphic`], [`Risk`], [`Simulation`]: the
//!   answers to questions.
//! - [`Explanation`], [`Masking`], [`Replay`], [`Counterexamples`], [`Regression`], [`Comparison`]:
//!   about recorded simulations.
//! - [`Check`]: the requirements of a file, for several controllers.
//! - [`Campaign`], [`RunSummary`], [`Evidence`], [`EvidenceVerification`]: about several runs.
//! - [`Training`], [`TrainingPlan`], [`Hardening`], [`GuardTuning`], [`Controller`]: about
//!   controllers.
//! - [`Demonstrations`]: a data set of recorded episodes.
//! - [`Task`], [`Listing`], [`Target`], [`Search`]: what can be named.
//! - [`FormulaDescription`], [`RequirementPattern`], [`Mining`]: about formulas.
//! - [`WithoutVerdict`]: the simulations of a question without a verdict.
//! - [`ProtocolCheck`]: about a simulator that is a program.
//! - [`Number`], [`Seed`], [`Named`]: values that JSON cannot hold as they are.
//! - [`Remedy`]: what helps against an error, in no document.
//!
//! With the feature `schema`, `Document` lists the documents with their schemas. The program needs
//! none, so only `cargo xtask results` and a test of the command line build it. This crate contains
//! no physics, reads no files and formats no text.
//!
//! # Example
//! ```
//! use mishandle_results::Estimate;
//! let rate = Estimate { value: Some(0.5), low: Some(0.1), high: Some(f64::INFINITY), n: 4 };
//! assert_eq!(serde_json::to_string(&rate).unwrap(), r#"{"value":0.5,"low":0.1,"high":"inf","n":4}"#);
//! ```

mod answer;
mod axis_rates;
mod bisection;
mod campaign;
mod catalog;
mod check;
mod comparison;
mod controller;
mod counterexamples;
mod demonstrations;
mod document;
mod ends;
mod estimate;
mod evaluation;
mod evidence;
mod explanation;
mod falsification;
mod guard;
mod hardening;
mod margin;
mod metamorphic;
mod modes;
mod monitor;
mod physics;
mod protocol;
mod reasons;
mod regression;
mod remedy;
mod replay;
mod requirements;
mod risk;
mod run_difference;
mod runs;
#[cfg(feature = "schema")]
mod schema;
mod screening;
mod sequential;
mod simulation;
mod subject;
mod training;
mod values;
mod word;

pub use answer::{Answer, OtherQuestion};
pub use axis_rates::{AxisRate, AxisRates, PairRate, RateBin, ValueRange};
pub use bisection::{BisectedCandidate, BisectedResult, Bisection};
pub use campaign::{Campaign, CampaignRun};
pub use catalog::{
    Axis, Formula, InitialAxis, Listing, Note, Search, SearchOption, Signal, Space, Target, Task,
};
pub use check::{
    Check, CheckCell, CheckCounterexample, CheckCounts, CheckRun, CheckRunKind, CheckVerdict,
    CheckedController, CheckedRequirement, CheckedValue, Severity,
};
pub use comparison::{ComparedPair, ComparedRun, Comparison, PairedMeans, PairedRates};
pub use controller::{ActionInterface, Controller, ControllerExport, ControllerImport, Validation};
pub use counterexamples::{Counterexamples, ExportedCounterexample, Exports, Minimized};
pub use demonstrations::Demonstrations;
pub use document::{SCHEMA, Versioned};
pub use ends::{EndCounts, Vacuous, WithoutVerdict};
pub use estimate::{Estimate, QUANTILES, Quantile, Repeats};
pub use evaluation::{
    BoxPoint, Broken, Control, CornerPoint, Corners, Evaluation, Metrics, ScreenedFailure, StartRegion,
};
pub use evidence::{
    Evidence, EvidenceCheck, EvidenceRun, EvidenceSigner, EvidenceVerification, ReplayedSimulation,
    VerifiedCheck, VerifiedRun,
};
pub use explanation::{
    AxesAtNominal, AxisAtNominal, Conjunct, Decision, EvaluatedCount, Explanation, Instant, LogExplanation,
    LogExplanations, MaskedConjunct, Masking, PathStep, Predicate, SignalRow, SignalTable, Window,
};
pub use falsification::{
    Cause, Falsification, Requirement, SearchValue, SmoothRegion, Trial, TrialEnd, Unevaluated, Violation,
};
pub use guard::{AlarmLead, GuardAlarms, GuardCurvePoint, GuardTuning};
pub use hardening::{
    HardenedArchive, HardenedCorners, HardenedMargin, HardenedMeasure, HardenedMode, HardenedSearch,
    Hardening, HardeningRound, ModeChange,
};
pub use margin::{CategoryMargin, Level, Margin, Norms, Witness};
pub use metamorphic::{
    BrokenPair, Metamorphic, MetamorphicRelation, PairCase, SmallestChange, SourceRange, VerdictCounts,
};
pub use modes::{Coverage, FailureMode, FirstInMode, FoundMode, Modes, UnseenModes};
pub use monitor::{
    FirstViolation, LogPredicate, LogVerdict, LogViolation, Monitor, MonitorChange, MonitorEvent, NoVerdict,
    Windows, WorstPart,
};
pub use physics::{CheckedFailure, PhysicsCheck, SolverChange, SolverSimulation};
pub use protocol::{ProtocolCheck, ProtocolFinding};
pub use reasons::EndReasons;
pub use regression::{BaselineTest, Regression, RegressionResult, RegressionTest};
pub use remedy::{Choice, Command, Key, Recorded, Remedy, Words};
pub use replay::Replay;
pub use requirements::{
    ExampleKind, FormulaDescription, FormulaExample, FormulaHorizon, FormulaLane, FormulaTrap, FormulaValues,
    LaneSpan, LaneState, MinedParameter, MinedPoint, MinedTrace, Mining, MiningOutcome, ParameterKind,
    PatternParameter, RequirementPattern, Tightest, TrapSeverity,
};
pub use risk::{
    AxisDistribution, Chain, Exploration, Importance, MonteCarlo, Probability, Risk, RiskFailure, Splitting,
};
pub use run_difference::{
    ChangedVerdict, DifferingFact, DifferingResult, DifferingRun, DifferingSimulations, Quantity,
    RunDifference,
};
pub use runs::{RelationCounts, RunFacts, RunShown, RunSummary};
#[cfg(feature = "schema")]
pub use schema::Document;
pub use screening::{Confirmed, Finding, Screening};
pub use sequential::{ExpectedPairs, Measure, SampleSize, Sequential, StopDecision};
pub use simulation::{Noise, RequirementVerdict, Simulation};
pub use subject::{AxisFacts, AxisValues, GuardFacts, NeededAxis, Offered, Subject};
pub use training::{ScenarioRates, Training, TrainingPlan, TrainingTime};
pub use values::{Named, Number, Scenario, Seed};

pub(crate) use values::{number, optional};
