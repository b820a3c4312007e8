//! The probability that a Python target fails.

use std::collections::BTreeMap;

use mishandle::counterexample::Counterexample;
use mishandle::plan::{FalsifyPlan, RiskPlan};
use mishandle::results::Chain;
use mishandle::risk::{Importance, Marginal, Report, Splitting};
use mishandle::rollout::{Axis, Request, Scenario, Seed};
use mishandle::run::{Answer, Engine};
use mishandle::store::RunWriter;
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::campaign::{Out, detached, estimate, in_run_until, plan, report};
use crate::raised;
use crate::target::{AxisTuple, PyTarget, scenario, space};

/// Checks the settings of an estimation in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, simulations, method, batch, distributions))]
pub fn check_risk(
    axes: Vec<AxisTuple>,
    simulations: u64,
    method: String,
    batch: u64,
    distributions: BTreeMap<String, String>,
) -> PyResult<()> {
    let batch = u32::try_from(batch).unwrap_or(u32::MAX);
    let risk = RiskPlan { formula: None, simulations, method, batch, distributions };
    mishandle::resolve::check_risk(&risk, &space(axes)?).map_err(raised)
}

/// Estimates the probability of a violation. Returns the outcome as a dictionary, with the exception that ended the estimation early.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (target, *, formula, simulations, method, batch, distributions, seed, out, progress))]
pub fn risk<'py>(
    py: Python<'py>,
    target: &PyTarget,
    formula: Option<String>,
    simulations: u64,
    method: String,
    batch: u32,
    distributions: BTreeMap<String, String>,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let risk = RiskPlan { formula, simulations, method, batch, distributions };
    let plan = Plan { risk: Some(risk), ..plan(target, seed) };
    let work = |resolved: &ResolvedPlan, run: RunWriter| {
        let path = run.file().path().to_path_buf();
        let scenarios = mishandle::run::risk_scenarios(resolved)?;
        let answer = mishandle::run::ask(resolved, run, Engine::Direct, &mut |done| {
            report(target, progress.as_ref(), done.simulations, done.max_simulations)
        })?;
        let Answer::Risk(found) = answer else { return Err(Error::MissingPlanTable { table: "risk" }) };
        Ok((found, path, scenarios, resolved.specification.requirement.to_string()))
    };
    let ((found, path, scenarios, formula), exception) = in_run_until(py, target, &plan, out, work)?;
    let dict = PyDict::new(py);
    dict.set_item("path", path)?;
    dict.set_item("warnings", scenarios.warnings())?;
    dict.set_item("interruption", exception)?;
    dict.set_item("is_complete", found.is_complete)?;
    dict.set_item("formula", formula)?;
    let distribution = |(axis, marginal): (&Axis, &Marginal)| {
        let text = if axis.is_fixed() { "fixed".to_string() } else { marginal.to_string() };
        (axis.name.clone(), text, axis.low, axis.high, axis.unit.clone())
    };
    dict.set_item("distribution", scenarios.axes().map(distribution).collect::<Vec<_>>())?;
    let failures = PyList::empty(py);
    for failure in &found.failures {
        let values = scenarios.scenario(&failure.draw.latent);
        let named = scenario(py, &target.space, values.values())?;
        let seed = failure.draw.seed.0;
        failures.append((named, failure.number, seed, failure.robustness, values.values().to_vec()))?;
    }
    dict.set_item("failures", failures)?;
    set_parts(&dict, &found)?;
    Ok(dict)
}

/// Adds the answer and the results of the parts.
fn set_parts(dict: &Bound<'_, PyDict>, found: &Report) -> PyResult<()> {
    let Report { answer, monte_carlo, importance, splitting, .. } = found;
    let probability = answer.source.map(|source| {
        let bounds = (answer.estimate.value, answer.estimate.low, answer.estimate.high);
        (bounds, source.name(), mishandle::run::risk_assumption(found))
    });
    dict.set_item("simulations", found.simulations)?;
    dict.set_item("probability", probability)?;
    dict.set_item("bounds", <(f64, f64)>::from(answer.bounds))?;
    dict.set_item("refusals", mishandle::run::risk_refusals(found))?;
    let counts = (monte_carlo.simulations, monte_carlo.failures, monte_carlo.without_verdict);
    let bound = monte_carlo.bound_with_undecided();
    dict.set_item("monte_carlo", (counts, estimate(&monte_carlo.estimate()), bound))?;
    dict.set_item("exploration", found.exploration)?;
    let importance = importance.as_ref().map(|importance| {
        let Importance { fitting, simulations, failures, effective_failures, components, .. } = *importance;
        let counts = (fitting, simulations, failures, effective_failures, components);
        let monte_carlo = (importance.monte_carlo_inside, importance.monte_carlo_outside);
        (counts, estimate(&importance.regions), importance.outside, monte_carlo)
    });
    dict.set_item("importance", importance)?;
    let chain = |chain: &Chain| {
        let Chain { probability, level, is_complete, levels, acceptance } = *chain;
        (probability, level, is_complete, levels, acceptance)
    };
    let splitting = splitting.as_ref().map(|splitting| {
        let Splitting { simulations, population, chains } = splitting;
        let mean = splitting.estimate().ok().map(|mean| estimate(&mean));
        (*simulations, *population, mean, chains.iter().map(chain).collect::<Vec<_>>())
    });
    dict.set_item("splitting", splitting)
}

/// Simulates a scenario that violates the requirement, and returns the text of its counterexample file.
#[pyfunction]
#[pyo3(signature = (target, *, formula, values, seed))]
pub fn simulated_counterexample(
    py: Python<'_>,
    target: &PyTarget,
    formula: Option<String>,
    values: Vec<Option<f64>>,
    seed: u64,
) -> PyResult<String> {
    let falsify = FalsifyPlan { formula, ..FalsifyPlan::default() };
    let plan = Plan { falsify: Some(falsify), ..plan(target, 0) };
    detached(py, target, || {
        let resolved = ResolvedPlan::with_target(&plan, target.target.clone())?;
        let request = Request::new(Scenario::new(values), Seed(seed));
        Ok(Counterexample::simulate(&resolved, request)?.to_json())
    })
}
