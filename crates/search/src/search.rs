//! The ask-and-tell interface of all searches.

use std::fmt;

use crate::{Observation, SearchError};

/// A search minimizes the robustness on `[0,1]^d`: it proposes points (ask) and takes the
/// observations there (tell).
///
/// The points are a pure function of the space, the random seed, the options and the observations
/// so far. To resume a search, create it again and tell it the recorded
/// observations. The caller owns the budget and may stop after any observation.
///
/// A robustness of `+∞` is the worst valid value, for example for a simulation that diverged. NaN
/// is an error.
pub trait Search: Send {
    /// Returns the name in [`SEARCHES`](crate::SEARCHES).
    fn name(&self) -> &'static str;

    /// Returns the number of coordinates d, at least 1.
    fn dimension(&self) -> usize;

    /// Returns the next points to evaluate, at most `n`, each of length d with coordinates in [0,
    /// 1].
    ///
    /// It returns fewer than `n` points if the next point depends on pending values. `random`,
    /// `sobol` and `corners` propose any number of points, the searches with generations up to one
    /// of them. `nelder-mead` proposes several points only for its first or a shrunken simplex,
    /// `dual-annealing` only for a point with its neighbors for a gradient. It returns no point if
    /// all further points depend on pending values, or if the search has ended; see
    /// [`finished`](Search::finished). The sequence of points does not depend on the batch sizes.
    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>>;

    /// Returns the next point to evaluate: [`ask_batch`](Search::ask_batch) with `n` = 1.
    fn ask(&mut self) -> Option<Vec<f64>> {
        self.ask_batch(1).pop()
    }

    /// Returns whether observations must contain the [parts](crate::Parts) of the robustness.
    ///
    /// The result is constant for a search. If it is `false`, the caller computes no parts.
    fn needs_parts(&self) -> bool {
        false
    }

    /// Returns whether the points are independent and uniform in the unit cube, whatever the
    /// observations, so that frequencies among them estimate probabilities.
    fn samples_uniformly(&self) -> bool {
        false
    }

    /// Returns a number that is at least 0, such that all robustness values above it have the same
    /// effect on the further points if the pending point `u` has them. A simulation can end as soon
    /// as its robustness is certain to be above it.
    ///
    /// +∞ is always correct, and the value for a search that needs exact values.
    fn stop_threshold(&self, _u: &[f64]) -> f64 {
        f64::INFINITY
    }

    /// Returns whether the search explores the whole box as long as it runs, whatever the values. A
    /// local search converges, so a new one with another seed finds other minima.
    fn keeps_exploring(&self) -> bool {
        false
    }

    /// Passes the observation at a proposed point to the search. Observations must be in the order
    /// of the points.
    ///
    /// # Errors
    /// [`SearchError::NotAsked`] if no point is pending, [`SearchError::WrongPoint`] if `u` is not
    /// the oldest pending point, [`SearchError::NotANumber`] if the robustness is NaN. After an
    /// error the search is unchanged and the point is still pending.
    ///
    /// # Example
    /// ```
    /// use mishandle_search::{Observation, Random, Search};
    /// let mut search = Random::new(2, 0)?;
    /// let u = search.ask().expect("random never ends");
    /// search.tell(&u, &Observation::from(0.3))?;
    /// assert_eq!(search.best(), Some((u.as_slice(), 0.3)));
    /// # Ok::<(), mishandle_search::SearchError>(())
    /// ```
    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError>;

    /// Returns the termination criterion that ended the search; `None` if it has not ended.
    fn finished(&self) -> Option<SearchEnd>;

    /// Returns the point with the lowest robustness so far, the earliest if several have it; `None`
    /// without observations.
    fn best(&self) -> Option<(&[f64], f64)>;
}

/// The termination criterion that ended a search. It proposes no more points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SearchEnd {
    /// The tolerances on points and values are met.
    Converged,
    /// The maximum number of iterations is reached.
    IterationLimit,
    /// The maximum number of evaluations is reached.
    EvaluationLimit,
    /// A line search found no lower value along a descent direction.
    Abnormal,
    /// No initial point with a finite value was found.
    NoFiniteStart,
}

impl fmt::Display for SearchEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SearchEnd::Converged => "tolerances met",
            SearchEnd::IterationLimit => "maximum number of iterations reached",
            SearchEnd::EvaluationLimit => "maximum number of evaluations reached",
            SearchEnd::Abnormal => "no progress along a descent direction",
            SearchEnd::NoFiniteStart => "no initial point with a finite value found",
        })
    }
}
