//! Multi-threaded batches whose results do not depend on the number of threads.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::scalar::Scalar;

/// The default chunk size in rows: the values of a layer fit in a core's cache, and adding the sums
/// of chunks is cheap.
pub const CHUNK_ROWS: usize = 256;

/// Splits a batch into chunks of a fixed number of rows and processes them on the threads of the
/// current rayon pool.
///
/// `S` is the scratch memory of a chunk, for example a [`Workspace`](crate::Workspace) per network.
/// It is created once per concurrent chunk and reused. The result of a chunk must not depend on its
/// content.
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
    /// Creates a pool with chunks of `chunk_rows` rows, at least one. The last chunk of a batch may
    /// be smaller. See [`CHUNK_ROWS`].
    pub fn new(chunk_rows: usize) -> ChunkPool<T, S> {
        ChunkPool { chunk_rows: chunk_rows.max(1), scratch: Mutex::default(), sums: Vec::new() }
    }

    /// Returns the number of rows per chunk.
    pub fn chunk_rows(&self) -> usize {
        self.chunk_rows
    }

    /// Sets `total` to the sum over all chunks of the vectors that `add` computes.
    ///
    /// `add` takes the chunk's rows, the scratch memory and a vector of zeros with the length of
    /// `total`, and adds to the vector. The vectors are summed in the order of the rows, so the
    /// bits depend on the chunk size but not on the number of threads. Additional elements of the
    /// vector can contain a loss or a count.
    pub fn sum(&mut self, rows: usize, total: &mut [T], add: impl Fn(Range<usize>, &mut S, &mut [T]) + Sync) {
        /// The number of elements of the total that one task sums.
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

    /// Calls `fill` to write each chunk's part of `output`, which has the same number of elements
    /// for every row.
    ///
    /// `fill` takes the chunk's rows, the scratch memory and the chunk's part of `output`.
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
        output.par_chunks_mut(self.chunk_rows * columns).enumerate().for_each(|(c, part)| {
            let first = c * self.chunk_rows;
            with_scratch(&self.scratch, |scratch| fill(first..first + part.len() / columns, scratch, part));
        });
    }
}

/// Runs `work` with scratch memory that no other chunk is using. Memory left by a panic is fine,
/// since its content does not matter.
fn with_scratch<S: Default>(scratches: &Mutex<Vec<S>>, work: impl FnOnce(&mut S)) {
    let lock = || scratches.lock().unwrap_or_else(PoisonError::into_inner);
    let mut scratch = lock().pop().unwrap_or_default();
    work(&mut scratch);
    lock().push(scratch);
}
