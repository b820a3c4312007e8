//! Outcomes of trials and falsifications.

use mishandle_evaluation::{Estimate, bound_without_failures, rate};
use mishandle_rollout::{Episode, EpisodeEnd, Scenario, Seed};
use mishandle_stl::is_violated;

use crate::TrialEnd;

/// The simulation of a trial with the minimum robustness, the earliest of equals. It is a
/// counterexample if the trial was falsified.
#[derive(Clone, Debug, PartialEq)]
pub struct Minimum {
    /// Robustness.
    pub robustness: f64,
    /// Scenario.
    pub scenario: Scenario,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// Number of the simulation in the trial, from 1.
    pub number: u32,
}

/// A simulation without a verdict, because it failed, or the formula, the controller or the
/// environment returned a value that is not finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Unevaluated {
    /// Number of the simulation in the trial, from 1.
    pub number: u32,
    /// Scenario.
    pub scenario: Scenario,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// End of the simulation: undefined, invalid or failed.
    pub end: EpisodeEnd,
}

/// Outcome of a trial so far.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialOutcome {
    /// Number of the trial, from 1.
    pub trial: u32,
    /// Random seed of the trial.
    pub seed: Seed,
    /// How the trial ended; `None` if it was interrupted.
    pub end: Option<TrialEnd>,
    /// Number of simulations. The falsifying one is the last, unless the trial keeps going.
    pub simulations: u32,
    /// Number of these that only another physics engine ran: see
    /// [`Falsification::run_screened`](crate::Falsification::run_screened). They decide where the
    /// search looks, and nothing else.
    pub screened: u32,
    /// Number of control steps of all other simulations.
    pub control_steps: u64,
    /// Number of the first simulation with a robustness below 0.
    pub first_violation: Option<u32>,
    /// Number of diverged simulations.
    pub diverged: u32,
    /// Number of simulations that ended because the controller or the environment returned a value
    /// that is not finite.
    pub invalid: u32,
    /// Number of simulations that could not start or failed: crash, invalid answer or time limit.
    pub failed: u32,
    /// Number of other simulations that left the formula undecided.
    pub undecided: u32,
    /// Number of undecided simulations without a finite value of the formula.
    pub undefined: u32,
    /// First undefined, invalid or failed simulation.
    pub first_unevaluated: Option<Unevaluated>,
    /// Simulation with the minimum robustness; `None` if no simulation has a robustness.
    pub minimum: Option<Minimum>,
}

impl TrialOutcome {
    /// Makes the outcome of a trial without simulations.
    pub fn new(trial: u32, seed: Seed) -> TrialOutcome {
        TrialOutcome {
            trial,
            seed,
            end: None,
            simulations: 0,
            screened: 0,
            control_steps: 0,
            first_violation: None,
            diverged: 0,
            invalid: 0,
            failed: 0,
            undecided: 0,
            undefined: 0,
            first_unevaluated: None,
            minimum: None,
        }
    }

    /// Returns whether the trial found a violation.
    pub fn falsified(&self) -> bool {
        self.first_violation.is_some()
    }

    /// Adds a simulation that only another physics engine ran.
    pub(crate) fn add_screened(&mut self) {
        self.simulations += 1;
        self.screened += 1;
    }

    /// Adds a simulation.
    pub fn add(&mut self, episode: &Episode) {
        self.simulations += 1;
        self.control_steps += episode.steps as u64;
        let request = &episode.request;
        let number = request.number;
        let seed = request.seed;
        match episode.robustness() {
            Some(robustness) => {
                if is_violated(robustness) {
                    self.first_violation.get_or_insert(number);
                }
                if self
                    .minimum
                    .as_ref()
                    .is_none_or(|minimum| robustness.total_cmp(&minimum.robustness).is_lt())
                {
                    let scenario = request.scenario.clone();
                    self.minimum = Some(Minimum { robustness, scenario, seed, number });
                }
            }
            None => match episode.end {
                EpisodeEnd::Diverged { .. } => self.diverged += 1,
                end if end.is_invalid() => self.invalid += 1,
                end if end.is_failed() => self.failed += 1,
                end => {
                    self.undecided += 1;
                    self.undefined += u32::from(matches!(end, EpisodeEnd::Undefined { .. }));
                }
            },
        }
        let end = episode.end;
        if matches!(end, EpisodeEnd::Undefined { .. }) || end.is_invalid() || end.is_failed() {
            self.first_unevaluated.get_or_insert_with(|| {
                let scenario = request.scenario.clone();
                Unevaluated { number, scenario, seed, end }
            });
        }
    }
}

