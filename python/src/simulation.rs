//! Simulations of chosen scenarios, and replays of recorded ones.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::ResolvedPlan;
use mishandle::counterexample::Counterexample;
use mishandle::falsification::repeat_seeds;
use mishandle::inspect::Simulated;
use mishandle::rollout::{Episode, EpisodeEnd, Scenario, Seed, Space};
use mishandle::store::RunFile;
use numpy::PyArray2;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::target::{PyTarget, scenario};
use crate::work::{detached, json, recorded, report};
use crate::{InvalidValueError, raised, warn};

/// Returns the scenario of some values. Warns of values that have no effect, which become nominal.
fn canonical(target: &PyTarget, values: Vec<Option<f64>>) -> PyResult<Scenario> {
    let given = Scenario::new(values);
    target.space.check(&given).map_err(raised)?;
    for axis in target.space.ineffective(&given) {
        warn(&format!("{} has no effect with the other values of `at`", axis.name), 3)?;
    }
    Ok(target.space.canonical(given))
}

/// Simulates a scenario with `seed`, or several times with seeds that are derived from it. Returns
/// one dictionary per simulation.
#[pyfunction]
#[pyo3(signature = (target, *, values, repeat))]
pub fn simulate<'py>(
    py: Python<'py>,
    target: &PyTarget,
    values: Vec<Option<f64>>,
    repeat: u64,
) -> PyResult<Bound<'py, PyList>> {
    let scenario = canonical(target, values)?;
    let seed = Seed(target.plan.seed);
    let seeds: Vec<Seed> = match repeat {
        1 => vec![seed],
        n => repeat_seeds(seed, n).collect(),
    };
    let simulated = detached(py, target, || {
        let resolved = target.simulated()?;
        mishandle::inspect::simulate(&resolved, &scenario, seeds)
    })?;
    let list = PyList::empty(py);
    for Simulated { episode: found, result, .. } in &simulated {
        let dict = episode(py, &target.space, found)?;
        dict.set_item("document", json(result)?)?;
        list.append(dict)?;
    }
    Ok(list)
}

/// Simulates a scenario with derived seeds, and random scenarios to measure the noise. Returns the
/// document.
#[pyfunction]
#[pyo3(signature = (target, *, values, repeats))]
pub fn repeat(
    py: Python<'_>,
    target: &PyTarget,
    values: Vec<Option<f64>>,
    repeats: Option<u64>,
) -> PyResult<String> {
    let scenario = canonical(target, values)?;
    let scenarios = Some(target.settings.simulate.scenarios.into());
    let watch = |_, _| -> ControlFlow<()> { report(target, None, 0, 0) };
    let found = detached(py, target, || {
        let resolved = target.simulated()?;
        mishandle::run::repeat_scenario(&resolved, &scenario, repeats, scenarios, watch)
    })?;
    json(&found.result)
}

/// A replay: document, simulation, recorded robustness, and differences of the builds.
type Replayed<'py> = (String, Bound<'py, PyDict>, Option<f64>, Vec<String>);

/// Replays a recorded simulation; by default the first counterexample, or else the simulation with
/// the minimum robustness.
#[pyfunction]
#[pyo3(signature = (target, *, path, trial, number))]
pub fn replay<'py>(
    py: Python<'py>,
    target: &PyTarget,
    path: PathBuf,
    trial: Option<u32>,
    number: Option<u32>,
) -> PyResult<Replayed<'py>> {
    let found = detached(py, target, || {
        let run = RunFile::open(&path)?;
        let Some((trial, number)) = mishandle::replay::select_simulation(&run, trial, number)? else {
            return Ok(None);
        };
        let resolved = recorded(target, &run)?;
        let replayed = mishandle::replay::replay_with(&run, trial, number, &resolved)?;
        Ok(Some((replayed.result(&run), replayed)))
    })?;
    let Some((result, replayed)) = found else {
        return Err(InvalidValueError::new_err(
            "no simulation of the run has a robustness; name a trial and a simulation",
        ));
    };
    let found = episode(py, &target.space, &replayed.episode)?;
    Ok((json(&result)?, found, replayed.recorded.robustness, replayed.build_differences))
}

/// Replays a counterexample file.
#[pyfunction]
pub fn replay_counterexample<'py>(
    py: Python<'py>,
    target: &PyTarget,
    path: PathBuf,
) -> PyResult<Replayed<'py>> {
    let (recorded, replayed) = detached(py, target, || {
        let recorded = Counterexample::read(&path)?;
        let resolved = ResolvedPlan::with_target(&recorded.plan, target.target.clone())?;
        let replayed = recorded.replay(&resolved)?;
        Ok((recorded, replayed))
    })?;
    let found = episode(py, &target.space, &replayed.episode)?;
    let robustness = Some(recorded.expected.robustness);
    Ok((json(&replayed.result(&recorded, &path))?, found, robustness, replayed.build_differences))
}

fn episode<'py>(py: Python<'py>, space: &Space, episode: &Episode) -> PyResult<Bound<'py, PyDict>> {
    let Episode { request, end, steps, verdict, total_reward, trace, .. } = episode;
    let dict = PyDict::new(py);
    dict.set_item("scenario", scenario(py, space, request.scenario.values())?)?;
    dict.set_item("seed", request.seed.0)?;
    dict.set_item("end", end_name(*end))?;
    dict.set_item("steps", steps)?;
    dict.set_item("robustness", verdict.robustness)?;
    dict.set_item("total_reward", total_reward)?;
    let shape = (trace.len(), trace.names().len());
    let samples = Array2::from_shape_fn(shape, |(sample, signal)| trace.column(signal)[sample]);
    dict.set_item("samples", PyArray2::from_owned_array(py, samples))?;
    Ok(dict)
}

fn end_name(end: EpisodeEnd) -> String {
    match end {
        EpisodeEnd::Completed => "completed".to_string(),
        EpisodeEnd::Terminated { step } => format!("terminated after control step {step}"),
        EpisodeEnd::Stopped { step } => format!("stopped after control step {step}"),
        EpisodeEnd::Diverged { step } => format!("diverged in control step {step}"),
        EpisodeEnd::Undefined { step } => {
            format!("the formula has no finite value at sample {step}")
        }
        EpisodeEnd::InvalidAction { step, index } => {
            format!("invalid action {index} in control step {step}")
        }
        EpisodeEnd::InvalidObservation { step, index } => {
            format!("invalid observation {index} at sample {step}")
        }
        EpisodeEnd::InvalidReward { step, index } => {
            format!("invalid reward {index} in control step {step}")
        }
        EpisodeEnd::InvalidSignal { step, index } => {
            format!("invalid signal {index} at sample {step}")
        }
        EpisodeEnd::InvalidScenario => "invalid scenario".to_string(),
        EpisodeEnd::Crashed { step } => format!("crashed in control step {step}"),
        EpisodeEnd::TimedOut { step } => format!("timed out in control step {step}"),
    }
}
