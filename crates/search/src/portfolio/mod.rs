//! The portfolio: corners first, then a Gaussian process in the whole box and in a trust region,
//! beside exploration.

mod corners;
mod polish;
mod restarts;
mod shares;
mod steps;
mod trace;

use std::collections::VecDeque;
use std::mem;

use mishandle_random::Sequence;

use crate::bayesian::{TRANSFORM, new_point, snapped_point, transform};
use crate::gp::acquisition::Batch;
use crate::gp::candidates::{CandidateGenerator, Candidates, Region};
use crate::gp::elementary::normal_tail;
use crate::gp::history::History;
use crate::gp::space::TypedSpace;
use crate::gp::surrogate::Surrogate;
use crate::gp::trust_region::{TrustRegion, is_success};
use crate::options::{ANY, NOT_NEGATIVE, POINTS, options};
use crate::registry::SearchEntry;
use crate::sobol::SobolPoints;
use crate::{AskTell, RoundBased, SearchEnd, SearchError, SearchSpace};
use corners::{RemainingCorners, corners};
use polish::Polish;
use restarts::Restarts;
use shares::{Credits, EXPLORATION, Evidence, N_SOURCES, Source, exploration};
use steps::{SuccessRate, changed_coordinate};
use trace::Trace;

const NAME: &str = "portfolio";

/// Sobol points of the first round: one for three coordinates, within these bounds. Corners and
/// center show the slopes of a few coordinates, so that few other points suffice for a first model.
const SOBOL: (usize, usize) = (2, 8);
/// Numbers of candidates of each kind: a constant, and more per point of a round.
const CANDIDATES: (usize, usize) = (96, 8);
const MAX_CANDIDATES: usize = 192;
/// The share of the trust region among the model's points.
const LOCAL: f64 = 0.5;
/// The share of corners among the points that neither a model nor a step proposes, as long as there
/// are corners.
const CORNERS: f64 = 0.25;
/// The share of the model's points that ripple takes at most.
const RIPPLE: f64 = 0.5;
/// Robustness is flat while more than this share of the points has the lowest value.
const FLAT: f64 = 0.5;
/// The share of corners among the points while robustness is flat.
const FLAT_CORNERS: f64 = 1.0 / 11.0;
/// Without the option, a round has one point for this number of evaluations, at most [`MAX_ROUND`]:
/// a round waits for values that are few beside those that are known.
const EVALUATIONS_PER_POINT: usize = 16;
const MAX_ROUND: usize = 8;
/// A new trust region keeps this distance from the centers of collapsed ones, as a fraction of the
/// diagonal.
const APART: f64 = 0.05;
/// The number of collapsed trust regions that are remembered.
const MAX_EXHAUSTED: usize = 32;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "corners, then a Gaussian process in the box and in a trust region, beside exploration",
    reference: "Desautels, Krause and Burdick, JMLR 15, 2014 (batches). Eriksson et al., \"Scalable global optimization via \
                local Bayesian optimization\", NeurIPS 2019 (trust region).",
    options: PortfolioOptions::specs,
    make: |space, seed, options| {
        let options = PortfolioOptions::read(options)?;
        Ok(Box::new(AskTell::new(Portfolio::new(space, seed, &options)?)))
    },
};

