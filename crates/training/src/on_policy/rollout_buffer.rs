//! The rollout buffer.

use mishandle_network::{CHUNK_ROWS, Moments};
use rayon::prelude::*;

use crate::inference::first_columns;
use crate::{Boundary, Episodes};

/// A rollout of `steps` control steps in `rows` environments. All arrays have the shape
/// `[steps, rows, ..]`. Observations are whole inputs of the policy: with their histories, if it
/// has one.
#[derive(Clone, Debug)]
pub struct RolloutBuffer {
    rows: usize,
    input_size: usize,
    action_size: usize,
    privileged_size: usize,
    filled: usize,
    /// Observation before each step, not normalized.
    pub observations: Vec<f32>,
    /// Privileged inputs of the critic before each step; empty if it sees observations only.
    pub privileged: Vec<f32>,
    /// Actions, not clipped.
    pub actions: Vec<f32>,
    /// Log-probabilities of the actions under the policy that sampled them.
    pub log_probs: Vec<f64>,
    /// Rewards.
    pub rewards: Vec<f64>,
    /// Whether the episode continued after each step, terminated, or was truncated.
    pub boundaries: Vec<Boundary>,
    /// Values V(s_t).
    pub values: Vec<f64>,
    /// Values V(s_t+1) of the following observations; see [`gae`](crate::gae).
    pub next_values: Vec<f64>,
    /// Advantages.
    pub advantages: Vec<f64>,
    /// Observation after the last step, `[rows, ..]`; after a reset, the first observation of the
    /// next episode.
    pub last_observations: Vec<f32>,
    /// Privileged inputs of these observations.
    pub last_privileged: Vec<f32>,
    /// Indices of the truncated steps, ascending.
    pub truncated: Vec<usize>,
    /// Final observation of each truncated episode, from before the reset.
    pub truncated_observations: Vec<f32>,
    /// Privileged inputs of these observations.
    pub truncated_privileged: Vec<f32>,
}

impl RolloutBuffer {
    /// Creates an empty buffer for `steps` control steps in `rows` environments.
    pub fn new(steps: usize, rows: usize, input_size: usize, action_size: usize) -> RolloutBuffer {
        let count = steps * rows;
        RolloutBuffer {
            rows,
            input_size,
            action_size,
            privileged_size: 0,
            filled: 0,
            observations: vec![0.0; count * input_size],
            privileged: Vec::new(),
            actions: vec![0.0; count * action_size],
            log_probs: vec![0.0; count],
            rewards: vec![0.0; count],
            boundaries: vec![Boundary::Running; count],
            values: vec![0.0; count],
            next_values: vec![0.0; count],
            advantages: vec![0.0; count],
            last_observations: vec![0.0; rows * input_size],
            last_privileged: Vec::new(),
            truncated: Vec::new(),
            truncated_observations: Vec::new(),
            truncated_privileged: Vec::new(),
        }
    }

    /// Returns an empty buffer with `size` privileged inputs in each row.
    #[must_use]
    pub fn with_privileged(self, size: usize) -> RolloutBuffer {
        RolloutBuffer {
            privileged_size: size,
            privileged: vec![0.0; self.count() * size],
            last_privileged: vec![0.0; self.rows * size],
            ..self
        }
    }

    /// Returns the number of privileged inputs in each row.
    pub fn privileged_size(&self) -> usize {
        self.privileged_size
    }

    /// Returns the number of environments.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the number of transitions: control steps times environments.
    pub fn count(&self) -> usize {
        self.rewards.len()
    }

    /// Removes all transitions.
    pub fn clear(&mut self) {
        self.filled = 0;
        self.truncated.clear();
        self.truncated_observations.clear();
        self.truncated_privileged.clear();
    }

    /// Stores the current observations; returns them and the slices for the actions and their
    /// log-probabilities.
    ///
    /// # Panics
    /// If the buffer is full.
    pub fn begin_step(&mut self, episodes: &Episodes) -> (&[f32], &mut [f32], &mut [f64]) {
        let first = self.filled;
        let observations = &mut self.observations[first * self.input_size..][..self.rows * self.input_size];
        observations.copy_from_slice(episodes.inputs());
        let own = self.privileged_size;
        self.privileged[first * own..][..self.rows * own].copy_from_slice(episodes.privileged());
        let actions = &mut self.actions[first * self.action_size..][..self.rows * self.action_size];
        (observations, actions, &mut self.log_probs[first..][..self.rows])
    }

    /// Returns the actions of the current step.
    pub fn step_actions(&self) -> &[f32] {
        &self.actions[self.filled * self.action_size..][..self.rows * self.action_size]
    }

    /// Stores rewards, episode boundaries and final observations of the current step.
    pub fn end_step(&mut self, episodes: &Episodes) {
        let step = self.filled..self.filled + self.rows;
        self.rewards[step.clone()].copy_from_slice(episodes.rewards());
        self.boundaries[step].copy_from_slice(episodes.boundaries());
        for (row, boundary) in episodes.boundaries().iter().enumerate() {
            if *boundary == Boundary::Truncated {
                self.truncated.push(self.filled + row);
                let observation = &episodes.final_inputs()[row * self.input_size..][..self.input_size];
                self.truncated_observations.extend_from_slice(observation);
                let own = self.privileged_size;
                self.truncated_privileged.extend_from_slice(&episodes.final_privileged()[row * own..][..own]);
            }
        }
        self.filled += self.rows;
        if self.filled == self.count() {
            self.last_observations.copy_from_slice(episodes.inputs());
            self.last_privileged.copy_from_slice(episodes.privileged());
        }
    }

    /// Fills `next_values` from `values`, the values `last` of the observations after the rollout,
    /// and the values `truncated` of the final observations of truncated episodes.
    pub fn set_next_values(&mut self, last: &[f64], truncated: &[f64]) {
        let kept = self.count() - self.rows;
        self.next_values[..kept].copy_from_slice(&self.values[self.rows..]);
        self.next_values[kept..].copy_from_slice(last);
        for (index, value) in self.truncated.iter().zip(truncated) {
            self.next_values[*index] = *value;
        }
    }

    /// Returns the moments of the present observations, the first `columns` numbers of each row;
    /// the bits do not depend on the number of threads.
    pub fn observation_moments(&self, columns: usize) -> Moments {
        let parts: Vec<Moments> = self
            .observations
            .par_chunks(CHUNK_ROWS * self.input_size)
            .map(|rows| Moments::of_rows(&first_columns(rows, self.input_size, columns), columns))
            .collect();
        merged(&parts, columns)
    }

    /// Returns the moments of the present observations with these indices; the bits do not depend
    /// on the number of threads.
    pub fn observation_moments_at(&self, indices: &[u32], columns: usize) -> Moments {
        let at = |index: &u32| &self.observations[*index as usize * self.input_size..][..columns];
        let parts: Vec<Moments> = indices
            .par_chunks(CHUNK_ROWS)
            .map(|indices| {
                Moments::of_rows(&indices.iter().flat_map(at).copied().collect::<Vec<_>>(), columns)
            })
            .collect();
        merged(&parts, columns)
    }
}

fn merged(parts: &[Moments], columns: usize) -> Moments {
    let mut moments = Moments::new(columns);
    parts.iter().for_each(|part| moments.merge(part));
    moments
}
