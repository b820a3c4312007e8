//! One seeded search with a budget.

use mishandle_rollout::{End, Episode, Seed};
use mishandle_search::{Finish, Search};

use crate::{FalsificationError, TrialOutcome};

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialEnd {
    /// Its last simulation has a robustness below 0.
    Falsified,
    /// The budget was spent without one.
    BudgetSpent,
    /// The search ended by its own criterion, without one and before the budget was spent.
    SearchEnded(Finish),
}

/// A simulation that a trial wants.
#[derive(Clone, Debug, PartialEq)]
pub struct Asked {
    /// Number of the simulation in its trial, from 1.
    pub number: u32,
    /// The search's point of \[0,1\]^d.
    pub unit_point: Vec<f64>,
    /// Key of everything random in it.
    pub seed: Seed,
}

/// One seeded search that stops at the first robustness below 0, or when its budget of simulations is spent, or when
/// the search ends by itself.
///
/// Of the trial's seed, child 0 is the search's and child m that of simulation m, counted from 1. A violation found by
/// simulation m counts as m simulations. The trial holds no history, only the least robustness.
///
/// A diverged simulation is told to the search as +∞, the worst there is, since it is no counterexample. So is one that
/// was stopped with the formula undecided, or on whose trace the formula has no finite value. All are counted. An episode that ran to its end and still left the formula
/// undecided is an error: the formula is longer than the episode, and the whole budget would be spent on nothing.
pub struct Trial {
    search: Box<dyn Search>,
    budget: u32,
    outcome: TrialOutcome,
}

impl Trial {
    /// Trial `number` with this seed, not begun. The search is to be made with [`search_seed`](Self::search_seed).
    pub fn new(number: u32, seed: Seed, budget: u32, search: Box<dyn Search>) -> Trial {
        Trial { search, budget, outcome: TrialOutcome::new(number, seed) }
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
    /// the trial has simulated. Those after a violation will be thrown away: so they never cost more than the trial
    /// itself.
    ///
    /// # Errors
    /// [`FalsificationError::Stalled`] if the search has nothing to say and has not ended.
    pub fn ask(&mut self, n: usize) -> Result<Vec<Asked>, FalsificationError> {
        if self.outcome.end.is_some() {
            return Ok(Vec::new());
        }
        let done = self.outcome.simulations;
        let n = n.min((self.budget - done) as usize).min(done as usize + 1);
        let points = self.search.ask_batch(n);
        if points.is_empty() {
            match self.search.finished() {
                Some(finish) => self.outcome.end = Some(TrialEnd::SearchEnded(finish)),
                None => {
                    let (search, trial) = (self.search.name(), self.outcome.trial);
                    return Err(FalsificationError::Stalled { search, trial });
                }
            }
        }
        let asked = (done + 1..).zip(points).map(|(number, unit_point)| Asked {
            number,
            unit_point,
            seed: self.outcome.seed.child(u64::from(number)),
        });
        Ok(asked.collect())
    }

    /// Takes the result of `asked`, which is the first of those asked for that has none yet: its initial configuration,
    /// its robustness, `None` if undecided, and how it ended.
    ///
    /// # Errors
    /// [`FalsificationError::Undecidable`], [`FalsificationError::NotANumber`], or what the search refuses.
    pub fn tell(
        &mut self,
        asked: &Asked,
        x0: &[f64],
        robustness: Option<f64>,
        end: End,
    ) -> Result<(), FalsificationError> {
        let (trial, number) = (self.outcome.trial, asked.number);
        match (robustness, end) {
            (None, End::Completed) => return Err(FalsificationError::Undecidable { trial, number }),
            (Some(rho), _) if rho.is_nan() => {
                return Err(FalsificationError::NotANumber { trial, number, x0: x0.to_vec() });
            }
            _ => {}
        }
        self.search.tell(&asked.unit_point, robustness.unwrap_or(f64::INFINITY))?;
        self.outcome.add(asked, x0, robustness, end);
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

/// The robustness of an episode as a trial takes it: `None` if it diverged or was left undecided.
pub(crate) fn robustness_of(episode: &Episode) -> Option<f64> {
    match episode.end {
        End::Diverged { .. } | End::Undefined { .. } => None,
        End::Completed | End::Stopped { .. } => episode.verdict.robustness,
    }
}
