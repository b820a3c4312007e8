//! An environment in which an adversary acts: it sees the simulations of a frozen controller and
//! decides offsets of observations and actions, and pushes, while they run.

mod batch;
mod decisions;

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use crate::rollout::Rollout;
use crate::{
    BatchFactory, EnvironmentBatch, EnvironmentSpec, Episode, RolloutError, Scenario, Seed, Space,
    TrainingScenarios,
};
use batch::AdversaryBatch;
use decisions::Decisions;

/// A [`Rollout`] as an environment of its adversary.
///
/// A step of this environment lasts from one decision to the next. An axis whose value is an offset
/// of observations or actions is decided at the start of the control step in which it begins to
/// act. An [event](crate::Environment::events), such as a push, begins at the first decision that
/// asks for it, if its time is within the bounds of its axis. So what the adversary did is a
/// scenario: the simulation of that scenario is the same one, to the bit, and needs no adversary.
///
/// - Action: a number for each offset that a decision sets, from -1 (lower bound of the axis) to 1
///   (upper bound); for each event a number that asks for it if it is positive, and one for each of
///   its other axes. The other axes of the space belong to the scenario of the episode.
/// - Observation: the observation of the controller without noise and disturbances; all signals;
///   the share of the episode that is over; the running robustness; and whether the simulation has
///   ended.
/// - Reward: the decrease of the running robustness, which is the upper bound of the robustness of
///   the requirement over all continuations, or the lower bound if the upper one is infinite. At
///   the end of the simulation it is the robustness, so the return of an episode is the first
///   running robustness minus the robustness.
///
/// All rows start together and have the same number of steps; a simulation that has ended stays in
/// its last sample. [`take_finished`](Self::take_finished) returns the simulations.
#[derive(Clone)]
pub struct AdversaryEnvironment {
    shared: Arc<Shared>,
    /// Trial of the simulations, and the largest number of them.
    trial: u32,
    budget: u32,
    stop_threshold: Option<f64>,
    /// Seed of every simulation; `None` gives each one that of its start.
    fixed_seed: Option<Seed>,
    finished: Arc<Mutex<Vec<Episode>>>,
}

impl fmt::Debug for AdversaryEnvironment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AdversaryEnvironment").field("trial", &self.trial).finish_non_exhaustive()
    }
}

/// Facts that all batches share.
struct Shared {
    rollout: Rollout,
    decisions: Decisions,
    /// The axes that the adversary does not decide, and their indices in the space.
    others: Space,
    places: Vec<usize>,
}

impl Shared {
    /// Returns the scenario of the space with the values of the other axes. Decided ones are
    /// nominal.
    fn undecided(&self, others: &Scenario) -> Scenario {
        let mut values = self.rollout.space.nominal().values().to_vec();
        for (place, value) in self.places.iter().zip(others.values()) {
            values[*place] = *value;
        }
        Scenario::new(values)
    }
}

impl AdversaryEnvironment {
    /// Makes the environment of simulations of trial 1, of any number.
    ///
    /// # Errors
    /// If the adversary has nothing to decide.
    pub(crate) fn new(rollout: &Rollout) -> Result<AdversaryEnvironment, RolloutError> {
        if rollout.eyes.is_some() {
            // The states that a training run saves do not contain what cameras showed before.
            let what = "the controller sees images; search with the other falsifiers";
            return Err(RolloutError::NoAdversary { what });
        }
        let rollout = rollout.without_workers();
        let decisions = Decisions::new(&rollout);
        if decisions.channels() == 0 {
            let what = "no free axis of the space offsets an observation or an action, and none is the time of a push \
                        that can begin; tasks have such axes in the spaces `disturbance`, `drift` and `events`";
            return Err(RolloutError::NoAdversary { what });
        }
        let places: Vec<usize> =
            (0..rollout.space.dimension()).filter(|axis| !decisions.contains(*axis)).collect();
        let others = places.iter().map(|place| rollout.space.axes()[*place].clone()).collect();
        let others = Space::new(rollout.space.name(), others)?;
        Ok(AdversaryEnvironment {
            shared: Arc::new(Shared { rollout, decisions, others, places }),
            trial: 1,
            budget: u32::MAX,
            stop_threshold: None,
            fixed_seed: None,
            finished: Arc::default(),
        })
    }

    /// Returns the environment of the simulations 1 to `budget` of a trial. Rows without a
    /// simulation do nothing.
    #[must_use]
    pub fn of_trial(self, trial: u32, budget: u32) -> AdversaryEnvironment {
        AdversaryEnvironment { trial, budget, finished: Arc::default(), ..self }
    }

    /// Lets simulations end before their last step: see
    /// [`Request::stop_threshold`](crate::Request::stop_threshold).
    #[must_use]
    pub fn with_stop_threshold(self, stop_threshold: Option<f64>) -> AdversaryEnvironment {
        AdversaryEnvironment { stop_threshold, ..self }
    }

    /// Gives every simulation the same random seed. The scenarios stay those of the starts.
    #[must_use]
    pub fn with_fixed_seed(self, fixed_seed: Option<Seed>) -> AdversaryEnvironment {
        AdversaryEnvironment { fixed_seed, ..self }
    }

    /// Returns the number of decisions of an episode.
    pub fn decisions(&self) -> usize {
        self.shared.decisions.all().len()
    }

    /// Returns the indices of the axes that the adversary decides.
    pub fn decided_axes(&self) -> Vec<usize> {
        let all = 0..self.shared.rollout.space.dimension();
        all.filter(|axis| self.shared.decisions.contains(*axis)).collect()
    }

    /// Returns the scenario of the space with values of the axes that the adversary does not
    /// decide, and nominal ones of the others.
    pub fn undecided(&self, others: &Scenario) -> Scenario {
        self.shared.undecided(others)
    }

    /// Returns the simulations that have ended since the last call, in the order of their numbers.
    pub fn take_finished(&self) -> Vec<Episode> {
        std::mem::take(&mut *self.finished.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl BatchFactory for AdversaryEnvironment {
    fn spec(&self) -> EnvironmentSpec {
        let rollout = &self.shared.rollout;
        let environment = &rollout.environment;
        EnvironmentSpec {
            name: format!("adversary of {}", environment.name()),
            space: self.shared.others.clone(),
            observation_size: batch::observation_size(&self.shared),
            action_size: self.shared.decisions.channels(),
            action_limit: 1.0,
            state_size: 0,
            signal_count: 0,
            reward_terms: vec!["decrease".to_string()],
            episode_steps: self.decisions(),
        }
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        Ok(Box::new(AdversaryBatch::new(self.clone(), rows)?))
    }

    fn scenarios(&self) -> TrainingScenarios {
        TrainingScenarios::of(self.shared.others.clone())
    }
}
