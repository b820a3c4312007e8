//! When a guard would have handed over in a recorded simulation, and when its failure was certain.

use mishandle_controllers::guard::{ROBUSTNESS, Switch};
use mishandle_rollout::{Episode, Request};
use mishandle_stl::{Clock, Formula, Trace, is_violated};
use mishandle_store::{RANDOM_TRIAL, RunFile};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::violation::decided;
use crate::run::{evaluation_request, rows};

/// Number of simulations whose traces are in memory together.
const BATCH: usize = 256;

/// A simulation that a guard watched, with a verdict of the requirement.
#[derive(Clone, Debug, PartialEq)]
pub struct Watched {
    /// Number of the simulation.
    pub number: u32,
    /// Whether it violates the requirement.
    pub fails: bool,
    /// The least robustness of the guard's formula in an action that came before the failure was
    /// certain; in a success, in any action.
    pub least: f64,
    /// The robustness in each action of a failure; empty for a success.
    robustness: Vec<f64>,
    /// Sample of a failure from which on it was certain.
    failure: usize,
}

impl Watched {
    /// Reads a watched simulation from its trace.
    fn new(
        number: u32,
        formula: &Formula,
        fails: bool,
        trace: &Trace,
        control_dt: f64,
    ) -> Result<Watched, MishandleError> {
        let column = trace.names().iter().position(|name| name == ROBUSTNESS);
        // Sample 0 comes before the first action, so its value decided nothing.
        let decisions = column.and_then(|column| trace.column(column).get(1..)).unwrap_or_default();
        let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
        if !fails {
            return Ok(Watched { number, fails, least: least(decisions), robustness: vec![], failure: 0 });
        }
        let last = trace.len().saturating_sub(1);
        let failure = decided(formula, trace, Clock::steps(control_dt), -1.0)?.unwrap_or(last);
        // Action i follows sample i.
        let in_time = least(&decisions[..failure.min(decisions.len())]);
        Ok(Watched { number, fails, least: in_time, robustness: decisions.to_vec(), failure })
    }

    /// Returns the first sample of a failure after which the fallback acts; `None` without an
    /// alarm.
    fn alarm(&self, switch: &Switch) -> Option<usize> {
        self.robustness.iter().position(|robustness| switch.is_active(0, *robustness, true))
    }

    /// Returns the number of control steps from the alarm to the certain failure: 0 or less if it
    /// comes too late. `None` for a success, and without an alarm.
    pub fn lead(&self, switch: &Switch) -> Option<i64> {
        self.alarm(switch).map(|alarm| self.failure as i64 - alarm as i64)
    }
}

/// The random simulations of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct WatchedRun {
    /// Those with a verdict, in their order.
    pub simulations: Vec<Watched>,
    /// Number of simulations without a verdict.
    pub without_verdict: u64,
}

impl WatchedRun {
    /// Reads a complete run. A run file has the traces of violations of the target's own formula
    /// only. Another simulation is simulated again if its trace is needed: a failure of a named
    /// requirement, and a success that ended early, which leaves the least robustness undecided.
    ///
    /// # Errors
    /// If the run file cannot be read, or a simulation fails.
    pub fn read(
        run: &RunFile,
        resolved: &ResolvedPlan,
        requirement: &Requirement,
    ) -> Result<WatchedRun, MishandleError> {
        let mut found = WatchedRun::default();
        let mut again = Vec::new();
        let control_dt = resolved.target.control_dt;
        let watched = |number: u32, fails: bool, trace: &Trace| {
            Watched::new(number, &requirement.formula, fails, trace, control_dt)
        };
        for simulation in run.trial_simulations(RANDOM_TRIAL) {
            let simulation = simulation?;
            let episode = rows::episode(&simulation, resolved)?;
            if !episode.end.counts_in_rates() {
                continue;
            }
            let Some(fails) = requirement.is_violated(&episode) else {
                found.without_verdict += 1;
                continue;
            };
            let number = simulation.number;
            let least = requirement.least(&episode);
            if let Some(least) = least.filter(|_| !fails) {
                found.simulations.push(Watched { number, fails, least, robustness: vec![], failure: 0 });
                continue;
            }
            // A list of simulations has no traces.
            match run.simulation(RANDOM_TRIAL, number)?.trace {
                Some(stored) => {
                    let trace = rows::trace(resolved.signal_names(), &stored);
                    found.simulations.push(watched(number, fails, &trace)?);
                }
                None => again.push((number, fails)),
            }
        }
        if !again.is_empty() {
            let mut system = resolved.system()?;
            for batch in again.chunks(BATCH) {
                let mut requests: Vec<Request> = Vec::with_capacity(batch.len());
                for (number, _) in batch {
                    requests.extend(evaluation_request(resolved, RANDOM_TRIAL, *number)?);
                }
                for ((number, fails), episode) in batch.iter().zip(system.rollout(&requests)?) {
                    found.simulations.push(watched(*number, *fails, &episode.trace)?);
                }
            }
        }
        found.simulations.sort_by_key(|simulation| simulation.number);
        Ok(found)
    }
}

/// Definition of a failure.
#[derive(Clone, Debug)]
pub(super) struct Requirement {
    /// The formula.
    pub formula: Formula,
    /// Its place among the named requirements; `None` for the formula of the target.
    pub named: Option<usize>,
    /// Place of the named requirement whose value is the least robustness of the guard's formula.
    pub guard: usize,
}

impl Requirement {
    /// Returns whether an episode violates it; `None` without a verdict.
    pub fn is_violated(&self, episode: &Episode) -> Option<bool> {
        let robustness = match self.named {
            Some(index) => episode.verdict.others.get(index).copied().flatten(),
            None => episode.robustness(),
        };
        robustness.filter(|_| episode.end.has_verdict()).map(is_violated)
    }

    /// Returns the least robustness of the guard's formula, if the whole episode decides it.
    fn least(&self, episode: &Episode) -> Option<f64> {
        episode.verdict.others.get(self.guard).copied().flatten()
    }
}
