//! What trials found, and what a campaign of them amounts to.

use mishandle_evaluation::{Estimate, wilson};
use mishandle_rollout::{Episode, EpisodeEnd, Scenario, Seed};

use crate::TrialEnd;

/// The simulation of a trial with the least robustness, the earliest of equals: its counterexample, if it has one.
#[derive(Clone, Debug, PartialEq)]
pub struct Minimum {
    /// Robustness.
    pub robustness: f64,
    /// Its scenario.
    pub scenario: Scenario,
    /// Key of everything random in it.
    pub seed: Seed,
    /// Its number in the trial, from 1.
    pub number: u32,
}

/// A simulation on whose trace the formula has no finite value.
#[derive(Clone, Debug, PartialEq)]
pub struct Undefined {
    /// Its number in the trial, from 1.
    pub number: u32,
    /// Its scenario.
    pub scenario: Scenario,
    /// Key of everything random in it.
    pub seed: Seed,
    /// Sample of the trace at which the formula has no finite value.
    pub step: usize,
}

/// What a trial found, as far as it went.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialOutcome {
    /// Number of the trial, from 1.
    pub trial: u32,
    /// Its seed.
    pub seed: Seed,
    /// How it ended; `None` if it was cut short.
    pub end: Option<TrialEnd>,
    /// Simulations it made, the falsifying one included.
    pub simulations: u32,
    /// How many of them diverged.
    pub diverged: u32,
    /// How many of them did not diverge and were stopped undecided.
    pub undecided: u32,
    /// How many of the undecided ones have no finite value of the formula.
    pub undefined: u32,
    /// The first of these.
    pub first_undefined: Option<Undefined>,
    /// The least robustness; `None` if no simulation has one.
    pub minimum: Option<Minimum>,
}

impl TrialOutcome {
    /// The outcome of a trial that has not begun.
    pub(crate) fn new(trial: u32, seed: Seed) -> TrialOutcome {
        TrialOutcome {
            trial,
            seed,
            end: None,
            simulations: 0,
            diverged: 0,
            undecided: 0,
            undefined: 0,
            first_undefined: None,
            minimum: None,
        }
    }

    /// Whether it found a violation.
    pub fn falsified(&self) -> bool {
        self.end == Some(TrialEnd::Falsified)
    }

    /// Adds a simulation.
    pub(crate) fn add(&mut self, episode: &Episode) {
        self.simulations += 1;
        let request = &episode.request;
        let (number, seed) = (request.number, request.seed);
        match (episode.robustness(), episode.end) {
            (Some(robustness), _) => {
                if self.minimum.as_ref().is_none_or(|minimum| robustness < minimum.robustness) {
                    let scenario = request.scenario.clone();
                    self.minimum = Some(Minimum { robustness, scenario, seed, number });
                }
            }
            (None, EpisodeEnd::Diverged { .. }) => self.diverged += 1,
            (None, EpisodeEnd::Undefined { step }) => {
                self.undecided += 1;
                self.undefined += 1;
                self.first_undefined.get_or_insert_with(|| {
                    let scenario = request.scenario.clone();
                    Undefined { number, scenario, seed, step }
                });
            }
            (None, _) => self.undecided += 1,
        }
    }
}

/// What a campaign found, as far as it went.
#[derive(Clone, Debug, PartialEq)]
pub struct CampaignOutcome {
    /// The trials that have begun, in order.
    pub trials: Vec<TrialOutcome>,
    /// How many of them found a violation.
    pub falsified_trials: u32,
    /// FR: their share of the trials that have ended, with its Wilson interval.
    pub falsification_rate: Estimate,
    /// S̄: mean number of simulations over the falsified trials; `None` if there is none. It says nothing of how often
    /// a search fails: the two below do.
    pub mean_simulations: Option<f64>,
    /// The least number of simulations after which at least half of the trials have found a violation; `None` if fewer
    /// than half do, or if a trial was cut short.
    pub median_simulations: Option<u32>,
    /// Mean number of simulations to the first violation, the budget where there is none. A search that ended by itself
    /// counts as the whole budget, since it would find nothing more. `None` if a trial was cut short.
    pub restricted_mean_simulations: Option<f64>,
    /// Simulations of all trials.
    pub simulations: u64,
    /// How many of them diverged.
    pub diverged: u64,
    /// How many of them did not diverge and were stopped undecided.
    pub undecided: u64,
    /// How many of the undecided ones have no finite value of the formula.
    pub undefined: u64,
    /// Simulations that were run and belong to no trial: those of a batch that come after a violation in their trial.
    pub surplus: u64,
}

