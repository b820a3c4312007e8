//! The evaluated points of a search.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// The number of evaluations that are kept. Beyond it the best and the latest halves of this number
/// remain, so that the memory is bounded.
const CAPACITY: usize = 4096;

/// Values above this quantile of the earlier ones count as equal to it. How bad a bad point is
/// matters little, and simulations of such points can end early.
const CAP: f64 = 0.75;

/// Evaluated points with their robustness, oldest first.
#[derive(Debug, Clone)]
pub(crate) struct History {
    points: Vec<Vec<f64>>,
    values: Vec<f64>,
    /// Hashes of all points.
    seen: HashSet<u64>,
    /// The number of evaluations that were dropped.
    n_dropped: usize,
    cap: f64,
}

impl Default for History {
    fn default() -> Self {
        Self {
            points: Vec::new(),
            values: Vec::new(),
            seen: HashSet::new(),
            n_dropped: 0,
            cap: f64::INFINITY,
        }
    }
}

impl History {
    /// Returns the value that higher ones of the next round count as: not negative, and `+∞`
    /// without evaluations.
    pub(crate) fn cap(&self) -> f64 {
        self.cap
    }

    /// Returns the values of a round with none above the cap.
    pub(crate) fn capped(&self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|value| value.min(self.cap)).collect()
    }

    /// Adds the evaluations of a round, and sets the cap of the next one.
    pub(crate) fn extend(&mut self, round: &[Vec<f64>], values: &[f64]) {
        round.iter().zip(values).for_each(|(point, value)| self.push(point, *value));
        self.cap = self.quantile(CAP).max(0.0);
    }

    /// Adds an evaluation.
    pub(crate) fn push(&mut self, point: &[f64], value: f64) {
        if self.values.len() == CAPACITY {
            self.drop_some();
        }
        self.seen.insert(hash(point));
        self.points.push(point.to_vec());
        self.values.push(value);
    }

    /// Returns the number of kept evaluations.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Returns the number of dropped evaluations.
    pub(crate) fn n_dropped(&self) -> usize {
        self.n_dropped
    }

    /// Returns the kept points.
    pub(crate) fn points(&self) -> &[Vec<f64>] {
        &self.points
    }

    /// Returns the values of the kept points.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Returns whether a kept evaluation is at this point.
    pub(crate) fn contains(&self, point: &[f64]) -> bool {
        self.seen.contains(&hash(point))
    }

    /// Returns the indices of the kept evaluations, lowest value first; of equal values the latest
    /// first, so that a search moves on plateaus.
    pub(crate) fn by_value(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.len()).rev().collect();
        order.sort_by(|&i, &j| self.values[i].total_cmp(&self.values[j]));
        order
    }

    /// Returns the squared distance from a point to the nearest kept one; `+∞` without evaluations.
    pub(crate) fn squared_distance(&self, point: &[f64]) -> f64 {
        let squared =
            |other: &Vec<f64>| -> f64 { point.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum() };
        self.points.iter().map(squared).fold(f64::INFINITY, f64::min)
    }

    /// Returns the share of the kept evaluations that have the lowest value; 0 without evaluations.
    pub(crate) fn share_of_lowest(&self) -> f64 {
        let lowest = self.values.iter().copied().fold(f64::INFINITY, f64::min);
        let n_lowest = self.values.iter().filter(|value| **value == lowest).count();
        n_lowest as f64 / self.len().max(1) as f64
    }

    /// Returns the value that at least the fraction `q` of the kept evaluations does not exceed;
    /// `+∞` without evaluations.
    fn quantile(&self, q: f64) -> f64 {
        let mut values = self.values.clone();
        if values.is_empty() {
            return f64::INFINITY;
        }
        let rank = ((q * values.len() as f64).ceil() as usize).clamp(1, values.len());
        *values.select_nth_unstable_by(rank - 1, f64::total_cmp).1
    }

    /// Returns the indices of at most `most` evaluations in order of time: the best half, and the
    /// latest of the others.
    pub(crate) fn selection(&self, most: usize) -> Vec<usize> {
        if self.len() <= most {
            return (0..self.len()).collect();
        }
        let order = self.by_value();
        let (best, others) = order.split_at(most / 2);
        let mut others = others.to_vec();
        others.sort_unstable_by(|i, j| j.cmp(i));
        let mut chosen: Vec<usize> = best.iter().chain(&others[..most - best.len()]).copied().collect();
        chosen.sort_unstable();
        chosen
    }

    fn drop_some(&mut self) {
        let kept = self.selection(CAPACITY / 2);
        self.n_dropped += self.len() - kept.len();
        self.points = kept.iter().map(|&i| std::mem::take(&mut self.points[i])).collect();
        self.values = kept.iter().map(|&i| self.values[i]).collect();
        self.seen = self.points.iter().map(|point| hash(point)).collect();
    }
}

fn hash(point: &[f64]) -> u64 {
    let mut hasher = DefaultHasher::new();
    point.iter().for_each(|x| x.to_bits().hash(&mut hasher));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_bounded_and_keeps_the_best_and_the_latest() {
        let mut history = History::default();
        for i in 0..20_000 {
            let x = f64::from(i);
            history.push(&[x], if i == 17 { -1.0 } else { x });
        }
        assert!(history.len() <= CAPACITY && history.len() + history.n_dropped() == 20_000);
        assert!(history.contains(&[17.0]) && history.contains(&[19_999.0]) && !history.contains(&[9_000.0]));
        assert_eq!(history.points()[history.by_value()[0]], [17.0]);
    }

    #[test]
    fn selection_is_in_order_of_time() {
        let mut history = History::default();
        [5.0, 1.0, 4.0, 0.0, 3.0, 2.0].iter().enumerate().for_each(|(i, y)| history.push(&[i as f64], *y));
        assert_eq!(history.selection(4), [1, 3, 4, 5]);
        assert_eq!(history.selection(9), [0, 1, 2, 3, 4, 5]);
    }

    /// Two of five values are the lowest; simulations without a verdict have a value, too.
    #[test]
    fn equal_lowest_values_are_counted() {
        let mut history = History::default();
        assert_eq!(history.share_of_lowest(), 0.0);
        history.push(&[0.0], f64::INFINITY);
        assert_eq!(history.share_of_lowest(), 1.0);
        [1.0, 2.0, 1.0, 4.0].iter().enumerate().for_each(|(i, y)| history.push(&[i as f64], *y));
        assert_eq!(history.share_of_lowest(), 0.4);
    }

    /// Three of four values are at most 3; two of four are at most 2.
    #[test]
    fn quantiles_are_values() {
        let mut history = History::default();
        assert_eq!(history.quantile(0.75), f64::INFINITY);
        [4.0, 1.0, 3.0, 2.0].iter().enumerate().for_each(|(i, y)| history.push(&[i as f64], *y));
        assert_eq!((history.quantile(0.75), history.quantile(0.5), history.quantile(0.0)), (3.0, 2.0, 1.0));
    }
}
