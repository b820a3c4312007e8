//! Recorded simulations with their states, for viewers of others.

use std::path::PathBuf;

use mishandle::MishandleError;
use mishandle::picture::{SceneEpisode, recorded_scene};
use numpy::PyArray2;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::call::settings;
use crate::raised;

/// Simulates a recorded simulation again, and with `nominal` the nominal scenario with its seed.
/// Returns model, signals and episodes as a dictionary.
#[pyfunction]
#[pyo3(signature = (path, call, *, trial, number, nominal))]
pub fn recorded_states<'py>(
    py: Python<'py>,
    path: PathBuf,
    call: &str,
    trial: Option<u32>,
    number: Option<u32>,
    nominal: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let engine = settings(call)?.engine;
    let scene = py.detach(|| recorded_scene(&path, trial, number, engine.moved(), nominal));
    let scene = scene.map_err(raised)?;
    let found = PyDict::new(py);
    let model = py.detach(|| scene.model.compile()).map_err(MishandleError::from).map_err(raised)?;
    found.set_item("model", PyBytes::new(py, &model.binary()))?;
    let resolved = &scene.resolved;
    found.set_item("target", &resolved.target.identity.name)?;
    found.set_item("control_dt", resolved.target.control_dt)?;
    found.set_item("steps", resolved.target.episode_steps)?;
    found.set_item("formula", resolved.specification.requirement.to_string())?;
    found.set_item("place", scene.place)?;
    found.set_item("differences", &scene.differences)?;
    let axes = resolved.space.axes().iter().map(|axis| (axis.name.clone(), axis.unit.clone()));
    found.set_item("axes", axes.collect::<Vec<_>>())?;
    let signals = resolved.signals.iter().map(|signal| (signal.name.clone(), signal.unit.clone()));
    found.set_item("signals", signals.collect::<Vec<_>>())?;
    let episodes: Vec<Bound<'_, PyDict>> =
        scene.episodes.iter().map(|found| episode(py, found)).collect::<PyResult<_>>()?;
    found.set_item("episodes", episodes)?;
    Ok(found)
}

fn episode<'py>(py: Python<'py>, found: &SceneEpisode) -> PyResult<Bound<'py, PyDict>> {
    let SceneEpisode { episode, states } = found;
    let rows = |rows: usize, columns: usize, value: &dyn Fn(usize, usize) -> f64| {
        let array = Array2::from_shape_fn((rows, columns), |(row, column)| value(row, column));
        PyArray2::from_owned_array(py, array)
    };
    let dict = PyDict::new(py);
    let width = states.first().map_or(0, Vec::len);
    dict.set_item("states", rows(states.len(), width, &|row, column| states[row][column]))?;
    let trace = &episode.trace;
    let signals = trace.names().len();
    dict.set_item("trace", rows(trace.len(), signals, &|row, column| trace.column(column)[row]))?;
    dict.set_item("names", trace.names().to_vec())?;
    dict.set_item("scenario", episode.request.scenario.values().to_vec())?;
    dict.set_item("seed", episode.request.seed.0)?;
    dict.set_item("robustness", episode.robustness())?;
    Ok(dict)
}
