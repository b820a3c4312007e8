//! Experience that is learned from at once.

use std::ops::Range;

use mishandle_network::Scalar;

/// Rows of experience, all arrays `[rows, ..]`.
///
/// ```text
/// y = returns + discounts · value(next_observations, ·)
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch<T> {
    /// What was seen, scaled.
    pub observations: Vec<T>,
    /// What was done, within [-1, 1].
    pub actions: Vec<T>,
    /// Σ γ^i r_i over k steps: as many as were asked for, or those up to the episode's end.
    pub returns: Vec<T>,
    /// γ^k, or 0 if the task ended the episode.
    pub discounts: Vec<T>,
    /// What was seen after the k steps, scaled; of no importance where the discount is 0.
    pub next_observations: Vec<T>,
    /// Where in the replay each row begins.
    pub starts: Vec<usize>,
}

/// Some rows of a [`Batch`]; arrays as there.
pub(crate) struct Part<'a, T> {
    pub observations: &'a [T],
    pub actions: &'a [T],
    pub returns: &'a [T],
    pub discounts: &'a [T],
    pub next_observations: &'a [T],
}

impl<T> Batch<T> {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.returns.len()
    }

    /// Some of its rows.
    pub(crate) fn part(&self, rows: Range<usize>) -> Part<'_, T> {
        let all = self.rows();
        Part {
            observations: cut(&self.observations, all, &rows),
            actions: cut(&self.actions, all, &rows),
            returns: &self.returns[rows.clone()],
            discounts: &self.discounts[rows.clone()],
            next_observations: cut(&self.next_observations, all, &rows),
        }
    }
}

impl<T: Scalar> Part<'_, T> {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.returns.len()
    }

    /// Turns values of what was seen after each row into targets: y = returns + discounts · values.
    pub fn bootstrap(&self, values: &mut [T]) {
        for ((value, returns), discount) in values.iter_mut().zip(self.returns).zip(self.discounts) {
            *value = discount.mul_add(*value, *returns);
        }
    }
}

/// Of an array `[all, ..]`, these rows.
pub(crate) fn cut<'a, N>(numbers: &'a [N], all: usize, rows: &Range<usize>) -> &'a [N] {
    let columns = numbers.len() / all;
    &numbers[rows.start * columns..rows.end * columns]
}
