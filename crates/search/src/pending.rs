//! Proposed points that wait for their values, and the best point so far.

use std::collections::VecDeque;

use crate::SearchError;

/// The proposed points without a value. Checks that values arrive in the order of the points.
#[derive(Debug, Clone, Default)]
pub(crate) struct PendingPoints {
    points: VecDeque<Vec<f64>>,
    best: Option<(Vec<f64>, f64)>,
}

impl PendingPoints {
    /// Adds a proposed point.
    pub(crate) fn push(&mut self, u: Vec<f64>) {
        self.points.push_back(u);
    }

    /// Removes and returns the oldest pending point, and updates the best point.
    ///
    /// # Errors
    /// If no point is pending, `u` is not the oldest pending point, or `value` is NaN.
    pub(crate) fn resolve(&mut self, u: &[f64], value: f64) -> Result<Vec<f64>, SearchError> {
        let Some(expected) = self.points.front() else {
            return Err(SearchError::NotAsked { point: u.to_vec() });
        };
        if expected != u {
            return Err(SearchError::WrongPoint { point: u.to_vec(), expected: expected.clone() });
        }
        if value.is_nan() {
            return Err(SearchError::NotANumber { point: u.to_vec() });
        }
        let point = self.points.pop_front().unwrap_or_default();
        if self.best.as_ref().is_none_or(|(_, best)| value < *best) {
            self.best = Some((point.clone(), value));
        }
        Ok(point)
    }

    /// Returns the point with the lowest value so far; the earliest, if several have it.
    pub(crate) fn best(&self) -> Option<(&[f64], f64)> {
        self.best.as_ref().map(|(u, value)| (u.as_slice(), *value))
    }
}
