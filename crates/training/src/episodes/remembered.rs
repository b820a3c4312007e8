//! The memory of the policy in each row, for policies with a history.

use mishandle_controllers::History;
use rayon::prelude::*;

use super::ROWS_PER_TASK;
use crate::{Checkpoint, TrainingError};

/// Last observations and actions of the policy in each row, and the inputs of its network.
pub(super) struct Remembered {
    history: History,
    /// `[rows, memory_size]`
    memory: Vec<f64>,
    /// `[rows, input_size]`
    inputs: Vec<f32>,
    /// Inputs after the last step and before any reset, `[rows, input_size]`.
    final_inputs: Vec<f32>,
}

impl Remembered {
    /// Makes empty memories for rows with these observations.
    pub fn new(history: History, observations: &[f32]) -> Remembered {
        let rows = observations.len() / history.observation_size();
        let mut remembered = Remembered {
            history,
            memory: vec![0.0; rows * history.memory_size()],
            inputs: vec![0.0; rows * history.input_size()],
            final_inputs: vec![0.0; rows * history.input_size()],
        };
        remembered.observe(observations);
        remembered
    }

    pub fn inputs(&self) -> &[f32] {
        &self.inputs
    }

    pub fn final_inputs(&self) -> &[f32] {
        &self.final_inputs
    }

    /// Adds the last observations and the actions that answered them, except in paused rows.
    pub fn push(&mut self, actions: &[f32], is_paused: impl Fn(usize) -> bool + Sync) {
        let Remembered { history, memory, inputs, .. } = self;
        let size = actions.len() * history.input_size() / inputs.len();
        let rows = memory.par_chunks_mut(history.memory_size()).zip(inputs.par_chunks(history.input_size()));
        let rows = rows.zip(actions.par_chunks(size)).with_min_len(ROWS_PER_TASK).enumerate();
        rows.for_each(|(row, ((memory, input), action))| {
            if !is_paused(row) {
                history.push(memory, &input[..history.observation_size()], action);
            }
        });
    }

    /// Sets the final inputs from the final observations.
    pub fn finish(&mut self, observations: &[f32]) {
        write_inputs(self.history, observations, &self.memory, &mut self.final_inputs);
    }

    /// Empties the memories of the rows whose episodes start.
    pub fn reset(&mut self, rows: impl Iterator<Item = usize>) {
        let size = self.history.memory_size();
        rows.for_each(|row| self.memory[row * size..][..size].fill(0.0));
    }

    /// Sets the inputs from the current observations.
    pub fn observe(&mut self, observations: &[f32]) {
        write_inputs(self.history, observations, &self.memory, &mut self.inputs);
    }

    /// Saves the memories to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("episodes.memory", self.memory.clone());
    }

    /// Restores the memories from a checkpoint, for rows with these observations.
    ///
    /// # Errors
    /// If the checkpoint contains memories of another size.
    pub fn load(&mut self, checkpoint: &Checkpoint, observations: &[f32]) -> Result<(), TrainingError> {
        self.memory = checkpoint.f64s("episodes.memory", self.memory.len())?.to_vec();
        self.observe(observations);
        Ok(())
    }
}

fn write_inputs(history: History, observations: &[f32], memory: &[f64], inputs: &mut [f32]) {
    let rows = observations.par_chunks(history.observation_size());
    let rows = rows.zip(memory.par_chunks(history.memory_size()));
    let rows = rows.zip(inputs.par_chunks_mut(history.input_size())).with_min_len(ROWS_PER_TASK);
    rows.for_each(|((observation, memory), input)| history.write_input(observation, memory, input));
}
