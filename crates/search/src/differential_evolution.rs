//! Differential evolution: a population that moves along the differences of its members.

use mishandle_random::Sequence;

use crate::categories::level_of;
use crate::coordinate::dimension;
use crate::options::{ANY, FROM_0_TO_1, MOST_POINTS, NOT_NEGATIVE, Range, options};
use crate::registry::SearchEntry;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError};

const NAME: &str = "differential-evolution";
/// The least population: a member, the best one and two others must differ.
const MIN_POPULATION: usize = 5;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "a population that moves along the differences of its members, as in SciPy, with restarts",
    reference: "Storn and Price, \"Differential evolution: a simple and efficient heuristic for global optimization over \
                continuous spaces\", J. Global Optim. 11, 1997.",
    options: DifferentialEvolutionOptions::specs,
    make: |space, seed, options| {
        let options = DifferentialEvolutionOptions::read(options)?;
        Ok(Box::new(AskTell::new(DifferentialEvolution::new(&space.coordinates, seed, &options)?)))
    },
};

const STRATEGIES: [(&str, Strategy); 2] = [("best1bin", Strategy::Best), ("rand1bin", Strategy::Random)];
const STRATEGY: Range = Range::described("\"best1bin\" or \"rand1bin\"");
const POPULATION: Range =
    Range { words: "from 5 to 100000", holds: |x| (MIN_POPULATION as f64..=MOST_POINTS).contains(&x) };
const MUTATION: Range = Range { words: "in [0, 2)", holds: |x| (0.0..2.0).contains(&x) };

options! {
    /// The options of [`DifferentialEvolution`], with SciPy's names and defaults, except for the
    /// population.
    pub struct DifferentialEvolutionOptions of NAME {
        /// Base of a mutation: the best member (`best1bin`), which converges fast, or a random one
        /// (`rand1bin`).
        pub strategy: String = "best1bin".to_owned(), in STRATEGY;
        /// Number of members. SciPy has 15 d.
        pub population: Option<usize> = None, or "5 d, but at least 20 and at most 60", in POPULATION;
        /// Least factor of a difference. The factor of a generation is drawn uniformly between both
        /// bounds.
        pub mutation_min: f64 = 0.5, in MUTATION;
        /// Largest factor of a difference.
        pub mutation_max: f64 = 1.0, in MUTATION;
        /// Probability that a coordinate of a trial point is mutated.
        pub recombination: f64 = 0.7, in FROM_0_TO_1;
        /// Relative tolerance: the population has converged if the standard deviation of its values
        /// is at most `atol` + `tol` times the absolute mean.
        pub tol: f64 = 0.01, in NOT_NEGATIVE;
        /// Absolute tolerance.
        pub atol: f64 = 0.0, in NOT_NEGATIVE;
        /// Starts again with a new population after convergence. Otherwise the search ends, as in
        /// SciPy.
        pub restart: bool = true, in ANY;
    }
}

/// Differential evolution in `[0,1]^d`: each member competes with a mutation of another one.
///
/// Use it with large batches on rough functions: a generation is proposed at once, and it needs no
/// scale of values. It needs many evaluations; with a budget of some hundred, `cma-es` or a
/// model-based search is better.
///
/// ```text
/// base + F (a - b)                       a, b: random members, F uniform in [mutation-min, mutation-max)
/// trial = mutation in each coordinate with the probability `recombination`, and in a random one; else the member
/// the trial replaces the member if its value is not higher
/// ```
///
/// The first population is a Latin hypercube. A mutated coordinate outside [0, 1] is replaced by a
/// uniform number, as in SciPy, so bounds are approached but hardly ever proposed. Trials of a
/// generation use the members of the previous one (SciPy's `updating="deferred"`). There is no
/// final local search (`polish=False`).
///
/// Integer axes are treated as continuous. In a category, two equal levels have the difference 0,
/// so the base keeps its level; for different levels the mutation draws one uniformly. A population
/// with a value of +∞ has not converged, unless all are.
///
/// # Reference
/// Storn and Price, "Differential evolution: a simple and efficient heuristic for global
/// optimization over continuous spaces", J. Global Optim. 11, 1997.
#[derive(Debug, Clone)]
pub struct DifferentialEvolution {
    options: DifferentialEvolutionOptions,
    strategy: Strategy,
    coordinates: Vec<Coordinate>,
    random: Sequence,
    members: Vec<Vec<f64>>,
    /// The values of the members; empty while the first population is evaluated.
    values: Vec<f64>,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

#[derive(Debug, Clone, Copy)]
enum Strategy {
    Best,
    Random,
}

impl DifferentialEvolution {
    /// Creates the search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for an unknown strategy or a number outside the
    /// documented range of its option.
    pub fn new(
        coordinates: &[Coordinate],
        seed: u64,
        options: &DifferentialEvolutionOptions,
    ) -> Result<Self, SearchError> {
        let dimension = dimension(coordinates)?;
        options.check_ranges()?;
        let strategy = STRATEGIES.iter().find(|(name, _)| *name == options.strategy);
        let (_, strategy) = strategy.ok_or_else(|| SearchError::Option {
            search: NAME,
            option: "strategy".to_owned(),
            found: format!("{:?}", options.strategy),
            expected: STRATEGY.words.to_owned(),
        })?;
        if options.mutation_max < options.mutation_min {
            return Err(SearchError::Option {
                search: NAME,
                option: "mutation-max".to_owned(),
                found: format!("{:?}", options.mutation_max),
                expected: format!("at least mutation-min, {:?}", options.mutation_min),
            });
        }
        let population = options.population.unwrap_or((5 * dimension).clamp(20, 60));
        let mut search = Self {
            options: options.clone(),
            strategy: *strategy,
            coordinates: coordinates.to_vec(),
            random: Sequence::new(seed, 0),
            members: vec![vec![0.0; dimension]; population],
            values: Vec::new(),
            round: Vec::new(),
            end: None,
        };
        search.start();
        Ok(search)
    }

