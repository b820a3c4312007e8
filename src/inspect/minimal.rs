//! Minimal counterexamples: failures that were moved toward nominal, explained.

use std::ops::ControlFlow;

use mishandle_falsification::{PhysicsChecks, isolate, isolation_budget};
use mishandle_results::Cause;
use mishandle_rollout::{Episode, Request, RolloutError, Space, System};
use mishandle_store::{MAX_TRIALS, RunFile, RunHeader, Simulation};

use crate::error::{MishandleError, RunError};
use crate::inspect::{ExplainedSimulation, explain, explain_recorded};
use crate::resolve::{ResolvedPlan, space_depends_on_seed};
use crate::run::violation::described;
use crate::run::{Isolation, isolation, isolation_of, rows};

/// A failure with as few axes off nominal as were found, and as close to nominal.
#[derive(Clone, Debug)]
pub struct MinimalFailure {
    /// Why it fails.
    pub explained: ExplainedSimulation,
    /// The findings of the simulations that moved it.
    pub cause: Cause,
    /// Indices of its axes off nominal.
    pub axes: Vec<usize>,
    /// Trial and number of the failure from which it was moved.
    pub original: (u32, u32),
    /// Whether the run has the simulations that moved it.
    pub is_recorded: bool,
    isolation: Isolation,
}

impl MinimalFailure {
    /// Returns the minimal counterexample that a falsification recorded for a trial; `None` if it
    /// moved none.
    ///
    /// # Errors
    /// If the run cannot be read.
    pub fn recorded(run: &RunFile, trial: u32) -> Result<Option<MinimalFailure>, MishandleError> {
        let Some(isolation) = isolation(run, trial)? else { return Ok(None) };
        let explained = explain(run, isolation.closest.trial, isolation.closest.number, None)?;
        Ok(Some(MinimalFailure::new(run.header(), isolation, explained, true)))
    }

    /// Moves a recorded failure toward nominal, as a falsification does. `watch` gets the number of
    /// simulations, and can end them; then there is no result. It takes at most
    /// [`most`](Self::most) simulations.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn found(
        resolved: &ResolvedPlan,
        header: &RunHeader,
        original: Simulation,
        system: &mut dyn System,
        watch: impl FnMut(u64) -> ControlFlow<()>,
    ) -> Result<Option<MinimalFailure>, MishandleError> {
        let failure = Episode { request: plain(&original), ..rows::recorded_episode(&original) };
        let mut observed = Observed { system, rows: Vec::new(), resolved };
        let is_random = space_depends_on_seed(resolved);
        if !isolate(&mut observed, &failure, isolation_budget(0), is_random, watch)? {
            return Ok(None);
        }
        let rows = observed.rows;
        let isolation = isolation_of(header, original, rows)?;
        let explained = explained(header, &isolation.closest, resolved)?;
        Ok(Some(MinimalFailure::new(header, isolation, explained, false)))
    }

    /// Returns the largest number of simulations of [`found`](Self::found) in a space.
    pub fn most(space: &Space) -> u64 {
        isolation_budget(0) + space.axes().len() as u64 + 2
    }

    /// Goes back toward the found failure until the minimal one does not depend on the solver of
    /// the physics. Returns `false` if `watch`, which gets the number of simulations of the checks,
    /// ended them.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn check(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        checks: &mut PhysicsChecks,
        watch: &mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Result<bool, MishandleError> {
        if self.isolation.is_checked() {
            return Ok(true);
        }
        let Some(survivor) = checks.nearest_survivor(&self.isolation.failures(), watch)? else {
            return Ok(false);
        };
        self.isolation = self.isolation.clone().checked(survivor);
        if self.isolation.went_back() {
            let row = &self.isolation.closest;
            self.explained = if self.is_recorded || (row.trial, row.number) == self.original {
                explain(run, row.trial, row.number, None)?
            } else {
                explained(run.header(), row, resolved)?
            };
            self.axes = self.isolation.axes.clone();
        }
        let words = described(run.header(), &run.header().formula, &self.explained.trace).ok();
        self.cause = self.isolation.result_with(words);
        Ok(true)
    }

    fn new(
        header: &RunHeader,
        isolation: Isolation,
        explained: ExplainedSimulation,
        is_recorded: bool,
    ) -> MinimalFailure {
        let words = described(header, &header.formula, &explained.trace).ok();
        MinimalFailure {
            explained,
            cause: isolation.result_with(words),
            axes: isolation.axes.clone(),
            original: isolation.original(),
            is_recorded,
            isolation,
        }
    }
}

/// Returns the request of a recorded simulation, which runs to its end.
fn plain(row: &Simulation) -> Request {
    Request { stop_threshold: None, unit_point: Vec::new(), ..rows::request(row, false) }
}

/// Simulates a failure again, with its trace, which a journal does not return.
fn explained(
    header: &RunHeader,
    row: &Simulation,
    resolved: &ResolvedPlan,
) -> Result<ExplainedSimulation, MishandleError> {
    let mut system = resolved.system()?;
    let episode = system.rollout(&[plain(row)])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
    let again = rows::row(&episode, resolved);
    explain_recorded(header, again, episode.trace)
}

/// A system whose simulations are kept, without their traces.
struct Observed<'a> {
    system: &'a mut dyn System,
    rows: Vec<Simulation>,
    resolved: &'a ResolvedPlan,
}

impl System for Observed<'_> {
    fn space(&self) -> &Space {
        self.system.space()
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let episodes = self.system.rollout(requests)?;
        for episode in &episodes {
            let row = rows::row(episode, self.resolved);
            // Numbered as those that a falsification records.
            let trial = row.trial.saturating_add(MAX_TRIALS);
            let number = self.rows.len() as u32 + 1;
            self.rows.push(Simulation { trial, number, trace: None, ..row });
        }
        Ok(episodes)
    }
}
