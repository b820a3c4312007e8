//! Training in worlds that another physics engine steps.

use std::sync::Arc;

use mishandle_rollout::{
    BatchFactory, BatchStatus, Environment, EnvironmentBatch, EnvironmentSpec, GROUP_ROWS, RolloutError,
    Sample, ScenarioBatch, ScenarioRows, Start, StepStatus,
};
use mishandle_world::WorldDevice;

use crate::batch::TaskRows;
use crate::{TaskBatch, TaskEnvironment};

/// Makes environment batches of a task whose physics a [`WorldDevice`] steps.
///
/// Initial states, observations and rewards are those of the [`TaskEnvironment`]. A row with too
/// little memory for its contacts or constraints counts as diverged.
pub struct TaskBatches {
    environment: Arc<TaskEnvironment>,
    device: Arc<dyn WorldDevice>,
}

impl TaskBatches {
    /// Makes a factory.
    pub fn new(environment: Arc<TaskEnvironment>, device: Arc<dyn WorldDevice>) -> TaskBatches {
        TaskBatches { environment, device }
    }
}

impl BatchFactory for TaskBatches {
    fn spec(&self) -> EnvironmentSpec {
        let spec = EnvironmentSpec::of(&*self.environment);
        // A checkpoint of one engine is not resumed on another.
        EnvironmentSpec { name: format!("{} on {}", spec.name, self.device.engine()), ..spec }
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        let EnvironmentSpec { observation_size, reward_terms, .. } = EnvironmentSpec::of(&*self.environment);
        Ok(Box::new(TrainingBatch {
            batch: TaskBatch::new(&self.environment, &*self.device, rows)?,
            observations: vec![0.0; rows * observation_size],
            rewards: vec![0.0; rows * reward_terms.len()],
            statuses: vec![StepStatus::Running; rows],
            sizes: Sizes {
                observation: observation_size,
                action: self.environment.action_size(),
                signals: self.environment.signals().len(),
                rewards: reward_terms.len(),
            },
        }))
    }
}

struct TrainingBatch {
    batch: TaskBatch,
    observations: Vec<f32>,
    rewards: Vec<f64>,
    statuses: Vec<StepStatus>,
    sizes: Sizes,
}

/// Lengths of the rows of the buffers.
#[derive(Clone, Copy)]
struct Sizes {
    observation: usize,
    action: usize,
    signals: usize,
    rewards: usize,
}

/// Samples of a group of rows.
struct Samples<'a> {
    observations: &'a mut [f32],
    rewards: &'a mut [f64],
    statuses: &'a mut [StepStatus],
}

impl TrainingBatch {
    /// Calls `visit` for each group of rows with the index of its first row and its samples, on all
    /// threads.
    fn visit(&mut self, visit: impl Fn(usize, &mut TaskRows<'_>, Samples<'_>) + Sync) {
        let Sizes { observation, rewards, .. } = self.sizes;
        let samples = self
            .observations
            .chunks_mut(GROUP_ROWS * observation)
            .zip(self.rewards.chunks_mut(GROUP_ROWS * rewards))
            .zip(self.statuses.chunks_mut(GROUP_ROWS))
            .map(|((observations, rewards), statuses)| Samples { observations, rewards, statuses });
        self.batch.visit_with(samples, |index, rows, samples| visit(index * GROUP_ROWS, rows, samples));
    }
}

impl Sizes {
    /// Returns the buffers of the sample of a row.
    fn sample<'a>(&self, row: usize, samples: &'a mut Samples<'_>, signals: &'a mut [f64]) -> Sample<'a> {
        Sample {
            observation: &mut samples.observations[row * self.observation..][..self.observation],
            signals,
            rewards: &mut samples.rewards[row * self.rewards..][..self.rewards],
        }
    }
}

impl EnvironmentBatch for TrainingBatch {
    fn rows(&self) -> usize {
        self.batch.rows()
    }

    fn reset(&mut self, starts: &[Start]) -> Result<(), RolloutError> {
        let sizes = self.sizes;
        let mut starting = vec![None; self.rows()];
        starts.iter().for_each(|start| starting[start.row] = Some(start));
        self.visit(|first, rows, mut samples| {
            let mut signals = vec![0.0; sizes.signals];
            for row in 0..rows.len() {
                if let Some(Start { scenario, seed, .. }) = starting[first + row] {
                    let sample = sizes.sample(row, &mut samples, &mut signals);
                    samples.statuses[row] = rows.start(row, scenario, *seed, sample);
                }
            }
        });
        Ok(())
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        let sizes = self.sizes;
        let action = |row: usize| &actions[row * sizes.action..][..sizes.action];
        self.visit(|first, rows, _| {
            (0..rows.len()).for_each(|row| rows.command(row, action(first + row), true));
        });
        self.batch.start_step()?;
        self.batch.finish_step()?;
        self.visit(|_, rows, mut samples| {
            let mut signals = vec![0.0; sizes.signals];
            for row in 0..rows.len() {
                let sample = sizes.sample(row, &mut samples, &mut signals);
                samples.statuses[row] = match rows.rewarded_sample(row, sample) {
                    BatchStatus::Step(status) => status,
                    BatchStatus::Overflow => StepStatus::Diverged,
                };
            }
        });
        Ok(())
    }

    fn observations(&self) -> &[f32] {
        &self.observations
    }

    fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        self.batch.read_states(states)
    }

    fn write_states(&mut self, states: &[f64], observations: &[f32]) -> Result<(), RolloutError> {
        self.batch.write_states(states);
        self.observations.copy_from_slice(observations);
        self.statuses.fill(StepStatus::Running);
        Ok(())
    }
}
