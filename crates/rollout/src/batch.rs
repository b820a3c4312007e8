use std::sync::Arc;

use rayon::prelude::*;

use crate::{
    Environment, EnvironmentBatch, EnvironmentWorker, RolloutError, Sample, Scenario, Seed, Start, StepStatus,
};

/// Chunks of rows per thread. More than one balances the load between threads.
const CHUNKS_PER_THREAD: usize = 4;

/// Many simulations of one environment, stepped together on all threads of the current rayon pool.
///
/// Its buffers are row-major. The same seeds and actions give the same bits for any number of
/// threads.
pub struct CpuBatch<E: Environment + ?Sized = dyn Environment> {
    environment: Arc<E>,
    chunks: Vec<Chunk>,
    rows_per_chunk: usize,
    rows: usize,
    buffers: Buffers,
    statuses: Vec<StepStatus>,
    /// Index of the start of each row that [`EnvironmentBatch::reset`] resets.
    starting: Vec<Option<usize>>,
}

/// Output buffers of a whole batch. Each is row-major, with one row per simulation.
#[derive(Debug)]
pub struct Samples<'a> {
    /// The observations, `[rows, observation_size]`.
    pub observations: &'a mut [f32],
    /// The signals, `[rows, signals]`.
    pub signals: &'a mut [f64],
    /// The reward terms, `[rows, reward terms]`.
    pub rewards: &'a mut [f64],
}

/// The buffers of a batch that writes into its own.
#[derive(Default)]
struct Buffers {
    observations: Vec<f32>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
}

impl Buffers {
    fn samples(&mut self) -> Samples<'_> {
        Samples {
            observations: &mut self.observations,
            signals: &mut self.signals,
            rewards: &mut self.rewards,
        }
    }
}

struct Chunk {
    worker: Box<dyn EnvironmentWorker>,
    states: Vec<f64>,
}

impl<E: Environment + ?Sized> CpuBatch<E> {
    /// Makes a batch of `rows` simulations. Every row must be [reset](Self::reset) before its first
    /// step.
    pub fn new(environment: Arc<E>, rows: usize) -> CpuBatch<E> {
        let rows_per_chunk = rows.div_ceil(rayon::current_num_threads() * CHUNKS_PER_THREAD).max(1);
        let chunk = || Chunk {
            worker: environment.worker_of(rows_per_chunk),
            states: vec![0.0; rows_per_chunk * environment.state_size()],
        };
        CpuBatch {
            chunks: (0..rows.div_ceil(rows_per_chunk)).map(|_| chunk()).collect(),
            rows_per_chunk,
            rows,
            buffers: Buffers {
                observations: vec![0.0; rows * environment.observation_size()],
                signals: vec![0.0; rows * environment.signals().len()],
                rewards: vec![0.0; rows * environment.reward_terms().len()],
            },
            statuses: vec![StepStatus::Running; rows],
            starting: vec![None; rows],
            environment,
        }
    }

    /// Returns the number of simulations.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the environment.
    pub fn environment(&self) -> &Arc<E> {
        &self.environment
    }

    /// Starts a new simulation in every row for which `start` returns a scenario and a seed.
    pub fn reset(&mut self, start: impl Fn(usize) -> Option<(Scenario, Seed)> + Sync) {
        let mut buffers = std::mem::take(&mut self.buffers);
        self.reset_into(start, buffers.samples());
        self.buffers = buffers;
    }

    /// As [`reset`](Self::reset), but writes into the buffers of the caller. Other rows of the
    /// buffers keep their contents.
    ///
    /// # Panics
    /// If a buffer has another length.
    pub fn reset_into(
        &mut self,
        start: impl Fn(usize) -> Option<(Scenario, Seed)> + Sync,
        samples: Samples<'_>,
    ) {
        self.for_rows(samples, |row, worker, state, sample, status| {
            if let Some((scenario, seed)) = start(row) {
                *status = worker.reset(&scenario, seed, state, sample);
            }
        });
    }

    /// Advances every row by one control step. `actions` has the shape `[rows, action_size]` and is
    /// not clipped.
    pub fn step(&mut self, actions: &[f64]) {
        let mut buffers = std::mem::take(&mut self.buffers);
        self.step_into(actions, buffers.samples());
        self.buffers = buffers;
    }

