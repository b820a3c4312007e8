//! Reports, survival curves, counterexample files and regression tests of Python systems.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::counterexample::Counterexample;
use mishandle::evaluation::{Lifetime, Repeats, SurvivalCurve};
use mishandle::results::Quantile;
use mishandle::rollout::{Scenario, Seed, Space};
use mishandle::store::RunFile;
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use mishandle_report::{Measurement, RunReport, page};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::campaign::{EstimateFields, detached, estimate};
use crate::raised;
use crate::target::PyTarget;

/// Returns a report of a run as HTML, measured with the target.
#[pyfunction]
pub fn report(py: Python<'_>, target: &PyTarget, path: PathBuf, probes: u32) -> PyResult<String> {
    detached(py, target, || {
        let run = RunFile::open(&path)?;
        let mut found = target.target.clone();
        found.is_deterministic = run.header().target.is_deterministic;
        let resolved = ResolvedPlan::with_target(&Plan::from_toml(&run.header().plan)?, found)?;
        let mut report = RunReport::load(&run, &path.to_string_lossy())?;
        report.add_answer_of(&run, &resolved)?;
        let measured = report.measure_with(&run, &resolved, probes, |_, _| ControlFlow::Continue(()))?;
        if let Measurement::Skipped { reason } = &measured {
            report.note_no_simulations(reason);
        }
        Ok(page(&[report]))
    })
}

/// Summarizes robustness values of one scenario: numbers of simulations and failures, failure rate and quantiles.
#[pyfunction]
pub fn repeat_report(robustness: Vec<Option<f64>>) -> (u64, u64, EstimateFields, Option<Vec<f64>>) {
    let Repeats { simulations, failures, failure_rate, quantiles } =
        mishandle::evaluation::repeats(&robustness);
    (simulations, failures, estimate(&failure_rate), quantiles.map(robustness_of))
}

/// Returns the values of quantiles.
pub(crate) fn robustness_of(quantiles: Vec<Quantile>) -> Vec<f64> {
    quantiles.into_iter().map(|quantile| quantile.robustness.0).collect()
}

/// Steps of a survival curve, numbers of simulations at which trials were censored, and number of trials.
type Survival = (Vec<(u32, f64)>, Vec<u32>, usize);

/// Returns the survival curve of the trials of a run.
#[pyfunction]
pub fn survival(py: Python<'_>, path: PathBuf) -> PyResult<Survival> {
    let lifetimes = || Ok(RunReport::load(&RunFile::open(&path)?, "")?.lifetimes());
    let lifetimes: Vec<Lifetime> = py.detach(lifetimes).map_err(|error: Error| raised(error))?;
    let curve = SurvivalCurve::new(&lifetimes);
    let steps = std::iter::once((0, 1.0))
        .chain(curve.steps.iter().map(|step| (step.simulations, curve.at(step.simulations))))
        .chain([(curve.last, curve.at(curve.last))]);
    let censored = lifetimes.iter().filter(|life| !life.failed).map(|life| life.simulations);
    Ok((steps.collect(), censored.collect(), lifetimes.len()))
}

/// Returns a failing simulation of a run as the text of a counterexample file.
#[pyfunction]
pub fn counterexample(py: Python<'_>, path: PathBuf, trial: u32, number: u32) -> PyResult<String> {
    let read = || Ok(Counterexample::from_run(&RunFile::open(&path)?, trial, number)?.to_json());
    py.detach(read).map_err(|error: Error| raised(error))
}

/// Simulates a counterexample file with a target, and `repeats` times with other seeds.
#[pyfunction]
pub fn regress<'py>(
    py: Python<'py>,
    target: &PyTarget,
    path: PathBuf,
    repeats: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let (recorded, found) = detached(py, target, || {
        let recorded = Counterexample::read(&path)?;
        let plan = Plan { seed: 0, ..recorded.plan.clone() };
        let resolved = ResolvedPlan::with_target(&plan, target.target.clone())?;
        let found = mishandle::counterexample::regress_with(&recorded, &resolved, repeats, |_| {
            ControlFlow::Continue(())
        })?;
        Ok((recorded, found))
    })?;
    let dict = PyDict::new(py);
    dict.set_item("recorded_robustness", recorded.expected.robustness)?;
    dict.set_item("robustness", found.episode.robustness())?;
    dict.set_item("sentences", found.explained.explanation.sentences(found.header.control_dt))?;
    dict.set_item("same_target", found.has_other_target == Some(false))?;
    dict.set_item("failure_rate", found.repeats.as_ref().map(|repeats| estimate(&repeats.failure_rate)))?;
    let scenario = crate::target::scenario(py, &target.space, &values(&recorded, &target.space)?)?;
    dict.set_item("scenario", scenario)?;
    dict.set_item("seed", Seed(recorded.seed).0)?;
    Ok(dict)
}

/// Returns the scenario of a counterexample in the order of the axes.
fn values(recorded: &Counterexample, space: &Space) -> PyResult<Vec<Option<f64>>> {
    recorded.scenario_in(space).map(|scenario: Scenario| scenario.values().to_vec()).map_err(raised)
}
