//! Choosing the actions of all rows.

use mishandle_network::{ChunkPool, Normalizer, Workspace};
use mishandle_rollout::{Seed, Stream};
use rayon::prelude::*;

use crate::off_policy::Agent;

/// Rows that are inferred by one task: few, so that all threads have some.
const ACTING_ROWS: usize = 64;

/// What all rows see and do in a control step.
pub(crate) struct Acting {
    rows: usize,
    pool: ChunkPool<f32, (Vec<f32>, Workspace<f32>)>,
    /// What was seen before the step.
    pub seen: Vec<f32>,
    outputs: Vec<f32>,
    /// Standard normal numbers to explore with.
    pub draws: Vec<f64>,
    /// What is done, within [-1, 1].
    pub actions: Vec<f32>,
}

impl Acting {
    /// For `rows` rows, whose observations, actions and outputs of the actor have these many numbers.
    pub fn new(rows: usize, observation_size: usize, action_size: usize, output_size: usize) -> Acting {
        Acting {
            rows,
            pool: ChunkPool::new(ACTING_ROWS),
            seen: vec![0.0; rows * observation_size],
            outputs: vec![0.0; rows * output_size],
            draws: vec![0.0; rows * action_size],
            actions: vec![0.0; rows * action_size],
        }
    }

    /// Actions drawn uniformly from [-1, 1], for warming up.
    pub fn act_randomly(&mut self, seed: Seed, step: u64) {
        for (action, index) in self.actions.iter_mut().zip(0..) {
            *action = (2.0 * seed.uniform(Stream::Policy, step, index) - 1.0) as f32;
        }
    }

    /// The actions that `agent` explores with.
    pub fn act<A: Agent + Sync>(&mut self, agent: &A, normalizer: &Normalizer<f32>) {
        let Acting { rows, pool, seen, outputs, draws, actions } = self;
        let (rows, actor) = (*rows, agent.actor());
        let columns = actor.input_size();
        pool.map(rows, outputs, |rows, (inputs, workspace), outputs| {
            inputs.clear();
            inputs.extend_from_slice(&seen[rows.start * columns..rows.end * columns]);
            normalizer.normalize(inputs);
            outputs.copy_from_slice(actor.forward(inputs, workspace));
        });
        let size = draws.len() / rows;
        let each = outputs.par_chunks(actor.output_size()).zip(draws.par_chunks(size));
        let each = each.zip(actions.par_chunks_mut(size)).enumerate().with_min_len(ACTING_ROWS);
        each.for_each(|(row, ((outputs, draws), action))| agent.explore(row, rows, outputs, draws, action));
    }
}
