//! Trials and simulations of a run.

use crate::row::{end_columns, end_from_columns};
use crate::trace_blob::StoredTrace;

/// Status of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TrialStatus {
    /// The trial has started and not ended: the run is in progress, or was killed.
    Running,
    /// The trial found a counterexample.
    Falsified,
    /// The trial spent its budget without a counterexample.
    BudgetSpent,
    /// The search ended the trial before the budget was spent.
    Converged,
}

/// One seeded search with a budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TrialRecord {
    /// Number of the trial, unique within the run.
    pub number: u32,
    /// Seed of the trial.
    pub seed: u64,
    /// Status of the trial.
    pub status: TrialStatus,
}

/// End of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SimulationEnd {
    /// The episode ran to its last control step.
    Completed,
    /// The target terminated the episode.
    Terminated {
        /// The control step after which the episode ended.
        step: u32,
    },
    /// The monitor stopped the episode, because the verdict was decided.
    Stopped {
        /// The control step after which the episode stopped.
        step: u32,
    },
    /// The physics diverged.
    Diverged {
        /// The control step in which the physics diverged.
        step: u32,
    },
    /// A formula has no finite value on the trace.
    Undefined {
        /// The sample at which the formula is undefined.
        step: u32,
    },
    /// The controller returned an action that is not finite.
    InvalidAction {
        /// The control step of the action.
        step: u32,
        /// Index of the first value of the action that is not finite.
        index: u32,
    },
    /// The target returned an observation that is not finite.
    InvalidObservation {
        /// The control step after which it was observed; 0 is the initial state.
        step: u32,
        /// Index of the first value of the observation that is not finite.
        index: u32,
    },
    /// The target returned a reward that is not finite.
    InvalidReward {
        /// The control step of the reward.
        step: u32,
        /// Index of the first reward term that is not finite.
        index: u32,
    },
    /// The target returned a signal that is not finite.
    InvalidSignal {
        /// The sample of the trace.
        step: u32,
        /// Index of the first signal that is not finite.
        index: u32,
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

impl SimulationEnd {
    /// Returns the name of the end in the run file, such as `completed`.
    pub fn name(self) -> &'static str {
        let (name, _, _) = end_columns(self);
        name
    }

    /// Returns the end with this name, control step and index, as the columns `ended`, `end_step`
    /// and `end_index` of a run file contain them; `None` if they are not those of an end.
    pub fn from_name(name: &str, step: Option<u32>, index: Option<u32>) -> Option<SimulationEnd> {
        end_from_columns(name, step, index)
    }

    /// Returns the control step or sample of the end; `None` for an end without one.
    pub fn step(self) -> Option<u32> {
        let (_, step, _) = end_columns(self);
        step
    }

    /// Returns the index of the value that is not finite; `None` for an end without one.
    pub fn index(self) -> Option<u32> {
        let (_, _, index) = end_columns(self);
        index
    }
}

/// One episode and its robustness: a row of the run.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulation {
    /// Number of the trial that it belongs to.
    pub trial: u32,
    /// Number of the simulation within its trial, from 1.
    pub number: u32,
    /// Random seed of the simulation; any `u64`.
    pub seed: u64,
    /// The search's point of \[0, 1\]^d: one number per axis, or empty if no search proposed it.
    pub unit_point: Vec<f64>,
    /// The scenario: one value per axis, in the axis' unit; `None` for a value drawn from its
    /// random stream.
    pub scenario: Vec<Option<f64>>,
    /// Robustness of the requirement, possibly ±infinity; `None` if undecided. Its sign is the
    /// verdict, also that of a zero: see [`Simulation::is_violated`].
    pub robustness: Option<f64>,
    /// Lower bound of the robustness of the complete episode; equal to `robustness` if the episode
    /// is complete.
    pub robustness_low: Option<f64>,
    /// Upper bound of the robustness of the complete episode; equal to `robustness` if the episode
    /// is complete.
    pub robustness_high: Option<f64>,
    /// Threshold of the robustness at which the monitor stops the episode; `None` without early
    /// stopping.
    pub stop_threshold: Option<f64>,
    /// End of the episode.
    pub end: SimulationEnd,
    /// Number of simulated control steps.
    pub steps: u32,
    /// One value per verdict in the header; `None` where it does not apply.
    pub verdicts: Vec<Option<f64>>,
    /// Why it ended so, in the words of the target or its controller; empty if they said nothing.
    /// At most 4096 bytes are stored.
    ///
    /// [`RunFile::simulations`](crate::RunFile::simulations) does not read it, as the trace.
    pub reason: String,
    /// [`trace_digest`](crate::trace_digest) of the trace. A replay can be compared with it even if
    /// the trace is not stored.
    pub trace_digest: Option<u128>,
    /// The trace, with one column per signal of the header; `None` if it is not stored.
    ///
    /// [`RunFile::simulations`](crate::RunFile::simulations) does not read the trace and returns
    /// `None`; [`RunFile::simulation`](crate::RunFile::simulation) reads it.
    pub trace: Option<StoredTrace>,
}

impl Simulation {
    /// Returns whether the simulation violates the requirement: its robustness is negative or −0.0.
    pub fn is_violated(&self) -> bool {
        self.robustness.is_some_and(f64::is_sign_negative)
    }
}

/// Numbers of simulations by result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// All simulations.
    pub simulations: u64,
    /// Simulations that violate the requirement.
    pub falsified: u64,
    /// Simulations without a robustness, for any reason.
    pub undecided: u64,
    /// Simulations whose physics diverged.
    pub diverged: u64,
    /// Simulations that ended because controller or target returned a value that is not finite: an
    /// invalid action, observation, reward or signal.
    pub invalid: u64,
}

/// A trial with statistics of its simulations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrialSummary {
    /// The trial.
    pub trial: TrialRecord,
    /// Numbers of its simulations.
    pub counts: Counts,
    /// Minimum robustness of its decided simulations.
    pub minimum_robustness: Option<f64>,
}
