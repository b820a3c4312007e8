//! Gradient of a loss over a batch.

use std::ops::Range;

use mishandle_network::ChunkPool;

/// Rows of a batch per task: few, so that all threads get some.
pub(crate) const LEARNING_ROWS: usize = 64;

/// A loss over a batch and its gradient, summed over chunks of rows; `S` is the scratch memory of
/// one thread.
pub(crate) struct BatchGradient<S> {
    pool: ChunkPool<f32, S>,
    /// Gradient of the last batch, followed by the loss.
    pub sums: Vec<f32>,
    loss: &'static str,
}

impl<S: Default + Send> BatchGradient<S> {
    /// Allocates memory for the loss named `loss` of `parameters` parameters.
    pub fn new(loss: &'static str, parameters: usize) -> BatchGradient<S> {
        BatchGradient { pool: ChunkPool::new(LEARNING_ROWS), sums: vec![0.0; parameters + 1], loss }
    }

    /// Computes gradient and loss over a batch of `rows` rows. `add` adds the contribution of a
    /// range of rows to the gradient and returns their contribution to the loss.
    ///
    /// # Errors
    /// If the loss is NaN or infinite; returns its name.
    pub fn compute(
        &mut self,
        rows: usize,
        add: impl Fn(Range<usize>, &mut S, &mut [f32]) -> f64 + Sync,
    ) -> Result<(&[f32], f32), &'static str> {
        self.pool.sum(rows, &mut self.sums, |rows, scratch, sums| {
            let (gradient, loss) = sums.split_at_mut(sums.len() - 1);
            loss[0] += add(rows, scratch, gradient) as f32;
        });
        let (gradient, loss) = self.sums.split_at(self.sums.len() - 1);
        if loss[0].is_finite() { Ok((gradient, loss[0])) } else { Err(self.loss) }
    }
}