    /// Proposes a new population: a Latin hypercube.
    fn start(&mut self) {
        let n = self.members.len();
        let mut cells: Vec<usize> = (0..n).collect();
        for k in 0..self.coordinates.len() {
            for i in (1..n).rev() {
                cells.swap(i, self.random.below(i as u64 + 1) as usize);
            }
            for (member, cell) in self.members.iter_mut().zip(&cells) {
                member[k] = (*cell as f64 + self.random.uniform()) / n as f64;
            }
        }
        self.values.clear();
        self.round.clone_from(&self.members);
    }

    /// Proposes a trial for each member.
    fn propose_trials(&mut self) {
        let lowest = |best, i: usize| if self.values[i] < self.values[best] { i } else { best };
        let best = (0..self.values.len()).fold(0, lowest);
        let low = self.options.mutation_min;
        let high = self.options.mutation_max;
        let factor = low + (high - low) * self.random.uniform();
        for i in 0..self.members.len() {
            self.set_trial(i, best, factor);
        }
    }

    fn set_trial(&mut self, i: usize, best: usize, factor: f64) {
        let [first, second, third] = self.three_others(i);
        let (base, a, b) = match self.strategy {
            Strategy::Best => (best, first, second),
            Strategy::Random => (first, second, third),
        };
        let random = &mut self.random;
        let always = random.below(self.coordinates.len() as u64) as usize;
        for (k, coordinate) in self.coordinates.iter().enumerate() {
            let is_mutated = random.uniform() < self.options.recombination || k == always;
            let [base, a, b] = [base, a, b].map(|member| self.members[member][k]);
            self.round[i][k] = match coordinate {
                _ if !is_mutated => self.members[i][k],
                Coordinate::Categorical { levels } if level_of(a, *levels) == level_of(b, *levels) => base,
                Coordinate::Categorical { .. } => random.uniform(),
                _ => {
                    let mutated = base + factor * (a - b);
                    if (0.0..=1.0).contains(&mutated) { mutated } else { random.uniform() }
                }
            };
        }
    }

    /// Returns three different members other than `i`, all combinations with equal probability.
    fn three_others(&mut self, i: usize) -> [usize; 3] {
        let mut others = [i; 3];
        for j in 0..3 {
            while others[j] == i || others[..j].contains(&others[j]) {
                others[j] = self.random.below(self.members.len() as u64) as usize;
            }
        }
        others
    }

    fn has_converged(&self) -> bool {
        if self.values.iter().all(|value| *value == f64::INFINITY) {
            return true;
        }
        let n = self.values.len() as f64;
        let mean = self.values.iter().sum::<f64>() / n;
        let variance = self.values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / n;
        // With an infinite value, both sides are not numbers.
        variance.sqrt() <= self.options.atol + self.options.tol * mean.abs()
    }
}

impl RoundBased for DifferentialEvolution {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    /// A trial with a higher value than its member is dropped, whatever the value.
    fn stop_threshold(&self, i: usize) -> f64 {
        self.values.get(i).map_or(f64::INFINITY, |value| value.max(0.0))
    }

    fn receive(&mut self, values: &[f64]) {
        if self.values.is_empty() {
            self.values.extend_from_slice(values);
        } else {
            for (i, value) in values.iter().enumerate() {
                if *value <= self.values[i] {
                    self.values[i] = *value;
                    self.members[i].clone_from(&self.round[i]);
                }
            }
        }
        if !self.has_converged() {
            self.propose_trials();
        } else if self.options.restart {
            self.start();
        } else {
            self.round.clear();
            self.end = Some(SearchEnd::Converged);
        }
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }
}
