//! One seeded search with a budget of simulations.

use std::rc::Rc;

use mishandle_rollout::{Episode, EpisodeEnd, Request, Space, Verdict};
use mishandle_search::{Observation, Search, SearchEnd, SearchError};

use crate::keep_going::Archive;
use crate::{FalsificationError, FalsificationSettings, KeepGoing, TrialOutcome};

/// Makes a search from its seed.
pub type SearchFactory<'a> = dyn Fn(u64) -> Result<Box<dyn Search>, SearchError> + 'a;

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialEnd {
    /// The last simulation has a robustness below 0.
    Falsified,
    /// The budget was spent. Only a trial that [keeps going](Trial::keep_going) can have found a
    /// violation.
    BudgetSpent,
    /// The search ended by its own criterion before the budget was spent. Only a trial that [keeps
    /// going](Trial::keep_going) can have found a violation.
    SearchEnded(SearchEnd),
    /// New failure modes became rarer than the settings of a trial that [keeps
    /// going](Trial::keep_going) require.
    ModesDriedUp,
}

/// One seeded search. It ends at the first robustness below 0, when its budget of simulations is
/// spent, or when the search ends by its own criterion.
///
/// The search has the seed child 0 of the trial's seed, and simulation m, counted from 1, has
/// child m, unless all simulations have the same seed. A violation in simulation m counts as m
/// simulations. A trial stores the minimum robustness but no history, unless it [keeps
/// going](Self::keep_going).
///
/// The search observes +∞, the worst value, for a simulation that diverged, was stopped with the
/// formula undecided, or has no finite value of the formula, because none of them is a
/// counterexample. All of them count against the budget. A complete episode that leaves the formula
/// undecided is an error: the formula is longer than the episode, so no simulation could have a
/// robustness.
pub struct Trial<'a> {
    make: Rc<SearchFactory<'a>>,
    search: Box<dyn Search>,
    /// Number of searches before the present one, and of simulations before its first.
    restarts: u64,
    search_start: u32,
    /// Whether proposed points wait for a search that was replaced.
    is_stale: bool,
    space: Space,
    settings: FalsificationSettings,
    outcome: TrialOutcome,
    archive: Option<Archive<'a>>,
}

