use std::sync::Arc;

use crate::{
    CpuBatch, Environment, RolloutError, Scenario, Seed, Space, StepStatus, Supervisor, TrainingScenarios,
};

/// A vectorized environment: many simulations that are stepped together, one per row.
///
/// [`CpuBatch`] implements it on the CPU for any [`Environment`]. A batch on a GPU or in another
/// process implements it directly. All arrays are row-major.
///
/// The same seeds and actions must give the same numbers, or a training run cannot be repeated.
pub trait EnvironmentBatch: Send {
    /// Returns the number of rows.
    fn rows(&self) -> usize;

    /// Starts these episodes.
    ///
    /// A row may occur at most once. All rows must be reset before the first step. The
    /// [status](Self::statuses) of a row says whether its episode started.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn reset(&mut self, starts: &[Start]) -> Result<(), RolloutError>;

    /// Advances every row by one control step. `actions` has the shape `[rows, action_size]` and is
    /// not clipped.
    ///
    /// # Errors
    /// If the batch fails as a whole. The failure of one row is its [`StepStatus`].
    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError>;

    /// Returns the current observations, `[rows, observation_size]`.
    fn observations(&self) -> &[f32];

    /// Returns the reward terms of the last step, `[rows, reward terms]`.
    fn rewards(&self) -> &[f64];

    /// Returns the status of each row after its last reset or step.
    fn statuses(&self) -> &[StepStatus];

    /// Copies the states of all rows into `states`, `[rows, state_size]`. A checkpoint stores them.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError>;

    /// Restores all rows from the states and observations of a checkpoint. They continue to the
    /// same bits.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn write_states(&mut self, states: &[f64], observations: &[f32]) -> Result<(), RolloutError>;
}

/// Start of an episode in a row of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// The row.
    pub row: usize,
    /// Scenario in the [space of the batch](EnvironmentSpec::space).
    pub scenario: Scenario,
    /// Seed of the random numbers of the reset.
    pub seed: Seed,
}

/// Makes environment batches.
///
/// An [`Arc`] of an [`Environment`] makes batches on the CPU.
pub trait BatchFactory: Send + Sync {
    /// Returns the facts that every batch of this factory shares.
    fn spec(&self) -> EnvironmentSpec;

    /// Makes a batch of `rows` simulations. Every row must be reset before its first step.
    ///
    /// # Errors
    /// If the batch cannot be made.
    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError>;

    /// Returns the scenarios of training episodes: by default those of the space of the batches,
    /// without disturbances.
    fn scenarios(&self) -> TrainingScenarios {
        TrainingScenarios::of(self.spec().space)
    }

    /// Returns who supervises the policy, if anyone does: the actions of the environment are then
    /// those that leave the supervisor.
    fn supervisor(&self) -> Option<Arc<dyn Supervisor>> {
        None
    }
}

/// Sizes and names that a training algorithm must know about an environment.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentSpec {
    /// Name, for messages and checkpoints.
    pub name: String,
    /// Space of the scenarios that a reset accepts.
    pub space: Space,
    /// Length of an observation.
    pub observation_size: usize,
    /// Length of the last part of an observation, on which no noise and no disturbance acts.
    pub exact_size: usize,
    /// Number of actions.
    pub action_size: usize,
    /// Largest absolute value of an action. Actions of a policy are clipped to it.
    pub action_limit: f64,
    /// Length of a state row, which determines the future of its simulation.
    pub state_size: usize,
    /// Number of signals, which a validation records; may be 0.
    pub signal_count: usize,
    /// Names of the reward terms. The reward is their sum.
    pub reward_terms: Vec<String>,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
}

impl EnvironmentSpec {
    /// Returns the specification of `environment`.
    pub fn of(environment: &(impl Environment + ?Sized)) -> EnvironmentSpec {
        EnvironmentSpec {
            name: environment.name().to_string(),
            space: environment.space().clone(),
            observation_size: environment.observation_size(),
            exact_size: environment.exact_size(),
            action_size: environment.action_size(),
            action_limit: environment.action_limit(),
            state_size: environment.state_size(),
            signal_count: environment.signals().len(),
            reward_terms: environment.reward_terms().to_vec(),
            episode_steps: environment.episode_steps(),
        }
    }
}

impl<E: Environment + ?Sized + 'static> BatchFactory for Arc<E> {
    fn spec(&self) -> EnvironmentSpec {
        EnvironmentSpec::of(&**self)
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        Ok(Box::new(CpuBatch::new(self.clone(), rows)))
    }
}