/// Outcome of a falsification so far.
#[derive(Clone, Debug, PartialEq)]
pub struct FalsificationOutcome {
    /// Outcomes of the started trials, in order.
    pub trials: Vec<TrialOutcome>,
    /// Number of falsified trials.
    pub falsified_trials: u32,
    /// Falsification rate: fraction of falsified trials among the ended trials, with its Wilson
    /// interval; no value if no simulation has a verdict.
    pub falsification_rate: Estimate,
    /// Mean number of simulations over the falsified trials; `None` without falsified trials. It
    /// does not depend on the number of trials without a violation, unlike the median and the
    /// restricted mean.
    pub mean_simulations: Option<f64>,
    /// Median number of simulations to the first violation: the smallest number by which at least
    /// half of the trials have found one. `None` if fewer than half did, or if a trial was
    /// interrupted.
    pub median_simulations: Option<u32>,
    /// Restricted mean number of simulations to the first violation: a trial without one counts as
    /// the whole budget, also if its search ended by its own criterion. `None` if a trial was
    /// interrupted.
    pub restricted_mean_simulations: Option<f64>,
    /// Number of simulations of all trials.
    pub simulations: u64,
    /// Number of these that only another physics engine ran.
    pub screened: u64,
    /// Number of control steps of all other simulations.
    pub control_steps: u64,
    /// Number of diverged simulations.
    pub diverged: u64,
    /// Number of simulations that ended because the controller or the environment returned a value
    /// that is not finite.
    pub invalid: u64,
    /// Number of simulations that could not start or failed: crash, invalid answer or time limit.
    pub failed: u64,
    /// Number of other simulations that left the formula undecided.
    pub undecided: u64,
    /// Number of undecided simulations without a finite value of the formula.
    pub undefined: u64,
    /// Number of surplus simulations, which belong to no trial: in their batch they follow the end
    /// of their trial or its search.
    pub surplus: u64,
    /// Whether the caller ended simulations of its own that follow the trials.
    pub is_interrupted: bool,
}

impl FalsificationOutcome {
    /// Returns the [`bound_without_failures`] of the failure rate. It holds if the simulations are
    /// independent random samples. `None` with a failure, with a simulation without a verdict or
    /// one that only another physics engine ran, or if a trial was interrupted.
    pub fn failure_rate_bound(&self) -> Option<f64> {
        let without_verdict = self.screened + self.diverged + self.invalid + self.failed + self.undecided;
        let is_complete = self.trials.iter().all(|trial| trial.end.is_some());
        let applies =
            self.falsified_trials == 0 && without_verdict == 0 && is_complete && self.simulations > 0;
        applies.then(|| bound_without_failures(self.simulations))
    }

    /// Summarizes trials with this budget.
    pub fn new(trials: Vec<TrialOutcome>, budget: u32) -> FalsificationOutcome {
        let ended = trials.iter().filter(|trial| trial.end.is_some()).count() as u64;
        let total =
            |count: fn(&TrialOutcome) -> u32| trials.iter().map(|trial| u64::from(count(trial))).sum();
        // A trial that keeps going is interrupted after its first violation; it does not count
        // before it ends.
        let falsified = || trials.iter().filter(|trial| trial.end.is_some() && trial.falsified());
        let falsified_trials = falsified().count() as u32;
        let is_tested = |trial: &&TrialOutcome| {
            trial.simulations > trial.diverged + trial.invalid + trial.failed + trial.undecided
        };
        let tested = trials.iter().filter(is_tested).count() as u64;
        let spent: u64 = falsified().filter_map(|trial| trial.first_violation).map(u64::from).sum();
        let is_complete = !trials.is_empty() && ended == trials.len() as u64;
        let unfalsified = trials.len() as u64 - u64::from(falsified_trials);
        let total_with_budget = spent + unfalsified * u64::from(budget);
        FalsificationOutcome {
            falsified_trials,
            falsification_rate: rate(falsified_trials.into(), tested, ended),
            mean_simulations: (falsified_trials > 0).then(|| spent as f64 / f64::from(falsified_trials)),
            median_simulations: is_complete
                .then(|| median(falsified().filter_map(|trial| trial.first_violation), trials.len()))
                .flatten(),
            restricted_mean_simulations: is_complete.then(|| total_with_budget as f64 / trials.len() as f64),
            simulations: total(|trial| trial.simulations),
            screened: total(|trial| trial.screened),
            control_steps: trials.iter().map(|trial| trial.control_steps).sum(),
            diverged: total(|trial| trial.diverged),
            invalid: total(|trial| trial.invalid),
            failed: total(|trial| trial.failed),
            undecided: total(|trial| trial.undecided),
            undefined: total(|trial| trial.undefined),
            surplus: 0,
            is_interrupted: false,
            trials,
        }
    }
}

