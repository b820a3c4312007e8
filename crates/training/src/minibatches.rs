//! How the rows of a rollout are divided into minibatches.

use std::ops::Range;

use mishandle_rollout::Seed;

use crate::declare::choice;
use crate::setting::ask;
use crate::{TrainingError, shuffle};

choice! {
    /// How the rows of a rollout are divided into minibatches.
    pub enum Division {
        /// In random order, anew in each epoch; the last minibatch has what is left.
        Shuffled = "shuffled",
        /// As they were rolled out, time first, the same in each epoch; what is left is not learned from.
        Slices = "slices",
    }
}

/// The minibatches of an epoch.
pub(crate) struct Minibatches {
    /// What the rows are shuffled with, if they are.
    seed: Option<Seed>,
    order: Vec<u32>,
    /// Rows of a minibatch.
    size: usize,
    /// Rows that are learned from.
    used: usize,
}

impl Minibatches {
    /// Of `rows` rows: shuffled ones of `size`, or that many `slices`.
    pub fn new(division: Division, rows: usize, size: usize, slices: usize, seed: Seed) -> Minibatches {
        let order = (0..).take(rows).collect();
        match division {
            Division::Shuffled => Minibatches { seed: Some(seed), order, size, used: rows },
            Division::Slices => {
                let size = rows / slices;
                Minibatches { seed: None, order, size, used: rows - rows % size }
            }
        }
    }

    /// Draws the order of the epoch numbered `index`.
    pub fn begin_epoch(&mut self, index: u64) {
        if let Some(seed) = self.seed {
            shuffle(seed, index, &mut self.order);
        }
    }

    /// The places that [`order`](Minibatches::order) has each minibatch at.
    pub fn ranges(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let Minibatches { size, used, .. } = *self;
        (0..used).step_by(size).map(move |first| first..used.min(first + size))
    }

    /// The rows of the rollout, minibatch after minibatch.
    pub fn order(&self) -> &[u32] {
        &self.order
    }
}

/// Checks that a rollout of `rows` rows has enough of them for so many slices: for a deviation there must be two.
pub(crate) fn check_slices(rows: usize, slices: usize) -> Result<(), TrainingError> {
    let wanted = "at least 1, and at most half as many as rows of a rollout";
    ask("slices", wanted, slices, slices >= 1 && rows / slices >= 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shuffled_minibatches_have_every_row_once() {
        let mut minibatches = Minibatches::new(Division::Shuffled, 11, 4, 2, Seed(1));
        minibatches.begin_epoch(3);
        let first = minibatches.order().to_vec();
        assert_eq!(minibatches.ranges().collect::<Vec<_>>(), [0..4, 4..8, 8..11]);
        let mut sorted = first.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..11) && sorted != first);
        minibatches.begin_epoch(4);
        assert_ne!(minibatches.order(), first);
    }

    #[test]
    fn slices_are_whole_and_in_order() {
        // skrl takes a fixed number of rows, 11 / 3 = 3, as often as there are so many.
        let mut minibatches = Minibatches::new(Division::Slices, 11, 4, 3, Seed(1));
        minibatches.begin_epoch(3);
        assert!(minibatches.order().iter().copied().eq(0..11));
        assert_eq!(minibatches.ranges().collect::<Vec<_>>(), [0..3, 3..6, 6..9]);
        // 11 / 4 = 2 makes five of them.
        assert_eq!(Minibatches::new(Division::Slices, 11, 4, 4, Seed(1)).ranges().count(), 5);
    }
}