options! {
    /// The options of [`Portfolio`].
    pub struct PortfolioOptions of NAME {
        /// Points per round. The points of a round are chosen together, without each other's
        /// values.
        pub round_size: Option<usize> = None, or "a sixteenth of the evaluations, at most 8", in POINTS;
        /// Evaluates corners of the box: first all for up to 4 coordinates, otherwise 8, and the
        /// others later.
        pub corners: bool = true, in ANY;
        /// Proposes points on exact faces and corners of the box, too.
        pub faces: bool = true, in ANY;
        /// Uses a trust region around the best point for half of the model's points.
        pub trust_region: bool = true, in ANY;
        /// Takes random steps from the best point.
        pub polish: bool = true, in ANY;
        /// Changes single coordinates of the best point.
        pub single_coordinates: bool = true, in ANY;
        /// Tries points where the model is low and the differences from it may decide.
        pub ripple: bool = true, in ANY;
        /// Starts again elsewhere, from evaluation 301 on, with more than ten coordinates while no
        /// lower values are found.
        pub restarts: bool = true, in ANY;
        /// Gives points of the model to the other sources while it is of no use.
        pub exploration: bool = true, in ANY;
        /// Minimizes the lower confidence bound with gradients.
        pub refine: bool = true, in ANY;
        /// Standard deviations that the lower confidence bound is below the mean.
        pub kappa: f64 = 2.0, in NOT_NEGATIVE;
        /// Models the parts of the robustness, each with the coordinates that act before its end.
        pub trace: bool = true, in ANY;
        /// How robustness is transformed for the model: asinh, rank (normal scores) or standard
        /// (mean and variance).
        pub transform: String = "asinh".to_owned(), in TRANSFORM;
    }
}

/// The portfolio search: corners first, then a Gaussian process in the whole box and in a trust
/// region, beside exploration.
///
/// The first round is corners (all 2^d for d ≤ 4, otherwise a balanced sample of 8), the center and
/// 2 to 8 scrambled Sobol points. Each point of a further round comes from one of nine sources, in
/// proportion to their shares. With the share t of the source trace, those of the sources above it
/// are multiplied by 1 - t; with the share u of restarts, all others by 1 - u:
///
/// | source | point | share |
/// |---|---|---|
/// | model, global | lowest confidence bound of the box, its faces, corners and neighborhoods of the best points | (1 - e) / 2 |
/// | model, local | lowest confidence bound in a trust region around the best point | (1 - e) / 2 |
/// | polish | random step from the best point, with the one-fifth rule | e s |
/// | coordinate | the best point with a new value of one coordinate | e s' |
/// | ripple | where the model is low, far from other points | r, taken from the others |
/// | corners | next corner, as long as there are any | e (1 - s - s') / 4 |
/// | Sobol | next Sobol point | the rest of e |
/// | trace | highest probability of a violation, composed of those of the parts | t |
/// | restart | runs of coordinates of the best point of a start elsewhere with one new value each | u |
///
/// - The share e = 0.1 to 0.95 rises when the model is of no use: its leave-one-out predictions do
///   not correlate with the values, or it finds no lower values and believes in a violation less
///   than the number of points without one suggests.
/// - The shares s and s' follow the rates at which these steps find a new lowest value. They are at
///   most 0.9 in total. When a Sobol point or corner finds one, they start again, because the
///   values around it are unknown.
/// - The share t is 0.1 to 0.8: the rate of success of this source, divided by the sum of this rate
///   and that of the others. It is 0 if the space has no [parts](crate::Parts), more than 8, or
///   those of one signal only.
/// - The share u is 0 up to evaluation 300. Then it is (d - 10) / 30, from 0 to 0.8, as far as the
///   search finds no lower values.
///
/// Ripple is the spread of the leave-one-out residuals at the quarter of the points with the lowest
/// predictions. Where it makes a violation more probable than the model alone, the model shows the
/// right region, but not the points in it. Then r replaces corners and Sobol points as far as the
/// model would no longer count as certain with this spread, and up to half of the model's points
/// once they find no lower values. Its point is a random one among the candidates at which a
/// violation is at least a quarter as probable as at the best one, of the half of them that is
/// farther from evaluated points.
///
/// While more than half of the points have the lowest value, robustness is flat: it shows no way to
/// lower values, so all points are Sobol points and, one of eleven, corners.
///
/// So a violation in a small region without a slope towards it is found nearly as fast as by random
/// points.
///
/// The model is a Gaussian process (Matérn-5/2, one length per coordinate) of asinh-transformed
/// robustness. The most promising candidates are moved to local minima of the bound by gradients;
/// within a round, the variance shrinks around chosen points as if they were evaluated. The trust
/// region has the rules of TuRBO-1. When it collapses, a new one starts at the best point that is
/// not near the centers of collapsed ones; the model keeps all evaluations.
///
/// For the source trace, each part has a model of its own, which sees the coordinates that act
/// before the end of the part. Of maxima, probabilities are multiplied, as if the parts were
/// independent; of minima, and of several windows of one signal, one of them counts. So the parts
/// may have units that differ by any factor.
///
/// Values above the 75 % quantile of the earlier ones count as this quantile, so simulations of
/// such points can end early, unless the search models parts.
///
/// Integer coordinates are modeled by the centers of their levels, categories by one feature per
/// level. The search never ends. Beyond a few hundred evaluations it models the best and the
/// latest.
///
/// # Reference
/// Desautels, Krause and Burdick, "Parallelizing exploration-exploitation tradeoffs in Gaussian
/// process bandit optimization", JMLR 15, 2014. Eriksson, Pearce, Gardner, Turner and Poloczek,
/// "Scalable global optimization via local Bayesian optimization", NeurIPS 2019.
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
    /// The rates of success of single coordinates and of the polish.
    step_rates: [SuccessRate; 2],
    /// The number of evaluations after the last improvement.
    since_improvement: usize,
    corners: RemainingCorners,
    trace: Option<Trace>,
    restarts: Restarts,
    generator: CandidateGenerator,
    sobol: SobolPoints,
    stream: Sequence,
    round: Vec<Vec<f64>>,
    /// The source of each point of the round; shorter for the first round.
    sources: Vec<Source>,
}

