//! CMA-ES: an evolution strategy that learns the covariance of successful steps.

mod gaussian;
mod parameters;

use std::collections::VecDeque;

use mishandle_random::Sequence;

use crate::categories::{Categories, Normals, least_deviation, n_categories};
use crate::coordinate::dimension;
use crate::gp::trust_region::is_success;
use crate::options::{AT_LEAST_1, NOT_NEGATIVE, POINT_OF_THE_BOX, Range, check_start, options};
use crate::registry::SearchEntry;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError};
use gaussian::Gaussian;

const NAME: &str = "cma-es";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "active CMA-ES, which learns the covariance of successful steps, with restarts",
    reference: "Hansen, \"The CMA evolution strategy: a tutorial\", arXiv:1604.00772, 2016. Auger and Hansen, \"A restart CMA \
                evolution strategy with increasing population size\", CEC 2005.",
    options: CmaEsOptions::specs,
    make: |space, seed, options| {
        let options = CmaEsOptions::read(options)?;
        Ok(Box::new(AskTell::new(CmaEs::new(&space.coordinates, seed, &options)?)))
    },
};

/// The largest population after restarts.
const MAX_POPULATION: usize = 100_000;

/// The generations without a lower value after which a search in 0 dimensions would restart; one
/// more for each dimension.
const PATIENCE: usize = 8;

const POPULATION: Range =
    Range { words: "from 4 to 100000", holds: |x| (4.0..=MAX_POPULATION as f64).contains(&x) };
const DEVIATION: Range = Range { words: "in (0, 1]", holds: |x| x > 0.0 && x <= 1.0 };
const BOUNDS: Range = Range::described("\"clip\" or \"mirror\"");

options! {
    /// The options of [`CmaEs`].
    pub struct CmaEsOptions of NAME {
        /// First mean.
        pub start: Option<Vec<f64>> = None, or "the center of the box", in POINT_OF_THE_BOX;
        /// Standard deviation of the first generation, and after a restart.
        pub initial_deviation: f64 = 0.3, in DEVIATION;
        /// Number of samples in a generation.
        pub population: Option<usize> = None, or "4 + ⌊3 ln d⌋", in POPULATION;
        /// Factor of the population at each restart.
        pub population_growth: usize = 2, in AT_LEAST_1;
        /// Treatment of samples outside the box: `clip` moves them to the bounds, `mirror` reflects
        /// them at the bounds.
        pub bounds: String = "clip".to_owned(), in BOUNDS;
        /// Restarts when the standard deviations of all coordinates are below this number.
        pub xatol: f64 = 1e-5, in NOT_NEGATIVE;
        /// Restarts when all values of a generation, and the best ones of the last 10 + ⌈30 d /
        /// population⌉ generations, are in a range of this length.
        pub fatol: f64 = 1e-9, in NOT_NEGATIVE;
        /// Restarts when the best value since the last start has not fallen by a thousandth in this
        /// number of generations.
        pub patience: Option<usize> = None, or "8 + d", in AT_LEAST_1;
    }
}

