//! Conclusions from a random search without a failure about a smooth robustness.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle_evaluation::{NotSmooth, smooth_region};
use mishandle_falsification::unit_scenario;
use mishandle_results::{Falsification, SmoothRegion};
use mishandle_rollout::{AxisValues, Request, RolloutError};
use mishandle_stl::{Clock, Formula, Monitor, Trace};
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, space_depends_on_seed};
use crate::run::recorded_episode;

/// Most samples that are used. They are simulated again for their traces.
const MOST: usize = 1000;

/// Number of simulations of a batch.
const BATCH: usize = 64;

/// Returns the part of the space in which no scenario fails if each predicate of the requirement is
/// as smooth as its samples, or why that cannot be said: see
/// [`smooth_region()`](mishandle_evaluation::smooth_region()). `None` if a simulation failed, or
/// the search does not draw uniform samples. `run` is the path of the run file.
///
/// A run file has no traces of simulations that do not fail, so up to 1000 of them are simulated
/// again. `watch` gets the number of finished ones and of all, and can end them.
///
/// # Errors
/// If the run cannot be read, or a simulation cannot be run.
pub(super) fn smooth_region_of(
    resolved: &ResolvedPlan,
    found: &Falsification,
    run: &Path,
    watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<SmoothRegion>, MishandleError> {
    if found.failure_rate_bound.is_none() {
        return Ok(None);
    }
    if let Some(reason) = obstacle(resolved) {
        return Ok(Some(refused(reason)));
    }
    let axes = resolved.space.axes();
    let mut points = Vec::new();
    let mut requests = Vec::new();
    let run = RunFile::open(run)?;
    for simulation in run.simulations() {
        let simulation = simulation?;
        if simulation.robustness.is_none_or(|rho| !rho.is_finite()) {
            continue;
        }
        let unit = unit_scenario(axes, &simulation.scenario);
        let free = axes.iter().zip(unit).filter(|(axis, _)| !axis.is_fixed());
        points.push(free.map(|(_, u)| u.unwrap_or(0.5)).collect());
        requests.push(recorded_episode(&simulation).request);
        if points.len() == MOST {
            break;
        }
    }
    let Some(traces) = traces(resolved, &requests, watch)? else {
        return Ok(Some(refused(NotSmooth::Interrupted)));
    };
    let parts = Parts::new(resolved, &traces)?;
    let scaled = |factors: &[f64]| parts.robustness(factors);
    Ok(Some(match smooth_region(&points, &parts.values, scaled, resolved.plan.seed) {
        Ok(found) => {
            let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
            SmoothRegion {
                slope: Some(largest(&found.slopes)),
                largest_slope: Some(largest(&found.largest_slopes)),
                predicates: Some(found.slopes.len() as u64),
                covered: Some(found.covered),
                refusal: None,
            }
        }
        Err(reason) => refused(reason),
    }))
}

/// Simulates again. Returns the traces; `None` after an interruption.
fn traces(
    resolved: &ResolvedPlan,
    requests: &[Request],
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<Vec<Trace>>, MishandleError> {
    let mut system = resolved.system()?;
    let mut traces = Vec::with_capacity(requests.len());
    for batch in requests.chunks(BATCH) {
        traces.extend(system.rollout(batch)?.into_iter().map(|episode| episode.trace));
        if watch(traces.len() as u64, requests.len() as u64).is_break() {
            return Ok(None);
        }
    }
    Ok(Some(traces))
}

/// The requirement as a formula over the values of its predicates.
struct Parts {
    skeleton: Formula,
    clock: Clock,
    /// For each predicate and each simulation, the values over time.
    values: Vec<Vec<Vec<f64>>>,
}

impl Parts {
    fn new(resolved: &ResolvedPlan, traces: &[Trace]) -> Result<Parts, MishandleError> {
        let clock = Clock::steps(resolved.target.control_dt);
        let (skeleton, predicates) = resolved.specification.requirement.skeleton();
        let signals = resolved.signal_names();
        let of = |predicate: &Formula| -> Result<Vec<Vec<f64>>, RolloutError> {
            let error = |source| RolloutError::Monitor { formula: predicate.to_string(), source };
            let mut monitor = Monitor::new(predicate, &signals, clock).map_err(error)?;
            let mut values = |trace| monitor.robustness_signal(trace).map(<[f64]>::to_vec).map_err(error);
            traces.iter().map(&mut values).collect()
        };
        let values = predicates.iter().map(of).collect::<Result<_, _>>()?;
        Ok(Parts { skeleton, clock, values })
    }

    /// Returns the robustness of each simulation with the predicates multiplied by factors; `None`
    /// if the trace of one does not decide it.
    fn robustness(&self, factors: &[f64]) -> Option<Vec<f64>> {
        let names: Vec<String> = self.skeleton.signals().into_iter().map(String::from).collect();
        let mut monitor = Monitor::new(&self.skeleton, &names, self.clock).ok()?;
        let simulations = self.values.first().map_or(0, Vec::len);
        let of = |simulation: usize| {
            let samples = self.values[0][simulation].len();
            let mut trace = Trace::with_capacity(names.clone().into(), samples);
            for sample in 0..samples {
                let scaled = |(values, factor): (&Vec<Vec<f64>>, &f64)| values[simulation][sample] * factor;
                trace.push(&self.values.iter().zip(factors).map(scaled).collect::<Vec<_>>());
            }
            monitor.decided_robustness_signal(&trace).ok()?.first().copied()
        };
        (0..simulations).map(of).collect()
    }
}

fn refused(reason: NotSmooth) -> SmoothRegion {
    SmoothRegion { refusal: Some(reason.to_string()), ..SmoothRegion::default() }
}

/// Returns why the robustness is not a smooth function of the scenario; `None` if it may be one.
fn obstacle(resolved: &ResolvedPlan) -> Option<NotSmooth> {
    let is_discrete =
        |values: &AxisValues| matches!(values, AxisValues::Integer | AxisValues::Categorical(_));
    let axes = resolved.space.axes();
    if space_depends_on_seed(resolved) {
        Some(NotSmooth::Random)
    } else if axes.iter().any(|axis| is_discrete(&axis.values) && !axis.is_fixed()) {
        Some(NotSmooth::DiscreteAxes)
    } else if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.early_stopping) {
        Some(NotSmooth::Bounds)
    } else {
        None
    }
}
