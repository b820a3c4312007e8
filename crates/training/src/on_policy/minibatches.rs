//! Division of a rollout into minibatches.

use std::ops::Range;

use mishandle_rollout::{Seed, Stream};

use crate::TrainingError;
use crate::settings::declare::choice;
use crate::settings::setting::require;

choice! {
    /// Division of a rollout into minibatches.
    pub enum MinibatchScheme {
        /// Shuffled in each epoch; the last minibatch contains the remaining rows.
        Shuffled = "shuffled",
        /// Contiguous slices of the rollout, time first, the same in each epoch; remaining rows are
        /// not used.
        Slices = "slices",
    }
}

/// Minibatches of an epoch.
pub(crate) struct Minibatches {
    /// Seed of the shuffling; `None` for slices.
    seed: Option<Seed>,
    order: Vec<u32>,
    /// Number of rows of a minibatch.
    size: usize,
    /// Number of rows in all minibatches together.
    used: usize,
}

impl Minibatches {
    /// Divides `rows` rows into shuffled minibatches of `size` rows, or into `count` slices.
    pub fn new(scheme: MinibatchScheme, rows: usize, size: usize, count: usize, seed: Seed) -> Minibatches {
        let order = (0..).take(rows).collect();
        match scheme {
            MinibatchScheme::Shuffled => Minibatches { seed: Some(seed), order, size, used: rows },
            MinibatchScheme::Slices => {
                let size = rows / count;
                Minibatches { seed: None, order, size, used: rows - rows % size }
            }
        }
    }

    /// Shuffles the rows for epoch `index`.
    pub fn start_epoch(&mut self, index: u64) {
        if let Some(seed) = self.seed {
            shuffle(seed, index, &mut self.order);
        }
    }

    /// Returns the range of each minibatch in [`order`](Minibatches::order).
    pub fn ranges(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let Minibatches { size, used, .. } = *self;
        (0..used).step_by(size).map(move |first| first..used.min(first + size))
    }

    /// Returns the row indices of the rollout, minibatch after minibatch.
    pub fn order(&self) -> &[u32] {
        &self.order
    }
}

/// Checks that each of `count` slices of `rows` rows has at least two rows, which a standard
/// deviation needs.
pub(crate) fn check_minibatch_count(rows: usize, count: usize) -> Result<(), TrainingError> {
    let expected = "at least 1, and at most half the number of rows of a rollout";
    require("minibatch_count", expected, count, count >= 1 && rows / count >= 2)
}

/// Fills `order` with a random permutation of its indices: permutation `index` of `seed`.
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
/// Fisher and Yates; Durstenfeld, "Algorithm 235: Random permutation", Communications of the ACM
/// 7(7), 1964.
pub fn shuffle(seed: Seed, index: u64, order: &mut [u32]) {
    for (entry, number) in order.iter_mut().zip(0..) {
        *entry = number;
    }
    for last in (1..order.len()).rev() {
        let other = seed.uniform(Stream::Shuffle, index, last as u32) * (last + 1) as f64;
        order.swap(last, other as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffled_minibatches_contain_every_row_once() {
        let mut minibatches = Minibatches::new(MinibatchScheme::Shuffled, 11, 4, 2, Seed(1));
        minibatches.start_epoch(3);
        let first = minibatches.order().to_vec();
        assert_eq!(minibatches.ranges().collect::<Vec<_>>(), [0..4, 4..8, 8..11]);
        let mut sorted = first.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..11) && sorted != first);
        minibatches.start_epoch(4);
        assert_ne!(minibatches.order(), first);
    }

    #[test]
    fn slices_have_equal_sizes_and_are_in_order() {
        // skrl takes slices of 11 / 3 = 3 rows as long as 3 rows remain.
        let mut minibatches = Minibatches::new(MinibatchScheme::Slices, 11, 4, 3, Seed(1));
        minibatches.start_epoch(3);
        assert!(minibatches.order().iter().copied().eq(0..11));
        assert_eq!(minibatches.ranges().collect::<Vec<_>>(), [0..3, 3..6, 6..9]);
        // 11 / 4 = 2 rows give five slices.
        assert_eq!(Minibatches::new(MinibatchScheme::Slices, 11, 4, 4, Seed(1)).ranges().count(), 5);
    }
}
