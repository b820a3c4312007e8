//! The points handed out and not yet told, and the best value told.

use std::collections::VecDeque;

use crate::SearchError;

/// Checks that values come back for the points asked for, in their order.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ledger {
    awaited: VecDeque<Vec<f64>>,
    best: Option<(Vec<f64>, f64)>,
}

impl Ledger {
    /// Notes that `u` was handed out.
    pub(crate) fn hand_out(&mut self, u: Vec<f64>) {
        self.awaited.push_back(u);
    }

    /// Returns the point told, if it is the one whose turn it is and the value is a number.
    pub(crate) fn take_back(&mut self, u: &[f64], value: f64) -> Result<Vec<f64>, SearchError> {
        let Some(asked) = self.awaited.front() else {
            return Err(SearchError::NotAsked { told: u.to_vec() });
        };
        if asked != u {
            return Err(SearchError::WrongPoint { told: u.to_vec(), asked: asked.clone() });
        }
        if value.is_nan() {
            return Err(SearchError::NotANumber { told: u.to_vec() });
        }
        let point = self.awaited.pop_front().unwrap_or_default();
        if self.best.as_ref().is_none_or(|(_, best)| value < *best) {
            self.best = Some((point.clone(), value));
        }
        Ok(point)
    }

    /// The point with the lowest value told, the earliest of equals.
    pub(crate) fn best(&self) -> Option<(&[f64], f64)> {
        self.best.as_ref().map(|(u, value)| (u.as_slice(), *value))
    }
}