/// Active CMA-ES with restarts and increasing population (IPOP) in `[0,1]^d`.
///
/// Use it for smooth or moderately rough robustness in up to a hundred dimensions, in which
/// coordinates interact, with budgets from some hundred evaluations on. A generation is proposed at
/// once: 6 points for 2 axes, 14 for 30. Set `population` to the batch size for larger batches. It
/// uses the order of values only. It is a local method that restarts from random points; a narrow
/// failure region far from the center needs luck or many restarts.
///
/// All formulas and constants are those of the tutorial, with negative weights (active), cumulative
/// step-size adaptation, and a larger step size if the best values are equal. The first mean is the
/// center. After convergence, or `patience` generations without a lower value, the search restarts
/// from a random mean with twice the population. It never ends.
///
/// Convergence takes longer than the budget of a trial, and a falsification needs no minimum but a
/// value below 0: a local minimum above 0 is left after 8 + d generations, not after `xatol`.
///
/// # Bounds
/// `clip` proposes the bounds exactly, with positive probability, and adapts with the clipped
/// samples. A coordinate that is at a bound in all good samples loses its variance until the next
/// restart. It is the default because controllers often fail at bounds: in the example
/// `compare_searches`, it needs 15 evaluations on average to a corner in 2 dimensions, 82 in 10 and
/// 110 for disturbances with hidden signs in 30, `mirror` 24, 130 and 167. Inside the box both need
/// about the same.
///
/// `mirror` folds samples into the box, which makes the function periodic and leaves the
/// distribution untouched: steps keep their lengths, so step size and covariance adapt as without
/// bounds. A bound is approached but hardly ever proposed exactly.
///
/// # Types of coordinates
/// Integers are continuous with a least standard deviation of a quarter of a level. A category has
/// a probability per level, which moves toward the weighted frequencies of the better half of the
/// samples, at the rate μ / (μ + L) for L levels and the effective number of samples μ.
///
/// # Reference
/// Hansen, "The CMA evolution strategy: a tutorial", arXiv:1604.00772, 2016. Auger and Hansen, "A
/// restart CMA evolution strategy with increasing population size", CEC 2005. Hansen, "A CMA-ES for
/// mixed-integer nonlinear optimization", INRIA report 7751, 2011 (integers). Hamano et al.,
/// "CatCMA: stochastic optimization for mixed-category problems", GECCO 2024 (categories; here with
/// a simpler learning rate).
#[derive(Debug, Clone)]
pub struct CmaEs {
    options: CmaEsOptions,
    is_clipped: bool,
    coordinates: Vec<Coordinate>,
    population: usize,
    /// The distribution of the coordinates that are numbers; `None` if all are categories.
    gaussian: Option<Gaussian>,
    categories: Vec<Categories>,
    normals: Normals,
    uniforms: Sequence,
    /// The numbers of each sample, as the distribution gave them, or clipped.
    samples: Vec<Vec<f64>>,
    /// The best values of the last generations.
    history: VecDeque<f64>,
    /// The best value since the last start, and the number of generations since it fell.
    best: f64,
    since_improvement: usize,
    round: Vec<Vec<f64>>,
}

impl CmaEs {
    /// Creates the search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for a start outside `[0,1]^d` or of the wrong length,
    /// an unknown treatment of bounds, or a number outside the documented range of its option.
    pub fn new(coordinates: &[Coordinate], seed: u64, options: &CmaEsOptions) -> Result<Self, SearchError> {
        let dimension = dimension(coordinates)?;
        check_start(NAME, options.start.as_ref(), dimension)?;
        options.check_ranges()?;
        if !["mirror", "clip"].contains(&options.bounds.as_str()) {
            return Err(SearchError::Option {
                search: NAME,
                option: "bounds".to_owned(),
                found: format!("{:?}", options.bounds),
                expected: BOUNDS.words.to_owned(),
            });
        }
        let population = options.population.unwrap_or(4 + (3.0 * (dimension as f64).ln()) as usize);
        let mut search = Self {
            options: options.clone(),
            is_clipped: options.bounds == "clip",
            coordinates: coordinates.to_vec(),
            population,
            gaussian: None,
            categories: Vec::new(),
            normals: Normals::new(seed, 0),
            uniforms: Sequence::new(seed, 1),
            samples: Vec::new(),
            history: VecDeque::new(),
            best: f64::INFINITY,
            since_improvement: 0,
            round: Vec::new(),
        };
        let start = options.start.clone().unwrap_or_else(|| vec![0.5; dimension]);
        search.start(&start);
        search.sample();
        Ok(search)
    }

    /// Sets the distribution to one around `start`.
    fn start(&mut self, start: &[f64]) {
        let samples = self.population * n_categories(&self.coordinates);
        let mut mean = Vec::new();
        let mut least = Vec::new();
        self.categories.clear();
        for (coordinate, x) in self.coordinates.iter().zip(start) {
            if let Coordinate::Categorical { levels } = coordinate {
                self.categories.push(Categories::new(*levels, samples));
            } else {
                mean.push(*x);
                least.push(least_deviation(*coordinate));
            }
        }
        let deviation = self.options.initial_deviation;
        self.gaussian = (!mean.is_empty()).then(|| Gaussian::new(mean, deviation, least, self.population));
        self.history.clear();
        (self.best, self.since_improvement) = (f64::INFINITY, 0);
    }

