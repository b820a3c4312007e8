//! Replays recorded simulations and compares them with their records.

mod command;
mod result;
mod simulation;
mod trial;

use mishandle_falsification::norms;
use mishandle_results::Norms;
use mishandle_rollout::{Episode, Scenario, Space, System};
use mishandle_stl::is_violated;
use mishandle_store::{RunFile, RunKind, Simulation, SimulationEnd};

use crate::error::{Compared, MishandleError, RunError};
use crate::resolve::{Moved, ResolvedPlan, recorded_plan};
use crate::run::journal::keeps_all_traces;
use crate::run::{recorded_axis, rows, same_plan, system_of};

pub use crate::run::build_differences;
pub use command::replay_command;

/// A replay of a recorded simulation.
pub struct ReplayResult {
    /// The recorded simulation.
    pub recorded: Simulation,
    /// The replayed episode.
    pub episode: Episode,
    /// Differences between the run file and what its plan and the replay give. Empty if everything
    /// recorded of the simulation has the same bits.
    pub differences: Vec<String>,
    /// Differences between the recorded build and the present one. Results can differ between
    /// builds.
    pub build_differences: Vec<String>,
}

/// Replays simulation `number` of trial `trial` and compares everything recorded of it, bit for
/// bit.
///
/// A hash in the run file detects accidental damage, but anybody can compute it. So the replay
/// derives what it compares: the header from the plan, seed and scenario from the seed of the run,
/// and the results from the simulation. For a falsification it also derives the other points of the
/// trial, from the recorded results of the earlier simulations.
///
/// `moved` has the present paths of the run's files that were moved; an `Option<&str>` is that of
/// the controller.
///
/// # Errors
/// If the run has no such simulation, its plan cannot be resolved any more, the controller differs
/// from the run's, or the target cannot run the recorded scenario.
pub fn replay<'a>(
    run: &RunFile,
    trial: u32,
    number: u32,
    moved: impl Into<Moved<'a>>,
) -> Result<ReplayResult, MishandleError> {
    replay_with(run, trial, number, &recorded_plan(run.header(), moved)?)
}

/// Replays a simulation as [`replay`] does, with a plan that the caller has resolved.
///
/// # Errors
/// The errors of [`replay`].
pub fn replay_with(
    run: &RunFile,
    trial: u32,
    number: u32,
    resolved: &ResolvedPlan,
) -> Result<ReplayResult, MishandleError> {
    let (mut system, space) = system_of(resolved, trial)?;
    replay_in(run, trial, number, resolved, &mut *system, &space)
}

/// Replays a simulation as [`replay`] does, in a given system of the run's target and space.
pub(crate) fn replay_in(
    run: &RunFile,
    trial: u32,
    number: u32,
    resolved: &ResolvedPlan,
    system: &mut dyn System,
    space: &Space,
) -> Result<ReplayResult, MishandleError> {
    let recorded = run.simulation(trial, number)?;
    let mut differences = same_plan::differences(run.header(), resolved)?;
    differences.extend(trial::differences(run, &recorded, resolved)?);
    let scenario = Scenario::new(recorded.scenario.clone());
    if let Err(error) = space.check(&scenario) {
        differences.push(format!("scenario of simulation {number} of trial {trial}: {error}"));
        return Err(MishandleError::differs(Compared::Plan, differences));
    }
    let mut episodes = system.rollout(&[rows::request(&recorded, resolved.stored_parts > 0)])?;
    let episode = episodes.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
    let mut again = rows::row(&episode, resolved);
    if !keeps_all_traces(resolved) && recorded.trace.is_none() {
        again.trace = None;
    }
    let names = rows::verdict_names(resolved);
    differences.extend(simulation::differences(&recorded, &run.header().verdicts, &again, &names));
    Ok(ReplayResult {
        differences,
        build_differences: build_differences(run.header(), resolved),
        recorded,
        episode,
    })
}

/// Simulates the first recorded simulation of a run again, and lists how it differs. The hash of a
/// target that is not part of this program can miss a part of what it does.
///
/// Returns `None` if the run has no simulation that does the same each time. A time limit depends
/// on the clock.
///
/// # Errors
/// If the run is of another plan, cannot be read, or the simulation cannot be run.
pub fn replay_first(run: &RunFile, resolved: &ResolvedPlan) -> Result<Option<Vec<String>>, MishandleError> {
    same_plan::check(run.header(), resolved)?;
    for recorded in run.simulations() {
        let recorded = recorded?;
        if matches!(recorded.end, SimulationEnd::TimedOut { .. }) {
            continue;
        }
        resolved.space.check(&Scenario::new(recorded.scenario.clone()))?;
        let request = rows::request(&recorded, resolved.stored_parts > 0);
        let episode =
            resolved.system()?.rollout(&[request])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
        let again = Simulation { trace: None, ..rows::row(&episode, resolved) };
        let names = rows::verdict_names(resolved);
        return Ok(Some(simulation::differences(&recorded, &run.header().verdicts, &again, &names)));
    }
    Ok(None)
}

/// Selects a simulation to replay: the first counterexample, or else the simulation with the
/// minimum robustness.
///
/// `trial` and `number` restrict the choice. Returns trial and number, or `None` if no simulation
/// has a robustness.
///
/// # Errors
/// If the run has no such trial, or cannot be read.
pub fn select_simulation(
    run: &RunFile,
    trial: Option<u32>,
    number: Option<u32>,
) -> Result<Option<(u32, u32)>, MishandleError> {
    if let Some(trial) = trial {
        run.trial(trial)?;
    }
    if let Some(number) = number {
        return Ok(Some((trial.unwrap_or(1), number)));
    }
    if run.header().kind == RunKind::Margin
        && trial.is_none()
        && let Some(witness) = smallest_violation(run)?
    {
        return Ok(Some(witness));
    }
    let mut least: Option<Simulation> = None;
    for simulation in run.simulations() {
        let simulation = simulation?;
        if trial.is_some_and(|trial| trial != simulation.trial) {
            continue;
        }
        let Some(rho) = simulation.robustness else { continue };
        if is_violated(rho) {
            return Ok(Some((simulation.trial, simulation.number)));
        }
        if least.as_ref().and_then(|least| least.robustness).is_none_or(|least| rho < least) {
            least = Some(simulation);
        }
    }
    Ok(least.map(|simulation| (simulation.trial, simulation.number)))
}

/// Returns the violation of a margin with the smallest disturbance.
fn smallest_violation(run: &RunFile) -> Result<Option<(u32, u32)>, MishandleError> {
    let axes = run.header().axes.iter().map(recorded_axis).collect();
    let space = Space::new(&run.header().space, axes)?;
    let mut smallest: Option<(Norms, (u32, u32))> = None;
    for simulation in run.simulations() {
        let simulation = simulation?;
        // The second trial repeats the witness with other seeds.
        if simulation.trial > 1 {
            break;
        }
        if !simulation.is_violated() {
            continue;
        }
        let found = norms(&space, &Scenario::new(simulation.scenario));
        // The minimization starts with the same scenario again.
        let is_larger = |than: &Norms| (found.amplitude, found.l1) > (than.amplitude, than.l1);
        if smallest.as_ref().is_none_or(|(least, _)| !is_larger(least)) {
            smallest = Some((found, (simulation.trial, simulation.number)));
        }
    }
    Ok(smallest.map(|(_, found)| found))
}
