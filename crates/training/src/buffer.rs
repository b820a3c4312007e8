//! What a rollout of all rows left behind.

use mishandle_network::{CHUNK_ROWS, Moments};
use mishandle_rollout::{Seed, Stream};
use rayon::prelude::*;

use crate::{Boundary, Episodes};

/// A rollout: `steps` control steps of `rows` simulations, all arrays `[steps, rows]`, time first.
#[derive(Clone, Debug)]
pub struct Buffer {
    rows: usize,
    observation_size: usize,
    action_size: usize,
    filled: usize,
    /// What was seen before each step, as the environment showed it.
    pub observations: Vec<f32>,
    /// What was done, not clipped.
    pub actions: Vec<f32>,
    /// Logarithms of the actions' densities under the policy that took them.
    pub log_probs: Vec<f64>,
    /// Rewards.
    pub rewards: Vec<f64>,
    /// How each step left its episode.
    pub boundaries: Vec<Boundary>,
    /// Values of the observations.
    pub values: Vec<f64>,
    /// Values of what followed; see [`gae`](crate::gae).
    pub next_values: Vec<f64>,
    /// Advantages.
    pub advantages: Vec<f64>,
    /// What was seen after the last step; of a fresh episode where one ended with it.
    pub last_observations: Vec<f32>,
    /// Places of the truncated steps, in order.
    pub truncated: Vec<usize>,
    /// What was seen after each truncated step, before the reset.
    pub truncated_observations: Vec<f32>,
}

impl Buffer {
    /// An empty buffer for `steps` control steps of `rows` simulations.
    pub fn new(steps: usize, rows: usize, observation_size: usize, action_size: usize) -> Buffer {
        let count = steps * rows;
        Buffer {
            rows,
            observation_size,
            action_size,
            filled: 0,
            observations: vec![0.0; count * observation_size],
            actions: vec![0.0; count * action_size],
            log_probs: vec![0.0; count],
            rewards: vec![0.0; count],
            boundaries: vec![Boundary::Running; count],
            values: vec![0.0; count],
            next_values: vec![0.0; count],
            advantages: vec![0.0; count],
            last_observations: vec![0.0; rows * observation_size],
            truncated: Vec::new(),
            truncated_observations: Vec::new(),
        }
    }

    /// Number of simulations.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of entries: control steps times rows.
    pub fn count(&self) -> usize {
        self.rewards.len()
    }

    /// Forgets all entries.
    pub fn clear(&mut self) {
        self.filled = 0;
        self.truncated.clear();
        self.truncated_observations.clear();
    }

    /// Takes in what is seen now, and lends the slices for the actions and their densities to the one that acts.
    ///
    /// # Panics
    /// If the buffer is full.
    pub fn begin_step(&mut self, episodes: &Episodes) -> (&[f32], &mut [f32], &mut [f64]) {
        let first = self.filled;
        let seen =
            &mut self.observations[first * self.observation_size..][..self.rows * self.observation_size];
        seen.copy_from_slice(episodes.observations());
        let actions = &mut self.actions[first * self.action_size..][..self.rows * self.action_size];
        (seen, actions, &mut self.log_probs[first..][..self.rows])
    }

    /// The actions that the step begun last is to be taken with.
    pub fn step_actions(&self) -> &[f32] {
        &self.actions[self.filled * self.action_size..][..self.rows * self.action_size]
    }

    /// Takes in what the step led to.
    pub fn end_step(&mut self, episodes: &Episodes) {
        let step = self.filled..self.filled + self.rows;
        self.rewards[step.clone()].copy_from_slice(episodes.rewards());
        self.boundaries[step].copy_from_slice(episodes.boundaries());
        for (row, boundary) in episodes.boundaries().iter().enumerate() {
            if *boundary == Boundary::Truncated {
                self.truncated.push(self.filled + row);
                let seen =
                    &episodes.final_observations()[row * self.observation_size..][..self.observation_size];
                self.truncated_observations.extend_from_slice(seen);
            }
        }
        self.filled += self.rows;
        if self.filled == self.count() {
            self.last_observations.copy_from_slice(episodes.observations());
        }
    }

    /// Fills `next_values` from `values`, the values of what is seen after the rollout, and those of the truncated
    /// observations.
    pub fn set_next_values(&mut self, last: &[f64], truncated: &[f64]) {
        let kept = self.count() - self.rows;
        self.next_values[..kept].copy_from_slice(&self.values[self.rows..]);
        self.next_values[kept..].copy_from_slice(last);
        for (place, value) in self.truncated.iter().zip(truncated) {
            self.next_values[*place] = *value;
        }
    }

    /// Moments of the observations, the same bits for any number of threads.
    pub fn observation_moments(&self) -> Moments {
        let parts: Vec<Moments> = self
            .observations
            .par_chunks(CHUNK_ROWS * self.observation_size)
            .map(|rows| Moments::of_rows(rows, self.observation_size))
            .collect();
        self.merged(&parts)
    }

    /// Moments of the observations at some places, the same bits for any number of threads.
    pub fn observation_moments_at(&self, places: &[u32]) -> Moments {
        let columns = self.observation_size;
        let at = |place: &u32| &self.observations[*place as usize * columns..][..columns];
        let parts: Vec<Moments> = places
            .par_chunks(CHUNK_ROWS)
            .map(|places| Moments::of_rows(&places.iter().flat_map(at).copied().collect::<Vec<_>>(), columns))
            .collect();
        self.merged(&parts)
    }

    fn merged(&self, parts: &[Moments]) -> Moments {
        let mut moments = Moments::new(self.observation_size);
        parts.iter().for_each(|part| moments.merge(part));
        moments
    }
}

/// Writes the numbers below `order.len()` in random order, the `index`-th of `seed`.
///
/// # Example
/// ```
/// use mishandle_rollout::Seed;
/// let mut order = [0; 10];
/// mishandle_training::shuffle(Seed(1), 0, &mut order);
/// let mut sorted = order;
/// sorted.sort_unstable();
/// assert_eq!(sorted, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
/// assert_ne!(order, sorted);
/// ```
///
/// # Reference
/// Fisher and Yates; Durstenfeld, "Algorithm 235: Random permutation", Communications of the ACM 7(7), 1964.
pub fn shuffle(seed: Seed, index: u64, order: &mut [u32]) {
    for (place, number) in order.iter_mut().zip(0..) {
        *place = number;
    }
    for last in (1..order.len()).rev() {
        let other = seed.uniform(Stream::Shuffle, index, last as u32) * (last + 1) as f64;
        order.swap(last, other as usize);
    }
}
