//! The questions about a Python target: evaluation, falsification, margin and failure probability.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use mishandle::plan::{
    EvaluatePlan, FalsifyPlan, MarginPlan, MetamorphicPlan, RelationPlan, RiskPlan, Until,
};
use mishandle::run::Engine;
use mishandle::search::{OptionValue, SearchOptions};
use mishandle::store::RunWriter;
use mishandle::{Plan, ResolvedPlan};
use pyo3::prelude::*;

use crate::target::{AxisTuple, PyTarget, space};
use crate::work::{Out, in_run, json, plan, report};
use crate::{InvalidValueError, raised};

/// Value of an option of a search.
#[derive(FromPyObject)]
pub enum SearchOption {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Point(Vec<f64>),
    Points(Vec<Vec<f64>>),
}

impl From<SearchOption> for OptionValue {
    fn from(value: SearchOption) -> OptionValue {
        match value {
            SearchOption::Boolean(value) => OptionValue::Boolean(value),
            SearchOption::Integer(value) => OptionValue::Integer(value),
            SearchOption::Float(value) => OptionValue::Float(value),
            SearchOption::Text(value) => OptionValue::Text(value),
            SearchOption::Point(value) => OptionValue::Point(value),
            SearchOption::Points(value) => OptionValue::Points(value),
        }
    }
}

/// Checks the settings of a falsification in the space of these axes, before the system is
/// simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, search, options, trials, budget, batch, new_mode_rate))]
pub fn check_falsify(
    axes: Vec<AxisTuple>,
    search: String,
    options: Vec<(String, SearchOption)>,
    trials: u64,
    budget: u64,
    batch: u64,
    new_mode_rate: f64,
) -> PyResult<()> {
    let space = space(axes)?;
    // A number that does not fit is out of the range, too.
    let [trials, budget, batch] =
        [trials, budget, batch].map(|number| u32::try_from(number).unwrap_or(u32::MAX));
    let options = search_options(options);
    let falsify = FalsifyPlan { search, trials, budget, batch, new_mode_rate, options, ..Default::default() };
    mishandle::resolve::check_falsify(&falsify, &space).map_err(raised)
}

/// Checks the settings of an evaluation in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, episodes, batch, until, rate))]
pub fn check_evaluate(
    axes: Vec<AxisTuple>,
    episodes: u64,
    batch: u64,
    until: Option<String>,
    rate: Option<f64>,
) -> PyResult<()> {
    space(axes)?;
    let batch = u32::try_from(batch).unwrap_or(u32::MAX);
    let until = rule(until)?;
    let evaluate = EvaluatePlan { episodes, batch, until, rate, ..Default::default() };
    mishandle::resolve::check_evaluate(&evaluate).map_err(raised)
}

/// Reads a rule that ends simulations.
pub(crate) fn rule(text: Option<String>) -> PyResult<Option<Until>> {
    let read = |text: String| {
        text.parse().map_err(|problem| InvalidValueError::new_err(format!("until: {problem}")))
    };
    text.map(read).transpose()
}

fn search_options(given: Vec<(String, SearchOption)>) -> SearchOptions {
    let mut options = SearchOptions::new();
    for (name, value) in given {
        options.set(&name, value);
    }
    options
}

/// Checks the settings of a margin in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, budget))]
pub fn check_margin(axes: Vec<AxisTuple>, budget: u64) -> PyResult<()> {
    mishandle::falsification::check_margin(budget, &space(axes)?).map_err(raised)
}

/// A relation of Python: its name, the changes of axes by name, and the relation of the results.
type RelationTuple = (String, BTreeMap<String, String>, String);

fn metamorphic_plan(
    relations: Vec<RelationTuple>,
    pairs: u64,
    batch: u64,
    formula: Option<String>,
) -> MetamorphicPlan {
    let relation = |(name, change, holds)| (name, RelationPlan { holds, change });
    let batch = u32::try_from(batch).unwrap_or(u32::MAX);
    MetamorphicPlan { formula, pairs, batch, relations: relations.into_iter().map(relation).collect() }
}

/// Checks relations in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, relations, pairs, batch, seed))]
pub fn check_metamorphic(
    axes: Vec<AxisTuple>,
    relations: Vec<RelationTuple>,
    pairs: u64,
    batch: u64,
    seed: u64,
) -> PyResult<()> {
    let space = space(axes)?;
    let known = space.axes().to_vec();
    let table = metamorphic_plan(relations, pairs, batch, None);
    mishandle::resolve::check_metamorphic(&table, space, &known, seed).map_err(raised)
}

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

