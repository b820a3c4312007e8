//! Dual annealing: generalised simulated annealing with a local search, as SciPy's `dual_annealing`.

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

/// Starts with values that are not finite, drawn anew so many times before the search gives up.
const MAX_REDRAWS: usize = 1000;
/// Chains without a better point before the first local search for want of improvement; d chains after that.
const PATIENCE: usize = 1000;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "simulated annealing with restarts and local search (L-BFGS-B), as in SciPy",
    reference: "Xiang, Sun, Fan and Gong, \"Generalized simulated annealing algorithm and its application to the Thomson \
                model\", Physics Letters A 233, 1997. Xiang, Gubian, Suomela and Hoeng, \"Generalized simulated annealing \
                for global optimization: the GenSA package\", The R Journal 5/1, 2013.",
    options: DualAnnealingOptions::specs,
    make: |coordinates, seed, options| {
        let options = DualAnnealingOptions::read(options)?;
        Ok(Box::new(AskTell::new(DualAnnealing::new(coordinates.len(), seed, &options)?)))
    },
};

const TEMPERATURE: Range = Range { words: "in (0.01, 50000]", holds: |x| x > 0.01 && x <= 5e4 };
const OPEN_SHARE: Range = Range { words: "in (0, 1)", holds: |x| x > 0.0 && x < 1.0 };
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
        /// Restarts from a random point when the temperature falls below this fraction of the initial one.
        pub restart_ratio: f64 = 2e-5, in OPEN_SHARE;
        /// Parameter q of the visiting distribution: larger values give heavier tails, so longer jumps.
        pub visit: f64 = 2.62, in VISIT;
        /// Parameter of the acceptance probability: lower values accept worse points less often.
        pub accept: f64 = -5.0, in ACCEPT;
        /// Improves good points with a local search (L-BFGS-B).
        pub local_search: bool = true, in ANY;
    }
}

/// Dual annealing in `[0,1]^d`: chains of visits at falling temperature, each followed by a local search if it paid.
///
/// Chain t = 0, 1, ... makes 2d visits from the current point at
///
/// ```text
/// T(t) = T₀ (2^(q-1) - 1) / ((t + 2)^(q-1) - 1)
/// ```
///
/// A visited point replaces the current one if its value is lower, else with probability
/// [1 - (1 - a) Δ (t + 1) / T]^(1 / (1 - a)), or 0 where the bracket is not positive; a is the acceptance parameter and Δ
/// the rise of the value. After the chain a local search runs from the best point if the chain has improved it (or
/// was the first of an annealing), and another from the chain's own best point after long want of improvement. Below
/// the restart temperature the annealing begins anew at a random point; the best point and the patience stay.
///
/// Draws differ from SciPy's, since the generator does; the laws of all draws and every decision are the same. A start
/// whose value is not finite is drawn again. Every coordinate is treated as continuous.
///
/// # Reference
/// Xiang, Sun, Fan and Gong, "Generalized simulated annealing algorithm and its application to the Thomson model",
/// Physics Letters A 233, 1997. Xiang, Gubian, Suomela and Hoeng, "Generalized simulated annealing for global
/// optimization: the GenSA package", The R Journal 5/1, 2013.
#[derive(Debug, Clone)]
pub struct DualAnnealing {
    options: DualAnnealingOptions,
    visiting: VisitingDistribution,
    stream: Sequence,
    local_iterations: usize,
    /// Chains made, and chains made since the annealing began.
    n_chains: usize,
    chain: usize,
    current: Valued,
    best: Valued,
    /// The point and the value a local search for want of improvement starts from. As in SciPy, the point follows
    /// every acceptance and the value does not.
    chain_best: Valued,
    improved: bool,
    /// Chains since the best point was last improved, and how many bring about a local search.
    idle_chains: usize,
    patience: usize,
    phase: Phase,
    round: Vec<Vec<f64>>,
    finish: Option<SearchEnd>,
}

#[derive(Debug, Clone)]
struct Valued {
    u: Vec<f64>,
    value: f64,
}

#[derive(Debug, Clone)]
enum Phase {
    /// A start is valued; so many have been drawn again.
    Start { redraws: usize },
    /// Visit `j` of a chain is valued.
    Visit { j: usize },
    /// A local search from the best point runs.
    Improve(Box<Lbfgsb>),
    /// A local search for want of improvement runs.
    Rescue(Box<Lbfgsb>),
}

