//! The whole estimation: which simulations are run, and in which order.

use std::ops::ControlFlow;

use mishandle_random::{Seed, Sequence};
use mishandle_rollout::System;

use crate::experiment::{Experiment, Failure, Stop};
use crate::explore::explore;
use crate::importance::{Importance, importance};
use crate::method::Shares;
use crate::sequence::{check_steerable, sequence};
use crate::splitting::{self, Splitting, split};
use crate::{Answer, Draw, Method, MonteCarlo, Refusal, RiskError, Scenarios};

/// Monte Carlo alone answers if its part of the budget has this many failures. The other
/// simulations are then Monte Carlo, too.
pub const FREQUENT: u64 = 20;

/// Largest number of failures in a report, and their smallest distance in the latent space.
pub(crate) const SHOWN: (usize, f64) = (3, 1.0);

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
    /// The method.
    pub method: Method,
    /// The answer.
    pub answer: Answer,
    /// The plain Monte Carlo part.
    pub monte_carlo: MonteCarlo,
    /// Number of simulations that searched for failures and sampled around them.
    pub exploration: u64,
    /// The multilevel splitting part; `None` if it was not needed or its budget is too small.
    pub splitting: Option<Splitting>,
    /// The importance sampling part; `None` if it was not needed, has no budget, or no failure was
    /// found before.
    pub importance: Option<Importance>,
    /// Up to three failures, those nearest to the center of the distribution first.
    pub failures: Vec<Failure>,
    /// Number of all simulations.
    pub simulations: u64,
    /// Whether it was not interrupted.
    pub is_complete: bool,
}

/// Estimates the probability that a simulation violates the requirement, under a distribution of
/// scenarios.
///
/// The sample is a scenario and a seed, so the noise of the simulation is part of the probability.
/// The probability is that among valid scenarios: a simulation that the target cannot start leaves
/// numerator and denominator. Importance sampling and splitting weigh all scenarios, so they give
/// no estimate if the target cannot start from a scenario of Monte Carlo. Another simulation
/// without a verdict counts as passed, and is counted apart.
///
/// 1. Plain Monte Carlo. If it has [`FREQUENT`] failures, all other simulations are Monte Carlo,
///    too.
/// 2. Searches for failures, and samples around them.
/// 3. Adaptive multilevel splitting with independent chains.
/// 4. Importance sampling with a mixture that is fitted to the failures of 2 and 3, but not to
///    those of 1, which test it.
///
/// [`Method::Sequence`] has, after 1, importance sampling with a proposal that chooses disturbances
/// of actions from what it sees while the simulation runs.
///
/// Simulations that a part does not spend go to the later ones, and to Monte Carlo if no failure
/// was found. The number of simulations is exactly that of the settings. `watch` gets it after each
/// batch, and can interrupt the estimation. Then the answer is that of the finished parts and of
/// the simulations of Monte Carlo so far, and a part that is not finished is lost.
///
/// # Errors
/// If a simulation cannot be run.
pub fn risk(
    system: &mut dyn System,
    scenarios: &Scenarios,
    settings: &Settings,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Report, RiskError> {
    let mut experiment = Experiment::new(system, scenarios, settings.simulations, settings.batch, &mut watch);
    let mut parts = Parts::default();
    let is_complete = match parts.run(&mut experiment, settings) {
        Ok(()) => true,
        Err(Stop::Interrupted) => false,
        Err(Stop::Error(error)) => return Err(error),
    };
    let Parts { monte_carlo, exploration, splitting, splitting_refusal, importance } = parts;
    let mut answer = Answer::new(&monte_carlo, splitting.as_ref(), importance.as_ref());
    // A larger budget is the cure for chains that are missing, small, or disagree.
    if let None | Some(Refusal::Chains(_)) = answer.splitting_refusal {
        answer.splitting_refusal = splitting_refusal.or(answer.splitting_refusal);
    }
    Ok(Report {
        method: settings.method,
        answer,
        monte_carlo,
        exploration,
        splitting,
        importance,
        simulations: experiment.done(),
        failures: experiment.distinct_failures(SHOWN.0, SHOWN.1),
        is_complete,
    })
}

/// Results of the parts.
#[derive(Default)]
struct Parts {
    monte_carlo: MonteCarlo,
    exploration: u64,
    splitting: Option<Splitting>,
    splitting_refusal: Option<Refusal>,
    importance: Option<Importance>,
}

impl Parts {
    fn run(&mut self, experiment: &mut Experiment<'_>, settings: &Settings) -> Result<(), Stop> {
        let Settings { simulations, method, seed, .. } = *settings;
        let of = |share: f64| (share * simulations as f64) as u64;
        if method == Method::Sequence {
            check_steerable(experiment.steerable().as_ref(), experiment.scenarios)?;
        }
        // Without axes there is nothing to search or to move.
        let is_fixed = experiment.scenarios.dimension() == 0;
        let shares = if is_fixed { Method::MonteCarlo.shares() } else { method.shares() };
        let mut random = Sequence::new(seed.child(0).0, 0);
        self.monte_carlo.run(experiment, &mut random, of(shares.monte_carlo))?;
        if !self.monte_carlo.decide() {
            let fitting = of(shares.fitting);
            let failed = self.monte_carlo.failed.clone();
            if method == Method::Sequence {
                self.importance = sequence(experiment, seed.child(4), fitting, &failed)?;
            } else {
                let found = self.search(experiment, settings, &shares)?;
                if shares.importance > 0.0 {
                    self.importance = importance(experiment, seed.child(3), &found, fitting, &failed)?;
                }
            }
        }
        if self.importance.is_none() {
            let left = experiment.left();
            self.monte_carlo.run(experiment, &mut random, left)?;
        }
        Ok(())
    }

    /// Searches for failures, and splits.
    fn search(
        &mut self,
        experiment: &mut Experiment<'_>,
        settings: &Settings,
        shares: &Shares,
    ) -> Result<Vec<Draw>, Stop> {
        let Settings { simulations, seed, .. } = *settings;
        let of = |share: f64| (share * simulations as f64) as u64;
        let before = experiment.done();
        let found = explore(experiment, seed.child(1), of(shares.exploration));
        self.exploration = experiment.done() - before;
        let mut found = found?;
        if of(shares.splitting) >= splitting::FEWEST {
            let (result, failing) = split(experiment, seed.child(2), of(shares.splitting))?;
            self.splitting = Some(result);
            found.extend(failing);
        }
        if shares.splitting > 0.0 && of(shares.splitting) < splitting::FEWEST_FOR_ESTIMATE {
            let needed = (splitting::FEWEST_FOR_ESTIMATE as f64 / shares.splitting).ceil() as u64;
            self.splitting_refusal = Some(Refusal::Budget { simulations: of(shares.splitting), needed });
        }
        Ok(found)
    }
}
