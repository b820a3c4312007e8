//! What was seen and done, kept for long, and batches drawn from it.

use mishandle_network::Normalizer;
use mishandle_rollout::{Seed, Stream};

pub use crate::batch::Batch;
use crate::{Boundary, Checkpoint, Episodes, TrainingError};

/// The last control steps of all rows: a ring for each row.
///
/// An entry is what was seen, what was done, the reward, and how the step left the episode. Behind a truncated step
/// stands one more entry, with the true last observation of its episode alone; it is never the start of anything.
/// Observations are kept as the environment showed them and scaled when they are drawn.
///
/// An entry takes 4 (observation size + action size + 1) + 1 bytes: a million of them with 30 and 8 numbers, 157 MB;
/// a checkpoint holds as much.
#[derive(Clone, Debug, PartialEq)]
pub struct Replay {
    /// Entries of a row's ring.
    length: usize,
    observation_size: usize,
    action_size: usize,
    /// `[rows, length, ..]`
    observations: Vec<f32>,
    actions: Vec<f32>,
    rewards: Vec<f32>,
    kinds: Vec<u8>,
    /// Entries written so far to each row.
    written: Vec<u64>,
}

/// Kinds of entries.
const RUNNING: u8 = 0;
const TERMINATED: u8 = 1;
const TRUNCATED: u8 = 2;
/// The observation after a truncated step.
const LAST: u8 = 3;

/// How batches are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Control steps whose rewards are summed.
    pub n_steps: usize,
    /// γ
    pub gamma: f64,
    /// Factor on rewards.
    pub reward_scale: f64,
    /// Whether an entry may be the start of more than one row.
    pub replacement: bool,
}

impl Replay {
    /// An empty replay of `capacity` entries in equal parts for `rows` rows.
    pub fn new(capacity: usize, rows: usize, observation_size: usize, action_size: usize) -> Replay {
        let length = capacity / rows;
        let count = rows * length;
        Replay {
            length,
            observation_size,
            action_size,
            observations: vec![0.0; count * observation_size],
            actions: vec![0.0; count * action_size],
            rewards: vec![0.0; count],
            kinds: vec![RUNNING; count],
            written: vec![0; rows],
        }
    }

    /// Takes in the last step of `episodes`: `seen` before it, `actions` within [-1, 1].
    pub fn push(&mut self, seen: &[f32], actions: &[f32], episodes: &Episodes) {
        let (columns, size) = (self.observation_size, self.action_size);
        for (row, boundary) in episodes.boundaries().iter().enumerate() {
            let kind = match boundary {
                Boundary::Running => RUNNING,
                Boundary::Terminated => TERMINATED,
                Boundary::Truncated => TRUNCATED,
            };
            let place = self.append(row, &seen[row * columns..][..columns], kind);
            self.actions[place * size..][..size].copy_from_slice(&actions[row * size..][..size]);
            self.rewards[place] = episodes.rewards()[row] as f32;
            if kind == TRUNCATED {
                self.append(row, &episodes.final_observations()[row * columns..][..columns], LAST);
            }
        }
    }

    fn append(&mut self, row: usize, observation: &[f32], kind: u8) -> usize {
        let place = self.place(row, self.written[row]);
        self.observations[place * self.observation_size..][..self.observation_size]
            .copy_from_slice(observation);
        self.kinds[place] = kind;
        self.written[row] += 1;
        place
    }

    /// Where the entry numbered `index` of a row is.
    fn place(&self, row: usize, index: u64) -> usize {
        row * self.length + (index % self.length as u64) as usize
    }

    /// Fills `batch` with `rows` rows, the `index`-th batch of `seed`: uniformly drawn starts among all that are followed by
    /// enough entries. Without replacement there must be as many of them: there are if `rows` is at most the number of rows
    /// that are remembered.
    ///
    /// # Panics
    /// If a row has fewer than `n_steps` + 2 entries.
    pub fn sample(
        &self,
        sampling: &Sampling,
        (seed, index): (Seed, u64),
        rows: usize,
        normalizer: &Normalizer<f32>,
        batch: &mut Batch<f32>,
    ) {
        let (columns, size) = (self.observation_size, self.action_size);
        batch.observations.clear();
        batch.actions.clear();
        batch.returns.clear();
        batch.discounts.clear();
        batch.next_observations.clear();
        batch.starts.clear();
        let mut draw = 0;
        while batch.rows() < rows {
            let (row, start) = self.start(sampling.n_steps, seed.uniform(Stream::Shuffle, index, draw));
            draw += 1;
            let place = self.place(row, start);
            let is_drawn = !sampling.replacement && batch.starts.contains(&place);
            if self.kinds[place] == LAST || is_drawn {
                continue;
            }
            batch.starts.push(place);
            let Steps { total, discount, next } = self.follow(sampling, row, start);
            batch.observations.extend_from_slice(&self.observations[place * columns..][..columns]);
            batch.actions.extend_from_slice(&self.actions[place * size..][..size]);
            batch.returns.push((total * sampling.reward_scale) as f32);
            batch.discounts.push(discount as f32);
            batch.next_observations.extend_from_slice(&self.observations[next * columns..][..columns]);
        }
        normalizer.normalize(&mut batch.observations);
        normalizer.normalize(&mut batch.next_observations);
    }

