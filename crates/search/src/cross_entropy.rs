//! The cross-entropy method: a distribution that moves to the best samples of each generation.

use mishandle_random::Sequence;

use crate::categories::{Categories, Normals, least_deviation, n_categories};
use crate::coordinate::dimension;
use crate::options::{MOST_POINTS, Range, options};
use crate::registry::SearchEntry;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError};

const NAME: &str = "cross-entropy";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "samples of a distribution per coordinate that moves to the best samples, with restarts",
    reference: "Rubinstein and Kroese, \"The Cross-Entropy Method\", Springer, 2004. Kroese, Porotsky and Rubinstein, \"The \
                cross-entropy method for continuous multi-extremal optimization\", Methodol. Comput. Appl. Probab. 8, \
                2006.",
    options: CrossEntropyOptions::specs,
    make: |space, seed, options| {
        let options = CrossEntropyOptions::read(options)?;
        Ok(Box::new(AskTell::new(CrossEntropy::new(&space.coordinates, seed, &options)?)))
    },
};

const FROM_2: Range = Range { words: "from 2 to 100000", holds: |x| (2.0..=MOST_POINTS).contains(&x) };
const POSITIVE: Range = Range { words: "a positive number", holds: |x| x > 0.0 && x.is_finite() };
const FRACTION: Range = Range { words: "in (0, 1]", holds: |x| x > 0.0 && x <= 1.0 };

options! {
    /// The options of [`CrossEntropy`].
    pub struct CrossEntropyOptions of NAME {
        /// Number of samples in a generation.
        pub population: usize = 40, in FROM_2;
        /// Fraction of the samples that the next distribution is fitted to. Ties with the worst of
        /// them are included.
        pub elite_fraction: f64 = 0.2, in FRACTION;
        /// Weight of the fitted distribution; the previous one has the rest. 1 means no smoothing.
        pub smoothing: f64 = 0.7, in FRACTION;
        /// Standard deviation of the first generation, and after a restart.
        pub initial_deviation: f64 = 0.3, in POSITIVE;
        /// Restarts from a random mean when all standard deviations are below this number.
        pub deviation_tolerance: f64 = 1e-3, in POSITIVE;
    }
}

/// The cross-entropy method in `[0,1]^d`: samples of independent coordinates, whose distributions
/// are fitted to the best samples of each generation.
///
/// Use it with large batches: a generation of `population` points is proposed at once. It tolerates
/// noise and steps, needs no scale of the values, and handles categories. It is slower than
/// [`cma-es`](crate::CmaEs) where coordinates interact, because it knows no correlations.
///
/// ```text
/// uᵢ = clip(μᵢ + σᵢ z, 0, 1)            z standard normal
/// γ = value of rank ⌈elite-fraction · N⌉, elite = {samples with a value ≤ γ}
/// μᵢ ← α mean(elite) + (1 - α) μᵢ       σᵢ ← α std(elite) + (1 - α) σᵢ       α: smoothing
/// ```
///
/// The first mean is the center. Samples outside the box are clipped, so that the bounds, at which
/// controllers often fail, have positive probability. A category has one probability per level,
/// fitted to the elite in the same way. It and an integer axis keep a small probability of other
/// levels. If all values are equal, all samples are the elite, so the distribution does not move on
/// average. If some values are +∞, only samples with finite ones are. When all deviations are below
/// the tolerance, the search restarts from a random mean. It never ends.
///
/// # Reference
/// Rubinstein and Kroese, "The Cross-Entropy Method", Springer, 2004. Kroese, Porotsky and
/// Rubinstein, "The cross-entropy method for continuous multi-extremal optimization", Methodol.
/// Comput. Appl. Probab. 8, 2006.
#[derive(Debug, Clone)]
pub struct CrossEntropy {
    options: CrossEntropyOptions,
    coordinates: Vec<Coordinate>,
    axes: Vec<Axis>,
    normals: Normals,
    uniforms: Sequence,
    round: Vec<Vec<f64>>,
}

#[derive(Debug, Clone)]
enum Axis {
    Number { mean: f64, deviation: f64, least: f64 },
    Category(Categories),
}

impl CrossEntropy {
    /// Creates the search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for a number outside the documented range of its
    /// option.
    pub fn new(
        coordinates: &[Coordinate],
        seed: u64,
        options: &CrossEntropyOptions,
    ) -> Result<Self, SearchError> {
        dimension(coordinates)?;
        options.check_ranges()?;
        let mut search = Self {
            options: options.clone(),
            coordinates: coordinates.to_vec(),
            axes: Vec::new(),
            normals: Normals::new(seed, 0),
            uniforms: Sequence::new(seed, 1),
            round: Vec::new(),
        };
        search.reset(|_| 0.5);
        search.sample();
        Ok(search)
    }

    /// Sets the distribution of a first generation.
    fn reset(&mut self, mut mean: impl FnMut(&mut Sequence) -> f64) {
        let samples = self.options.population * n_categories(&self.coordinates);
        let uniforms = &mut self.uniforms;
        let axis = |coordinate: &Coordinate| match coordinate {
            Coordinate::Categorical { levels } => Axis::Category(Categories::new(*levels, samples)),
            _ => Axis::Number {
                mean: mean(uniforms),
                deviation: self.options.initial_deviation,
                least: least_deviation(*coordinate),
            },
        };
        self.axes = self.coordinates.iter().map(axis).collect();
    }

    fn sample(&mut self) {
        let n = self.options.population;
        self.round.resize_with(n, Vec::new);
        for u in &mut self.round {
            u.clear();
            u.extend(self.axes.iter().map(|axis| match axis {
                Axis::Number { mean, deviation, .. } => {
                    (mean + deviation * self.normals.next()).clamp(0.0, 1.0)
                }
                Axis::Category(categories) => categories.sample(&mut self.uniforms),
            }));
        }
    }

    /// Returns the indices of the elite of the round.
    fn elite(&self, values: &[f64]) -> Vec<usize> {
        let mut sorted: Vec<f64> = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = (self.options.elite_fraction * values.len() as f64).ceil().max(1.0) as usize;
        let n_finite = sorted.partition_point(|value| *value < f64::INFINITY);
        let rank = if n_finite == 0 { sorted.len() } else { n.min(n_finite) };
        let worst = sorted[rank - 1];
        (0..values.len()).filter(|i| values[*i] <= worst).collect()
    }

    fn has_converged(&self) -> bool {
        let tolerance = self.options.deviation_tolerance;
        let is_narrow = |axis: &Axis| match axis {
            Axis::Number { deviation, least, .. } => *deviation <= least.max(tolerance),
            Axis::Category(categories) => categories.is_decided(),
        };
        self.axes.iter().all(is_narrow)
    }
}

impl RoundBased for CrossEntropy {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let elite = self.elite(values);
        let alpha = self.options.smoothing;
        let weight = 1.0 / elite.len() as f64;
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let coordinates = || elite.iter().map(|i| self.round[*i][k]);
            match axis {
                Axis::Number { mean, deviation, least } => {
                    let fitted = weight * coordinates().sum::<f64>();
                    let variance = weight * coordinates().map(|x| (x - fitted) * (x - fitted)).sum::<f64>();
                    *mean = alpha * fitted + (1.0 - alpha) * *mean;
                    *deviation = (alpha * variance.sqrt() + (1.0 - alpha) * *deviation).max(*least);
                }
                Axis::Category(categories) => categories.update(coordinates().map(|u| (u, weight)), alpha),
            }
        }
        if self.has_converged() {
            self.reset(Sequence::uniform);
        }
        self.sample();
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }
}
