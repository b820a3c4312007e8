//! Random search: independent uniform points, the baseline for every other search.

use crate::coordinate::check_dimension;
use crate::pending::PendingPoints;
use crate::registry::SearchEntry;
use mishandle_random::Sequence;

use crate::{Observation, Search, SearchEnd, SearchError, options};

const NAME: &str = "random";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "independent uniform points",
    reference: "Brooks, \"A discussion of random methods for seeking maxima\", Operations Research 6, 1958.",
    options: Vec::new,
    make: |space, seed, options| {
        options::check_names(NAME, options, &[])?;
        Ok(Box::new(Random::new(space.coordinates.len(), seed)?))
    },
};

/// Random search: independent uniform points of `[0,1]^d`. Point i depends only on (seed, i). The
/// search never ends.
///
/// Every coordinate is treated as continuous. If the caller maps it to n levels, each has the
/// probability 1/n.
#[derive(Debug, Clone)]
pub struct Random {
    dimension: usize,
    seed: u64,
    next: u64,
    pending: PendingPoints,
}

impl Random {
    /// Creates a random search on `[0,1]^dimension`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] if `dimension` is 0.
    pub fn new(dimension: usize, seed: u64) -> Result<Self, SearchError> {
        check_dimension(dimension)?;
        Ok(Self { dimension, seed, next: 0, pending: PendingPoints::default() })
    }

    /// Returns point number `i`, counted from 0.
    pub fn point(&self, i: u64) -> Vec<f64> {
        let mut stream = Sequence::new(self.seed, i);
        (0..self.dimension).map(|_| stream.uniform()).collect()
    }
}

impl Search for Random {
    fn name(&self) -> &'static str {
        NAME
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let points: Vec<Vec<f64>> = (self.next..self.next + n as u64).map(|i| self.point(i)).collect();
        self.next += n as u64;
        points.iter().for_each(|u| self.pending.push(u.clone()));
        points
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        self.pending.resolve(u, observation.robustness).map(drop)
    }

    fn stop_threshold(&self, _u: &[f64]) -> f64 {
        0.0
    }

    fn samples_uniformly(&self) -> bool {
        true
    }

    fn keeps_exploring(&self) -> bool {
        true
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        self.pending.best()
    }
}
