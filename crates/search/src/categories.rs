//! Distributions over the levels of a category, and a stream of normal numbers: parts of sampling
//! searches.

use mishandle_random::Sequence;

use crate::Coordinate;

/// A distribution over the levels of a category.
#[derive(Debug, Clone)]
pub(crate) struct Categories {
    probabilities: Vec<f64>,
    /// The least probability of a level.
    floor: f64,
}

impl Categories {
    /// Creates a uniform distribution. `samples` is the number of samples of one generation, over
    /// all categories: the least probability of a level is such that about one of them has a level
    /// that had no success.
    pub(crate) fn new(levels: usize, samples: usize) -> Self {
        let n = levels as f64;
        let others = (n - 1.0).max(1.0);
        Self { probabilities: vec![1.0 / n; levels], floor: (1.0 / (samples as f64 * others)).min(0.5 / n) }
    }

    /// Returns the number of levels.
    pub(crate) fn n_levels(&self) -> usize {
        self.probabilities.len()
    }

    /// Returns a random level as a coordinate in (0, 1): the middle of its interval.
    pub(crate) fn sample(&self, random: &mut Sequence) -> f64 {
        let mut rest = random.uniform();
        let last = self.probabilities.len() - 1;
        let is_above = |p: &f64| {
            rest -= p;
            rest < 0.0
        };
        let level = self.probabilities.iter().position(is_above).unwrap_or(last);
        (level as f64 + 0.5) / self.probabilities.len() as f64
    }

    /// Moves the probabilities by the fraction `rate` toward the weighted frequencies of the
    /// coordinates. The weights sum to 1.
    pub(crate) fn update(&mut self, weighted: impl Iterator<Item = (f64, f64)>, rate: f64) {
        let n = self.probabilities.len();
        self.probabilities.iter_mut().for_each(|p| *p *= 1.0 - rate);
        for (u, weight) in weighted {
            self.probabilities[level_of(u, n)] += rate * weight;
        }
        let floor = self.floor;
        self.probabilities.iter_mut().for_each(|p| *p = p.max(floor));
        let sum: f64 = self.probabilities.iter().sum();
        self.probabilities.iter_mut().for_each(|p| *p /= sum);
    }

    /// Returns whether all levels but one are at or near their least probability.
    pub(crate) fn is_decided(&self) -> bool {
        let likely = self.probabilities.iter().filter(|p| **p > 2.0 * self.floor).count();
        likely <= 1
    }
}

/// Returns the level of a coordinate in [0, 1].
pub(crate) fn level_of(u: f64, levels: usize) -> usize {
    ((u * levels as f64) as usize).min(levels - 1)
}

/// Returns the number of categorical coordinates.
pub(crate) fn n_categories(coordinates: &[Coordinate]) -> usize {
    coordinates.iter().filter(|c| matches!(c, Coordinate::Categorical { .. })).count()
}

/// Returns the least standard deviation of a coordinate, which keeps an integer from staying at one
/// level: with a quarter of a level, 5 % of the samples around the middle of a level have another
/// one. It is 0 for a continuous coordinate.
pub(crate) fn least_deviation(coordinate: Coordinate) -> f64 {
    match coordinate {
        Coordinate::Integer { levels } if levels > 1 => 0.25 / levels as f64,
        _ => 0.0,
    }
}

/// A sequence of standard normal numbers.
#[derive(Debug, Clone)]
pub(crate) struct Normals {
    random: Sequence,
    spare: Option<f64>,
}

impl Normals {
    /// Creates the numbers of stream `stream` of `seed`.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        Self { random: Sequence::new(seed, stream), spare: None }
    }

    /// Returns the next number.
    pub(crate) fn next(&mut self) -> f64 {
        self.spare.take().unwrap_or_else(|| {
            let (first, second) = self.random.normal_pair();
            self.spare = Some(second);
            first
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn updates_move_probabilities_toward_frequencies_and_keep_a_floor() {
        let mut categories = Categories::new(4, 30);
        categories.update([(0.1, 0.5), (0.3, 0.25), (0.99, 0.25)].into_iter(), 0.5);
        let expected = [0.375, 0.25, 0.125, 0.25];
        assert!(categories.probabilities.iter().zip(expected).all(|(p, e)| (p - e).abs() < 1e-12));
        for _ in 0..100 {
            categories.update([(0.6, 1.0)].into_iter(), 0.7);
        }
        let p = &categories.probabilities;
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-12 && p[2] > 0.96 && p[0] > 0.01, "{p:?}");
    }

    /// Counts of 4000 samples are within five standard errors of the probabilities.
    #[test]
    fn samples_have_the_probabilities() {
        let mut categories = Categories::new(3, 100);
        categories.update([(0.9, 1.0)].into_iter(), 0.4);
        let mut random = Sequence::new(1, 0);
        let mut counts = [0.0; 3];
        for _ in 0..4000 {
            counts[level_of(categories.sample(&mut random), 3)] += 1.0;
        }
        for (count, p) in counts.into_iter().zip([0.2, 0.2, 0.6]) {
            let expected: f64 = 4000.0 * p;
            assert!((count - expected).abs() < 5.0 * (expected * (1.0 - p)).sqrt(), "{counts:?}");
        }
    }
}
