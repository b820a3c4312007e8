//! Importance sampling with a mixture that was fitted to failures.

use mishandle_evaluation::{Estimate, betting_mean_at};
use mishandle_random::{Seed, Sequence};

use crate::experiment::Experiment;
use crate::proposal::{NOMINAL, Proposal, effective_size};
use crate::{CONFIDENCE, Draw, RiskError};

/// Number of rounds that refine the proposal.
const ROUNDS: u64 = 3;

/// The regions contain the points with weights up to this multiple of the largest weight of a failure in the last round.
const REACH: f64 = 4.0;

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
    /// Number of equally weighted failures with the same precision.
    pub effective_failures: f64,
    /// Number of failures of Monte Carlo in the regions, and outside of them.
    pub monte_carlo_inside: u64,
    /// See [`monte_carlo_inside`](Self::monte_carlo_inside).
    pub monte_carlo_outside: u64,
    /// Probability of a failure in the regions, with a 95 % interval. The interval holds without an assumption.
    pub regions: Estimate,
    /// The same with 97.5 %, for sums of two intervals.
    pub(crate) wide: Estimate,
}

/// Fits a mixture to failing draws, refines it with `fitting` simulations, and then estimates the probability of failures where the mixture
/// has draws. This takes the rest of the budget.
///
/// The regions are where the weights of the frozen mixture are at most a bound c. In them, the products of weight and failure are numbers
/// from 0 to c with the mean p, so the betting interval contains p with the stated confidence for every n and whatever the regions are.
/// `failed`: the failures of independent Monte Carlo simulations, which are counted inside and outside. Returns `None` without failures to
/// fit to.
pub(crate) fn importance(
    experiment: &mut Experiment<'_>,
    seed: Seed,
    found: &[Draw],
    fitting: u64,
    failed: &[Draw],
) -> Result<Option<Importance>, RiskError> {
    let points: Vec<Vec<f64>> = found.iter().map(|draw| draw.latent.clone()).collect();
    let Some(mut proposal) = Proposal::fit(&points) else { return Ok(None) };
    let before = experiment.done();
    let mut largest = 0.0;
    for round in 0..ROUNDS {
        let draws = fitting / ROUNDS;
        let values = simulate(experiment, &proposal, &mut Sequence::new(seed.0, round), draws)?;
        let failures: Vec<(&[f64], f64)> =
            values.iter().flatten().map(|(latent, weight)| (latent.as_slice(), *weight)).collect();
        proposal.update(&failures);
        largest = failures.iter().map(|(latent, _)| proposal.weight(latent)).fold(0.0, f64::max);
    }
    let fitting = experiment.done() - before;
    let bound = if largest > 0.0 { (REACH * largest).min(1.0 / NOMINAL) } else { 1.0 / NOMINAL };
    let n = experiment.left();
    let values = simulate(experiment, &proposal, &mut Sequence::new(seed.0, ROUNDS), n)?;
    let value = |failure: &Option<(Vec<f64>, f64)>| match failure {
        Some((_, weight)) if *weight <= bound => *weight,
        _ => 0.0,
    };
    let values: Vec<f64> = values.iter().map(value).collect();
    let count = values.iter().filter(|value| **value > 0.0).count() as u64;
    let effective = effective_size(values.iter().copied());
    let fractions: Vec<f64> = values.iter().map(|value| value / bound).collect();
    let interval = |confidence| {
        let Estimate { value, low, high, n } = betting_mean_at(&fractions, confidence);
        let scaled = |fraction: Option<f64>| fraction.map(|fraction| fraction * bound);
        Estimate { value: scaled(value), low: scaled(low), high: scaled(high), n }
    };
    let inside = failed.iter().filter(|draw| proposal.weight(&draw.latent) <= bound).count() as u64;
    Ok(Some(Importance {
        simulations: n,
        failures: count,
        fitting,
        components: proposal.components(),
        effective_failures: effective,
        monte_carlo_inside: inside,
        monte_carlo_outside: failed.len() as u64 - inside,
        regions: interval(CONFIDENCE),
        wide: interval(0.5 + 0.5 * CONFIDENCE),
    }))
}

/// Simulates `n` draws of the proposal. Returns for each the latent point and the weight, or `None` if it does not fail.
fn simulate(
    experiment: &mut Experiment<'_>,
    proposal: &Proposal,
    random: &mut Sequence,
    n: u64,
) -> Result<Vec<Option<(Vec<f64>, f64)>>, RiskError> {
    let mut values = Vec::with_capacity(n as usize);
    let end = experiment.done() + n;
    while experiment.done() < end {
        let count = CHUNK.min(end - experiment.done());
        let draws: Vec<Draw> = (0..count).map(|_| proposal.draw(experiment.scenarios, random)).collect();
        let robustness = experiment.robustness(&draws)?;
        let failure = |(draw, rho): (Draw, f64)| {
            let weight = proposal.weight(&draw.latent);
            (rho < 0.0).then_some((draw.latent, weight))
        };
        values.extend(draws.into_iter().zip(robustness).map(failure));
    }
    Ok(values)
}
