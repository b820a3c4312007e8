//! The ask-and-tell interface for searches whose points do not depend on values.

use crate::pending::PendingPoints;
use crate::{Observation, Search, SearchEnd, SearchError};

/// A sequence of points of `[0,1]^d`: point i is a function of i.
pub trait PointSequence: Send {
    /// Returns the name in [`SEARCHES`](crate::SEARCHES).
    fn name(&self) -> &'static str;

    /// Returns the number of coordinates.
    fn dimension(&self) -> usize;

    /// Returns point number `i`, counted from 0.
    fn point(&self, i: u64) -> Vec<f64>;
}

/// Adapts a sequence of points to the [`Search`] interface. It proposes any number of points at
/// once and never ends.
///
/// # Example
/// ```
/// use mishandle_search::{InSequence, PointSequence, Search, Sobol, SobolOptions};
///
/// let mut search = InSequence::new(Sobol::new(2, 7, &SobolOptions::default())?);
/// let points = search.ask_batch(64);
/// assert_eq!(points[63], search.sequence().point(63));
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
#[derive(Debug, Clone)]
pub struct InSequence<P> {
    sequence: P,
    next: u64,
    pending: PendingPoints,
}

impl<P: PointSequence> InSequence<P> {
    /// Creates a search that starts with point 0.
    pub fn new(sequence: P) -> Self {
        Self { sequence, next: 0, pending: PendingPoints::default() }
    }

    /// Returns the sequence.
    pub fn sequence(&self) -> &P {
        &self.sequence
    }
}

impl<P: PointSequence> Search for InSequence<P> {
    fn name(&self) -> &'static str {
        self.sequence.name()
    }

    fn dimension(&self) -> usize {
        self.sequence.dimension()
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let points: Vec<Vec<f64>> =
            (self.next..self.next + n as u64).map(|i| self.sequence.point(i)).collect();
        self.next += n as u64;
        points.iter().for_each(|u| self.pending.push(u.clone()));
        points
    }

    fn stop_threshold(&self, _u: &[f64]) -> f64 {
        0.0
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        self.pending.resolve(u, observation.robustness).map(drop)
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }

    fn keeps_exploring(&self) -> bool {
        true
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        self.pending.best()
    }
}
