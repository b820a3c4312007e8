//! Dual annealing: generalized simulated annealing with a local search, as in SciPy's
//! `dual_annealing`.
//!
//! # Reference
//! Virtanen et al., "SciPy 1.0: fundamental algorithms for scientific computing in Python", Nature
//! Methods 17, 2020.

mod visiting;

use std::mem;

use crate::coordinate::check_dimension;
use crate::lbfgsb::{Lbfgsb, LbfgsbOptions};
use crate::options::{ANY, AT_LEAST_1, POINT_OF_THE_BOX, Range, check_start, options};
use crate::registry::SearchEntry;
use mishandle_random::Sequence;

use crate::{AskTell, RoundBased, SearchEnd, SearchError};
pub use visiting::VisitingDistribution;

const NAME: &str = "dual-annealing";

/// The maximum number of redraws of an initial point whose value is not finite.
const MAX_REDRAWS: usize = 1000;
/// The number of chains without improvement before the first local search because of stagnation; d
/// chains afterwards.
const FIRST_PATIENCE: usize = 1000;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "simulated annealing with restarts and local search (L-BFGS-B), as in SciPy",
    reference: "Xiang, Sun, Fan and Gong, \"Generalized simulated annealing algorithm and its application to the Thomson \
                model\", Physics Letters A 233, 1997. Xiang, Gubian, Suomela and Hoeng, \"Generalized simulated annealing \
                for global optimization: the GenSA package\", The R Journal 5/1, 2013.",
    options: DualAnnealingOptions::specs,
    make: |space, seed, options| {
        let options = DualAnnealingOptions::read(options)?;
        Ok(Box::new(AskTell::new(DualAnnealing::new(space.coordinates.len(), seed, &options)?)))
    },
};

const TEMPERATURE: Range = Range { words: "in (0.01, 50000]", holds: |x| x > 0.01 && x <= 5e4 };
const OPEN_UNIT_INTERVAL: Range = Range { words: "in (0, 1)", holds: |x| x > 0.0 && x < 1.0 };
const VISIT: Range = Range { words: "in (1, 3)", holds: |x| x > 1.0 && x < 3.0 };
const ACCEPT: Range = Range { words: "in (-10000, -5]", holds: |x| x > -1e4 && x <= -5.0 };

options! {
    /// The options of [`DualAnnealing`], with SciPy's defaults.
    pub struct DualAnnealingOptions of NAME {
        /// First point, in `[0,1]^d`.
        pub start: Option<Vec<f64>> = None, or "drawn uniformly from the seed", in POINT_OF_THE_BOX;
        /// Maximum number of chains, of 2d visits each.
        pub max_iterations: usize = 1000, in AT_LEAST_1;
        /// Temperature of the first chain.
        pub initial_temperature: f64 = 5230.0, in TEMPERATURE;
        /// Restarts from a random point when the temperature falls below this fraction of the
        /// initial one.
        pub restart_ratio: f64 = 2e-5, in OPEN_UNIT_INTERVAL;
        /// Parameter q of the visiting distribution: larger values give heavier tails, so longer
        /// jumps.
        pub visit: f64 = 2.62, in VISIT;
        /// Parameter of the acceptance probability: lower values accept worse points less often.
        pub accept: f64 = -5.0, in ACCEPT;
        /// Improves good points with a local search (L-BFGS-B).
        pub local_search: bool = true, in ANY;
    }
}

