//! What a run records: trials, and the simulations in them.

use crate::trace_blob::StoredTrace;

/// How a trial stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TrialStatus {
    /// It has begun and not ended: the run goes on, or was killed.
    Running,
    /// It found a violation.
    Falsified,
    /// It spent its budget without one.
    BudgetSpent,
    /// The search ended it before the budget was spent.
    Converged,
}

/// One seeded search with a budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrialRecord {
    /// Number of the trial, unique within the run.
    pub number: u32,
    /// Seed of the trial.
    pub seed: u64,
    /// How it stands.
    pub status: TrialStatus,
}

/// How an episode ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SimulationEnd {
    /// It ran to its last control step.
    Completed,
    /// The target ended it by its own rule.
    Terminated {
        /// The control step after which it ended.
        step: u32,
    },
    /// The monitor stopped it, because the verdict was decided.
    Stopped {
        /// The control step after which it stopped.
        step: u32,
    },
    /// The physics diverged.
    Diverged {
        /// The control step in which it diverged.
        step: u32,
    },
    /// A formula has no finite value on its trace.
    Undefined {
        /// The sample at which the formula is undefined.
        step: u32,
    },
    /// The controller returned an action that the target cannot apply.
    InvalidAction {
        /// The control step of the action.
        step: u32,
    },
    /// The target cannot start from the scenario.
    InvalidScenario,
    /// The target or its controller failed.
    Crashed {
        /// The control step in which it failed.
        step: u32,
    },
    /// The target or its controller took too long.
    TimedOut {
        /// The control step in which it took too long.
        step: u32,
    },
}

/// One episode and its robustness: a row of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Number of the trial that it belongs to.
    pub trial: u32,
    /// Number of the simulation within its trial, from 1.
    pub number: u32,
    /// Seed of the simulation's random numbers; any `u64`.
    pub seed: u64,
    /// The search's point of \[0, 1\]^d: one number per axis, or empty if no search proposed it.
    pub unit_point: Vec<f64>,
    /// The scenario: one value per axis, in the axis' unit; `None` is a random draw left to its stream.
    pub scenario: Vec<Option<f64>>,
    /// Robustness of the run's formula, ±infinity included; `None` if it is undecided.
    pub robustness: Option<f64>,
    /// Lower bound of the robustness of the whole episode; equal to `robustness` if the episode is whole.
    pub robustness_low: Option<f64>,
    /// Upper bound of the robustness of the whole episode; equal to `robustness` if the episode is whole.
    pub robustness_high: Option<f64>,
    /// The threshold at which the monitor was to stop the episode; `None` if it was not to.
    pub stop_threshold: Option<f64>,
    /// How the episode ended.
    pub end: SimulationEnd,
    /// Control steps that were simulated.
    pub steps: u32,
    /// One value per verdict that the header names; `None` where it does not apply.
    pub verdicts: Vec<Option<f64>>,
    /// [`trace_digest`](crate::trace_digest) of the trace, so that a replay can be compared even if the trace is
    /// not stored.
    pub trace_digest: Option<u128>,
    /// The trace, with the header's signals as its columns; `None` if it is not stored.
    ///
    /// [`RunFile::simulations`](crate::RunFile::simulations) does not read it and leaves `None`;
    /// [`RunFile::simulation`](crate::RunFile::simulation) reads it.
    pub trace: Option<StoredTrace>,
}

/// How many simulations there are, and of which kind.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// All of them.
    pub simulations: u64,
    /// Those with a robustness below 0.
    pub falsified: u64,
    /// Those without a robustness.
    pub undecided: u64,
    /// Those in which the physics diverged.
    pub diverged: u64,
}

/// A trial and what its simulations amount to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrialSummary {
    /// The trial.
    pub trial: TrialRecord,
    /// Its simulations, counted.
    pub counts: Counts,
    /// The least robustness among those that are decided.
    pub minimum_robustness: Option<f64>,
}