/// Returns the smallest number of simulations by which at least half of `trials` trials are
/// falsified.
///
/// `simulations` contains the numbers of the falsified trials. The function counts trials, because
/// a Kaplan-Meier product of fractions has rounding errors at one half.
fn median(simulations: impl Iterator<Item = u32>, trials: usize) -> Option<u32> {
    let mut simulations: Vec<u32> = simulations.collect();
    simulations.sort_unstable();
    simulations.get(trials.div_ceil(2) - 1).copied()
}

#[cfg(test)]
mod tests {
    use mishandle_search::SearchEnd;

    use super::*;

    fn trial(simulations: u32, end: Option<TrialEnd>) -> TrialOutcome {
        let first_violation = (end == Some(TrialEnd::Falsified)).then_some(simulations);
        TrialOutcome {
            end,
            simulations,
            first_violation,
            diverged: 1,
            undecided: 2,
            ..TrialOutcome::new(1, Seed(0))
        }
    }

    #[test]
    fn an_outcome_matches_a_hand_calculation() {
        let outcome = FalsificationOutcome::new(
            vec![
                trial(20, Some(TrialEnd::Falsified)),
                trial(40, Some(TrialEnd::Falsified)),
                trial(300, Some(TrialEnd::BudgetSpent)),
                trial(100, Some(TrialEnd::SearchEnded(SearchEnd::Converged))),
            ],
            300,
        );
        assert_eq!(outcome.falsified_trials, 2);
        assert_eq!((outcome.falsification_rate.value, outcome.falsification_rate.n), (Some(0.5), 4));
        assert_eq!(outcome.mean_simulations, Some(30.0));
        // Half of the trials are falsified by simulation 40. The other two count as 300 each.
        assert_eq!(outcome.median_simulations, Some(40));
        assert_eq!(outcome.restricted_mean_simulations, Some((20.0 + 40.0 + 300.0 + 300.0) / 4.0));
        assert_eq!((outcome.simulations, outcome.diverged, outcome.undecided), (460, 4, 8));
    }

    #[test]
    fn without_a_violation_the_mean_is_none() {
        let outcome = FalsificationOutcome::new(vec![trial(300, Some(TrialEnd::BudgetSpent))], 300);
        assert_eq!((outcome.mean_simulations, outcome.median_simulations), (None, None));
        assert_eq!(outcome.restricted_mean_simulations, Some(300.0));
    }

    #[test]
    fn an_interrupted_trial_is_excluded_from_the_rate() {
        let outcome =
            FalsificationOutcome::new(vec![trial(20, Some(TrialEnd::Falsified)), trial(50, None)], 300);
        assert_eq!((outcome.falsification_rate.value, outcome.falsification_rate.n), (Some(1.0), 1));
        assert_eq!((outcome.median_simulations, outcome.restricted_mean_simulations), (None, None));
    }

    #[test]
    fn without_any_verdict_there_is_no_falsification_rate() {
        let untested = TrialOutcome { simulations: 3, ..trial(0, Some(TrialEnd::BudgetSpent)) };
        let outcome = FalsificationOutcome::new(vec![untested.clone(); 2], 3);
        assert_eq!((outcome.falsification_rate.value, outcome.falsification_rate.n), (None, 2));
        let tested = TrialOutcome { simulations: 4, ..untested.clone() };
        let outcome = FalsificationOutcome::new(vec![untested, tested], 4);
        assert_eq!(outcome.falsification_rate, rate(0, 1, 2));
    }

    /// Of 30 trials that are falsified after 1 to 30 simulations, half are falsified by
    /// simulation 15. The product of the rounded fractions 29/30 * 28/29 * ... is above one half
    /// there.
    #[test]
    fn the_median_counts_trials_without_rounding_errors() {
        for trials in 1..=60 {
            let falsified = (1..=trials).map(|n| trial(n, Some(TrialEnd::Falsified))).collect();
            let outcome = FalsificationOutcome::new(falsified, 300);
            assert_eq!(outcome.median_simulations, Some(trials.div_ceil(2)), "{trials} trials");
        }
    }

    #[test]
    fn a_median_requires_half_of_the_trials_to_be_falsified() {
        let spent = || trial(300, Some(TrialEnd::BudgetSpent));
        let found = |n| trial(n, Some(TrialEnd::Falsified));
        let outcome = FalsificationOutcome::new(vec![spent(), found(7), spent(), found(3)], 300);
        assert_eq!(outcome.median_simulations, Some(7));
        let outcome = FalsificationOutcome::new(vec![spent(), found(7), spent(), found(3), spent()], 300);
        assert_eq!(outcome.median_simulations, None);
        assert_eq!(FalsificationOutcome::new(vec![], 300).median_simulations, None);
    }
}