/// Dual annealing on `[0,1]^d`: Markov chains at decreasing temperature, followed by a local search
/// after an improvement.
///
/// Chain t = 0, 1, ... consists of 2d visits from the current point at the temperature
///
/// ```text
/// T(t) = T₀ (2^(q-1) - 1) / ((t + 2)^(q-1) - 1)
/// ```
///
/// A visited point replaces the current point if its value is lower, otherwise with probability
/// [1 - (1 - a) Δ (t + 1) / T]^(1 / (1 - a)), or 0 if the bracket is not positive. Here a is the
/// acceptance parameter and Δ the increase of the value. After the chain, a local search starts
/// from the best point if the chain improved it or is the first since a restart. After a long
/// stagnation, another local search starts from the best point of the chain. Below the restart
/// temperature the annealing restarts from a random point; the best point and the number of chains
/// without improvement are kept.
///
/// The random numbers differ from SciPy's, which has another generator. The distributions and
/// decisions are the same. An initial point is redrawn until its value is finite. Every coordinate
/// is treated as continuous.
///
/// # Units
/// Jumps, the step of the finite differences (1e-8) and the gradient of the local search (`gtol`
/// 1e-5) are in fractions of the box. SciPy 1.17.1 has the same numbers in the units of its bounds,
/// so both agree for the bounds 0 and 1. Temperatures and the acceptance parameter have no unit of
/// length. `docs/reference/plans.md` compares all parameters.
///
/// # Reference
/// Xiang, Sun, Fan and Gong, "Generalized simulated annealing algorithm and its application to the
/// Thomson model", Physics Letters A 233, 1997. Xiang, Gubian, Suomela and Hoeng, "Generalized
/// simulated annealing for global optimization: the GenSA package", The R Journal 5/1, 2013.
#[derive(Debug, Clone)]
pub struct DualAnnealing {
    options: DualAnnealingOptions,
    visiting: VisitingDistribution,
    stream: Sequence,
    local_iterations: usize,
    /// Completed chains, in total and since the last restart.
    n_chains: usize,
    chain: usize,
    current: EvaluatedPoint,
    best: EvaluatedPoint,
    /// The initial point and value of a local search because of stagnation. As in SciPy, the point
    /// is updated on every acceptance, but the value is not.
    chain_best: EvaluatedPoint,
    improved: bool,
    /// Chains since the last improvement of the best point, and the number of them that triggers a
    /// local search.
    chains_without_improvement: usize,
    patience: usize,
    phase: Phase,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

#[derive(Debug, Clone)]
struct EvaluatedPoint {
    u: Vec<f64>,
    value: f64,
}

#[derive(Debug, Clone)]
enum Phase {
    /// Evaluates an initial point, after `redraws` redraws.
    Start { redraws: usize },
    /// Evaluates visit `j` of a chain.
    Visit { j: usize },
    /// Runs a local search from the best point.
    LocalSearch(Box<Lbfgsb>),
    /// Runs a local search because of stagnation.
    StagnationSearch(Box<Lbfgsb>),
}

impl DualAnnealing {
    /// Creates a dual annealing on `[0,1]^dimension`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] for dimension 0; [`SearchError::Option`] for a start outside
    /// `[0,1]^d` or of the wrong length, or a number outside the documented range of its option.
    pub fn new(dimension: usize, seed: u64, options: &DualAnnealingOptions) -> Result<Self, SearchError> {
        check(dimension, options)?;
        let mut stream = Sequence::new(seed, 0);
        let start = match &options.start {
            Some(start) => start.clone(),
            None => uniform_point(dimension, &mut stream),
        };
        let unknown = EvaluatedPoint { u: start.clone(), value: f64::INFINITY };
        Ok(Self {
            options: options.clone(),
            visiting: VisitingDistribution::new(options.visit),
            stream,
            local_iterations: (6 * dimension).clamp(100, 1000),
            n_chains: 0,
            chain: 0,
            current: unknown.clone(),
            best: unknown.clone(),
            chain_best: unknown,
            improved: false,
            chains_without_improvement: 0,
            patience: FIRST_PATIENCE,
            phase: Phase::Start { redraws: 0 },
            round: vec![start],
            end: None,
        })
    }

    fn dimension(&self) -> usize {
        self.current.u.len()
    }

    fn temperature(&self) -> f64 {
        let power = self.options.visit - 1.0;
        let first = (power * std::f64::consts::LN_2).exp() - 1.0;
        let now = (power * (self.chain as f64 + 2.0).ln()).exp() - 1.0;
        self.options.initial_temperature * first / now
    }

    fn stop(&mut self, end: SearchEnd) {
        self.end = Some(end);
        self.round.clear();
    }

    fn propose_start(&mut self, redraws: usize) {
        self.round = vec![uniform_point(self.dimension(), &mut self.stream)];
        self.phase = Phase::Start { redraws };
    }

    fn after_start(&mut self, start: EvaluatedPoint, redraws: usize) {
        let is_first = self.n_chains == 0;
        // The first initial point is the best point so far even if its value is not finite.
        if is_first && redraws == 0 {
            self.best = start.clone();
        }
        if start.value.is_finite() {
            if is_first {
                self.chain_best = start.clone();
            }
            self.current = start;
            self.chain = 0;
            self.start_chain();
        } else if redraws < MAX_REDRAWS {
            self.propose_start(redraws + 1);
        } else {
            self.stop(SearchEnd::NoFiniteStart);
        }
    }

    fn start_chain(&mut self) {
        if self.n_chains >= self.options.max_iterations {
            self.stop(SearchEnd::IterationLimit);
        } else if self.temperature() < self.options.initial_temperature * self.options.restart_ratio {
            self.propose_start(0);
        } else {
            self.chains_without_improvement += 1;
            self.improved = self.chain == 0;
            self.propose_visit(0);
        }
    }

    fn end_chain(&mut self) {
        self.n_chains += 1;
        self.chain += 1;
        self.start_chain();
    }

