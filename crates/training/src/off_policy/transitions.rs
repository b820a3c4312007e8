//! Batches of transitions.

use std::ops::Range;

use mishandle_network::Scalar;

/// A batch of transitions with n-step returns. All arrays have the shape `[rows, ..]`.
///
/// ```text
/// y = returns + discounts · value(next_observations, ·)
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TransitionBatch<T> {
    /// Normalized observations.
    pub observations: Vec<T>,
    /// Actions, within [-1, 1].
    pub actions: Vec<T>,
    /// Σ γ^i r_i over k steps; k is n, or less if the episode ended before.
    pub returns: Vec<T>,
    /// γ^k, or 0 if the task terminated the episode.
    pub discounts: Vec<T>,
    /// Normalized observations after the k steps; unused where the discount is 0.
    pub next_observations: Vec<T>,
    /// Privileged inputs of the critics; empty if they see observations only.
    pub privileged: Vec<T>,
    /// Privileged inputs after the k steps.
    pub next_privileged: Vec<T>,
    /// Index of each transition in the replay buffer.
    pub indices: Vec<usize>,
}

/// Consecutive rows of a [`TransitionBatch`].
pub(crate) struct TransitionSlice<'a, T> {
    pub observations: &'a [T],
    pub actions: &'a [T],
    pub returns: &'a [T],
    pub discounts: &'a [T],
    pub next_observations: &'a [T],
    pub privileged: &'a [T],
    pub next_privileged: &'a [T],
}

impl<T> TransitionBatch<T> {
    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.returns.len()
    }

    /// Returns the rows `rows`.
    pub(crate) fn slice(&self, rows: Range<usize>) -> TransitionSlice<'_, T> {
        let total = self.rows();
        TransitionSlice {
            observations: row_slice(&self.observations, total, &rows),
            actions: row_slice(&self.actions, total, &rows),
            returns: &self.returns[rows.clone()],
            discounts: &self.discounts[rows.clone()],
            next_observations: row_slice(&self.next_observations, total, &rows),
            privileged: row_slice(&self.privileged, total, &rows),
            next_privileged: row_slice(&self.next_privileged, total, &rows),
        }
    }
}

impl<T: Scalar> TransitionSlice<'_, T> {
    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.returns.len()
    }

    /// Turns values of the next observations into targets: y = returns + discounts · values.
    pub fn bootstrap(&self, values: &mut [T]) {
        for ((value, returns), discount) in values.iter_mut().zip(self.returns).zip(self.discounts) {
            *value = discount.mul_add(*value, *returns);
        }
    }
}

/// Returns the rows `rows` of an array `[total, ..]`.
pub(crate) fn row_slice<'a, N>(array: &'a [N], total: usize, rows: &Range<usize>) -> &'a [N] {
    let columns = array.len() / total;
    &array[rows.start * columns..rows.end * columns]
}
