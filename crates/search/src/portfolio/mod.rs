//! The portfolio: corners first, then a Gaussian process in the whole box and in a trust region, beside exploration.

mod corners;
mod polish;
mod shares;

use std::collections::VecDeque;
use std::mem;

use mishandle_random::Sequence;

use crate::bayesian::{TRANSFORM, new_point, snapped_point, transform};
use crate::gp::acquisition::Batch;
use crate::gp::candidates::{CandidateGenerator, Candidates, Region};
use crate::gp::history::History;
use crate::gp::space::TypedSpace;
use crate::gp::surrogate::Surrogate;
use crate::gp::trust_region::TrustRegion;
use crate::options::{ANY, AT_LEAST_1, NOT_NEGATIVE, options};
use crate::registry::SearchEntry;
use crate::sobol::SobolPoints;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError, coordinate};
use corners::corners;
use polish::Polish;
use shares::{Credits, Source, exploration};

const NAME: &str = "portfolio";

/// Sobol points of the first round: one per coordinate, within these bounds.
const SOBOL: (usize, usize) = (4, 8);
/// Numbers of candidates of each kind: a constant, and more per point of a round.
const CANDIDATES: (usize, usize) = (96, 8);
const MAX_CANDIDATES: usize = 192;
/// The share of polish and, of the rest, of the trust region, without exploration.
const POLISH: f64 = 0.1;
const LOCAL: f64 = 0.5;
/// A new trust region keeps this distance from the centers of collapsed ones, as a fraction of the diagonal.
const APART: f64 = 0.05;
/// The number of collapsed trust regions that are remembered.
const MAX_EXHAUSTED: usize = 32;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "corners, then a Gaussian process in the box and in a trust region, beside exploration",
    reference: "Desautels, Krause and Burdick, JMLR 15, 2014 (batches). Eriksson et al., \"Scalable global optimization via \
                local Bayesian optimization\", NeurIPS 2019 (trust region).",
    options: PortfolioOptions::specs,
    make: |coordinates, seed, options| {
        let options = PortfolioOptions::read(options)?;
        Ok(Box::new(AskTell::new(Portfolio::new(coordinates, seed, &options)?)))
    },
};

options! {
    /// The options of [`Portfolio`].
    pub struct PortfolioOptions of NAME {
        /// Points per round. The points of a round are chosen together, without each other's values.
        pub round_size: usize = 8, in AT_LEAST_1;
        /// Evaluates corners of the box first: all for up to 4 coordinates, otherwise 8.
        pub corners: bool = true, in ANY;
        /// Proposes points on exact faces and corners of the box, too.
        pub faces: bool = true, in ANY;
        /// Uses a trust region around the best point for half of the model's points.
        pub trust_region: bool = true, in ANY;
        /// Takes random steps from the best point.
        pub polish: bool = true, in ANY;
        /// Raises the share of Sobol points when the model is of no use.
        pub exploration: bool = true, in ANY;
        /// Minimizes the lower confidence bound with gradients.
        pub refine: bool = true, in ANY;
        /// Standard deviations that the lower confidence bound is below the mean.
        pub kappa: f64 = 2.0, in NOT_NEGATIVE;
        /// How robustness is transformed for the model: asinh, rank (normal scores) or standard (mean and variance).
        pub transform: String = "asinh".to_owned(), in TRANSFORM;
    }
}