impl Portfolio {
    /// Creates the search on a space.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for an option out of range.
    pub fn new(facts: &SearchSpace, seed: u64, options: &PortfolioOptions) -> Result<Self, SearchError> {
        let d = facts.dimension()?;
        options.check_ranges()?;
        let transform = transform(&options.transform, NAME)?;
        let space = TypedSpace::new(&facts.coordinates);
        let mut search = Self {
            options: options.clone(),
            history: History::default(),
            surrogate: Surrogate::new(space.clone(), transform),
            region: TrustRegion::new(d),
            exhausted: VecDeque::new(),
            polish: Polish::new(),
            credits: Credits::default(),
            step_rates: [SuccessRate::default(); 2],
            since_improvement: 0,
            corners: RemainingCorners::new(&facts.coordinates, seed),
            trace: if options.trace { Trace::new(facts, seed) } else { None },
            restarts: Restarts::new(seed),
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
        search.round.extend(
            (0..d.div_ceil(3).clamp(SOBOL.0, SOBOL.1)).map(|_| snapped_point(&mut search.sobol, &space)),
        );
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
                    let range = range.clone();
                    batch.refine(&self.surrogate, &mut candidates, &self.history, range, region, kappa);
                }
            }
        }
        let level = self.surrogate.level();
        let ripple = if self.options.ripple { self.surrogate.ripple() } else { 0.0 };
        let distances =
            [0.0, ripple].map(|ripple| batch.as_ref().map_or(0.0, |batch| batch.distance(level, ripple)));
        for source in self.credits.divide(self.round_size(), &self.shares(distances)) {
            let kappa = self.options.kappa;
            let chosen = batch.as_mut().and_then(|batch| match source {
                Source::Global => batch.choose(0..n_global, kappa),
                Source::Local => batch.choose(n_global..candidates.len(), kappa),
                Source::Ripple => {
                    batch.choose_by_ripple(&candidates, &self.history, level, ripple, &mut self.stream)
                }
                _ => None,
            });
            let proposed = match &mut self.trace {
                Some(trace) if source == Source::Trace => trace.propose(&self.history, &self.round),
                _ => chosen.map(|i| candidates.point(i).to_vec()),
            };
            self.add(source, proposed);
        }
    }

    /// Covers the box, without the model and without steps from the best point.
    fn cover(&mut self) {
        let corner = if self.options.corners && !self.corners.is_empty() { FLAT_CORNERS } else { 0.0 };
        let mut shares = [0.0; N_SOURCES];
        (shares[Source::Sobol as usize], shares[Source::Corner as usize]) = (1.0 - corner, corner);
        for source in self.credits.divide(self.round_size(), &shares) {
            self.add(source, None);
        }
    }

    /// Adds `chosen` to the round, otherwise a point of a source that needs no model.
    fn add(&mut self, source: Source, chosen: Option<Vec<f64>>) {
        // A Sobol point also without a model, and if all candidates in a discrete space are
        // evaluated.
        let (source, point) = chosen.or_else(|| self.without_model(source)).map_or_else(
            || (Source::Sobol, new_point(&mut self.sobol, self.surrogate.space(), &self.history)),
            |point| (source, point),
        );
        self.sources.push(source);
        self.round.push(point);
    }

    fn n_evaluations(&self) -> usize {
        self.history.n_dropped() + self.history.len()
    }

    fn round_size(&self) -> usize {
        self.options.round_size.unwrap_or((self.n_evaluations() / EVALUATIONS_PER_POINT).clamp(1, MAX_ROUND))
    }

    /// Returns a point of a source that needs no model. `None` if it leads to an evaluated point,
    /// or for other sources.
    fn without_model(&mut self, source: Source) -> Option<Vec<f64>> {
        let best = &self.history.points()[self.history.by_value()[0]];
        let space = self.surrogate.space();
        let point = match source {
            Source::Corner => self.corners.next(space, &self.history)?,
            Source::Coordinate => changed_coordinate(best, space, &mut self.stream),
            Source::Polish => self.polish.propose(best, space, &mut self.stream),
            Source::Restart => self.restarts.propose(space),
            Source::Sobol | Source::Ripple | Source::Global | Source::Local | Source::Trace => {
                return None;
            }
        };
        Some(point).filter(|point| !self.history.contains(point))
    }

    /// Returns candidates of the whole box, followed by those of the trust region, and the number
    /// of the former.
    fn candidates(&mut self, region: &Region) -> (Candidates, usize) {
        let n = (CANDIDATES.0 + CANDIDATES.1 * self.round_size()).min(MAX_CANDIDATES);
        let mut candidates = self.generator.global(&self.history, n, self.options.faces);
        let n_global = candidates.len();
        if self.options.trust_region {
            candidates.append(self.generator.local(&self.history, region, n));
        }
        (candidates, n_global)
    }

    /// Returns the shares of the sources, given the distances of the most promising candidates from
    /// a violation, without and with ripple.
    fn shares(&self, distances: [f64; 2]) -> [f64; N_SOURCES] {
        let evidence = distances.map(|distance| Evidence {
            rank_correlation: self.surrogate.rank_correlation(),
            distance,
            n: self.history.len(),
            since_improvement: self.since_improvement,
            dimension: self.surrogate.space().dimension(),
        });
        let [free, covered] = evidence
            .map(|evidence| if self.options.exploration { exploration(evidence) } else { EXPLORATION.0 });
        let local = if self.options.trust_region { LOCAL } else { 0.0 };
        let [coordinate, polish] = steps::shares(self.step_rates);
        let coordinate = if self.options.single_coordinates { coordinate } else { 0.0 };
        let polish = if self.options.polish { polish } else { 0.0 };
        let others = 1.0 - coordinate - polish;
        let covering = others * (covered / free).min(1.0);
        let corner = if self.options.corners && !self.corners.is_empty() { CORNERS * covering } else { 0.0 };
        let sources = [covering - corner, corner, coordinate, polish, others - covering];
        let [sobol, corner, coordinate, polish, ripple] = sources.map(|share| free * share);
        let [without, with] = distances.map(normal_tail);
        let more_probable = (1.0 - without / with.max(f64::MIN_POSITIVE)).max(0.0);
        let of_model = RIPPLE * evidence[0].stalled() * more_probable * (1.0 - free);
        let model = 1.0 - free - of_model;
        let ripple = ripple + of_model;
        let trace = self.trace.as_ref().map_or(0.0, Trace::share);
        let global = model * (1.0 - local);
        let local = model * local;
        let [sobol, corner, coordinate, polish, ripple, global, local] =
            [sobol, corner, coordinate, polish, ripple, global, local].map(|share| (1.0 - trace) * share);
        let restart = if self.options.restarts {
            Restarts::share(self.n_evaluations(), evidence[0].dimension, evidence[0].stalled())
        } else {
            0.0
        };
        let others = [sobol, corner, coordinate, polish, ripple, global, local, trace];
        let [sobol, corner, coordinate, polish, ripple, global, local, trace] =
            others.map(|share| (1.0 - restart) * share);
        [sobol, corner, coordinate, polish, ripple, global, local, trace, restart]
    }

    /// Returns the index of the best point that is not near a collapsed trust region; of the best
    /// point if all are near one.
    fn center(&self) -> usize {
        let order = self.history.by_value();
        let apart = APART * (self.surrogate.space().dimension() as f64).sqrt();
        let is_near = |i: usize| {
            let point = &self.history.points()[i];
            self.exhausted.iter().any(|center| distance(point, center) < apart)
        };
        order.iter().copied().find(|&i| !is_near(i)).unwrap_or(order[0])
    }

    /// Adapts shares, steps and trust region to the values of a round.
    fn adapt(&mut self, round: &[Vec<f64>], values: &[f64]) {
        let mut best = self.history.values()[self.history.by_value()[0]];
        let mut lowest = f64::INFINITY;
        let mut n_local = 0;
        let sources = mem::take(&mut self.sources);
        for ((source, point), &value) in sources.into_iter().zip(round).zip(values) {
            let is_success = is_success(value, best);
            best = best.min(value);
            if let Some(trace) = self.trace.as_mut().filter(|_| source != Source::Restart) {
                trace.adapt(source == Source::Trace, is_success);
            }
            self.since_improvement = if is_success { 0 } else { self.since_improvement + 1 };
            match source {
                Source::Sobol | Source::Corner if is_success => {
                    self.step_rates = [SuccessRate::default(); 2];
                    self.polish = Polish::new();
                }
                Source::Coordinate => self.step_rates[0].receive(is_success),
                Source::Polish => {
                    self.step_rates[1].receive(is_success);
                    self.polish.receive(is_success);
                }
                Source::Restart => self.restarts.receive(point, value),
                Source::Local => (lowest, n_local) = (value.min(lowest), n_local + 1),
                Source::Sobol | Source::Corner | Source::Ripple | Source::Global | Source::Trace => (),
            }
        }
        if n_local > 0 {
            self.region.receive(lowest, n_local);
        }
        if self.region.has_collapsed() {
            let center = self.center();
            self.exhausted.push_back(self.history.points()[center].clone());
            if self.exhausted.len() > MAX_EXHAUSTED {
                self.exhausted.pop_front();
            }
            self.region = TrustRegion::new(self.surrogate.space().dimension());
        }
    }
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
        let values = self.history.capped(values);
        if self.history.len() > 0 {
            self.adapt(&round, &values);
        } else {
            let best = (0..values.len()).min_by(|&i, &j| values[i].total_cmp(&values[j])).unwrap_or_default();
            self.since_improvement = values.len() - 1 - best;
        }
        if let Some(trace) = &mut self.trace {
            trace.extend(&round);
        }
        self.history.extend(&round, &values);
        let center = self.center();
        self.region.set_best(self.history.values()[center]);
        let is_flat = self.history.share_of_lowest() > FLAT;
        if is_flat && self.options.exploration { self.cover() } else { self.propose() }
    }

    fn needs_parts(&self) -> bool {
        self.trace.is_some()
    }

    fn receive_parts(&mut self, parts: Vec<Vec<f64>>) {
        if let Some(trace) = &mut self.trace {
            trace.receive_parts(parts);
        }
    }

    fn stop_threshold(&self, _i: usize) -> f64 {
        // A simulation that ends early may have no parts.
        if self.trace.is_some() { f64::INFINITY } else { self.history.cap() }
    }

    fn finished(&self) -> Option<SearchEnd> {
        None
    }

    fn keeps_exploring(&self) -> bool {
        true
    }
}