impl<'a> Trial<'a> {
    /// Makes trial `number` of a falsification, counted from 1. `make` makes its search.
    ///
    /// # Errors
    /// If the search cannot be made, or its dimension is not that of `space`.
    pub fn new(
        number: u32,
        settings: &FalsificationSettings,
        space: Space,
        make: Rc<SearchFactory<'a>>,
    ) -> Result<Trial<'a>, FalsificationError> {
        let seed = settings.trial_seed(number);
        let search = make(seed.child(0).0)?;
        let found = search.dimension();
        let expected = space.dimension();
        if found != expected {
            return Err(FalsificationError::Dimension { search: search.name(), found, expected });
        }
        let outcome = TrialOutcome::new(number, seed);
        Ok(Trial {
            make,
            search,
            restarts: 0,
            search_start: 0,
            is_stale: false,
            space,
            settings: *settings,
            outcome,
            archive: None,
        })
    }

    /// Continues after the first violation: until the budget is spent, or new failure modes dry up.
    /// The search is steered away from known failures. After a failure, and if the search ends or
    /// finds none for a while, another one continues, with child k of the seed of the first one,
    /// for k = 1, 2, ...; but a search that [keeps exploring](Search::keeps_exploring) is not
    /// replaced.
    pub fn keep_going(mut self, settings: KeepGoing<'a>) -> Trial<'a> {
        self.archive = Some(Archive::new(settings, self.space.clone()));
        self
    }

    /// Returns the outcome so far.
    pub fn outcome(&self) -> &TrialOutcome {
        &self.outcome
    }

    /// Returns the next simulations to run, at most `n`. The list is empty if the trial has ended.
    ///
    /// The list is longer than 1 only if the search can propose points before it observes the first
    /// of them. Its length is at most one more than the number of completed simulations of the
    /// search. Simulations after a violation are surplus, so this limit keeps the surplus below the
    /// cost of the trial.
    ///
    /// # Errors
    /// [`FalsificationError::Stalled`] if the search proposes no point and has not ended.
    pub fn ask(&mut self, n: usize) -> Result<Vec<Request>, FalsificationError> {
        if self.outcome.end.is_some() {
            return Ok(Vec::new());
        }
        let trial = self.outcome.trial;
        let done = self.outcome.simulations;
        let own = done - self.search_start;
        let limit = self.replacing_archive().and_then(Archive::search_limit);
        let limit = limit.map_or(u32::MAX, |limit| limit - own);
        let n = n.min((self.settings.budget - done).min(own + 1).min(limit) as usize);
        self.is_stale = false;
        let mut points = self.search.ask_batch(n);
        if points.is_empty() && self.replace_ended_search()? {
            points = self.search.ask_batch(n);
        }
        if points.is_empty() {
            match self.search.finished() {
                Some(end) => self.outcome.end = Some(TrialEnd::SearchEnded(end)),
                None => {
                    return Err(FalsificationError::Stalled { search: self.search.name(), trial });
                }
            }
        }
        let request = |(number, unit_point): (u32, Vec<f64>)| Request {
            trial,
            number,
            scenario: self.space.at(&unit_point),
            stop_threshold: self.settings.early_stopping.then(|| self.search.stop_threshold(&unit_point)),
            unit_point,
            seed: self.settings.simulation_seed(trial, number),
            needs_parts: self.search.needs_parts(),
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
        let observed = match &mut self.archive {
            Some(archive) => archive.observe(episode)?,
            None => observation(robustness, &episode.verdict),
        };
        self.search.tell(unit_point, &observed)?;
        self.outcome.add(episode);
        self.outcome.end = self.end()?;
        Ok(())
    }

    /// Adds the result of another physics engine for the first request without an episode: a
    /// robustness of at least 0. The search observes it, but it is not evidence: it cannot become
    /// the minimum of the trial.
    ///
    /// # Errors
    /// [`FalsificationError::Search`] if the search rejects the observation.
    pub(crate) fn tell_screened(
        &mut self,
        request: &Request,
        observed: &Observation,
    ) -> Result<(), FalsificationError> {
        self.search.tell(&request.unit_point, observed)?;
        self.outcome.add_screened();
        self.outcome.end = self.end()?;
        Ok(())
    }

    /// Returns whether the requests that have no episode yet are void, because the search that
    /// proposed them was replaced.
    pub(crate) fn is_stale(&self) -> bool {
        self.is_stale
    }

    /// Returns the end of the trial after an observation. Replaces the search if the trial
    /// continues without it.
    fn end(&mut self) -> Result<Option<TrialEnd>, FalsificationError> {
        if self.archive.is_none() && self.outcome.falsified() {
            return Ok(Some(TrialEnd::Falsified));
        }
        if self.outcome.simulations == self.settings.budget {
            return Ok(Some(TrialEnd::BudgetSpent));
        }
        if self.archive.as_mut().is_some_and(Archive::is_dry) {
            return Ok(Some(TrialEnd::ModesDriedUp));
        }
        if self.must_restart() {
            self.replace_search()?;
        }
        if self.replace_ended_search()? {
            return Ok(None);
        }
        Ok(self.search.finished().map(TrialEnd::SearchEnded))
    }

    /// Returns whether another search must continue, although the present one has not ended.
    fn must_restart(&self) -> bool {
        let own = self.outcome.simulations - self.search_start;
        self.replacing_archive().is_some_and(|archive| {
            archive.has_failed() || archive.search_limit().is_some_and(|limit| own >= limit)
        })
    }

    /// Replaces the search if it has ended and another one could find something. Returns whether it
    /// did.
    fn replace_ended_search(&mut self) -> Result<bool, FalsificationError> {
        let is_over = self.search.finished().is_some();
        let must = is_over && self.replacing_archive().is_some_and(Archive::has_failures);
        if must {
            self.replace_search()?;
        }
        Ok(must)
    }

    /// Returns the archive if the search is one that another replaces.
    fn replacing_archive(&self) -> Option<&Archive<'a>> {
        self.archive.as_ref().filter(|_| !self.search.keeps_exploring())
    }

    fn replace_search(&mut self) -> Result<(), FalsificationError> {
        self.restarts += 1;
        self.search_start = self.outcome.simulations;
        self.search = (self.make)(self.outcome.seed.child(0).child(self.restarts).0)?;
        self.is_stale = true;
        self.archive.as_mut().map(Archive::restart);
        Ok(())
    }
}

/// Returns the search's observation of a simulation: +∞ if it has no robustness.
pub(crate) fn observation(robustness: Option<f64>, verdict: &Verdict) -> Observation {
    match robustness {
        Some(robustness) => Observation { robustness, parts: verdict.parts.clone() },
        None => Observation::from(f64::INFINITY),
    }
}