    /// As [`step`](Self::step), but writes into the buffers of the caller.
    ///
    /// # Panics
    /// If a buffer has another length.
    pub fn step_into(&mut self, actions: &[f64], samples: Samples<'_>) {
        let size = self.environment.action_size();
        self.for_rows(samples, |row, worker, state, sample, status| {
            *status = worker.step(&actions[row * size..][..size], state, sample);
        });
    }

    /// Returns the current observations, `[rows, observation_size]`.
    pub fn observations(&self) -> &[f32] {
        &self.buffers.observations
    }

    /// Returns the current signals, `[rows, signals]`.
    pub fn signals(&self) -> &[f64] {
        &self.buffers.signals
    }

    /// Returns the reward terms of the last step, `[rows, reward terms]`.
    pub fn rewards(&self) -> &[f64] {
        &self.buffers.rewards
    }

    /// Returns the status of each row after the last step.
    pub fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    /// Copies the state of simulation `row` into `state`. A simulation restored from it continues
    /// with the same bits.
    pub fn read_state(&self, row: usize, state: &mut [f64]) {
        let size = self.environment.state_size();
        let chunk = &self.chunks[row / self.rows_per_chunk];
        state.copy_from_slice(&chunk.states[(row % self.rows_per_chunk) * size..][..size]);
    }

    /// Restores the state of simulation `row`. Its observation, signals and rewards are updated by
    /// the next step.
    pub fn write_state(&mut self, row: usize, state: &[f64]) {
        let size = self.environment.state_size();
        let chunk = &mut self.chunks[row / self.rows_per_chunk];
        chunk.states[(row % self.rows_per_chunk) * size..][..size].copy_from_slice(state);
    }

    fn for_rows(
        &mut self,
        Samples { observations: o, signals: s, rewards: r }: Samples<'_>,
        each: impl Fn(usize, &mut dyn EnvironmentWorker, &mut [f64], Sample<'_>, &mut StepStatus) + Sync,
    ) {
        let state_size = self.environment.state_size();
        let observation_size = self.environment.observation_size();
        let signals = self.environment.signals().len();
        let rewards = self.environment.reward_terms().len();
        assert_eq!(o.len(), self.rows * observation_size, "length of the observations");
        assert_eq!(s.len(), self.rows * signals, "length of the signals");
        assert_eq!(r.len(), self.rows * rewards, "length of the reward terms");
        let rows = self.rows_per_chunk;
        self.chunks
            .par_iter_mut()
            .zip(o.par_chunks_mut(rows * observation_size))
            .zip(s.par_chunks_mut(rows * signals))
            .zip(r.par_chunks_mut(rows * rewards))
            .zip(self.statuses.par_chunks_mut(rows))
            .enumerate()
            .for_each(|(chunk_index, ((((chunk, o), s), r), statuses))| {
                for (i, status) in statuses.iter_mut().enumerate() {
                    let sample = Sample {
                        observation: &mut o[i * observation_size..][..observation_size],
                        signals: &mut s[i * signals..][..signals],
                        rewards: &mut r[i * rewards..][..rewards],
                    };
                    let state = &mut chunk.states[i * state_size..][..state_size];
                    each(chunk_index * rows + i, chunk.worker.as_mut(), state, sample, status);
                }
            });
    }
}

impl<E: Environment + ?Sized> EnvironmentBatch for CpuBatch<E> {
    fn rows(&self) -> usize {
        self.rows
    }

    fn reset(&mut self, starts: &[Start]) -> Result<(), RolloutError> {
        let mut starting = std::mem::take(&mut self.starting);
        starts.iter().enumerate().for_each(|(index, start)| starting[start.row] = Some(index));
        CpuBatch::reset(self, |row| {
            starting[row].map(|index| (starts[index].scenario.clone(), starts[index].seed))
        });
        starting.fill(None);
        self.starting = starting;
        Ok(())
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        CpuBatch::step(self, actions);
        Ok(())
    }

    fn observations(&self) -> &[f32] {
        &self.buffers.observations
    }

    fn rewards(&self) -> &[f64] {
        &self.buffers.rewards
    }

    fn statuses(&self) -> &[StepStatus] {
        &self.statuses
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        let size = self.environment.state_size();
        for row in 0..self.rows {
            self.read_state(row, &mut states[row * size..][..size]);
        }
        Ok(())
    }

    fn write_states(&mut self, states: &[f64], observations: &[f32]) -> Result<(), RolloutError> {
        let size = self.environment.state_size();
        for row in 0..self.rows {
            self.write_state(row, &states[row * size..][..size]);
        }
        self.buffers.observations.copy_from_slice(observations);
        Ok(())
    }
}
