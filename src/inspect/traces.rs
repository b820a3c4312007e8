//! The traces of simulations of a run: simulated again, or as they are recorded.

use std::ops::ControlFlow;

use mishandle_evaluation::Corners;
use mishandle_rollout::Request;
use mishandle_stl::Trace;
use mishandle_store::{RunFile, RunKind, Simulation};

use crate::error::MishandleError;
use crate::inspect::explanation::trace;
use crate::resolve::ResolvedPlan;
use crate::run::{has_random_rows, rows};

/// Number of simulations per batch.
const BATCH: usize = 64;

/// A simulation by its trial and its number, with its trace.
pub type SimulatedTrace = ((u32, u32), Trace);

/// The traces of a run.
#[derive(Clone, Debug)]
pub struct RandomTraces {
    /// Traces of random simulations.
    pub traces: Vec<SimulatedTrace>,
    /// The number of simulations with a verdict that are not random: the corners and the center of
    /// the initial box, and points that a search, a margin or a screening chose.
    pub left_out: u64,
}

/// Returns the traces of at most `limit` random simulations of a run with a verdict, evenly chosen.
/// They are simulated again with `resolved`; without it, only those with a recorded trace are
/// returned, which are violated ones. `watch` gets the number of traces so far and the number of
/// all; it can end the simulations, of which nothing is then returned: `None`.
///
/// # Errors
/// If the run cannot be read, or a simulation cannot be run.
pub fn random_traces(
    run: &RunFile,
    resolved: Option<&ResolvedPlan>,
    limit: u64,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<RandomTraces>, MishandleError> {
    let header = run.header();
    let has_random_rows = has_random_rows(header);
    let is_random =
        |trial: u32| has_random_rows && (header.kind != RunKind::Evaluate || trial != Corners::TRIAL);
    let mut decided = Vec::new();
    let mut left_out = 0;
    for simulation in run.simulations() {
        let simulation = simulation?;
        if simulation.robustness.is_some() && is_random(simulation.trial) {
            decided.push((simulation.trial, simulation.number));
        } else if simulation.robustness.is_some() {
            left_out += 1;
        }
    }
    let chosen: Vec<Simulation> = evenly(&decided, limit)
        .into_iter()
        .map(|(trial, number)| run.simulation(trial, number))
        .collect::<Result<_, _>>()?;
    let mut traces = Vec::new();
    let is_whole = each_trace(run, resolved, &chosen, |simulation, trace| {
        traces.push(((simulation.trial, simulation.number), trace.clone()));
        Ok(watch(traces.len() as u64, chosen.len() as u64))
    })?;
    Ok(is_whole.is_continue().then_some(RandomTraces { traces, left_out }))
}

/// Calls `each` with the simulations and their traces, until it breaks.
pub(crate) fn each_trace(
    run: &RunFile,
    resolved: Option<&ResolvedPlan>,
    chosen: &[Simulation],
    mut each: impl FnMut(&Simulation, &Trace) -> Result<ControlFlow<()>, MishandleError>,
) -> Result<ControlFlow<()>, MishandleError> {
    let Some(resolved) = resolved else {
        for simulation in chosen {
            let Some(stored) = &simulation.trace else { continue };
            if each(simulation, &trace(run.header(), stored))?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
        return Ok(ControlFlow::Continue(()));
    };
    let mut system = resolved.system()?;
    for batch in chosen.chunks(BATCH) {
        // The whole episode, also of a simulation that was stopped early.
        let whole = |simulation| Request { stop_threshold: None, ..rows::request(simulation, false) };
        let requests: Vec<_> = batch.iter().map(whole).collect();
        for (simulation, episode) in batch.iter().zip(system.rollout(&requests)?) {
            if each(simulation, &episode.trace)?.is_break() {
                return Ok(ControlFlow::Break(()));
            }
        }
    }
    Ok(ControlFlow::Continue(()))
}

/// Returns at most `limit` of the items, evenly spaced.
pub(crate) fn evenly<T: Copy>(items: &[T], limit: u64) -> Vec<T> {
    let n = items.len() as u64;
    let count = n.min(limit);
    // u128, since the product of two u64 can overflow.
    let index = |index: u64| (u128::from(index) * u128::from(n) / u128::from(count.max(1))) as usize;
    (0..count).map(|i| items[index(i)]).collect()
}