/// The document of an answer, the exception that ended the question early, and warnings.
type Answered = (String, Option<PyErr>, Vec<String>);

/// Searches for counterexamples.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (
    target, *, formula, search, options, trials, budget, batch, fixed_seed, early_stopping, keep_going, new_mode_rate, isolate, repeats,
    seed,    out, progress
))]
pub fn falsify(
    py: Python<'_>,
    target: &PyTarget,
    formula: Option<String>,
    search: String,
    options: Vec<(String, SearchOption)>,
    trials: u32,
    budget: u32,
    batch: u32,
    fixed_seed: Option<u64>,
    early_stopping: bool,
    keep_going: bool,
    new_mode_rate: f64,
    isolate: Option<bool>,
    repeats: Option<u64>,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let mut falsify = FalsifyPlan {
        formula,
        search,
        trials,
        budget,
        batch,
        fixed_seed,
        early_stopping,
        keep_going,
        new_mode_rate,
        isolate,
        options: search_options(options),
    };
    falsify.isolate_by_default();
    let plan = Plan { falsify: Some(falsify), ..plan(target, seed) };
    ask(py, target, &plan, out, repeats, progress)
}

/// Simulates random scenarios and the corners of the space.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (target, *, episodes, batch, until, rate, control, seed, out, progress))]
pub fn evaluate(
    py: Python<'_>,
    target: &PyTarget,
    episodes: u64,
    batch: u32,
    until: Option<String>,
    rate: Option<f64>,
    control: bool,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let until = rule(until)?;
    let evaluate = EvaluatePlan { episodes, batch, until, rate, control, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), ..plan(target, seed) };
    ask(py, target, &plan, out, None, progress)
}

/// Searches for the smallest disturbance that violates the requirement.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (target, *, formula, budget, each_category, seed, out, progress))]
pub fn margin(
    py: Python<'_>,
    target: &PyTarget,
    formula: Option<String>,
    budget: u64,
    each_category: bool,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let margin = MarginPlan { formula, budget, each_category };
    let plan = Plan { margin: Some(margin), ..plan(target, seed) };
    ask(py, target, &plan, out, None, progress)
}

/// Compares pairs of scenarios.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (target, *, formula, relations, pairs, batch, seed, out, progress))]
pub fn metamorphic(
    py: Python<'_>,
    target: &PyTarget,
    formula: Option<String>,
    relations: Vec<RelationTuple>,
    pairs: u64,
    batch: u64,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let metamorphic = metamorphic_plan(relations, pairs, batch, formula);
    let plan = Plan { metamorphic: Some(metamorphic), ..plan(target, seed) };
    ask(py, target, &plan, out, None, progress)
}

/// Estimates the probability of a violation.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (target, *, formula, simulations, method, batch, distributions, seed, out, progress))]
pub fn risk(
    py: Python<'_>,
    target: &PyTarget,
    formula: Option<String>,
    simulations: u64,
    method: String,
    batch: u32,
    distributions: BTreeMap<String, String>,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let risk = RiskPlan { formula, simulations, method, batch, distributions };
    let plan = Plan { risk: Some(risk), ..plan(target, seed) };
    ask(py, target, &plan, out, None, progress)
}

/// Asks the question of a plan. `repeats` are those of the counterexamples of a falsification.
fn ask(
    py: Python<'_>,
    target: &PyTarget,
    plan: &Plan,
    out: Out,
    repeats: Option<u64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answered> {
    let work = |resolved: &ResolvedPlan, run: RunWriter| {
        let is_new = run.file().counts()?.simulations == 0;
        let mut warnings = if is_new { run.file().header().preflight.clone() } else { Vec::new() };
        if plan.risk.is_some() {
            warnings.extend(mishandle::run::risk_scenarios(resolved)?.warnings());
        }
        let mut answer = mishandle::run::ask(resolved, run, Engine::Direct, &mut |done| {
            report(target, progress.as_ref(), done.simulations, done.max_simulations)
        })?;
        // The progress is that of the question; its repeats can be interrupted, too.
        let watch = |_, _| -> ControlFlow<()> { report(target, None, 0, 0) };
        mishandle::inspect::further(resolved, &mut answer, repeats, watch)?;
        Ok((answer, warnings))
    };
    let ((answer, warnings), exception) = in_run(py, target, plan, out, work)?;
    Ok((json(&answer)?, exception, warnings))
}
