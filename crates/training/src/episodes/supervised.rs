//! The supervisor of the policy in each row, such as a guard: what the policy does is not always
//! what the environment gets.

use std::convert::Infallible;
use std::sync::Arc;

use mishandle_rollout::{PerThread, Seed, Supervised, Supervisor, SupervisorWorker};
use rayon::prelude::*;

use super::ROWS_PER_TASK;
use crate::{Checkpoint, TrainingError};

/// States of a supervisor in all rows, and its actions.
pub(super) struct SupervisedRows {
    supervisor: Arc<dyn Supervisor>,
    workers: PerThread<Box<dyn SupervisorWorker>>,
    /// `[rows, state_size]`
    states: Vec<f64>,
    /// `[rows, action_size]`
    actions: Vec<f32>,
    size: usize,
}

impl SupervisedRows {
    /// Makes states of rows that have no episode yet.
    pub fn new(supervisor: Arc<dyn Supervisor>, rows: usize, action_size: usize) -> SupervisedRows {
        let size = supervisor.state_size();
        SupervisedRows {
            states: vec![0.0; rows * size],
            actions: vec![0.0; rows * action_size],
            workers: PerThread::new(),
            supervisor,
            size,
        }
    }

    /// Returns what the supervisor does, as a part of the identity of the episodes.
    pub fn identity(&self) -> String {
        format!(", supervised: {}", self.supervisor.identity())
    }

    /// Starts the episode of a row.
    pub fn reset(&mut self, row: usize, seed: Seed) {
        let SupervisedRows { supervisor, workers, states, size, .. } = self;
        let state = &mut states[row * *size..][..*size];
        with(workers, supervisor, |worker| worker.reset(state, seed));
    }

    /// Returns the actions that leave the supervisor in a control step, given those of the policy.
    /// A row that `is_paused` keeps its state.
    pub fn supervise(
        &mut self,
        observations: &[f32],
        actions: &[f32],
        is_paused: impl Fn(usize) -> bool + Sync,
    ) -> &[f32] {
        let SupervisedRows { supervisor, workers, states, actions: own, size } = self;
        let (size, rows) = (*size, states.len() / *size);
        let observation_size = observations.len() / rows;
        let action_size = actions.len() / rows;
        own.copy_from_slice(actions);
        let chunks = states
            .par_chunks_mut(ROWS_PER_TASK * size)
            .zip(own.par_chunks_mut(ROWS_PER_TASK * action_size))
            .zip(observations.par_chunks(ROWS_PER_TASK * observation_size));
        chunks.enumerate().for_each(|(chunk, ((states, actions), observations))| {
            let rows = states.len() / size;
            let paused = (0..rows).filter(|row| is_paused(chunk * ROWS_PER_TASK + row));
            let held: Vec<(usize, Vec<f64>)> =
                paused.map(|row| (row, states[row * size..][..size].to_vec())).collect();
            with(workers, supervisor, |worker| {
                let supervised = Supervised { observations, states, stride: size, actions };
                worker.supervise(rows, supervised, &|_| true);
            });
            for (row, state) in held {
                states[row * size..][..size].copy_from_slice(&state);
            }
        });
        own
    }

    /// Saves the states to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("episodes.supervisor", self.states.clone());
    }

    /// Restores the states from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains states of another size, as those of another supervisor.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.states = checkpoint.f64s("episodes.supervisor", self.states.len())?.to_vec();
        Ok(())
    }
}

/// Calls `function` with a worker of this thread.
fn with(
    workers: &PerThread<Box<dyn SupervisorWorker>>,
    supervisor: &Arc<dyn Supervisor>,
    function: impl FnOnce(&mut dyn SupervisorWorker),
) {
    let made = || Ok::<_, Infallible>(supervisor.worker());
    match workers.with(made, |worker| function(&mut **worker)) {
        Ok(()) => {}
        Err(never) => match never {},
    }
}
