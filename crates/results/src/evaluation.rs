use serde::Serialize;

use crate::word::words;
use crate::{
    AxisRates, EndCounts, EndReasons, Estimate, Number, Requirement, Scenario, Screening, Seed, Sequential,
    Subject, Violation, WithoutVerdict,
};

/// Success rate, dangerous behavior rate and completion time of a controller.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Evaluation {
    /// Path of the run file; missing if none is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target, controller, noise and space of the evaluation.
    #[serde(flatten)]
    pub subject: Subject,
    /// Region of the initial states: `whole` or `reachable`.
    #[serde(rename = "box")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub starts: StartRegion,
    /// Whether any initial state was rejected as unreachable and drawn again.
    pub leaves_out_starts: bool,
    /// Whether all simulations of the plan are finished; `false` after an interruption, exit
    /// code 130.
    pub is_complete: bool,
    /// The random simulations without a verdict on success.
    pub without_verdict: WithoutVerdict,
    /// The metrics.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// Why all simulations satisfy the formula and ask nothing of the controller; `null` if one
    /// asks something.
    pub asks_nothing: Option<String>,
    /// How the first random simulation violates each of the formulas `success`, `strict` and
    /// `careful`; without those that no simulation with a recorded trace violates.
    pub breaks: Vec<Broken>,
    /// Results at the corners and the center of the initial box; `null` if the space has no numeric
    /// axis of kind `start`.
    pub corners: Option<Corners>,
    /// Success rates over the values of the axes; missing for fewer than 50 random simulations,
    /// with screening, and without any verdict or axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis_rates: Option<AxisRates>,
    /// The rule that ends the evaluation; missing without one. The intervals of the rates then hold
    /// at any time, and the completion time has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequential: Option<Sequential>,
    /// The control arm; missing if no axis is varied but initial states, and if it is switched off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<Control>,
    /// Each named requirement over the random simulations; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirements: Option<Vec<Requirement>>,
    /// Reasons that the target gave for the ends of simulations, by end; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Vec<EndReasons>>,
    /// Counts of the screening; missing without it. The rates are then those of a two-phase sample:
    /// see `gpu.md`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
    /// With screening, up to 100 simulations of MuJoCo C without success; missing without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failures: Option<Vec<ScreenedFailure>>,
}

/// A formula that a random simulation violates.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Broken {
    /// Name of the formula.
    pub formula: String,
    /// Number of the simulation.
    pub simulation: u32,
    /// When and how it violates the formula.
    #[serde(flatten)]
    pub violation: Violation,
}

words! {
    /// Region from which an evaluation draws initial states.
    #[derive(Default)]
    pub enum StartRegion { #[default] Whole = "whole", Reachable = "reachable" }

    /// A point of the initial box that an evaluation tests besides random scenarios.
    #[derive(Default)]
    pub enum BoxPoint { #[default] Corner = "corner", Center = "center" }
}

/// The same starts and seeds with every other axis at nominal: what the controller does without the
/// perturbations of the space. Simulation i of the arm is paired with simulation i of the space.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Control {
    /// Number of the trial that holds the simulations of the arm in the run file.
    pub trial: u32,
    /// Axes that the arm fixes at their nominal values.
    pub nominal: Vec<String>,
    /// Number of simulations of the arm; 1 if all of them would be the same.
    pub simulations: u64,
    /// Success rate of the arm over the pairs, with an interval as that of the space; of a single
    /// simulation, its outcome without one. As there, a simulation without a verdict is not a
    /// success. `null` if none has a verdict.
    pub success_rate: Estimate,
    /// Success rate in the space minus that of the arm, with Newcombe's interval for pairs; with a
    /// rule that ends the evaluation, with one that holds at any time.
    pub difference: Estimate,
    /// Number of pairs that fail only in the space, or have no verdict only there: the perturbation
    /// is the cause.
    pub fails_only_in_space: u64,
    /// Number of pairs that fail, or have no verdict, only in the arm.
    pub fails_only_in_control: u64,
    /// Two-sided p-value of "no difference": exact McNemar test, or one that holds at any time.
    pub p_value: f64,
    /// Number of pairs that do not count, because the target cannot start from a scenario, or no
    /// simulation of the arm has a verdict.
    pub left_out: u64,
    /// Simulations of the arm without a verdict, by reason.
    pub without_verdict: EndCounts,
}

/// A simulation without success.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ScreenedFailure {
    /// Number of the simulation.
    pub number: u32,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Random seed.
    pub seed: Seed,
    /// Robustness of the success formula; `null` without a verdict.
    pub robustness: Option<Number>,
}

