//! Training in worlds that another physics engine steps.

use std::sync::Arc;

use mishandle_rollout::{
    BatchFactory, BatchStatus, Environment, EnvironmentBatch, EnvironmentSpec, RolloutError, ScenarioBatch,
    Seed, StepStatus,
};
use mishandle_world::Backend;

use crate::{TaskBatch, TaskEnvironment};

/// Makes environment batches of a task whose physics a [`Backend`] steps.
///
/// Initial states, observations and rewards are those of the [`TaskEnvironment`]. A row with too little memory for its contacts or
/// constraints counts as diverged.
pub struct TaskBatches {
    environment: Arc<TaskEnvironment>,
    backend: Arc<dyn Backend>,
}

impl TaskBatches {
    /// Makes a factory.
    pub fn new(environment: Arc<TaskEnvironment>, backend: Arc<dyn Backend>) -> TaskBatches {
        TaskBatches { environment, backend }
    }
}

impl BatchFactory for TaskBatches {
    fn spec(&self) -> EnvironmentSpec {
        let spec = EnvironmentSpec::of(&*self.environment);
        // A checkpoint of one engine is not resumed on another.
        EnvironmentSpec { name: format!("{} on {}", spec.name, self.backend.engine()), ..spec }
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        Ok(Box::new(TrainingBatch {
            batch: TaskBatch::new(&self.environment, &*self.backend, rows)?,
            environment: self.environment.clone(),
            statuses: vec![StepStatus::Running; rows],
        }))
    }
}

struct TrainingBatch {
    batch: TaskBatch,
    environment: Arc<TaskEnvironment>,
    statuses: Vec<StepStatus>,
}

impl EnvironmentBatch for TrainingBatch {
    fn rows(&self) -> usize {
        self.batch.rows()
    }

    fn reset(&mut self, rows: &[(usize, Seed)]) -> Result<(), RolloutError> {
        let space = self.environment.space();
        let scenarios: Vec<_> = rows.iter().map(|(_, seed)| space.sample(*seed, 0)).collect();
        let starts = rows.iter().zip(&scenarios).map(|((row, seed), scenario)| (*row, scenario, *seed));
        self.batch.start(&starts.collect::<Vec<_>>())
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        self.batch.step(actions)?;
        for (status, found) in self.statuses.iter_mut().zip(self.batch.samples().statuses) {
            *status = match found {
                BatchStatus::Step(status) => *status,
                BatchStatus::Overflow => StepStatus::Diverged,
            };
        }
        Ok(())
    }

    fn observations(&self) -> &[f32] {
        self.batch.samples().observations
    }

    fn rewards(&self) -> &[f64] {
        self.batch.samples().rewards
    }

    fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        self.batch.read_states(states)
    }

    fn write_states(&mut self, states: &[f64], observations: &[f32]) -> Result<(), RolloutError> {
        self.batch.write_states(states, observations)
    }
}
