//! Searches only the coordinates that have more than one value.

use crate::pending::PendingPoints;
use crate::{Coordinate, Observation, Search, SearchEnd, SearchError};

/// Coordinate of a single level.
const FIXED: f64 = 0.5;

/// Returns for each coordinate whether it has more than one value.
pub(crate) fn is_free(coordinate: &Coordinate) -> bool {
    !matches!(coordinate, Coordinate::Integer { levels: 1 } | Coordinate::Categorical { levels: 1 })
}

/// A search in the free coordinates. Its points have all coordinates, the fixed ones at 0.5.
pub(crate) struct FreeSearch {
    inner: Box<dyn Search>,
    is_free: Vec<bool>,
    /// The pending points and the best one, with all coordinates.
    pending: PendingPoints,
}

impl FreeSearch {
    /// Makes a search in all `coordinates` from a search in the free ones of them.
    pub(crate) fn new(inner: Box<dyn Search>, coordinates: &[Coordinate]) -> FreeSearch {
        FreeSearch {
            inner,
            is_free: coordinates.iter().map(is_free).collect(),
            pending: PendingPoints::default(),
        }
    }

    /// Returns the point with all coordinates.
    fn completed(&self, free: &[f64]) -> Vec<f64> {
        let mut values = free.iter().copied();
        self.is_free
            .iter()
            .map(|is_free| if *is_free { values.next().unwrap_or(FIXED) } else { FIXED })
            .collect()
    }

    /// Returns the free coordinates of a point.
    fn free(&self, u: &[f64]) -> Vec<f64> {
        u.iter().zip(&self.is_free).filter(|(_, is_free)| **is_free).map(|(u, _)| *u).collect()
    }
}

impl Search for FreeSearch {
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    fn dimension(&self) -> usize {
        self.is_free.len()
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let points: Vec<Vec<f64>> =
            self.inner.ask_batch(n).iter().map(|point| self.completed(point)).collect();
        points.iter().for_each(|point| self.pending.push(point.clone()));
        points
    }

    fn needs_parts(&self) -> bool {
        self.inner.needs_parts()
    }

    fn stop_threshold(&self, u: &[f64]) -> f64 {
        self.inner.stop_threshold(&self.free(u))
    }

    fn samples_uniformly(&self) -> bool {
        self.inner.samples_uniformly()
    }

    fn keeps_exploring(&self) -> bool {
        self.inner.keeps_exploring()
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        self.pending.resolve(u, observation.robustness)?;
        self.inner.tell(&self.free(u), observation)
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.inner.finished()
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        self.pending.best()
    }
}

#[cfg(test)]
mod tests {
    use crate::{SEARCHES, SearchOptions, by_name};

    use super::*;

    const SPACE: [Coordinate; 4] = [
        Coordinate::Continuous,
        Coordinate::Integer { levels: 1 },
        Coordinate::Continuous,
        Coordinate::Categorical { levels: 1 },
    ];

    /// A fixed coordinate costs no simulations.
    #[test]
    fn the_free_coordinates_of_every_search_are_those_of_a_smaller_space() {
        for entry in SEARCHES {
            let options = SearchOptions::default();
            let mut search = by_name(entry.name, &SPACE, 3, &options).unwrap();
            let mut smaller = by_name(entry.name, &[Coordinate::Continuous; 2], 3, &options).unwrap();
            assert_eq!((search.name(), search.dimension()), (entry.name, 4));
            for _ in 0..40 {
                let (Some(u), Some(v)) = (search.ask(), smaller.ask()) else { break };
                assert_eq!(u, [v[0], FIXED, v[1], FIXED], "{}", entry.name);
                let value = Observation::from((v[0] - 0.3).abs() + v[1]);
                search.tell(&u, &value).unwrap();
                smaller.tell(&v, &value).unwrap();
            }
            assert_eq!(search.best().map(|(_, value)| value), smaller.best().map(|(_, value)| value));
        }
    }

    #[test]
    fn a_wrong_point_and_a_space_without_free_coordinates_are_errors() {
        let mut search = by_name("random", &SPACE, 0, &SearchOptions::default()).unwrap();
        let mut u = search.ask().unwrap();
        u[1] = 0.25;
        assert!(matches!(search.tell(&u, &Observation::from(0.0)), Err(SearchError::WrongPoint { .. })));
        u[1] = FIXED;
        assert!(search.tell(&u, &Observation::from(0.0)).is_ok());
        let fixed = by_name("random", &SPACE[1..2], 0, &SearchOptions::default()).err();
        assert!(matches!(fixed, Some(SearchError::Dimension { found: 0 })));
    }
}
