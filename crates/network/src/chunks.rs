//! Batches over threads, with results that do not depend on how many there are.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::scalar::Scalar;

/// A good number of rows in a chunk: the values of a layer then stay in a core's cache, and the sums of chunks cost little.
pub const CHUNK_ROWS: usize = 256;

/// Cuts a batch into chunks of a fixed number of rows and runs them on the threads of the rayon pool that it is called in.
///
/// `S` is what a chunk needs to work in, for instance a [`Workspace`](crate::Workspace) per network. As many are made as chunks run
/// at once, and they are reused. A chunk must not depend on what is left in it.
///
/// # Example
/// ```
/// use mishandle_network::{Activation, ChunkPool, Mlp, Workspace};
///
/// // The gradient of Σ y² / 2 over 1,000 rows, where y = a x + b.
/// let mut network = Mlp::<f32>::new(&[1, 1], Activation::Elu, Activation::Identity)?;
/// network.update(|parameters| parameters.copy_from_slice(&[1.0, 1.0]));
/// let inputs = vec![2.0; 1000];
/// let mut pool = ChunkPool::<f32, Workspace<f32>>::new(256);
/// let mut gradient = [0.0; 2];
/// pool.sum(1000, &mut gradient, |rows, workspace, gradient| {
///     let outputs = network.forward(&inputs[rows], workspace).to_vec();
///     network.backward(&outputs, workspace, Some(gradient), None);
/// });
/// assert_eq!(gradient, [6000.0, 3000.0]); // y = 3: Σ y x, Σ y
/// # Ok::<(), mishandle_network::NetworkError>(())
/// ```
#[derive(Debug)]
pub struct ChunkPool<T, S> {
    chunk_rows: usize,
    scratch: Mutex<Vec<S>>,
    sums: Vec<T>,
}

impl<T: Scalar, S: Default + Send> ChunkPool<T, S> {
    /// A pool for chunks of `chunk_rows` rows (at least one), the last of a batch having what is left. See [`CHUNK_ROWS`].
    pub fn new(chunk_rows: usize) -> ChunkPool<T, S> {
        ChunkPool { chunk_rows: chunk_rows.max(1), scratch: Mutex::default(), sums: Vec::new() }
    }

    /// How many rows a chunk has.
    pub fn chunk_rows(&self) -> usize {
        self.chunk_rows
    }

    /// Sets `total` to the sum over all chunks of what `add` adds to its own vector of as many numbers, which begins at zero.
    ///
    /// `add` is given the chunk's rows, scratch and vector. The chunks' vectors are added in the order of the rows, so the bits depend on
    /// the size of a chunk and never on the threads. A loss or a count can ride along in extra numbers of the vector.
    pub fn sum(&mut self, rows: usize, total: &mut [T], add: impl Fn(Range<usize>, &mut S, &mut [T]) + Sync) {
        /// How many numbers of the total a thread adds up at a time.
        const BLOCK: usize = 4096;
        let count = total.len();
        if count == 0 {
            return;
        }
        let ChunkPool { chunk_rows, scratch, sums } = self;
        sums.resize(rows.div_ceil(*chunk_rows) * count, T::ZERO);
        sums.par_chunks_exact_mut(count).enumerate().for_each(|(c, sum)| {
            sum.fill(T::ZERO);
            let first = c * *chunk_rows;
            with_scratch(scratch, |scratch| add(first..rows.min(first + *chunk_rows), scratch, sum));
        });
        total.par_chunks_mut(BLOCK).enumerate().for_each(|(b, total)| {
            total.fill(T::ZERO);
            for sum in sums.chunks_exact(count) {
                for (total, number) in total.iter_mut().zip(&sum[b * BLOCK..]) {
                    *total += *number;
                }
            }
        });
    }

    /// Lets `fill` write each chunk's share of `output`, which has as many numbers for each row.
    ///
    /// `fill` is given the chunk's rows, scratch and share.
    ///
    /// # Panics
    /// If the length of `output` is not a multiple of `rows`.
    pub fn map<O: Send>(
        &self,
        rows: usize,
        output: &mut [O],
        fill: impl Fn(Range<usize>, &mut S, &mut [O]) + Sync,
    ) {
        if rows == 0 || output.is_empty() {
            return;
        }
        assert!(output.len().is_multiple_of(rows), "output: {} numbers for {rows} rows", output.len());
        let columns = output.len() / rows;
        output.par_chunks_mut(self.chunk_rows * columns).enumerate().for_each(|(c, share)| {
            let first = c * self.chunk_rows;
            with_scratch(&self.scratch, |scratch| fill(first..first + share.len() / columns, scratch, share));
        });
    }
}

/// Runs `work` with a scratch that no other chunk holds. What a panic left behind is no worse than what a chunk leaves.
fn with_scratch<S: Default>(scratches: &Mutex<Vec<S>>, work: impl FnOnce(&mut S)) {
    let lock = || scratches.lock().unwrap_or_else(PoisonError::into_inner);
    let mut scratch = lock().pop().unwrap_or_default();
    work(&mut scratch);
    lock().push(scratch);
}