    /// The row and the number of an entry, for a number drawn from [0, 1).
    fn start(&self, n_steps: usize, draw: f64) -> (usize, u64) {
        let scaled = draw * self.written.len() as f64;
        let row = scaled as usize;
        let written = self.written[row];
        let oldest = written.saturating_sub(self.length as u64);
        let count = (written - oldest).saturating_sub(n_steps as u64);
        assert!(count >= 2, "row {row} of the replay has {written} entries, {} are needed", n_steps + 2);
        (row, oldest + ((scaled - row as f64) * count as f64) as u64)
    }

    /// What followed the entry numbered `start`.
    fn follow(&self, sampling: &Sampling, row: usize, start: u64) -> Steps {
        let (mut total, mut discount, mut index) = (0.0, 1.0, start);
        for _ in 0..sampling.n_steps {
            let place = self.place(row, index);
            total += discount * f64::from(self.rewards[place]);
            discount *= sampling.gamma;
            index += 1;
            match self.kinds[place] {
                RUNNING => {}
                TERMINATED => {
                    discount = 0.0;
                    break;
                }
                _ => break,
            }
        }
        Steps { total, discount, next: self.place(row, index) }
    }

    /// Puts what is remembered into a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        let filled = self.filled();
        checkpoint.put("replay.observations", self.part(&self.observations, filled));
        checkpoint.put("replay.actions", self.part(&self.actions, filled));
        checkpoint.put("replay.rewards", self.part(&self.rewards, filled));
        checkpoint.put("replay.kinds", words(&self.part(&self.kinds, filled)));
        checkpoint.put("replay.written", self.written.clone());
    }

    /// Remembers what a checkpoint does.
    ///
    /// # Errors
    /// If the checkpoint holds a replay of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let rows = self.written.len();
        self.written = checkpoint.u64s("replay.written", rows)?.to_vec();
        let filled = self.filled();
        let count = rows * filled;
        let observations = checkpoint.f32s("replay.observations", count * self.observation_size)?;
        let actions = checkpoint.f32s("replay.actions", count * self.action_size)?;
        let rewards = checkpoint.f32s("replay.rewards", count)?;
        let kinds = bytes(checkpoint.u64s("replay.kinds", count.div_ceil(8))?);
        set_part(&mut self.observations, rows, observations);
        set_part(&mut self.actions, rows, actions);
        set_part(&mut self.rewards, rows, rewards);
        set_part(&mut self.kinds, rows, &kinds[..count]);
        Ok(())
    }

    /// Entries of a row that were ever written, of the fullest row.
    fn filled(&self) -> usize {
        let most = self.written.iter().copied().max().unwrap_or(0);
        most.min(self.length as u64) as usize
    }

    /// The first `filled` entries of each row.
    fn part<N: Copy>(&self, whole: &[N], filled: usize) -> Vec<N> {
        let columns = whole.len() / self.rewards.len();
        let rows = whole.chunks_exact(self.length * columns);
        rows.flat_map(|row| &row[..filled * columns]).copied().collect()
    }
}

/// Some steps from a start.
struct Steps {
    /// Σ γ^i r_i
    total: f64,
    discount: f64,
    /// Place of the observation behind them.
    next: usize,
}

/// Writes the first entries of each row.
fn set_part<N: Copy>(whole: &mut [N], rows: usize, part: &[N]) {
    let (row, kept) = (whole.len() / rows, part.len() / rows);
    for (to, r) in whole.chunks_exact_mut(row).zip(0..) {
        to[..kept].copy_from_slice(&part[r * kept..][..kept]);
    }
}

/// Eight bytes to a number.
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
