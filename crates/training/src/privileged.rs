//! Normalization of the privileged inputs of critics, and rows that combine them with observations.

use mishandle_network::{Moments, Normalizer, RunningNormalizer};

use crate::{Checkpoint, Episodes, TrainingError, inference::observation_normalizer};

/// Normalizes privileged inputs: the observation of the environment, at the start of each row, by
/// its own running moments. The values of the scenario after it are scaled already.
pub(crate) struct PrivilegedNormalizer {
    running: RunningNormalizer,
    normalizes: bool,
    /// Length of a row.
    size: usize,
}

impl PrivilegedNormalizer {
    /// Makes the normalizer for the privileged inputs of `episodes`. The other parameters are those
    /// of observations.
    pub fn new(episodes: &Episodes, normalizes: bool, std_floor: f64) -> PrivilegedNormalizer {
        PrivilegedNormalizer {
            running: observation_normalizer(episodes.spec(), normalizes, std_floor),
            normalizes,
            size: episodes.privileged_size(),
        }
    }

    fn columns(&self) -> usize {
        self.running.mean().len()
    }

    /// Returns a normalizer with the current moments.
    pub fn freeze(&self) -> Normalizer<f32> {
        self.running.freeze()
    }

    /// Normalizes rows.
    pub fn normalize(&self, normalizer: &Normalizer<f32>, rows: &mut [f32]) {
        if self.size > 0 {
            let columns = self.columns();
            rows.chunks_exact_mut(self.size).for_each(|row| normalizer.normalize(&mut row[..columns]));
        }
    }

    /// Updates the moments with rows that are not normalized.
    pub fn update(&mut self, rows: &[f32]) {
        if self.size == 0 || !self.normalizes {
            return;
        }
        let columns = self.columns();
        let seen: Vec<f32> = rows.chunks_exact(self.size).flat_map(|row| &row[..columns]).copied().collect();
        self.running.merge(&Moments::of_rows(&seen, columns));
    }

    /// Saves the moments to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        if self.size > 0 {
            checkpoint.put_moments("privileged.normalizer", self.running.moments());
        }
    }

    /// Restores the moments from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains moments of another size.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        if self.size > 0 {
            self.running.restore(checkpoint.moments("privileged.normalizer", self.columns())?)?;
        }
        Ok(())
    }
}

/// Fills `inputs` with the rows of `observations` and, after each, the row of `privileged` with an
/// index of `rows`. `columns` and `size` are the lengths of their rows.
pub(crate) fn join(
    observations: &[f32],
    columns: usize,
    privileged: &[f32],
    size: usize,
    rows: impl Iterator<Item = usize>,
    inputs: &mut [f32],
) {
    let each = observations.chunks_exact(columns).zip(rows).zip(inputs.chunks_exact_mut(columns + size));
    for ((observation, row), input) in each {
        let (seen, rest) = input.split_at_mut(columns);
        seen.copy_from_slice(observation);
        rest.copy_from_slice(&privileged[row * size..][..size]);
    }
}
