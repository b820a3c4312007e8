//! The smallest disturbance that makes a Python target fail.

use mishandle::counterexample::Counterexample;
use mishandle::evaluation::Repeats;
use mishandle::plan::MarginPlan;
use mishandle::results::Level;
use mishandle::run::{Answer, Engine, MarginOutcome};
use mishandle::store::RunWriter;
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::artifacts::robustness_of;
use crate::campaign::{Out, estimate, in_run_until, plan, report};
use crate::raised;
use crate::target::{AxisTuple, PyTarget, scenario, space};

/// Checks the settings of a margin in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, budget))]
pub fn check_margin(axes: Vec<AxisTuple>, budget: u64) -> PyResult<()> {
    mishandle::falsification::check_margin(budget, &space(axes)?).map_err(raised)
}

/// Searches for the smallest disturbance that violates the requirement. Returns the outcome as a dictionary, with the exception that
/// ended the search early.
#[pyfunction]
#[pyo3(signature = (target, *, formula, budget, seed, out, progress))]
pub fn margin<'py>(
    py: Python<'py>,
    target: &PyTarget,
    formula: Option<String>,
    budget: u64,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let plan = Plan { margin: Some(MarginPlan { formula, budget }), ..plan(target, seed) };
    let work = |resolved: &ResolvedPlan, run: RunWriter| {
        let path = run.file().path().to_path_buf();
        let answer = mishandle::run::ask(resolved, run, Engine::Direct, &mut |done| {
            report(target, progress.as_ref(), done.simulations, done.max_simulations)
        })?;
        let Answer::Margin(found) = answer else { return Err(Error::MissingPlanTable { table: "margin" }) };
        let witness = found.margin.witness.as_ref().map(|witness| witness.episode.request.clone());
        let counterexample =
            witness.map(|request| Counterexample::simulate(resolved, request)).transpose()?;
        Ok((found, path, counterexample, resolved.specification.requirement.to_string()))
    };
    let ((outcome, path, counterexample, formula), exception) = in_run_until(py, target, &plan, out, work)?;
    let MarginOutcome { margin: found, repeats, .. } = outcome;
    let dict = PyDict::new(py);
    dict.set_item("path", path)?;
    dict.set_item("interruption", exception)?;
    dict.set_item("is_complete", found.is_complete)?;
    dict.set_item("formula", formula)?;
    dict.set_item("simulations", found.simulations)?;
    let level = |level: &Level| {
        let Level {
            amplitude,
            simulations,
            without_verdict,
            minimum_robustness,
            is_violated,
            is_complete,
            is_exhaustive,
        } = *level;
        (amplitude, simulations, without_verdict, minimum_robustness, is_violated, is_complete, is_exhaustive)
    };
    dict.set_item("levels", found.levels.iter().map(level).collect::<Vec<_>>())?;
    let passed = found.largest_without_violation();
    dict.set_item("no_violation_up_to", passed.map(|level| level.amplitude))?;
    dict.set_item("no_violation_simulations", passed.map(|level| level.verdicts()))?;
    let Some(witness) = &found.witness else {
        dict.set_item("witness", py.None())?;
        return Ok(dict);
    };
    let request = &witness.episode.request;
    let fields = PyDict::new(py);
    fields.set_item("amplitude", witness.norms.amplitude)?;
    fields.set_item("l2", witness.norms.l2)?;
    fields.set_item("l1", witness.norms.l1)?;
    fields.set_item("axes", witness.axes)?;
    fields.set_item("scenario", scenario(py, &target.space, request.scenario.values())?)?;
    fields.set_item("seed", request.seed.0)?;
    fields.set_item("robustness", witness.episode.robustness())?;
    fields.set_item("fails_in_most_repeats", repeats.as_ref().map(Repeats::fails_in_most))?;
    let repeats = repeats.map(|Repeats { simulations, failures, failure_rate, quantiles }| {
        (simulations, failures, estimate(&failure_rate), quantiles.map(robustness_of))
    });
    fields.set_item("repeats", repeats)?;
    fields.set_item("counterexample", counterexample.map(|counterexample| counterexample.to_json()))?;
    dict.set_item("witness", fields)?;
    Ok(dict)
}
