//! How a round is divided among the parts of the portfolio.

/// A part of the portfolio that proposes points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Source {
    /// The next Sobol point.
    Exploration,
    /// The model, in the whole box.
    Global,
    /// The model, in the trust region.
    Local,
    /// A random step from the best point.
    Polish,
}

pub(super) const SOURCES: [Source; 4] = [Source::Exploration, Source::Global, Source::Local, Source::Polish];

/// Divides points among the sources in proportion to shares that may change from round to round.
///
/// Each source earns its share of every point, and the source with the largest credit proposes the point. So rounds of one
/// point have the same proportions as large rounds, without random numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct Credits([f64; 4]);

impl Credits {
    /// Returns the sources of the next `n` points. Shares sum to 1, in the order of [`SOURCES`].
    pub(super) fn divide(&mut self, n: usize, shares: &[f64; 4]) -> Vec<Source> {
        let next = |_| {
            self.0.iter_mut().zip(shares).for_each(|(credit, share)| *credit += share);
            // Of equal credits the last source, a model, comes first.
            let richest = (0..4).max_by(|&i, &j| self.0[i].total_cmp(&self.0[j])).unwrap_or_default();
            self.0[richest] -= 1.0;
            SOURCES[richest]
        };
        (0..n).map(next).collect()
    }
}

/// The least and the largest share of exploration.
const EXPLORATION: (f64, f64) = (0.1, 0.95);
/// The increase of the rank correlation, beyond what chance explains, at which the model counts as useful.
const USEFUL: f64 = 0.3;
/// Distances of the most promising candidate from a violation, in standard deviations, at which the model counts as
/// undecided and as certain that no point violates the requirement.
const DISTANCES: (f64, f64) = (2.5, 5.0);

/// Returns the share of exploration, given the leave-one-out rank correlation of `n` evaluations and the distance of the
/// most promising candidate from a violation in standard deviations.
///
/// A model is of no use in two cases. If it has learned nothing, its leave-one-out predictions do not correlate with the
/// values; without a relation, the standard deviation of the correlation is about 1 / √n. If it is certain that no point
/// violates the requirement, it can only confirm itself; a violation, if there is one, is where the model is wrong. In both
/// cases nearly all points are Sobol points, which find a small region about as fast as random ones.
pub(super) fn exploration(rank_correlation: f64, n: usize, distance: f64) -> f64 {
    let chance = (n.max(1) as f64).sqrt().recip();
    let useful = ((rank_correlation - chance) / USEFUL).clamp(0.0, 1.0);
    let certain = ((distance - DISTANCES.0) / (DISTANCES.1 - DISTANCES.0)).clamp(0.0, 1.0);
    EXPLORATION.0 + (EXPLORATION.1 - EXPLORATION.0) * (1.0 - useful).max(certain)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credits_follow_the_shares_for_any_round_size() {
        for n in [1, 3, 16] {
            let (mut credits, mut counts) = (Credits::default(), [0; 4]);
            for _ in 0..960 / n {
                for source in credits.divide(n, &[0.5, 0.25, 0.125, 0.125]) {
                    counts[SOURCES.iter().position(|s| *s == source).expect("listed")] += 1;
                }
            }
            assert_eq!(counts, [480, 240, 120, 120], "rounds of {n}");
        }
    }

    #[test]
    fn exploration_rises_when_the_model_is_useless_or_certain() {
        assert_eq!(exploration(0.9, 100, 1.0), 0.1);
        assert_eq!(exploration(0.1, 100, 1.0), 0.95);
        assert_eq!(exploration(0.9, 100, 8.0), 0.95);
        assert!((exploration(0.25, 100, 1.0) - 0.525).abs() < 1e-12);
        assert!((exploration(0.9, 100, 3.75) - 0.525).abs() < 1e-12);
    }
}
