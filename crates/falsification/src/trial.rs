//! One seeded search with a budget of simulations.

use mishandle_rollout::{Episode, EpisodeEnd, Request, Seed, Space};
use mishandle_search::{Observation, Search, SearchEnd, SubformulaMinimum};

use crate::{FalsificationError, TrialOutcome};

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialEnd {
    /// The last simulation has a robustness below 0.
    Falsified,
    /// The budget was spent without a violation.
    BudgetSpent,
    /// The search ended by its own criterion, without a violation and before the budget was spent.
    SearchEnded(SearchEnd),
}

/// One seeded search. It ends at the first robustness below 0, when its budget of simulations is spent, or when the search
/// ends by its own criterion.
///
/// The search has the seed child 0 of the trial's seed, and simulation m, counted from 1, has child m. A violation in
/// simulation m counts as m simulations. A trial stores the minimum robustness but no history.
///
/// The search observes +∞, the worst value, for a simulation that diverged, was stopped with the formula undecided, or has
/// no finite value of the formula, because none of them is a counterexample. All of them count against the budget. A
/// complete episode that leaves the formula undecided is an error: the formula is longer than the episode, so no
/// simulation could have a robustness.
pub struct Trial {
    search: Box<dyn Search>,
    space: Space,
    budget: u32,
    stops_early: bool,
    outcome: TrialOutcome,
}

impl Trial {
    /// Makes trial `number`, counted from 1. The search must have the seed [`search_seed`](Self::search_seed) and the
    /// dimension of `space`.
    pub fn new(number: u32, seed: Seed, budget: u32, search: Box<dyn Search>, space: Space) -> Trial {
        Trial { search, space, budget, stops_early: false, outcome: TrialOutcome::new(number, seed) }
    }

    /// Lets simulations end as soon as the search does not need the rest: see [`Search::stop_threshold`].
    pub fn with_early_stopping(mut self, stops_early: bool) -> Trial {
        self.stops_early = stops_early;
        self
    }

    /// Returns the seed of the search of a trial with this seed.
    pub fn search_seed(seed: Seed) -> u64 {
        seed.child(0).0
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> &TrialOutcome {
        &self.outcome
    }

    /// Returns the next simulations to run, at most `n`. The list is empty if the trial has ended.
    ///
    /// The list is longer than 1 only if the search can propose points before it observes the first of them. Its length
    /// is at most one more than the number of completed simulations. Simulations after a violation are surplus, so this
    /// limit keeps the surplus below the cost of the trial.
    ///
    /// # Errors
    /// [`FalsificationError::Stalled`] if the search proposes no point and has not ended.
    pub fn ask(&mut self, n: usize) -> Result<Vec<Request>, FalsificationError> {
        if self.outcome.end.is_some() {
            return Ok(Vec::new());
        }
        let (trial, done) = (self.outcome.trial, self.outcome.simulations);
        let n = n.min((self.budget - done) as usize).min(done as usize + 1);
        let points = self.search.ask_batch(n);
        if points.is_empty() {
            match self.search.finished() {
                Some(end) => self.outcome.end = Some(TrialEnd::SearchEnded(end)),
                None => return Err(FalsificationError::Stalled { search: self.search.name(), trial }),
            }
        }
        let request = |(number, unit_point): (u32, Vec<f64>)| Request {
            trial,
            number,
            scenario: self.space.at(&unit_point),
            stop_threshold: self.stops_early.then(|| self.search.stop_threshold(&unit_point)),
            unit_point,
            seed: self.outcome.seed.child(u64::from(number)),
            needs_subformulas: self.search.needs_subformulas(),
        };
        Ok((done + 1..).zip(points).map(request).collect())
    }

    /// Adds the episode of the first request without one. It may come from a record.
    ///
    /// # Errors
    /// - [`FalsificationError::Undecidable`] if the episode is complete but the formula undecided.
    /// - [`FalsificationError::NotANumber`] if the robustness is NaN.
    /// - [`FalsificationError::Search`] if the search rejects the observation.
    pub fn tell(&mut self, episode: &Episode) -> Result<(), FalsificationError> {
        let Request { trial, number, unit_point, scenario, .. } = &episode.request;
        let robustness = episode.robustness();
        match (robustness, episode.end) {
            (None, EpisodeEnd::Completed) => {
                return Err(FalsificationError::Undecidable { trial: *trial, number: *number });
            }
            (Some(rho), _) if rho.is_nan() => {
                let scenario = scenario.values().to_vec();
                return Err(FalsificationError::NotANumber { trial: *trial, number: *number, scenario });
            }
            _ => {}
        }
        self.search.tell(unit_point, &observation(episode))?;
        self.outcome.add(episode);
        self.outcome.end = if robustness.is_some_and(|rho| rho < 0.0) {
            Some(TrialEnd::Falsified)
        } else if self.outcome.simulations == self.budget {
            Some(TrialEnd::BudgetSpent)
        } else {
            self.search.finished().map(TrialEnd::SearchEnded)
        };
        Ok(())
    }
}

/// Returns the search's observation of an episode: +∞ if the episode has no robustness.
fn observation(episode: &Episode) -> Observation {
    let minimum = |found: &mishandle_stl::SubformulaMinimum| SubformulaMinimum {
        minimum: found.minimum,
        step: found.step,
    };
    match episode.robustness() {
        Some(robustness) => {
            let subformulas = episode.verdict.subformulas.iter().map(minimum).collect();
            Observation { robustness, subformulas }
        }
        None => Observation::from(f64::INFINITY),
    }
}
