//! The whole estimation: which simulations are run, and in which order.

use mishandle_random::{Seed, Sequence};
use mishandle_rollout::System;

use crate::experiment::{Experiment, Failure};
use crate::explore::explore;
use crate::importance::{Importance, importance};
use crate::splitting::{self, Splitting, split};
use crate::{Answer, Method, MonteCarlo, RiskError, Scenarios};

/// Monte Carlo alone answers if its part of the budget has this many failures. The other simulations are then Monte Carlo, too.
pub const FREQUENT: u64 = 20;

/// Largest number of failures in a report, and their smallest distance in the latent space.
const SHOWN: (usize, f64) = (3, 1.0);

/// Settings of an estimation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Number of simulations.
    pub simulations: u64,
    /// The parts of the estimation.
    pub method: Method,
    /// Random seed.
    pub seed: Seed,
    /// Number of simulations per batch; does not affect the results.
    pub batch: usize,
}

/// Results of an estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The answer.
    pub answer: Answer,
    /// The plain Monte Carlo part.
    pub monte_carlo: MonteCarlo,
    /// Number of simulations that searched for failures and sampled around them.
    pub exploration: u64,
    /// The multilevel splitting part; `None` if it was not needed or its budget is too small.
    pub splitting: Option<Splitting>,
    /// The importance sampling part; `None` if it was not needed, has no budget, or no failure was found before.
    pub importance: Option<Importance>,
    /// Up to three failures, those nearest to the center of the distribution first.
    pub failures: Vec<Failure>,
    /// Number of all simulations.
    pub simulations: u64,
}

/// Estimates the probability that a simulation violates the requirement, under a distribution of scenarios.
///
/// The sample is a scenario and a seed, so the noise of the simulation is part of the probability. A simulation without a verdict counts as
/// passed, and is counted apart.
///
/// 1. Plain Monte Carlo. If it has [`FREQUENT`] failures, all other simulations are Monte Carlo, too.
/// 2. Searches for failures, and samples around them.
/// 3. Adaptive multilevel splitting with independent chains.
/// 4. Importance sampling with a mixture that is fitted to the failures of 2 and 3, but not to those of 1, which test it.
///
/// What a part does not spend goes to the later ones, and to Monte Carlo if no failure was found. The number of simulations is exactly that of
/// the settings. `watch` gets it after each batch.
///
/// # Errors
/// If a simulation cannot be run.
pub fn risk(
    system: &mut dyn System,
    scenarios: &Scenarios,
    settings: &Settings,
    mut watch: impl FnMut(u64),
) -> Result<Report, RiskError> {
    let Settings { simulations, method, seed, batch } = *settings;
    let mut experiment = Experiment::new(system, scenarios, (simulations, batch), &mut watch);
    let of = |share: f64| (share * simulations as f64) as u64;
    // Without axes there is nothing to search or to move.
    let shares = if scenarios.dimension() == 0 { Method::MonteCarlo.shares() } else { method.shares() };
    let mut random = Sequence::new(seed.child(0).0, 0);
    let mut monte_carlo = MonteCarlo::default();
    monte_carlo.run(&mut experiment, &mut random, of(shares.monte_carlo))?;
    let (mut exploration, mut splitting, mut weighted) = (0, None, None);
    if monte_carlo.failures < FREQUENT {
        let before = experiment.done();
        let mut found = explore(&mut experiment, seed.child(1), of(shares.exploration))?;
        exploration = experiment.done() - before;
        if of(shares.splitting) >= splitting::FEWEST {
            let (result, failing) = split(&mut experiment, seed.child(2), of(shares.splitting))?;
            splitting = Some(result);
            found.extend(failing);
        }
        if shares.importance > 0.0 {
            let fitting = of(shares.fitting);
            weighted = importance(&mut experiment, seed.child(3), &found, fitting, &monte_carlo.failed)?;
        }
    }
    let left = experiment.left();
    if weighted.is_none() {
        monte_carlo.run(&mut experiment, &mut random, left)?;
    }
    Ok(Report {
        answer: Answer::new(&monte_carlo, splitting.as_ref(), weighted.as_ref()),
        monte_carlo,
        exploration,
        splitting,
        importance: weighted,
        simulations: experiment.done(),
        failures: experiment.distinct_failures(SHOWN.0, SHOWN.1),
    })
}