/// The portfolio search: corners first, then a Gaussian process in the whole box and in a trust region, beside exploration.
///
/// The first round is corners (all 2^d for d ≤ 4, otherwise a balanced sample of 8), the center and scrambled Sobol
/// points. Each point of a further round comes from one of four sources, in proportion to their shares:
///
/// | source | point | share |
/// |---|---|---|
/// | exploration | next Sobol point | e = 0.1 to 0.95 |
/// | model, global | lowest confidence bound of the box, its faces, corners and neighborhoods of the best points | 0.45 (1 - e) |
/// | model, local | lowest confidence bound in a trust region around the best point | 0.45 (1 - e) |
/// | polish | random step from the best point, with the one-fifth rule | 0.1 (1 - e) |
///
/// The share e rises when the model is of no use: its leave-one-out predictions do not correlate with the values, or it
/// is certain that no point violates the requirement. So a violation in a small region without a slope towards it is found
/// about as fast as by random points.
///
/// The model is a Gaussian process (Matérn-5/2, one length per coordinate) of asinh-transformed robustness. The most
/// promising candidates are moved to local minima of the bound by gradients; within a round, the variance shrinks around
/// chosen points as if they were evaluated. The trust region has the rules of TuRBO-1. When it collapses, a new one starts
/// at the best point that is not near the centers of collapsed ones; the model keeps all evaluations.
///
/// Integer coordinates are modeled by the centers of their levels, categories by one feature per level. The search never
/// ends. Beyond a few hundred evaluations it models the best and the latest.
///
/// # Reference
/// Desautels, Krause and Burdick, "Parallelizing exploration-exploitation tradeoffs in Gaussian process bandit
/// optimization", JMLR 15, 2014. Eriksson, Pearce, Gardner, Turner and Poloczek, "Scalable global optimization via local
/// Bayesian optimization", NeurIPS 2019.
#[derive(Debug, Clone)]
pub struct Portfolio {
    options: PortfolioOptions,
    history: History,
    surrogate: Surrogate,
    region: TrustRegion,
    /// The centers of collapsed trust regions.
    exhausted: VecDeque<Vec<f64>>,
    polish: Polish,
    credits: Credits,
    generator: CandidateGenerator,
    sobol: SobolPoints,
    stream: Sequence,
    round: Vec<Vec<f64>>,
    /// The source of each point of the round; shorter for the first round.
    sources: Vec<Source>,
}

impl Portfolio {
    /// Creates the search on coordinates of the given types.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate with 0 levels,
    /// [`SearchError::Option`] for an option out of range.
    pub fn new(
        coordinates: &[Coordinate],
        seed: u64,
        options: &PortfolioOptions,
    ) -> Result<Self, SearchError> {
        let d = coordinate::dimension(coordinates)?;
        options.check_ranges()?;
        let transform = transform(&options.transform, NAME)?;
        let space = TypedSpace::new(coordinates);
        let mut search = Self {
            options: options.clone(),
            history: History::default(),
            surrogate: Surrogate::new(space.clone(), transform),
            region: new_region(d, options),
            exhausted: VecDeque::new(),
            polish: Polish::new(),
            credits: Credits::default(),
            generator: CandidateGenerator::new(space.clone(), seed, 1),
            sobol: SobolPoints::new(d, seed),
            stream: Sequence::new(seed, 2),
            round: Vec::new(),
            sources: Vec::new(),
        };
        if options.corners {
            search.round = corners(&space, &mut search.stream);
        }
        search.round.push(space.center());
        search.round.extend((0..d.clamp(SOBOL.0, SOBOL.1)).map(|_| snapped_point(&mut search.sobol, &space)));
        Ok(search)
    }

    fn propose(&mut self) {
        self.surrogate.update(&self.history);
        let center = self.center();
        let region = self.region.around(&self.history.points()[center], &self.surrogate.lengths());
        let (mut candidates, n_global) = self.candidates(&region);
        let mut batch = Batch::new(&self.surrogate, &candidates);
        if let Some(batch) = batch.as_mut().filter(|_| self.options.refine) {
            let whole = Region::whole(region.center.len());
            for (range, region) in [(0..n_global, &whole), (n_global..candidates.len(), &region)] {
                for kappa in [self.options.kappa, 0.0] {
                    let area = (range.clone(), region);
                    batch.refine(&self.surrogate, &mut candidates, &self.history, area, kappa);
                }
            }
        }
        let distance = batch.as_ref().map_or(0.0, |batch| batch.distance(self.surrogate.level()));
        self.sources = self.credits.divide(self.options.round_size, &self.shares(distance));
        for slot in 0..self.sources.len() {
            let range = match self.sources[slot] {
                Source::Global => Some(0..n_global),
                Source::Local => Some(n_global..candidates.len()),
                Source::Exploration | Source::Polish => None,
            };
            let chosen =
                range.zip(batch.as_mut()).and_then(|(range, batch)| batch.choose(range, self.options.kappa));
            let point = match chosen {
                Some(i) => Some(candidates.point(i).to_vec()),
                None if self.sources[slot] == Source::Polish => self.polished(),
                None => None,
            };
            let point = point.unwrap_or_else(|| {
                // Also without a model, and if all candidates in a discrete space are evaluated.
                self.sources[slot] = Source::Exploration;
                new_point(&mut self.sobol, self.surrogate.space(), &self.history)
            });
            self.round.push(point);
        }
    }

