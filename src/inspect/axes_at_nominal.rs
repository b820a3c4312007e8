//! Which axis alone removes a failure: the failing simulation again, with each axis alone at its
//! nominal value.

use std::ops::ControlFlow;

use mishandle_falsification::off_nominal;
use mishandle_results::{AxesAtNominal, AxisAtNominal};
use mishandle_rollout::{Axis, Request, Scenario, Space};
use mishandle_stl::is_violated;
use mishandle_store::{RunFile, RunHeader, Simulation, SimulationEnd};
use mishandle_text::decimal;

use crate::error::{MishandleError, RunError};
use crate::inspect::ExplainedSimulation;
use crate::resolve::ResolvedPlan;
use crate::run::{recorded_axis, rows, system_of};

/// Number of simulations per batch.
const BATCH: usize = 8;

/// An axis and its scenario: that of the failure with this axis at nominal.
struct Tried {
    axis: usize,
    scenario: Scenario,
    /// The robustness of its simulation, which may have none; `None` before it was simulated.
    outcome: Option<Option<f64>>,
}

/// Simulates a failure again with each axis alone at its nominal value and the same seed, for at
/// most `limit` axes, those farthest from nominal. Simulations that `run` has already, because it
/// moved its counterexample toward nominal, are taken from it. `resolve` returns the plan of the
/// others, or why it has no plan. The result says so, and also if the failure itself has another
/// robustness now.
///
/// `watch` gets the number of simulations and of all of them. It can end them, and the result is
/// `None` then, as it is if the simulation does not fail or has no axis off nominal.
///
/// # Errors
/// If the run cannot be read or a simulation cannot be run.
pub fn axes_at_nominal(
    run: Option<&RunFile>,
    header: &RunHeader,
    explained: &ExplainedSimulation,
    resolve: impl FnOnce() -> Result<ResolvedPlan, String>,
    limit: u64,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<AxesAtNominal>, MishandleError> {
    let recorded = &explained.recorded;
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let space = Space::new(&header.space, axes)?;
    let mut off = off_nominal(&space, &Scenario::new(recorded.scenario.clone()));
    if limit == 0 || off.is_empty() || !is_violated(explained.explanation.diagnosis.robustness()) {
        return Ok(None);
    }
    let count = off.len();
    off.sort_by(|a, b| distance(&space, recorded, *b).total_cmp(&distance(&space, recorded, *a)));
    off.truncate(usize::try_from(limit).unwrap_or(usize::MAX));
    let known = match run {
        Some(run) => run.derived_simulations(recorded.trial).collect::<Result<Vec<_>, _>>()?,
        None => Vec::new(),
    };
    let mut tried: Vec<Tried> = off.iter().map(|axis| tried(&space, recorded, *axis, &known)).collect();
    let mut found = AxesAtNominal { left_out: (count - off.len()) as u64, ..AxesAtNominal::default() };
    if tried.iter().any(|tried| tried.outcome.is_none()) {
        match resolve() {
            Ok(resolved) => match simulate(&resolved, explained, &mut tried, &mut watch)? {
                ControlFlow::Continue(reason) => found.reason = reason,
                ControlFlow::Break(()) => return Ok(None),
            },
            Err(reason) => found.reason = Some(reason),
        }
    }
    found.axes = tried.iter().filter_map(|tried| described(&space, recorded, tried)).collect();
    let order = |axis: &AxisAtNominal| axis.robustness.map_or(f64::NEG_INFINITY, |robustness| robustness.0);
    found.axes.sort_by(|a, b| order(b).total_cmp(&order(a)));
    Ok(Some(found))
}

/// Returns how far an axis is from nominal, as a fraction of its width.
fn distance(space: &Space, recorded: &Simulation, index: usize) -> f64 {
    let axis = &space.axes()[index];
    let (Some(value), Some(nominal)) = (recorded.scenario[index], axis.nominal) else { return 0.0 };
    (axis.unit_coordinate(value) - axis.unit_coordinate(nominal)).abs()
}

fn tried(space: &Space, recorded: &Simulation, axis: usize, known: &[Simulation]) -> Tried {
    let mut scenario = recorded.scenario.clone();
    scenario[axis] = space.axes()[axis].nominal;
    let scenario = space.canonical(Scenario::new(scenario));
    // A simulation that was stopped early has a bound of the robustness.
    let is_same = |row: &&Simulation| {
        row.seed == recorded.seed
            && !matches!(row.end, SimulationEnd::Stopped { .. })
            && Scenario::new(row.scenario.clone()).is_same(&scenario)
    };
    let outcome = known.iter().find(is_same).map(|row| row.robustness);
    Tried { axis, scenario, outcome }
}

/// Returns an axis with its robustness; `None` if it was not simulated.
fn described(space: &Space, recorded: &Simulation, tried: &Tried) -> Option<AxisAtNominal> {
    let axis = &space.axes()[tried.axis];
    let robustness = tried.outcome?;
    Some(AxisAtNominal {
        axis: axis.name.clone(),
        value: recorded.scenario[tried.axis]?,
        nominal: axis.nominal?,
        robustness: robustness.map(Into::into),
        violated: robustness.map(is_violated),
    })
}

/// Simulates what is not recorded, after the failure itself. Returns why nothing was found out, if
/// so.
fn simulate(
    resolved: &ResolvedPlan,
    explained: &ExplainedSimulation,
    tried: &mut [Tried],
    watch: &mut impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<ControlFlow<(), Option<String>>, MishandleError> {
    let recorded = &explained.recorded;
    let (mut system, _) = system_of(resolved, recorded.trial)?;
    let failure = Request { stop_threshold: None, ..rows::request(recorded, false) };
    let mut missing: Vec<&mut Tried> = tried.iter_mut().filter(|tried| tried.outcome.is_none()).collect();
    let mut done = 1;
    let total = 1 + missing.len() as u64;
    let again = system
        .rollout(std::slice::from_ref(&failure))?
        .pop()
        .ok_or(MishandleError::Run(RunError::NoEpisode))?;
    let recorded_robustness = explained.explanation.diagnosis.robustness();
    let is_whole = !matches!(recorded.end, SimulationEnd::Stopped { .. });
    match again.robustness() {
        Some(found) if is_violated(found) && (!is_whole || found == recorded_robustness) => {}
        found => {
            let found = found.map_or("none".to_string(), |found| decimal(found, 4));
            return Ok(ControlFlow::Continue(Some(format!(
                "simulated again, the failure has the robustness {found} instead of {}",
                decimal(recorded_robustness, 4)
            ))));
        }
    }
    for batch in missing.chunks_mut(BATCH) {
        if watch(done, total).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let request = |tried: &&mut Tried| Request {
            scenario: tried.scenario.clone(),
            unit_point: Vec::new(),
            ..failure.clone()
        };
        let requests: Vec<Request> = batch.iter().map(request).collect();
        for (tried, episode) in batch.iter_mut().zip(system.rollout(&requests)?) {
            tried.outcome = Some(episode.robustness());
        }
        done += batch.len() as u64;
    }
    Ok(ControlFlow::Continue(None))
}
