//! Bayesian optimization in rounds: a Gaussian process of the robustness, and the lower confidence
//! bound or Thompson sampling.

use std::mem;

use mishandle_random::Sequence;

use crate::gp::acquisition::{Batch, thompson};
use crate::gp::candidates::{CandidateGenerator, Region};
use crate::gp::history::History;
use crate::gp::space::TypedSpace;
use crate::gp::surrogate::Surrogate;
use crate::gp::transform::Transform;
use crate::options::{ANY, NOT_NEGATIVE, POINTS, Range, options};
use crate::registry::SearchEntry;
use crate::sobol::SobolPoints;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError, coordinate};

const NAME: &str = "bayesian";

/// Numbers of candidates of each kind: a constant, and one more per point of a round.
const CANDIDATES: (usize, usize) = (128, 8);
/// The most candidates of each kind.
const MAX_CANDIDATES: usize = 256;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "Gaussian process with lower confidence bound or Thompson sampling, in rounds",
    reference: "Desautels, Krause and Burdick, \"Parallelizing exploration-exploitation tradeoffs in Gaussian process \
                bandit optimization\", JMLR 15, 2014.",
    options: BayesianOptions::specs,
    make: |space, seed, options| {
        let options = BayesianOptions::read(options)?;
        Ok(Box::new(AskTell::new(Bayesian::new(&space.coordinates, seed, &options)?)))
    },
};

const ACQUISITION: Range = Range::described("\"lcb\" or \"thompson\"");
pub(crate) const TRANSFORM: Range = Range::described(Transform::NAMES);

options! {
    /// The options of [`Bayesian`].
    pub struct BayesianOptions of NAME {
        /// Points per round. The points of a round are chosen together, without each other's
        /// values.
        pub round_size: usize = 8, in POINTS;
        /// Points of the first round: Sobol points and the center of the box.
        pub initial: Option<usize> = None, or "2 (d + 1), at most 20", in POINTS;
        /// How a round is chosen: lower confidence bound (lcb) or samples of the posterior
        /// (thompson).
        pub acquisition: String = "lcb".to_owned(), in ACQUISITION;
        /// Standard deviations that the lower confidence bound is below the mean.
        pub kappa: f64 = 2.0, in NOT_NEGATIVE;
        /// Proposes points on exact faces and corners of the box, too.
        pub faces: bool = true, in ANY;
        /// How robustness is transformed for the model: asinh, rank (normal scores) or standard
        /// (mean and variance).
        pub transform: String = "asinh".to_owned(), in TRANSFORM;
    }
}

/// Bayesian optimization with a Gaussian process (Matérn-5/2, one length per coordinate).
///
/// The first round is scrambled Sobol points and the center of the box. For each further round, the
/// model predicts mean and standard deviation of the transformed robustness at candidates: Sobol
/// points of the box, the same with some coordinates on exact faces, and neighbors of the best
/// points. The candidate with the lowest confidence bound joins the round, and the variance shrinks
/// around it as if it were evaluated, until the round is full.
///
/// Integer coordinates are modeled by the centers of their levels, categories by one feature per
/// level. The search never ends. It models at most a few hundred evaluations, the best and the
/// latest.
#[derive(Debug, Clone)]
pub struct Bayesian {
    options: BayesianOptions,
    history: History,
    surrogate: Surrogate,
    generator: CandidateGenerator,
    sobol: SobolPoints,
    stream: Sequence,
    round: Vec<Vec<f64>>,
}

impl Bayesian {
    /// Creates the search on coordinates of the given types.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for an option out of range.
    pub fn new(
        coordinates: &[Coordinate],
        seed: u64,
        options: &BayesianOptions,
    ) -> Result<Self, SearchError> {
        let d = coordinate::dimension(coordinates)?;
        options.check_ranges()?;
        check_name(&options.acquisition, &["lcb", "thompson"], NAME, "acquisition", ACQUISITION.words)?;
        let transform = transform(&options.transform, NAME)?;
        let space = TypedSpace::new(coordinates);
        let mut sobol = SobolPoints::new(d, seed);
        let n = options.initial.unwrap_or((2 * (d + 1)).min(20));
        let mut round: Vec<Vec<f64>> = (1..n).map(|_| snapped_point(&mut sobol, &space)).collect();
        round.push(space.center());
        Ok(Self {
            options: options.clone(),
            history: History::default(),
            surrogate: Surrogate::new(space.clone(), transform),
            generator: CandidateGenerator::new(space, seed, 1),
            sobol,
            stream: Sequence::new(seed, 2),
            round,
        })
    }

    fn propose(&mut self) {
        self.surrogate.update(&self.history);
        let n = (CANDIDATES.0 + CANDIDATES.1 * self.options.round_size).min(MAX_CANDIDATES);
        let mut candidates = self.generator.global(&self.history, n, self.options.faces);
        let chosen = if self.options.acquisition == "thompson" {
            thompson(&self.surrogate, &candidates, self.options.round_size, &mut self.stream)
        } else {
            let mut batch = Batch::new(&self.surrogate, &candidates);
            let region = Region::whole(self.surrogate.space().dimension());
            if let Some(batch) = &mut batch {
                for kappa in [self.options.kappa, 0.0] {
                    let all = 0..candidates.len();
                    batch.refine(&self.surrogate, &mut candidates, &self.history, all, &region, kappa);
                }
            }
            let pick = |_| batch.as_mut()?.choose(0..candidates.len(), self.options.kappa);
            (0..self.options.round_size).map_while(pick).collect()
        };
        self.round.extend(chosen.iter().map(|&i| candidates.point(i).to_vec()));
        // Without a model, or if all points of a discrete space are evaluated.
        while self.round.len() < self.options.round_size {
            self.round.push(new_point(&mut self.sobol, self.surrogate.space(), &self.history));
        }
    }
}

impl RoundBased for Bayesian {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let round = mem::take(&mut self.round);
        self.history.extend(&round, values);
        self.propose();
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }

    fn keeps_exploring(&self) -> bool {
        true
    }
}

/// Returns the next Sobol point that is not in `history`; in a discrete space with few points left,
/// any point.
pub(crate) fn new_point(sobol: &mut SobolPoints, space: &TypedSpace, history: &History) -> Vec<f64> {
    const ATTEMPTS: usize = 64;
    let mut point = snapped_point(sobol, space);
    for _ in 0..ATTEMPTS {
        if !history.contains(&point) {
            break;
        }
        point = snapped_point(sobol, space);
    }
    point
}

/// Returns the next Sobol point, with integers and categories at the centers of their levels.
pub(crate) fn snapped_point(sobol: &mut SobolPoints, space: &TypedSpace) -> Vec<f64> {
    let mut point = sobol.next_point();
    space.snap(&mut point);
    point
}

/// Returns the transform with this name.
pub(crate) fn transform(name: &str, search: &'static str) -> Result<Transform, SearchError> {
    Transform::by_name(name).ok_or_else(|| wrong_name(name, search, "transform", Transform::NAMES))
}

fn check_name(
    name: &str,
    allowed: &[&str],
    search: &'static str,
    option: &str,
    expected: &str,
) -> Result<(), SearchError> {
    if allowed.contains(&name) { Ok(()) } else { Err(wrong_name(name, search, option, expected)) }
}

fn wrong_name(name: &str, search: &'static str, option: &str, expected: &str) -> SearchError {
    SearchError::Option {
        search,
        option: option.to_owned(),
        found: format!("{name:?}"),
        expected: expected.to_owned(),
    }
}
