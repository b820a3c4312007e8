//! The interface of every search: it is asked for points and told what was observed there.

use std::fmt;

use crate::{Observation, SearchError};

/// A search proposes points of `[0,1]^d` and is told what was observed there; it minimizes the robustness.
///
/// The points are a pure function of the coordinates' types, the seed, the options and the observations told so far.
/// To resume a search, make it again and tell it the recorded observations. The caller owns the budget: it may stop
/// asking after any observation.
///
/// A robustness of `+∞` is valid and the worst value (a simulation that diverged). NaN is an error.
pub trait Search: Send {
    /// The name in [`SEARCHES`](crate::SEARCHES).
    fn name(&self) -> &'static str;

    /// The number of coordinates d of every point, at least 1.
    fn dimension(&self) -> usize;

    /// The next points to evaluate, at most `n`, each of length d with coordinates in [0, 1].
    ///
    /// Fewer than `n` where the next point depends on a value not yet told: `nelder-mead` gives its first simplex or
    /// a shrunken one at once, `dual-annealing` a point with its neighbours for a gradient; otherwise both give one.
    /// None at all while such a value is awaited, or when the search has ended, which
    /// [`finished`](Search::finished) tells apart.
    /// The sequence of points does not depend on how it is cut into batches.
    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>>;

    /// The next point to evaluate: [`ask_batch`](Search::ask_batch) of one.
    fn ask(&mut self) -> Option<Vec<f64>> {
        self.ask_batch(1).pop()
    }

    /// Returns whether observations must contain the minima of all sub-formulas.
    ///
    /// The answer is the same during the whole life of a search. If it is `false`, the caller computes no minima.
    fn needs_subformulas(&self) -> bool {
        false
    }

    /// Tells the search what was observed at a point that it proposed, in the order of asking.
    ///
    /// # Errors
    /// [`SearchError::NotAsked`] if no point awaits its observation, [`SearchError::WrongPoint`] if `u` does not equal
    /// the point that has waited longest, [`SearchError::NotANumber`] if the robustness is NaN. After an error the
    /// search is unchanged: the same point still waits.
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

    /// Why the search has ended by its own criterion; `None` while it has not.
    fn finished(&self) -> Option<SearchEnd>;

    /// Returns the point with the lowest robustness told so far, the earliest of equals; `None` before the first.
    fn best(&self) -> Option<(&[f64], f64)>;
}

/// Why a search ended by its own criterion; it will propose nothing more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum SearchEnd {
    /// The tolerances on points and values were met.
    Converged,
    /// The limit on iterations was reached.
    IterationLimit,
    /// The limit on evaluations was reached.
    EvaluationLimit,
    /// A line search found no lower value where its slope promised one.
    Abnormal,
    /// No start with a finite value was found.
    NoFiniteStart,
}

impl fmt::Display for SearchEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            SearchEnd::Converged => "tolerances met",
            SearchEnd::IterationLimit => "limit on iterations reached",
            SearchEnd::EvaluationLimit => "limit on evaluations reached",
            SearchEnd::Abnormal => "no progress along a descent direction",
            SearchEnd::NoFiniteStart => "no start with a finite value found",
        })
    }
}
