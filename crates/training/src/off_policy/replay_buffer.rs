//! Replay buffer with n-step returns.

use mishandle_network::Normalizer;
use mishandle_rollout::{Seed, Stream};

pub use super::transitions::TransitionBatch;
use crate::{Boundary, Checkpoint, Episodes, TrainingError};

/// The last control steps of all environments: one ring buffer per environment.
///
/// An entry contains observation, action, reward, and whether the episode ended. After a truncated
/// step, one more entry contains the final observation of the episode; it is never sampled as a
/// transition. Observations are stored without normalization and normalized when they are sampled.
/// They are whole inputs of the policy: with their histories, if it has one.
///
/// An entry takes 4 (input size + action size + 1) + 1 bytes: one million entries with 30 and 8
/// numbers take 157 MB, and as much in a checkpoint. A history of k adds 152 k MB. Privileged
/// inputs of critics take 4 bytes each.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayBuffer {
    /// Entries per environment.
    length: usize,
    input_size: usize,
    action_size: usize,
    privileged_size: usize,
    /// `[rows, length, ..]`
    observations: Vec<f32>,
    privileged: Vec<f32>,
    actions: Vec<f32>,
    rewards: Vec<f32>,
    kinds: Vec<u8>,
    /// Number of entries written so far for each environment.
    written: Vec<u64>,
}

/// Kinds of entries.
const RUNNING: u8 = 0;
const TERMINATED: u8 = 1;
const TRUNCATED: u8 = 2;
/// The final observation of a truncated episode.
const FINAL_OBSERVATION: u8 = 3;

/// Parameters of sampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Number of steps of the n-step return.
    pub n_steps: usize,
    /// Discount factor γ.
    pub gamma: f64,
    /// Factor on the rewards.
    pub reward_scale: f64,
    /// Whether a batch may contain a transition more than once.
    pub replacement: bool,
}

impl ReplayBuffer {
    /// Creates an empty buffer of `capacity` entries, divided equally between `rows` environments.
    pub fn new(capacity: usize, rows: usize, input_size: usize, action_size: usize) -> ReplayBuffer {
        let length = capacity / rows;
        let count = rows * length;
        ReplayBuffer {
            length,
            input_size,
            action_size,
            privileged_size: 0,
            observations: vec![0.0; count * input_size],
            privileged: Vec::new(),
            actions: vec![0.0; count * action_size],
            rewards: vec![0.0; count],
            kinds: vec![RUNNING; count],
            written: vec![0; rows],
        }
    }

    /// Returns an empty buffer with `size` privileged inputs in each entry.
    #[must_use]
    pub fn with_privileged(self, size: usize) -> ReplayBuffer {
        ReplayBuffer { privileged_size: size, privileged: vec![0.0; self.rewards.len() * size], ..self }
    }

    /// Stores the last step of `episodes`; `observations` are the inputs before the step, `actions`
    /// within [-1, 1].
    pub fn push(&mut self, observations: &[f32], actions: &[f32], episodes: &Episodes) {
        let columns = self.input_size;
        let size = self.action_size;
        let own = self.privileged_size;
        for (row, boundary) in episodes.boundaries().iter().enumerate() {
            let kind = match boundary {
                Boundary::Running => RUNNING,
                Boundary::Terminated => TERMINATED,
                Boundary::Truncated => TRUNCATED,
            };
            let privileged = &episodes.privileged_before()[row * own..][..own];
            let position = self.append(row, &observations[row * columns..][..columns], privileged, kind);
            self.actions[position * size..][..size].copy_from_slice(&actions[row * size..][..size]);
            self.rewards[position] = episodes.rewards()[row] as f32;
            if kind == TRUNCATED {
                self.append(
                    row,
                    &episodes.final_inputs()[row * columns..][..columns],
                    &episodes.final_privileged()[row * own..][..own],
                    FINAL_OBSERVATION,
                );
            }
        }
    }

    fn append(&mut self, row: usize, observation: &[f32], privileged: &[f32], kind: u8) -> usize {
        let position = self.position(row, self.written[row]);
        self.observations[position * self.input_size..][..self.input_size].copy_from_slice(observation);
        self.privileged[position * self.privileged_size..][..self.privileged_size]
            .copy_from_slice(privileged);
        self.kinds[position] = kind;
        self.written[row] += 1;
        position
    }

    /// Returns the position of entry `index` of a row in the arrays.
    fn position(&self, row: usize, index: u64) -> usize {
        row * self.length + (index % self.length as u64) as usize
    }

