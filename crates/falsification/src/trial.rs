//! One seeded search with a budget.

use mishandle_rollout::{Episode, EpisodeEnd, Request, Seed, Space};
use mishandle_search::{Observation, Search, SearchEnd, SubformulaMinimum};

use crate::{FalsificationError, TrialOutcome};

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialEnd {
    /// Its last simulation has a robustness below 0.
    Falsified,
    /// The budget was spent without one.
    BudgetSpent,
    /// The search ended by its own criterion, without one and before the budget was spent.
    SearchEnded(SearchEnd),
}

/// One seeded search that stops at the first robustness below 0, or when its budget of simulations is spent, or when
/// the search ends by itself.
///
/// Of the trial's seed, child 0 is the search's and child m that of simulation m, counted from 1. A violation found by
/// simulation m counts as m simulations. The trial holds no history, only the least robustness.
///
/// A diverged simulation is told to the search as +∞, the worst there is, since it is not a counterexample. So is one that
/// was stopped with the formula undecided, or on whose trace the formula has no finite value. All are counted. An episode
/// that ran to its end and still left the formula undecided is an error: the formula is longer than the episode, and the
/// whole budget would be spent on nothing.
pub struct Trial {
    search: Box<dyn Search>,
    space: Space,
    budget: u32,
    outcome: TrialOutcome,
}

impl Trial {
    /// Trial `number`, counted from 1, with this seed, before its first simulation. The search has to be made with
    /// [`search_seed`](Self::search_seed) and the dimension of `space`.
    pub fn new(number: u32, seed: Seed, budget: u32, search: Box<dyn Search>, space: Space) -> Trial {
        Trial { search, space, budget, outcome: TrialOutcome::new(number, seed) }
    }

    /// The seed for the search of a trial with this seed.
    pub fn search_seed(seed: Seed) -> u64 {
        seed.child(0).0
    }

    /// How it stands.
    pub fn outcome(&self) -> &TrialOutcome {
        &self.outcome
    }

    /// The next simulations it wants, at most `n`; none if it has ended.
    ///
    /// More than one only where the search can say them before it knows the first value, and at most one more than
    /// the trial has simulated. Those after a violation are surplus: so they never cost more than the trial itself.
    ///
    /// # Errors
    /// [`FalsificationError::Stalled`] if the search proposes nothing and has not ended.
    pub fn ask(&mut self, n: usize) -> Result<Vec<Request>, FalsificationError> {
        if self.outcome.end.is_some() {
            return Ok(Vec::new());
        }
        let (trial, done) = (self.outcome.trial, self.outcome.simulations);
        let n = n.min((self.budget - done) as usize).min(done as usize + 1);
        let points = self.search.ask_batch(n);
        if points.is_empty() {
            match self.search.finished() {
                Some(finish) => self.outcome.end = Some(TrialEnd::SearchEnded(finish)),
                None => return Err(FalsificationError::Stalled { search: self.search.name(), trial }),
            }
        }
        let request = |(number, unit_point): (u32, Vec<f64>)| Request {
            trial,
            number,
            scenario: self.space.at(&unit_point),
            unit_point,
            seed: self.outcome.seed.child(u64::from(number)),
            wants_subformulas: self.search.needs_subformulas(),
        };
        Ok((done + 1..).zip(points).map(request).collect())
    }

    /// Takes the episode of the first request that has none yet; it may come from a record.
    ///
    /// # Errors
    /// [`FalsificationError::Undecidable`], [`FalsificationError::NotANumber`], or what the search refuses.
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

/// What the search is told of a simulation: +∞ if it has no verdict.
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
