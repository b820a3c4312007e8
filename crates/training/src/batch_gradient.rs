//! The gradient of a loss over a batch.

use std::ops::Range;

use mishandle_network::ChunkPool;

/// Rows of a batch that one task learns from: few, so that all threads have some.
pub(crate) const LEARNING_ROWS: usize = 64;

/// A loss over a batch and its gradient, summed over chunks of rows; `S` is what a thread needs for a chunk.
pub(crate) struct BatchGradient<S> {
    pool: ChunkPool<f32, S>,
    /// The gradient of the last batch, with the loss behind it.
    pub sums: Vec<f32>,
    loss: &'static str,
}

impl<S: Default + Send> BatchGradient<S> {
    /// Of the loss with this name, by so many parameters.
    pub fn new(loss: &'static str, parameters: usize) -> BatchGradient<S> {
        BatchGradient { pool: ChunkPool::new(LEARNING_ROWS), sums: vec![0.0; parameters + 1], loss }
    }

    /// The gradient over a batch of `rows` rows, and the loss. `add` adds the share of some of them to a gradient, and gives
    /// their share of the loss.
    ///
    /// # Errors
    /// The loss's name, if it is not finite.
    pub fn of(
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