/// Metrics of a controller over the simulations from random scenarios, without the corners.
///
/// Diverged, invalid, crashed and undecided simulations count as failures in the success rates,
/// because excluding them would reward a controller that breaks the physics. They do not count as
/// falsified. Without any verdict the rates are `null`, because nothing was measured. A diverged or
/// invalid simulation is excluded from the dangerous behavior rate and the task completion time.
///
/// A scenario from which the target cannot start says nothing about the controller, so no rate
/// includes it; `failed` does.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Metrics {
    /// Number of simulations from random scenarios, without the corners.
    pub simulations: u64,
    /// Number of these that diverged. With screening, this and the next three keys count
    /// simulations of MuJoCo C.
    pub diverged: u64,
    /// Number of these that ended because the controller or the environment returned a value that
    /// is not finite.
    pub invalid: u64,
    /// Number of these that could not start or failed: crash, invalid answer or time limit.
    pub failed: u64,
    /// Number of these that could not start.
    pub invalid_starts: u64,
    /// Number of others that left success undecided.
    pub undecided: u64,
    /// Number of others that left strict success undecided.
    pub strict_undecided: u64,
    /// Number of others that left careful success undecided; missing if the target has no such
    /// formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub careful_undecided: Option<u64>,
    /// Number of simulations that violate the requirement.
    pub violations: u64,
    /// Number of the started simulations without a verdict on the requirement.
    pub requirement_undecided: u64,
    /// Fraction of the started simulations that violate the requirement, with its Wilson interval.
    /// Those without a verdict count as failures in the upper bound only.
    pub violation_rate: Estimate,
    /// Fraction of the started simulations that satisfy the success formula, with its Wilson
    /// interval.
    pub success_rate: Estimate,
    /// Fraction of the started simulations that satisfy the success formula and the strict formula,
    /// with its Wilson interval; missing if the target has no such formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strict_success_rate: Option<Estimate>,
    /// Fraction of the started simulations that satisfy the success formula and the formula
    /// `careful`, with its Wilson interval; missing if the target has no such formula, and with
    /// screening.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub careful_success_rate: Option<Estimate>,
    /// Mean fraction of control steps that violate the formula `safe`, over the simulations that
    /// neither diverged nor were invalid, with a betting interval; missing if the target has no
    /// such formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dangerous_behavior_rate: Option<Estimate>,
    /// Fraction of the same simulations in which any control step violates the formula `safe`, with
    /// its Wilson interval; missing if the target has no such formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dangerous_episode_rate: Option<Estimate>,
    /// Mean number of control steps until the formula `completion` first holds with its whole
    /// window inside the episode, over the successful simulations that complete, with a bootstrap
    /// interval; its bounds are `null` for fewer than 10 values or if all values are equal. Missing
    /// if the target has no such formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task_completion_time: Option<Estimate>,
}

impl Metrics {
    /// Returns the simulations without a verdict on success.
    pub fn ends(&self) -> EndCounts {
        let Metrics { simulations, diverged, invalid, failed, invalid_starts, undecided, .. } = *self;
        EndCounts {
            simulations: simulations - invalid_starts,
            diverged,
            invalid,
            failed: failed - invalid_starts,
            undecided,
            invalid_starts,
        }
    }
}

/// Results at the corners and the center of the initial box. They are counts of chosen points, so
/// they have no intervals.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Corners {
    /// Number of simulations per point.
    pub seeds: u32,
    /// Number of corners that count: those from which the target can start, with
    /// `evaluate.box = "reachable"` the reachable ones.
    pub n: u64,
    /// Number of these at which no simulation has a verdict. They do not count as successes.
    pub without_verdict: u64,
    /// Number of these at which all simulations succeed.
    pub succeeding: u64,
    /// Number of these at which all simulations succeed strictly; `null` without a strict formula.
    pub strictly_succeeding: Option<u64>,
    /// Number of these at which all simulations succeed carefully; missing without such a formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub carefully_succeeding: Option<u64>,
    /// Whether all simulations at the center succeed; `null` if it does not count, or none of them
    /// has a verdict.
    pub center_succeeds: Option<bool>,
    /// Whether all simulations at the center succeed strictly; `null` if it does not count, none of
    /// them has a verdict, and without a strict formula.
    pub center_strictly_succeeds: Option<bool>,
    /// Whether all simulations at the center succeed carefully; missing if it does not count, none
    /// of them has a verdict, and without such a formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center_carefully_succeeds: Option<bool>,
    /// The corners, then the center.
    pub points: Vec<CornerPoint>,
}

/// The simulations of a corner or of the center.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CornerPoint {
    /// `corner` or `center`.
    pub kind: BoxPoint,
    /// Value by axis name.
    pub scenario: Scenario,
    /// Whether success is possible from there; `null` if this is unknown.
    pub reachable: Option<bool>,
    /// Whether the point counts.
    pub counts: bool,
    /// Number of simulations.
    pub n: u32,
    /// Number of these that cannot start, which decide nothing; missing if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    pub invalid_starts: u32,
    /// Number of these that succeed.
    pub successes: u32,
    /// Number of these that succeed strictly; `null` without a strict formula.
    pub strict_successes: Option<u32>,
    /// Number of these that succeed carefully; missing without such a formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub careful_successes: Option<u32>,
    /// Number of simulations that diverged. Like the next three, none of them is a success.
    pub diverged: u32,
    /// Number of simulations that ended in a value that is not finite.
    pub invalid: u32,
    /// Number of simulations that could not start or failed: crash, invalid answer or time limit.
    pub failed: u32,
    /// Number of other simulations that left success undecided.
    pub undecided: u32,
}

impl CornerPoint {
    /// Returns how the simulations ended.
    pub fn ends(&self) -> EndCounts {
        EndCounts {
            simulations: self.started().into(),
            diverged: self.diverged.into(),
            invalid: self.invalid.into(),
            failed: (self.failed - self.invalid_starts).into(),
            undecided: self.undecided.into(),
            invalid_starts: self.invalid_starts.into(),
        }
    }

    /// Returns the number of simulations that decide about the point: all but the invalid starts.
    pub fn started(&self) -> u32 {
        self.n - self.invalid_starts
    }

    /// Returns whether any simulation has a verdict.
    pub fn has_verdict(&self) -> bool {
        self.verdicts() > 0
    }

    /// Returns the number of simulations with a verdict.
    pub fn verdicts(&self) -> u32 {
        self.n - (self.diverged + self.invalid + self.failed + self.undecided)
    }

    /// Returns the number of simulations that violate success.
    pub fn violations(&self) -> u32 {
        self.verdicts() - self.successes
    }
}

fn is_zero(count: &u32) -> bool {
    *count == 0
}
