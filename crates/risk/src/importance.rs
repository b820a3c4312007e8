//! Importance sampling with a mixture that was fitted to failures.

use mishandle_evaluation::{Estimate, betting_mean_at};
use mishandle_random::{Seed, Sequence};
use mishandle_stl::is_violated;

use crate::experiment::{Experiment, Stop};
use crate::proposal::{NOMINAL, Proposal, effective_size};
use crate::{CONFIDENCE, Draw};

/// Number of rounds that refine the proposal.
const ROUNDS: u64 = 3;

/// The regions contain the points with weights up to this multiple of the largest weight of a
/// failure in the last round.
const REACH: f64 = 20.0;

/// Importance sampling with fewer equally weighted failures is not an estimate: a draw with a large
/// weight may be missing.
const FEWEST_EFFECTIVE: f64 = 20.0;

/// Largest probability outside of the regions, as a fraction of that inside, with which the regions
/// are an estimate.
const MOST_OUTSIDE: f64 = 0.2;

/// Number of draws that are made at once.
const CHUNK: u64 = 4096;

/// Results of importance sampling.
#[derive(Clone, Debug, PartialEq)]
pub struct Importance {
    /// Number of independent simulations of the estimate.
    pub simulations: u64,
    /// Number of those that fail in the regions.
    pub failures: u64,
    /// Number of simulations that refined the proposal. They are not part of the estimate.
    pub fitting: u64,
    /// Number of components of the proposal.
    pub components: usize,
    /// Number of equally weighted failures with the same precision as all failures, outside of the
    /// regions too.
    pub effective_failures: f64,
    /// Estimate of the probability of failures outside of the regions, from the few draws there. It
    /// has no valid interval.
    pub outside: f64,
    /// Number of failures of Monte Carlo in the regions, and outside of them.
    pub monte_carlo_inside: u64,
    /// See [`monte_carlo_inside`](Self::monte_carlo_inside).
    pub monte_carlo_outside: u64,
    /// Probability of a failure in the regions, with a 95 % interval. The interval holds without an
    /// assumption.
    pub regions: Estimate,
    /// The same with 97.5 %, for sums of two intervals.
    pub(crate) wide: Estimate,
}

impl Importance {
    /// Returns whether enough failures carry the estimate, and few of them are outside of the
    /// regions.
    pub fn is_reliable(&self) -> bool {
        let inside = self.regions.value.unwrap_or(0.0);
        self.effective_failures >= FEWEST_EFFECTIVE && self.outside <= MOST_OUTSIDE * inside
    }
}

/// Fits a mixture to failing draws, refines it with `fitting` simulations, and then estimates the
/// probability of failures where the mixture has draws. This takes the rest of the budget.
///
/// The regions are where the weights of the frozen mixture are at most a bound c. In them, the
/// products of weight and failure are numbers from 0 to c with the mean p, so the betting interval
/// contains p with the stated confidence for every n and whatever the regions are. `failed`: the
/// failures of independent Monte Carlo simulations, which are counted inside and outside. Returns
/// `None` without failures to fit to.
pub(crate) fn importance(
    experiment: &mut Experiment<'_>,
    seed: Seed,
    found: &[Draw],
    fitting: u64,
    failed: &[Draw],
) -> Result<Option<Importance>, Stop> {
    let points: Vec<Vec<f64>> = found.iter().map(|draw| draw.latent.clone()).collect();
    let Some(mut proposal) = Proposal::fit(&points) else { return Ok(None) };
    let before = experiment.done();
    let mut largest = 0.0;
    for round in 0..ROUNDS {
        let draws = fitting / ROUNDS;
        let values = simulate(experiment, &proposal, &mut Sequence::new(seed.0, round), draws)?;
        let mut failures: Vec<(&[f64], f64)> =
            values.iter().flatten().map(|(latent, weight)| (latent.as_slice(), *weight)).collect();
        clip(&mut failures);
        proposal.update(&failures);
        largest = failures.iter().map(|(latent, _)| proposal.weight(latent)).fold(0.0, f64::max);
    }
    let fitting = experiment.done() - before;
    let n = experiment.left();
    let values = simulate(experiment, &proposal, &mut Sequence::new(seed.0, ROUNDS), n)?;
    let all: Vec<f64> =
        values.iter().map(|failure| failure.as_ref().map_or(0.0, |(_, weight)| *weight)).collect();
    let monte_carlo: Vec<f64> = failed.iter().map(|draw| proposal.weight(&draw.latent)).collect();
    Ok(Some(Importance {
        fitting,
        components: proposal.components(),
        ..regions(&all, largest, &monte_carlo)
    }))
}

