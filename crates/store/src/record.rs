//! What a run records: trials, and the simulations in them.

use crate::trace_blob::Trace;

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
pub struct Trial {
    /// Number of the trial, unique within the run.
    pub number: u32,
    /// Seed of the trial.
    pub seed: u64,
    /// How it stands.
    pub status: TrialStatus,
}

/// How an episode ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum End {
    /// It ran to its last control step.
    Horizon,
    /// It was stopped, since its verdict was decided.
    Stopped {
        /// The control step after which it stopped.
        step: u32,
    },
    /// The physics diverged.
    Diverged {
        /// The control step in which it did.
        step: u32,
    },
    /// A formula has no finite value on its trace.
    Undefined {
        /// The sample at which it has none.
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
    /// Seed of the simulation's random numbers; any of the 2⁶⁴.
    pub seed: u64,
    /// The search's point of \[0, 1\]^d: one number per axis, or none if no search proposed it.
    pub unit_point: Vec<f64>,
    /// The initial configuration: one number per axis, in the axis' unit.
    pub initial_configuration: Vec<f64>,
    /// Robustness of the run's formula, ±infinity included; `None` if it is undecided.
    pub robustness: Option<f64>,
    /// How the episode ended.
    pub end: End,
    /// Control steps that were simulated.
    pub steps: u32,
    /// The further verdicts that the header names, one each; `None` where there is nothing to say.
    pub verdicts: Vec<Option<f64>>,
    /// [`trace_digest`](crate::trace_digest) of the trace, so that a replay can be compared with it even if
    /// the trace is not stored.
    pub trace_digest: Option<u128>,
}

/// What is recorded of a simulation: its row and, if wanted, its trace.
#[derive(Debug, Clone, PartialEq)]
pub struct SimulationRecord {
    /// The row.
    pub simulation: Simulation,
    /// The trace, with the header's signals as its columns.
    pub trace: Option<Trace>,
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
    pub trial: Trial,
    /// Its simulations, counted.
    pub counts: Counts,
    /// The least robustness among those that are decided.
    pub minimum_robustness: Option<f64>,
}