    fn propose_visit(&mut self, j: usize) {
        let temperature = self.temperature();
        self.round = vec![self.visiting.visit(&self.current.u, j, temperature, &mut self.stream)];
        self.phase = Phase::Visit { j };
    }

    fn after_visit(&mut self, visited: EvaluatedPoint, j: usize) {
        if visited.value < self.current.value {
            if visited.value < self.best.value {
                self.best = visited.clone();
                self.improved = true;
                self.chains_without_improvement = 0;
            }
            self.current = visited;
        } else {
            self.accept_or_reject(visited, j);
        }
        if j + 1 < 2 * self.dimension() {
            self.propose_visit(j + 1);
        } else if self.options.local_search && self.improved {
            self.phase = Phase::LocalSearch(self.local_search(&self.best));
        } else {
            self.search_or_end_chain();
        }
    }

    fn accept_or_reject(&mut self, visited: EvaluatedPoint, j: usize) {
        let scale = 1.0 - self.options.accept;
        let temperature = self.temperature() / (self.chain as f64 + 1.0);
        let bracket = 1.0 - scale * (visited.value - self.current.value) / temperature;
        let probability = if bracket > 0.0 { (bracket.ln() / scale).exp() } else { 0.0 };
        if self.stream.uniform() < probability {
            self.chain_best.u.clone_from(&visited.u);
            self.current = visited;
        }
        let is_better = j == 0 || self.current.value < self.chain_best.value;
        if self.chains_without_improvement >= self.patience && is_better {
            self.chain_best = self.current.clone();
        }
    }

    fn search_or_end_chain(&mut self) {
        if self.options.local_search && self.chains_without_improvement >= self.patience {
            self.phase = Phase::StagnationSearch(self.local_search(&self.chain_best));
        } else {
            self.end_chain();
        }
    }

    fn local_search(&self, from: &EvaluatedPoint) -> Box<Lbfgsb> {
        let options = LbfgsbOptions { max_iterations: self.local_iterations, ..LbfgsbOptions::default() };
        Box::new(Lbfgsb::from_inside(&from.u, options))
    }

    fn after_local_search(&mut self, search: &Lbfgsb) {
        if let Some(better) = result_below(search, self.best.value) {
            self.chains_without_improvement = 0;
            self.best = better.clone();
            self.current = better;
        }
        self.search_or_end_chain();
    }

    fn after_stagnation_search(&mut self, search: &Lbfgsb) {
        if let Some(better) = result_below(search, self.chain_best.value) {
            self.chain_best = better;
        }
        self.chains_without_improvement = 0;
        self.patience = self.dimension();
        if self.chain_best.value < self.best.value {
            self.best = self.chain_best.clone();
            self.current = self.chain_best.clone();
        }
        self.end_chain();
    }
}

impl RoundBased for DualAnnealing {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        match &self.phase {
            Phase::LocalSearch(search) | Phase::StagnationSearch(search) if self.end.is_none() => {
                search.round()
            }
            _ => &self.round,
        }
    }

    fn receive(&mut self, values: &[f64]) {
        let evaluated =
            |round: &mut Vec<Vec<f64>>| EvaluatedPoint { u: round.swap_remove(0), value: values[0] };
        match mem::replace(&mut self.phase, Phase::Start { redraws: 0 }) {
            Phase::Start { redraws } => {
                let start = evaluated(&mut self.round);
                self.after_start(start, redraws);
            }
            Phase::Visit { j } => {
                let visited = evaluated(&mut self.round);
                self.after_visit(visited, j);
            }
            Phase::LocalSearch(mut search) => {
                search.receive(values);
                match search.finished() {
                    None => self.phase = Phase::LocalSearch(search),
                    Some(_) => self.after_local_search(&search),
                }
            }
            Phase::StagnationSearch(mut search) => {
                search.receive(values);
                match search.finished() {
                    None => self.phase = Phase::StagnationSearch(search),
                    Some(_) => self.after_stagnation_search(&search),
                }
            }
        }
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }
}

/// Returns the result of a local search if its value is finite and less than `value`.
fn result_below(search: &Lbfgsb, value: f64) -> Option<EvaluatedPoint> {
    let (u, found) = search.result();
    (found.is_finite() && found < value).then(|| EvaluatedPoint { u: u.to_vec(), value: found })
}

fn uniform_point(dimension: usize, stream: &mut Sequence) -> Vec<f64> {
    (0..dimension).map(|_| stream.uniform()).collect()
}

fn check(dimension: usize, options: &DualAnnealingOptions) -> Result<(), SearchError> {
    check_dimension(dimension)?;
    check_start(NAME, options.start.as_ref(), dimension)?;
    options.check_ranges()
}