    /// Samples batch `index` of `seed`, with `rows` rows: transitions drawn uniformly from those
    /// that enough entries follow. Without replacement `rows` must be at most the number of
    /// environments, so that there are enough of them. `normalizer` normalizes the observations,
    /// not the privileged inputs.
    ///
    /// # Panics
    /// If an environment has fewer than `n_steps` + 2 entries.
    pub fn sample(
        &self,
        sampling: &Sampling,
        seed: Seed,
        index: u64,
        rows: usize,
        normalizer: &Normalizer<f32>,
        batch: &mut TransitionBatch<f32>,
    ) {
        let columns = self.input_size;
        let size = self.action_size;
        let own = self.privileged_size;
        batch.observations.clear();
        batch.actions.clear();
        batch.returns.clear();
        batch.discounts.clear();
        batch.next_observations.clear();
        batch.privileged.clear();
        batch.next_privileged.clear();
        batch.indices.clear();
        let mut draw = 0;
        while batch.rows() < rows {
            let (row, start) =
                self.sample_start(sampling.n_steps, seed.uniform(Stream::Shuffle, index, draw));
            draw += 1;
            let position = self.position(row, start);
            let is_duplicate = !sampling.replacement && batch.indices.contains(&position);
            if self.kinds[position] == FINAL_OBSERVATION || is_duplicate {
                continue;
            }
            batch.indices.push(position);
            let NStepReturn { total, discount, next } = self.n_step_return(sampling, row, start);
            batch.observations.extend_from_slice(&self.observations[position * columns..][..columns]);
            batch.actions.extend_from_slice(&self.actions[position * size..][..size]);
            batch.returns.push((total * sampling.reward_scale) as f32);
            batch.discounts.push(discount as f32);
            batch.next_observations.extend_from_slice(&self.observations[next * columns..][..columns]);
            batch.privileged.extend_from_slice(&self.privileged[position * own..][..own]);
            batch.next_privileged.extend_from_slice(&self.privileged[next * own..][..own]);
        }
        normalizer.normalize(&mut batch.observations);
        normalizer.normalize(&mut batch.next_observations);
    }

    /// Returns row and index of an entry for a random number from [0, 1).
    fn sample_start(&self, n_steps: usize, draw: f64) -> (usize, u64) {
        let scaled = draw * self.written.len() as f64;
        let row = scaled as usize;
        let written = self.written[row];
        let oldest = written.saturating_sub(self.length as u64);
        let count = (written - oldest).saturating_sub(n_steps as u64);
        assert!(
            count >= 2,
            "environment {row} has {written} entries in the replay buffer, expected at least {}",
            n_steps + 2
        );
        (row, oldest + ((scaled - row as f64) * count as f64) as u64)
    }

    /// Computes the n-step return from entry `start`.
    fn n_step_return(&self, sampling: &Sampling, row: usize, start: u64) -> NStepReturn {
        let mut total = 0.0;
        let mut discount = 1.0;
        let mut index = start;
        for _ in 0..sampling.n_steps {
            let position = self.position(row, index);
            total += discount * f64::from(self.rewards[position]);
            discount *= sampling.gamma;
            index += 1;
            match self.kinds[position] {
                RUNNING => {}
                TERMINATED => {
                    discount = 0.0;
                    break;
                }
                _ => break,
            }
        }
        NStepReturn { total, discount, next: self.position(row, index) }
    }

    /// Saves the buffer to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        let filled = self.filled();
        checkpoint.put("replay.observations", self.filled_part(&self.observations, filled));
        if self.privileged_size > 0 {
            checkpoint.put("replay.privileged", self.filled_part(&self.privileged, filled));
        }
        checkpoint.put("replay.actions", self.filled_part(&self.actions, filled));
        checkpoint.put("replay.rewards", self.filled_part(&self.rewards, filled));
        checkpoint.put("replay.kinds", words(&self.filled_part(&self.kinds, filled)));
        checkpoint.put("replay.written", self.written.clone());
    }

    /// Restores the buffer from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains a buffer of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let rows = self.written.len();
        self.written = checkpoint.u64s("replay.written", rows)?.to_vec();
        let filled = self.filled();
        let count = rows * filled;
        let observations = checkpoint.f32s("replay.observations", count * self.input_size)?;
        let actions = checkpoint.f32s("replay.actions", count * self.action_size)?;
        let rewards = checkpoint.f32s("replay.rewards", count)?;
        let kinds = bytes(checkpoint.u64s("replay.kinds", count.div_ceil(8))?);
        if self.privileged_size > 0 {
            let privileged = checkpoint.f32s("replay.privileged", count * self.privileged_size)?;
            set_filled_part(&mut self.privileged, rows, privileged);
        }
        set_filled_part(&mut self.observations, rows, observations);
        set_filled_part(&mut self.actions, rows, actions);
        set_filled_part(&mut self.rewards, rows, rewards);
        set_filled_part(&mut self.kinds, rows, &kinds[..count]);
        Ok(())
    }

    /// Returns the number of written entries of the fullest environment.
    fn filled(&self) -> usize {
        let most = self.written.iter().copied().max().unwrap_or(0);
        most.min(self.length as u64) as usize
    }

    /// Returns the first `filled` entries of each environment.
    fn filled_part<N: Copy>(&self, whole: &[N], filled: usize) -> Vec<N> {
        let columns = whole.len() / self.rewards.len();
        let rows = whole.chunks_exact(self.length * columns);
        rows.flat_map(|row| &row[..filled * columns]).copied().collect()
    }
}

/// n-step return of a transition.
struct NStepReturn {
    /// Σ γ^i r_i
    total: f64,
    discount: f64,
    /// Position of the observation after the last step.
    next: usize,
}

/// Writes the first entries of each environment.
fn set_filled_part<N: Copy>(whole: &mut [N], rows: usize, part: &[N]) {
    let row = whole.len() / rows;
    let kept = part.len() / rows;
    for (to, r) in whole.chunks_exact_mut(row).zip(0..) {
        to[..kept].copy_from_slice(&part[r * kept..][..kept]);
    }
}

/// Packs eight bytes into each word.
fn words(bytes: &[u8]) -> Vec<u64> {
    let word = |bytes: &[u8]| {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        u64::from_le_bytes(word)
    };
    bytes.chunks(8).map(word).collect()
}

fn bytes(words: &[u64]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}
