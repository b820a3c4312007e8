//! How the points are divided among the parts of the portfolio.

use crate::gp::elementary::normal_tail;

/// A part of the portfolio that proposes points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// The next Sobol point.
    Sobol,
    /// The next corner that has not been evaluated.
    Corner,
    /// The best point with a new value of one coordinate.
    Coordinate,
    /// A random step from the best point.
    Polish,
    /// Where the model is low and ripple may decide.
    Ripple,
    /// The model, in the whole box.
    Global,
    /// The model, in the trust region.
    Local,
    /// The models of the parts of the robustness.
    Trace,
    /// A start elsewhere.
    Restart,
}

/// The number of sources.
pub(super) const N_SOURCES: usize = 9;
const SOURCES: [Source; N_SOURCES] = [
    Source::Sobol,
    Source::Corner,
    Source::Coordinate,
    Source::Polish,
    Source::Ripple,
    Source::Global,
    Source::Local,
    Source::Trace,
    Source::Restart,
];

/// Divides points among the sources in proportion to shares that may change from round to round.
///
/// Each source earns its share of every point, and the source with the largest credit proposes the
/// point. So rounds of one point have the same proportions as large rounds, without random numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct Credits([f64; N_SOURCES]);

impl Credits {
    /// Returns the sources of the next `n` points. Shares sum to 1, in the order of [`Source`].
    pub(super) fn divide(&mut self, n: usize, shares: &[f64; N_SOURCES]) -> Vec<Source> {
        let next = |_| {
            self.0.iter_mut().zip(shares).for_each(|(credit, share)| *credit += share);
            // Of equal credits the last source, a model, comes first. A source without a share
            // keeps its credit.
            let open = (0..N_SOURCES).filter(|&i| shares[i] > 0.0);
            let richest = open.max_by(|&i, &j| self.0[i].total_cmp(&self.0[j])).unwrap_or_default();
            self.0[richest] -= 1.0;
            SOURCES[richest]
        };
        (0..n).map(next).collect()
    }
}

/// The least and the largest share of points without the model.
pub(super) const EXPLORATION: (f64, f64) = (0.1, 0.95);
/// The increase of the rank correlation, beyond what chance explains, at which the model counts as
/// useful.
const USEFUL: f64 = 0.3;
/// The number of evaluations without an improvement after which a model that is certain loses its
/// share: a constant, and more per coordinate.
const PATIENCE: (f64, f64) = (4.0, 2.0);

/// Evidence that decides about the share of the model.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evidence {
    /// The leave-one-out rank correlation of the model.
    pub rank_correlation: f64,
    /// The distance of the most promising candidate from a violation in standard deviations.
    pub distance: f64,
    /// The number of evaluations, and how many of them came after the last improvement.
    pub n: usize,
    pub since_improvement: usize,
    pub dimension: usize,
}

/// Returns the share of points without the model.
///
/// A model is of no use in two cases. If it has learned nothing, its leave-one-out predictions do
/// not correlate with the values; without a relation, the standard deviation of the correlation is
/// about 1 / √n. The other case is that it is certain: n points without a violation leave a new
/// point of the box a probability of about 1 / n, and the model leaves its most promising candidate
/// less. Shares are in proportion to these two probabilities, as soon as the model no longer finds
/// lower values; a violation, if there is one, is where the model is wrong.
pub(super) fn exploration(evidence: Evidence) -> f64 {
    let chance = (evidence.n.max(1) as f64).sqrt().recip();
    let useful = ((evidence.rank_correlation - chance) / USEFUL).clamp(0.0, 1.0);
    let certain = (1.0 + evidence.n as f64 * normal_tail(evidence.distance)).recip();
    EXPLORATION.0 + (EXPLORATION.1 - EXPLORATION.0) * (1.0 - useful).max(certain * evidence.stalled())
}

impl Evidence {
    /// Returns how certain it is that no further improvement comes, from 0 to 1.
    pub(super) fn stalled(self) -> f64 {
        let patience = PATIENCE.0 + PATIENCE.1 * self.dimension as f64;
        (self.since_improvement as f64 / patience).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credits_follow_the_shares_for_any_round_size() {
        let shares = [0.5, 0.0, 0.125, 0.125, 0.125, 0.0, 0.0625, 0.0625, 0.0];
        for n in [1, 3, 16] {
            let mut credits = Credits::default();
            let mut counts = [0; N_SOURCES];
            for _ in 0..960 / n {
                credits.divide(n, &shares).iter().for_each(|source| counts[*source as usize] += 1);
            }
            assert_eq!(counts, [480, 0, 120, 120, 120, 0, 60, 60, 0], "rounds of {n}");
        }
    }

    /// In 3 dimensions the patience is 10 evaluations; with n = 100 chance explains a correlation
    /// of 0.1. A normal number is above 2.326 with a probability of 1 / 100.
    #[test]
    fn exploration_rises_when_the_model_is_useless_or_certain() {
        let share = |rank_correlation, distance, since_improvement| {
            exploration(Evidence { rank_correlation, distance, n: 100, since_improvement, dimension: 3 })
        };
        let is_about = |share: f64, expected: f64| (share - expected).abs() < 1e-3;
        assert_eq!(share(0.9, -1.0, 0), 0.1);
        assert_eq!(share(0.1, -1.0, 0), 0.95);
        assert!(is_about(share(0.25, -1.0, 0), 0.525));
        assert!(is_about(share(0.9, 8.0, 10), 0.95));
        assert!(is_about(share(0.9, 2.326_35, 10), 0.525), "as probable as a violation at another point");
        assert!(is_about(share(0.9, 8.0, 5), 0.525));
        assert_eq!(share(0.9, 8.0, 0), 0.1, "a certain model that still finds lower values keeps its share");
    }
}