    /// Returns candidates of the whole box, followed by those of the trust region, and the number of the former.
    fn candidates(&mut self, region: &Region) -> (Candidates, usize) {
        let n = (CANDIDATES.0 + CANDIDATES.1 * self.options.round_size).min(MAX_CANDIDATES);
        let mut candidates = self.generator.global(&self.history, n, self.options.faces);
        let n_global = candidates.len();
        if self.options.trust_region {
            candidates.append(self.generator.local(&self.history, region, n));
        }
        (candidates, n_global)
    }

    /// Returns a random step from the best point; `None` if it leads to an evaluated point.
    fn polished(&mut self) -> Option<Vec<f64>> {
        let best = &self.history.points()[self.history.by_value()[0]];
        let point = self.polish.propose(best, self.surrogate.space(), &mut self.stream);
        Some(point).filter(|point| !self.history.contains(point))
    }

    fn shares(&self, distance: f64) -> [f64; 4] {
        let explored = if self.options.exploration {
            exploration(self.surrogate.rank_correlation(), self.history.len(), distance)
        } else {
            0.0
        };
        let polish = if self.options.polish { POLISH } else { 0.0 };
        let local = if self.options.trust_region { LOCAL } else { 0.0 };
        let rest = 1.0 - explored;
        [explored, rest * (1.0 - polish) * (1.0 - local), rest * (1.0 - polish) * local, rest * polish]
    }

    /// Returns the index of the best point that is not near a collapsed trust region; of the best point if all are near one.
    fn center(&self) -> usize {
        let order = self.history.by_value();
        let apart = APART * (self.surrogate.space().dimension() as f64).sqrt();
        let is_near = |i: usize| {
            let point = &self.history.points()[i];
            self.exhausted.iter().any(|center| distance(point, center) < apart)
        };
        order.iter().copied().find(|&i| !is_near(i)).unwrap_or(order[0])
    }

    /// Adapts the polish and the trust region to the values of a round.
    fn adapt(&mut self, values: &[f64]) {
        let best = self.history.values()[self.history.by_value()[0]];
        let of =
            |source| self.sources.iter().zip(values).filter(move |(s, _)| **s == source).map(|(_, v)| *v);
        of(Source::Polish).for_each(|value| self.polish.receive(value < best));
        if let Some(lowest) = of(Source::Local).min_by(f64::total_cmp) {
            self.region.receive(lowest);
        }
        if self.region.has_collapsed() {
            let center = self.center();
            self.exhausted.push_back(self.history.points()[center].clone());
            if self.exhausted.len() > MAX_EXHAUSTED {
                self.exhausted.pop_front();
            }
            self.region = new_region(self.surrogate.space().dimension(), &self.options);
        }
    }
}

/// Returns a trust region that expects its share of each round.
fn new_region(dimension: usize, options: &PortfolioOptions) -> TrustRegion {
    TrustRegion::new(dimension, (LOCAL * options.round_size as f64).ceil() as usize)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

impl RoundBased for Portfolio {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let round = mem::take(&mut self.round);
        if self.history.len() > 0 {
            self.adapt(values);
        }
        round.iter().zip(values).for_each(|(point, value)| self.history.push(point, *value));
        let center = self.center();
        self.region.set_best(self.history.values()[center]);
        self.propose();
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }

    fn keeps_exploring(&self) -> bool {
        true
    }
}
