//! What a network gives for all rows.

use mishandle_network::{ChunkPool, Mlp, Normalizer, Workspace};

/// Rows that are inferred by one task: few, so that all threads have some.
pub(crate) const ACTING_ROWS: usize = 64;

/// What the actions of all rows are chosen by in a control step.
pub(crate) struct Acting {
    pool: ChunkPool<f32, (Vec<f32>, Workspace<f32>)>,
    /// The network's, for each row.
    pub outputs: Vec<f32>,
    /// Standard normal numbers to explore with, as many for each row as an action has numbers.
    pub draws: Vec<f64>,
}

impl Acting {
    /// For `rows` rows and a network with so many outputs.
    pub fn new(rows: usize, outputs: usize, action_size: usize) -> Acting {
        Acting {
            pool: ChunkPool::new(ACTING_ROWS),
            outputs: vec![0.0; rows * outputs],
            draws: vec![0.0; rows * action_size],
        }
    }

    /// Computes the outputs for what all rows see, which `normalizer` scales.
    pub fn infer(&mut self, network: &Mlp<f32>, normalizer: &Normalizer<f32>, seen: &[f32]) {
        let columns = network.input_size();
        self.pool.map(seen.len() / columns, &mut self.outputs, |rows, (inputs, workspace), outputs| {
            inputs.clear();
            inputs.extend_from_slice(&seen[rows.start * columns..rows.end * columns]);
            normalizer.normalize(inputs);
            outputs.copy_from_slice(network.forward(inputs, workspace));
        });
    }
}
