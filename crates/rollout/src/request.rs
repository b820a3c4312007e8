use mishandle_stl::Trace;

use crate::{Scenario, Seed, Verdict};

/// One simulation to run: what is asked for, before anything is known of how it goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Number of its trial, from 1.
    pub trial: u32,
    /// Its number within the trial, from 1.
    pub number: u32,
    /// The search's point of \[0,1\]^d; empty if no search chose the scenario.
    pub unit_point: Vec<f64>,
    /// A value for each axis of the system's space, SI units.
    pub scenario: Scenario,
    /// Key of everything random in the simulation.
    pub seed: Seed,
    /// Whether the verdict shall hold the least robustness of each sub-formula of the requirement.
    pub wants_subformulas: bool,
}

impl Request {
    /// A simulation on its own: the first of the first trial.
    pub fn new(scenario: impl Into<Scenario>, seed: Seed) -> Request {
        Request {
            trial: 1,
            number: 1,
            unit_point: Vec::new(),
            scenario: scenario.into(),
            seed,
            wants_subformulas: false,
        }
    }
}

/// One simulation, as it went. It carries its [`Request`], so that one value goes from the system to the search, the
/// callback and the record.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// What was asked for.
    pub request: Request,
    /// How it ended.
    pub end: EpisodeEnd,
    /// Control steps taken.
    pub steps: usize,
    /// What the formulas say of the trace. Undecided throughout if the simulation diverged.
    pub verdict: Verdict,
    /// Sum of the rewards.
    pub total_reward: f64,
    /// Sample 0 was taken after the reset, sample k after control step k. Empty if the episode comes from a record that
    /// stores no trace.
    pub trace: Trace,
}

impl Episode {
    /// The robustness that counts for a search: `None` if the simulation diverged or the formula is undecided.
    pub fn robustness(&self) -> Option<f64> {
        match self.end {
            EpisodeEnd::Diverged { .. } | EpisodeEnd::Undefined { .. } => None,
            EpisodeEnd::Completed | EpisodeEnd::Stopped { .. } => self.verdict.robustness,
        }
    }
}

/// How a simulation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EpisodeEnd {
    /// It ran all its control steps.
    Completed,
    /// The stop callback ended it after this control step.
    Stopped {
        /// Control step.
        step: usize,
    },
    /// Its numbers stopped being finite in this control step. Neither a success nor a falsification.
    Diverged {
        /// Control step.
        step: usize,
    },
    /// It ran on, but a formula has no finite value on its trace, as in a division by zero, so all are undecided. Neither
    /// a success nor a falsification.
    Undefined {
        /// Sample of the trace at which it has none.
        step: usize,
    },
}