impl DualAnnealing {
    /// A dual annealing of `dimension` coordinates.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] for dimension 0; [`SearchError::Option`] for a start outside the box or of another
    /// length, and for a number outside the range its option documents.
    pub fn new(dimension: usize, seed: u64, options: &DualAnnealingOptions) -> Result<Self, SearchError> {
        check(dimension, options)?;
        let mut stream = Sequence::new(seed, 0);
        let start = match &options.start {
            Some(start) => start.clone(),
            None => uniform_point(dimension, &mut stream),
        };
        let unknown = Valued { u: start.clone(), value: f64::INFINITY };
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
            idle_chains: 0,
            patience: PATIENCE,
            phase: Phase::Start { redraws: 0 },
            round: vec![start],
            finish: None,
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

    fn end(&mut self, finish: SearchEnd) {
        self.finish = Some(finish);
        self.round.clear();
    }

    fn start_anew(&mut self, redraws: usize) {
        self.round = vec![uniform_point(self.dimension(), &mut self.stream)];
        self.phase = Phase::Start { redraws };
    }

    fn after_start(&mut self, start: Valued, redraws: usize) {
        let is_first = self.n_chains == 0;
        // The very first start is the best point so far even if its value is not finite.
        if is_first && redraws == 0 {
            self.best = start.clone();
        }
        if start.value.is_finite() {
            if is_first {
                self.chain_best = start.clone();
            }
            self.current = start;
            self.chain = 0;
            self.begin_chain();
        } else if redraws < MAX_REDRAWS {
            self.start_anew(redraws + 1);
        } else {
            self.end(SearchEnd::NoFiniteStart);
        }
    }

    fn begin_chain(&mut self) {
        if self.n_chains >= self.options.max_iterations {
            self.end(SearchEnd::IterationLimit);
        } else if self.temperature() < self.options.initial_temperature * self.options.restart_ratio {
            self.start_anew(0);
        } else {
            self.idle_chains += 1;
            self.improved = self.chain == 0;
            self.propose_visit(0);
        }
    }

    fn end_chain(&mut self) {
        self.n_chains += 1;
        self.chain += 1;
        self.begin_chain();
    }

    fn propose_visit(&mut self, j: usize) {
        let temperature = self.temperature();
        self.round = vec![self.visiting.visit(&self.current.u, j, temperature, &mut self.stream)];
        self.phase = Phase::Visit { j };
    }

    fn after_visit(&mut self, visited: Valued, j: usize) {
        if visited.value < self.current.value {
            if visited.value < self.best.value {
                self.best = visited.clone();
                self.improved = true;
                self.idle_chains = 0;
            }
            self.current = visited;
        } else {
            self.accept_or_reject(visited, j);
        }
        if j + 1 < 2 * self.dimension() {
            self.propose_visit(j + 1);
        } else if self.options.local_search && self.improved {
            self.phase = Phase::Improve(self.local_search(&self.best));
        } else {
            self.rescue_or_end_chain();
        }
    }

    fn accept_or_reject(&mut self, visited: Valued, j: usize) {
        let scale = 1.0 - self.options.accept;
        let temperature = self.temperature() / (self.chain as f64 + 1.0);
        let bracket = 1.0 - scale * (visited.value - self.current.value) / temperature;
        let probability = if bracket > 0.0 { (bracket.ln() / scale).exp() } else { 0.0 };
        if self.stream.uniform() < probability {
            self.chain_best.u.clone_from(&visited.u);
            self.current = visited;
        }
        let is_better = j == 0 || self.current.value < self.chain_best.value;
        if self.idle_chains >= self.patience && is_better {
            self.chain_best = self.current.clone();
        }
    }

    fn rescue_or_end_chain(&mut self) {
        if self.options.local_search && self.idle_chains >= self.patience {
            self.phase = Phase::Rescue(self.local_search(&self.chain_best));
        } else {
            self.end_chain();
        }
    }

    fn local_search(&self, from: &Valued) -> Box<Lbfgsb> {
        let options = LbfgsbOptions { max_iterations: self.local_iterations, ..LbfgsbOptions::default() };
        Box::new(Lbfgsb::from_inside(&from.u, options))
    }

    fn after_improve(&mut self, search: &Lbfgsb) {
        if let Some(better) = result_below(search, self.best.value) {
            self.idle_chains = 0;
            self.best = better.clone();
            self.current = better;
        }
        self.rescue_or_end_chain();
    }

    fn after_rescue(&mut self, search: &Lbfgsb) {
        if let Some(better) = result_below(search, self.chain_best.value) {
            self.chain_best = better;
        }
        self.idle_chains = 0;
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
            Phase::Improve(search) | Phase::Rescue(search) if self.finish.is_none() => search.round(),
            _ => &self.round,
        }
    }

    fn receive(&mut self, values: &[f64]) {
        let told = |round: &mut Vec<Vec<f64>>| Valued { u: round.swap_remove(0), value: values[0] };
        match mem::replace(&mut self.phase, Phase::Start { redraws: 0 }) {
            Phase::Start { redraws } => {
                let start = told(&mut self.round);
                self.after_start(start, redraws);
            }
            Phase::Visit { j } => {
                let visited = told(&mut self.round);
                self.after_visit(visited, j);
            }
            Phase::Improve(mut search) => {
                search.receive(values);
                match search.finish() {
                    None => self.phase = Phase::Improve(search),
                    Some(_) => self.after_improve(&search),
                }
            }
            Phase::Rescue(mut search) => {
                search.receive(values);
                match search.finish() {
                    None => self.phase = Phase::Rescue(search),
                    Some(_) => self.after_rescue(&search),
                }
            }
        }
    }

    fn finish(&self) -> Option<SearchEnd> {
        self.finish
    }
}

/// The result of a local search if its value is finite and below `value`.
fn result_below(search: &Lbfgsb, value: f64) -> Option<Valued> {
    let (u, found) = search.result();
    (found.is_finite() && found < value).then(|| Valued { u: u.to_vec(), value: found })
}

fn uniform_point(dimension: usize, stream: &mut Sequence) -> Vec<f64> {
    (0..dimension).map(|_| stream.uniform()).collect()
}

fn check(dimension: usize, options: &DualAnnealingOptions) -> Result<(), SearchError> {
    check_dimension(dimension)?;
    check_start(NAME, options.start.as_ref(), dimension)?;
    options.check_ranges()
}
