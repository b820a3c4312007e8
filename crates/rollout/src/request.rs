use mishandle_stl::{Trace, is_violated};

use crate::{Scenario, Seed, Verdict};

/// Number of control steps between two checks of the [stop threshold](Request::stop_threshold).
const CHECK_PERIOD: usize = 10;

/// One simulation to run.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Number of the trial, from 1.
    pub trial: u32,
    /// Number of the simulation within the trial, from 1.
    pub number: u32,
    /// The point of \[0,1\]^d that the search proposed; empty if no search chose the scenario.
    pub unit_point: Vec<f64>,
    /// One value per axis of the system's space, in SI units.
    pub scenario: Scenario,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// Whether the verdict must contain the parts of the robustness.
    pub needs_parts: bool,
    /// With a threshold, which is at least 0, the system may end the simulation as soon as the
    /// trace determines the robustness or shows that it is above the threshold. Without one, it
    /// runs to the end.
    pub stop_threshold: Option<f64>,
}

impl Request {
    /// Makes a request for a single simulation: simulation 1 of trial 1.
    pub fn new(scenario: impl Into<Scenario>, seed: Seed) -> Request {
        Request {
            trial: 1,
            number: 1,
            unit_point: Vec::new(),
            scenario: scenario.into(),
            seed,
            needs_parts: false,
            stop_threshold: None,
        }
    }

    /// Returns whether the simulation is checked for its [stop threshold](Self::stop_threshold)
    /// after this number of control steps.
    pub fn may_stop_after(&self, steps: usize) -> bool {
        self.stop_threshold.is_some() && steps.is_multiple_of(CHECK_PERIOD)
    }
}

/// The result of one simulation. It contains its [`Request`], so that searches, callbacks and
/// records need nothing else.
#[derive(Clone, Debug, PartialEq)]
pub struct Episode {
    /// The request.
    pub request: Request,
    /// How the simulation ended.
    pub end: EpisodeEnd,
    /// Why it ended so, in the words of the target or of its controller; empty if they say nothing.
    pub reason: String,
    /// Number of control steps taken.
    pub steps: usize,
    /// Values of the formulas on the trace. All are undecided if the end of the episode yields no
    /// verdict.
    pub verdict: Verdict,
    /// Sum of the rewards.
    pub total_reward: f64,
    /// Sample 0 follows the reset, sample k follows control step k. The trace is empty if the
    /// episode comes from a record without a trace, or from another machine that kept it.
    pub trace: Trace,
    /// Digest of a trace that another machine kept, as run files contain it; otherwise `None`.
    pub trace_digest: Option<u128>,
}

impl Episode {
    /// Returns the robustness that a search minimizes; `None` if the formula is undecided or the
    /// simulation ended in a way that yields no verdict.
    pub fn robustness(&self) -> Option<f64> {
        self.end.has_verdict().then_some(self.verdict.robustness).flatten()
    }

    /// Returns whether the episode violates the requirement.
    pub fn is_violated(&self) -> bool {
        self.robustness().is_some_and(is_violated)
    }

    /// Returns whether the episode satisfies the success formula.
    pub fn is_success(&self) -> bool {
        self.end.has_verdict() && self.verdict.is_success()
    }

    /// Returns whether the episode is a success that also satisfies the strict formula.
    pub fn is_strict_success(&self) -> bool {
        self.end.has_verdict() && self.verdict.is_strict_success()
    }

    /// Returns whether the episode is a success that also satisfies the careful formula.
    pub fn is_careful_success(&self) -> bool {
        self.end.has_verdict() && self.verdict.is_careful_success()
    }
}

/// How a simulation ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EpisodeEnd {
    /// The simulation ran all its control steps.
    Completed,
    /// The target ended the simulation by its own rule after this control step.
    Terminated {
        /// Control step.
        step: usize,
    },
    /// The stop condition ended the simulation after this control step.
    Stopped {
        /// Control step.
        step: usize,
    },
    /// A state value stopped being finite in this control step. The simulation is neither a success
    /// nor a falsification.
    Diverged {
        /// Control step, from 1; 0 is the reset.
        step: usize,
    },
    /// A formula has no finite value on the trace, for instance after a division by zero, so all
    /// formulas are undecided. The simulation is neither a success nor a falsification.
    Undefined {
        /// Sample of the trace at which the formula has no finite value.
        step: usize,
    },
    /// The controller returned NaN or an infinity. The simulation is neither a success nor a
    /// falsification.
    InvalidAction {
        /// Control step of the action, from 1.
        step: usize,
        /// Index of the first such action.
        index: usize,
    },
    /// An input of the controller is NaN or infinite. The simulation is neither a success nor a
    /// falsification.
    InvalidObservation {
        /// Sample of the observation; sample 0 follows the reset.
        step: usize,
        /// Index of the first such observation.
        index: usize,
    },
    /// A reward term is NaN or infinite. The simulation is neither a success nor a falsification.
    InvalidReward {
        /// Control step of the reward, from 1.
        step: usize,
        /// Index of the first such reward term.
        index: usize,
    },
    /// A signal is NaN or infinite. The simulation is neither a success nor a falsification.
    InvalidSignal {
        /// Sample of the signal; sample 0 follows the reset.
        step: usize,
        /// Index of the first such signal.
        index: usize,
    },
    /// The target cannot start from the scenario. The simulation is neither a success nor a
    /// falsification.
    InvalidScenario,
    /// The target or its controller failed, for instance with an exception. The simulation is
    /// neither a success nor a falsification.
    Crashed {
        /// Control step, from 1; 0 is the reset.
        step: usize,
    },
    /// The simulation took longer than its time limit. It is neither a success nor a falsification.
    TimedOut {
        /// Control step, from 1; 0 is the reset.
        step: usize,
    },
}

impl EpisodeEnd {
    /// Returns whether an episode with this end can have a verdict.
    pub fn has_verdict(self) -> bool {
        matches!(self, EpisodeEnd::Completed | EpisodeEnd::Terminated { .. } | EpisodeEnd::Stopped { .. })
    }

    /// Returns whether the simulation failed: the target could not start it, crashed or took too
    /// long.
    pub fn is_failed(self) -> bool {
        matches!(self, EpisodeEnd::InvalidScenario | EpisodeEnd::Crashed { .. } | EpisodeEnd::TimedOut { .. })
    }

    /// Returns whether rates count the simulation. An invalid start says nothing about the
    /// controller, so no rate does; any other end without a verdict counts, as no success.
    pub fn counts_in_rates(self) -> bool {
        self != EpisodeEnd::InvalidScenario
    }

    /// Returns whether the controller or the environment returned a value that is not finite.
    pub fn is_invalid(self) -> bool {
        matches!(
            self,
            EpisodeEnd::InvalidAction { .. }
                | EpisodeEnd::InvalidObservation { .. }
                | EpisodeEnd::InvalidReward { .. }
                | EpisodeEnd::InvalidSignal { .. }
        )
    }
}
