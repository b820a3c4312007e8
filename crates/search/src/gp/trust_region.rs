//! A box around the best point that grows with successes and shrinks with failures.

use super::candidates::Region;

const FIRST_EDGE: f64 = 0.8;
const LONGEST_EDGE: f64 = 1.6;
const SHORTEST_EDGE: f64 = 0.007_812_5; // 2^-7
/// The number of consecutive successful rounds that doubles the edge.
const SUCCESSES: usize = 3;
/// The fraction of the best value that a success must improve by.
const IMPROVEMENT: f64 = 1e-3;

/// Returns whether a value is so much lower than the best one that it counts as a success. Any
/// finite value improves `+∞`.
pub(crate) fn is_success(value: f64, best: f64) -> bool {
    if best.is_infinite() { value < best } else { value < best - IMPROVEMENT * best.abs() }
}

/// A trust region with the rules of TuRBO-1.
///
/// # Reference
/// Eriksson, Pearce, Gardner, Turner and Poloczek, "Scalable global optimization via local Bayesian
/// optimization", NeurIPS 2019.
#[derive(Debug, Clone)]
pub(crate) struct TrustRegion {
    edge: f64,
    successes: usize,
    failures: usize,
    /// The number of points of consecutive failed rounds that halves the edge.
    patience: usize,
    best: f64,
}

impl TrustRegion {
    /// Creates a region.
    pub(crate) fn new(dimension: usize) -> Self {
        Self { edge: FIRST_EDGE, successes: 0, failures: 0, patience: dimension.max(4), best: f64::INFINITY }
    }

    /// Takes the lowest value of a round with `n` points into account.
    pub(crate) fn receive(&mut self, value: f64, n: usize) {
        if is_success(value, self.best) {
            (self.successes, self.failures) = (self.successes + 1, 0);
        } else {
            (self.successes, self.failures) = (0, self.failures + n);
        }
        self.best = self.best.min(value);
        if self.successes == SUCCESSES {
            self.edge = (2.0 * self.edge).min(LONGEST_EDGE);
            self.successes = 0;
        } else if self.failures >= self.patience {
            self.edge *= 0.5;
            self.failures = 0;
        }
    }

    /// Sets the value that a success must improve, without counting it.
    pub(crate) fn set_best(&mut self, value: f64) {
        self.best = value;
    }

    /// Returns whether the region has become so small that the search should restart elsewhere.
    pub(crate) fn has_collapsed(&self) -> bool {
        self.edge < SHORTEST_EDGE
    }

    /// Returns the region around `center`, with edges in proportion to the lengths of the model and
    /// the same volume as a cube.
    pub(crate) fn around(&self, center: &[f64], lengths: &[f64]) -> Region {
        let mean = lengths.iter().map(|length| length.ln()).sum::<f64>() / lengths.len() as f64;
        let half_edge = |length: &f64| (0.5 * self.edge * length / mean.exp()).min(1.0);
        Region { center: center.to_vec(), half_edges: lengths.iter().map(half_edge).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With d = 8 and rounds of 2 points, four failures halve the edge; three successes double it,
    /// at most to 1.6.
    #[test]
    fn edge_follows_the_rules_of_turbo() {
        let mut region = TrustRegion::new(8);
        region.receive(1.0, 2);
        for failures in 1..=8 {
            region.receive(1.0, 2);
            assert_eq!(region.edge, 0.8 * 0.5_f64.powi(failures / 4), "{failures}");
        }
        for (successes, edge) in [(1, 0.2), (2, 0.2), (3, 0.4), (6, 0.8), (9, 1.6), (12, 1.6)] {
            while region.best > 1.0 - 0.01 * f64::from(successes) + 1e-9 {
                region.receive(region.best - 0.01, 2);
            }
            assert_eq!(region.edge, edge, "{successes}");
        }
    }

    #[test]
    fn region_collapses_after_seven_halvings() {
        let mut region = TrustRegion::new(1);
        region.receive(0.0, 4);
        for _ in 0..6 {
            region.receive(0.0, 4);
            assert!(!region.has_collapsed());
        }
        region.receive(0.0, 4);
        assert!(region.has_collapsed());
    }

    /// The product of the half edges is that of a cube: (0.4)³.
    #[test]
    fn longer_lengths_give_longer_edges_and_the_same_volume() {
        let Region { half_edges, .. } = TrustRegion::new(3).around(&[0.5; 3], &[1.0, 2.0, 0.5]);
        assert!((half_edges.iter().product::<f64>() - 0.064).abs() < 1e-12);
        assert!((half_edges[1] / half_edges[2] - 4.0).abs() < 1e-12);
    }

    #[test]
    fn a_success_improves_by_a_thousandth_or_is_the_first_finite_value() {
        assert!(is_success(0.998, 1.0) && !is_success(0.9995, 1.0) && is_success(-1.002, -1.0));
        assert!(is_success(5.0, f64::INFINITY) && !is_success(f64::INFINITY, f64::INFINITY));
    }
}
