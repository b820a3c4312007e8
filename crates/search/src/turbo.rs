//! TuRBO-1: Bayesian optimization in one trust region with Thompson sampling.

use std::mem;

use mishandle_random::Sequence;

use crate::bayesian::{TRANSFORM, new_point, snapped_point, transform};
use crate::gp::acquisition::thompson;
use crate::gp::candidates::CandidateGenerator;
use crate::gp::history::History;
use crate::gp::space::TypedSpace;
use crate::gp::surrogate::Surrogate;
use crate::gp::transform::Transform;
use crate::gp::trust_region::TrustRegion;
use crate::options::{POINTS, options};
use crate::registry::SearchEntry;
use crate::sobol::SobolPoints;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError, coordinate};

const NAME: &str = "turbo";

/// Candidates of a round: a constant, and more per point of the round; the original has min(100 d,
/// 5000).
const CANDIDATES: (usize, usize) = (256, 32);
const MAX_CANDIDATES: usize = 768;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "trust-region Bayesian optimization (TuRBO-1) with Thompson sampling and restarts",
    reference: "Eriksson, Pearce, Gardner, Turner and Poloczek, \"Scalable global optimization via local Bayesian \
                optimization\", NeurIPS 2019.",
    options: TurboOptions::specs,
    make: |space, seed, options| {
        let options = TurboOptions::read(options)?;
        Ok(Box::new(AskTell::new(Turbo::new(&space.coordinates, seed, &options)?)))
    },
};

options! {
    /// The options of [`Turbo`].
    pub struct TurboOptions of NAME {
        /// Points per round. The points of a round are chosen together, without each other's
        /// values.
        pub round_size: usize = 8, in POINTS;
        /// Sobol points at the start and after a restart.
        pub initial: Option<usize> = None, or "2 d, from 4 to 40", in POINTS;
        /// How robustness is transformed for the model: asinh, rank (normal scores) or standard
        /// (mean and variance).
        pub transform: String = "standard".to_owned(), in TRANSFORM;
    }
}

/// Trust-region Bayesian optimization.
///
/// After Sobol points, each round evaluates the minima of samples of the posterior over candidates
/// in a box around the best point. Edges are in proportion to the lengths of the model. The box
/// doubles after 3 successful rounds and halves after max(4, d) / `round-size` failed ones. When
/// its edge falls below 2^-7, the search restarts from new Sobol points and forgets the old
/// evaluations.
///
/// Values above the 75 % quantile of the earlier ones since the restart count as this quantile, so
/// simulations of such points can end early.
///
/// It differs from the original in the priors of the hyperparameters, in samples by random features
/// instead of a joint factorization, in fewer candidates and, from 21 coordinates on, in fewer
/// initial points.
#[derive(Debug, Clone)]
pub struct Turbo {
    options: TurboOptions,
    transform: Transform,
    space: TypedSpace,
    history: History,
    surrogate: Surrogate,
    region: TrustRegion,
    generator: CandidateGenerator,
    sobol: SobolPoints,
    stream: Sequence,
    is_initial: bool,
    round: Vec<Vec<f64>>,
}

impl Turbo {
    /// Creates the search on coordinates of the given types.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for an option out of range.
    pub fn new(coordinates: &[Coordinate], seed: u64, options: &TurboOptions) -> Result<Self, SearchError> {
        let d = coordinate::dimension(coordinates)?;
        options.check_ranges()?;
        let transform = transform(&options.transform, NAME)?;
        let space = TypedSpace::new(coordinates);
        let mut search = Self {
            options: options.clone(),
            transform,
            history: History::default(),
            surrogate: Surrogate::new(space.clone(), transform),
            region: TrustRegion::new(d),
            generator: CandidateGenerator::new(space.clone(), seed, 1),
            space,
            sobol: SobolPoints::new(d, seed),
            stream: Sequence::new(seed, 2),
            is_initial: true,
            round: Vec::new(),
        };
        search.restart();
        Ok(search)
    }

    fn restart(&mut self) {
        let d = self.space.dimension();
        self.history = History::default();
        self.surrogate = Surrogate::new(self.space.clone(), self.transform);
        self.region = TrustRegion::new(d);
        self.is_initial = true;
        let n = self.options.initial.unwrap_or((2 * d).clamp(4, 40));
        self.round = (0..n).map(|_| snapped_point(&mut self.sobol, &self.space)).collect();
    }

    fn propose(&mut self) {
        self.surrogate.update(&self.history);
        let n = (CANDIDATES.0 + CANDIDATES.1 * self.options.round_size).min(MAX_CANDIDATES);
        let center = &self.history.points()[self.history.by_value()[0]];
        let region = self.region.around(center, &self.surrogate.lengths());
        let candidates = self.generator.local(&self.history, &region, n);
        let chosen = thompson(&self.surrogate, &candidates, self.options.round_size, &mut self.stream);
        self.round = chosen.iter().map(|&i| candidates.point(i).to_vec()).collect();
        // Without a model, or if all points of a discrete space are evaluated.
        while self.round.len() < self.options.round_size {
            self.round.push(new_point(&mut self.sobol, &self.space, &self.history));
        }
    }
}

impl RoundBased for Turbo {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let round = mem::take(&mut self.round);
        let values = self.history.capped(values);
        self.history.extend(&round, &values);
        let lowest = values.iter().copied().fold(f64::INFINITY, f64::min);
        if mem::take(&mut self.is_initial) {
            self.region.set_best(lowest);
        } else {
            self.region.receive(lowest, values.len());
        }
        if self.region.has_collapsed() { self.restart() } else { self.propose() }
    }

    fn stop_threshold(&self, _i: usize) -> f64 {
        self.history.cap()
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }
}