    fn restart(&mut self) {
        self.population = self.population.saturating_mul(self.options.population_growth).min(MAX_POPULATION);
        let start: Vec<f64> = self.coordinates.iter().map(|_| self.uniforms.uniform()).collect();
        self.start(&start);
    }

    fn sample(&mut self) {
        self.samples.resize_with(self.population, Vec::new);
        self.round.resize_with(self.population, Vec::new);
        for (x, u) in self.samples.iter_mut().zip(&mut self.round) {
            if let Some(gaussian) = &self.gaussian {
                gaussian.sample(&mut self.normals, x);
            }
            if self.is_clipped {
                x.iter_mut().for_each(|x| *x = x.clamp(0.0, 1.0));
            }
            let mut numbers = x.iter();
            let mut categories = self.categories.iter();
            u.clear();
            u.extend(self.coordinates.iter().map(|coordinate| match coordinate {
                Coordinate::Categorical { .. } => {
                    categories.next().map_or(0.5, |category| category.sample(&mut self.uniforms))
                }
                _ => numbers.next().map_or(0.5, |x| mirrored(*x)),
            }));
        }
    }

    fn update(&mut self, ranking: &[usize]) {
        let Self { samples, round, coordinates, categories, gaussian, .. } = self;
        let ranked: Vec<&[f64]> = ranking.iter().map(|i| samples[*i].as_slice()).collect();
        if let Some(gaussian) = gaussian {
            gaussian.update(&ranked);
        }
        let parameters = parameters::Parameters::new(coordinates.len(), ranking.len());
        let is_category = |k: &usize| matches!(coordinates[*k], Coordinate::Categorical { .. });
        for (category, k) in categories.iter_mut().zip((0..coordinates.len()).filter(is_category)) {
            let better = ranking.iter().zip(&parameters.weights[..parameters.mu]);
            let rate = parameters.mu_eff / (parameters.mu_eff + category.n_levels() as f64);
            category.update(better.map(|(i, weight)| (round[*i][k], *weight)), rate);
        }
    }

    /// Returns the number of generations whose best values must differ.
    fn history_length(&self) -> usize {
        10 + (30 * self.coordinates.len()).div_ceil(self.population)
    }

    /// Returns whether the values of the last generations are equal within the tolerance.
    fn is_flat(&self, lowest: f64, highest: f64) -> bool {
        let range = |low: f64, high: f64| low == high || high - low <= self.options.fatol;
        let low = self.history.iter().fold(lowest, |a, b| a.min(*b));
        let high = self.history.iter().fold(highest, |a, b| a.max(*b));
        self.history.len() >= self.history_length() && range(low, high)
    }

    fn is_exhausted(&self) -> bool {
        self.gaussian.as_ref().is_none_or(|gaussian| gaussian.is_exhausted(self.options.xatol))
            && self.categories.iter().all(Categories::is_decided)
    }
}

/// Returns the point of [0, 1] that `x` is folded to by reflections at 0 and 1.
fn mirrored(x: f64) -> f64 {
    let x = x.rem_euclid(2.0);
    if x > 1.0 { 2.0 - x } else { x }
}

impl RoundBased for CmaEs {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let mut ranking: Vec<usize> = (0..values.len()).collect();
        ranking.sort_by(|i, j| values[*i].total_cmp(&values[*j]));
        self.update(&ranking);
        let value = |rank: usize| values[ranking[rank]];
        let lowest = value(0);
        let highest = value(values.len() - 1);
        if let Some(gaussian) = &mut self.gaussian
            && lowest == value((0.7 * values.len() as f64) as usize)
        {
            gaussian.escape();
        }
        self.since_improvement = if is_success(lowest, self.best) { 0 } else { self.since_improvement + 1 };
        self.best = self.best.min(lowest);
        let patience = self.options.patience.unwrap_or(PATIENCE + self.coordinates.len());
        let has_stalled = self.since_improvement >= patience;
        if has_stalled || self.is_exhausted() || self.is_flat(lowest, highest) {
            self.restart();
        } else {
            self.history.push_back(lowest);
            if self.history.len() > self.history_length() {
                self.history.pop_front();
            }
        }
        self.sample();
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }
}