impl CampaignOutcome {
    /// What trials with this budget amount to.
    pub fn new(trials: Vec<TrialOutcome>, budget: u32) -> CampaignOutcome {
        let ended = trials.iter().filter(|trial| trial.end.is_some()).count() as u64;
        let total =
            |count: fn(&TrialOutcome) -> u32| trials.iter().map(|trial| u64::from(count(trial))).sum();
        let falsified = || trials.iter().filter(|trial| trial.falsified());
        let falsified_trials = falsified().count() as u32;
        let spent: u64 = falsified().map(|trial| u64::from(trial.simulations)).sum();
        let is_complete = !trials.is_empty() && ended == trials.len() as u64;
        let unfalsified = trials.len() as u64 - u64::from(falsified_trials);
        let total_with_budget = spent + unfalsified * u64::from(budget);
        CampaignOutcome {
            falsified_trials,
            falsification_rate: wilson(falsified_trials.into(), ended),
            mean_simulations: (falsified_trials > 0).then(|| spent as f64 / f64::from(falsified_trials)),
            median_simulations: is_complete
                .then(|| median(falsified().map(|trial| trial.simulations), trials.len()))
                .flatten(),
            restricted_mean_simulations: is_complete.then(|| total_with_budget as f64 / trials.len() as f64),
            simulations: total(|trial| trial.simulations),
            diverged: total(|trial| trial.diverged),
            undecided: total(|trial| trial.undecided),
            undefined: total(|trial| trial.undefined),
            surplus: 0,
            trials,
        }
    }
}

/// The least number of simulations by which at least half of `trials` trials are falsified, `simulations` being those of
/// the falsified ones. Counted in whole trials, since a rounded share would miss one half by a bit.
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
        TrialOutcome { end, simulations, diverged: 1, undecided: 2, ..TrialOutcome::new(1, Seed(0)) }
    }

    #[test]
    fn an_outcome_worked_out_by_hand() {
        let outcome = CampaignOutcome::new(
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
        // Half of the trials are falsified by simulation 40; the two others count 300 each.
        assert_eq!(outcome.median_simulations, Some(40));
        assert_eq!(outcome.restricted_mean_simulations, Some((20.0 + 40.0 + 300.0 + 300.0) / 4.0));
        assert_eq!((outcome.simulations, outcome.diverged, outcome.undecided), (460, 4, 8));
    }

    #[test]
    fn without_a_violation_there_is_no_mean() {
        let outcome = CampaignOutcome::new(vec![trial(300, Some(TrialEnd::BudgetSpent))], 300);
        assert_eq!((outcome.mean_simulations, outcome.median_simulations), (None, None));
        assert_eq!(outcome.restricted_mean_simulations, Some(300.0));
    }

    #[test]
    fn a_trial_cut_short_is_in_no_rate() {
        let outcome = CampaignOutcome::new(vec![trial(20, Some(TrialEnd::Falsified)), trial(50, None)], 300);
        assert_eq!((outcome.falsification_rate.value, outcome.falsification_rate.n), (Some(1.0), 1));
        assert_eq!((outcome.median_simulations, outcome.restricted_mean_simulations), (None, None));
    }

    /// 30 trials, each falsified after another number of simulations: half of them by the 15th. A product of rounded
    /// shares, 29/30 * 28/29 * ..., is above one half there.
    #[test]
    fn the_median_counts_whole_trials() {
        for trials in 1..=60 {
            let falsified = (1..=trials).map(|n| trial(n, Some(TrialEnd::Falsified))).collect();
            let outcome = CampaignOutcome::new(falsified, 300);
            assert_eq!(outcome.median_simulations, Some(trials.div_ceil(2)), "{trials} trials");
        }
    }

    #[test]
    fn half_of_the_trials_is_enough_for_a_median_and_fewer_are_not() {
        let spent = || trial(300, Some(TrialEnd::BudgetSpent));
        let found = |n| trial(n, Some(TrialEnd::Falsified));
        let outcome = CampaignOutcome::new(vec![spent(), found(7), spent(), found(3)], 300);
        assert_eq!(outcome.median_simulations, Some(7));
        let outcome = CampaignOutcome::new(vec![spent(), found(7), spent(), found(3), spent()], 300);
        assert_eq!(outcome.median_simulations, None);
        assert_eq!(CampaignOutcome::new(vec![], 300).median_simulations, None);
    }
}