/// Estimates the probability of failures in the regions: where the weights of a frozen proposal,
/// which are at most 1 / [`NOMINAL`], are not far above `largest`, the largest one of the failures
/// in the last fit. `all` has the weight of each independent draw, 0 without a failure;
/// `monte_carlo` those of the failures of Monte Carlo.
pub(crate) fn regions(all: &[f64], largest: f64, monte_carlo: &[f64]) -> Importance {
    let bound = if largest > 0.0 { (REACH * largest).min(1.0 / NOMINAL) } else { 1.0 / NOMINAL };
    let inside: Vec<f64> = all.iter().map(|weight| if *weight <= bound { *weight } else { 0.0 }).collect();
    let fractions: Vec<f64> = inside.iter().map(|value| value / bound).collect();
    let interval = |confidence| {
        let Estimate { value, low, high, n } = betting_mean_at(&fractions, confidence);
        let scaled = |fraction: Option<f64>| fraction.map(|fraction| fraction * bound);
        Estimate { value: scaled(value), low: scaled(low), high: scaled(high), n }
    };
    let monte_carlo_inside = monte_carlo.iter().filter(|weight| **weight <= bound).count() as u64;
    Importance {
        simulations: all.len() as u64,
        failures: inside.iter().filter(|value| **value > 0.0).count() as u64,
        fitting: 0,
        components: 0,
        effective_failures: effective_size(all.iter().copied()),
        outside: mean(all) - mean(&inside),
        monte_carlo_inside,
        monte_carlo_outside: monte_carlo.len() as u64 - monte_carlo_inside,
        regions: interval(CONFIDENCE),
        wide: interval(0.5 + 0.5 * CONFIDENCE),
    }
}

/// Limits the largest √n of n weights to the least of them. A step from a poor proposal would
/// otherwise follow a single point.
///
/// # Reference
/// Koblents and Míguez, "A population Monte Carlo scheme with transformed weights and its
/// application to stochastic kinetic models", Statistics and Computing 25, 2015.
pub(crate) fn clip<T>(failures: &mut [(T, f64)]) {
    let mut weights: Vec<f64> = failures.iter().map(|(_, weight)| *weight).collect();
    weights.sort_by(|a, b| b.total_cmp(a));
    let limit = weights.get(weights.len().isqrt().saturating_sub(1)).copied().unwrap_or(f64::INFINITY);
    failures.iter_mut().for_each(|(_, weight)| *weight = weight.min(limit));
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Latent point and weight of a failure.
type Failure = (Vec<f64>, f64);

/// Simulates `n` draws of the proposal. Returns for each the latent point and the weight, or `None`
/// if it does not fail.
fn simulate(
    experiment: &mut Experiment<'_>,
    proposal: &Proposal,
    random: &mut Sequence,
    n: u64,
) -> Result<Vec<Option<Failure>>, Stop> {
    let mut values = Vec::with_capacity(n as usize);
    let end = experiment.done() + n;
    while experiment.done() < end {
        let count = CHUNK.min(end - experiment.done());
        let draws: Vec<Draw> = (0..count).map(|_| proposal.draw(experiment.scenarios, random)).collect();
        let robustness = experiment.robustness(&draws)?;
        let failure = |(draw, rho): (Draw, f64)| {
            let weight = proposal.weight(&draw.latent);
            is_violated(rho).then_some((draw.latent, weight))
        };
        values.extend(draws.into_iter().zip(robustness).map(failure));
    }
    Ok(values)
}
