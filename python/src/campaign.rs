//! Falsification, evaluation, replay and simulation of a Python target.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::PoisonError;

use mishandle::counterexample::Counterexample;
use mishandle::evaluation::Estimate;
use mishandle::falsification::{FalsificationOutcome, TrialEnd, TrialOutcome};
use mishandle::plan::{EvaluatePlan, FalsifyPlan};
use mishandle::rollout::{Episode, EpisodeEnd, Request, Scenario, Seed, Space};
use mishandle::search::{OptionValue, SearchOptions};
use mishandle::store::{RunFile, RunWriter};
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use numpy::PyArray2;
use numpy::ndarray::Array2;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::target::{AxisTuple, PyTarget, scenario, space};
use crate::{InvalidValueError, raised};

/// Where a run is stored: path, whether to continue the run there, and whether to sync each batch.
pub(crate) type Out = (Option<PathBuf>, bool, bool);

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

/// Checks the settings of a falsification in the space of these axes, before the system is simulated.
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
    mishandle::resolve::check_falsify(&falsify, &space).map(drop).map_err(raised)
}

/// Checks the settings of an evaluation in the space of these axes, before the system is simulated.
#[pyfunction]
#[pyo3(signature = (axes, *, episodes, batch))]
pub fn check_evaluate(axes: Vec<AxisTuple>, episodes: u64, batch: u64) -> PyResult<()> {
    space(axes)?;
    let batch = u32::try_from(batch).unwrap_or(u32::MAX);
    mishandle::resolve::check_evaluate(&EvaluatePlan { episodes, batch, ..Default::default() })
        .map_err(raised)
}

fn search_options(given: Vec<(String, SearchOption)>) -> SearchOptions {
    let mut options = SearchOptions::new();
    for (name, value) in given {
        options.set(&name, value);
    }
    options
}

/// Searches for counterexamples. Returns the outcome as a dictionary.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (
    target, *, formula, search, options, trials, budget, batch, early_stopping, keep_going, new_mode_rate, seed, out, progress
))]
pub fn falsify<'py>(
    py: Python<'py>,
    target: &PyTarget,
    formula: Option<String>,
    search: String,
    options: Vec<(String, SearchOption)>,
    trials: u32,
    budget: u32,
    batch: u32,
    early_stopping: bool,
    keep_going: bool,
    new_mode_rate: f64,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let falsify = FalsifyPlan {
        formula,
        search,
        trials,
        budget,
        batch,
        early_stopping,
        keep_going,
        new_mode_rate,
        options: search_options(options),
    };
    let plan = Plan { falsify: Some(falsify), ..plan(target, seed) };
    let run = |resolved: &ResolvedPlan, run: RunWriter| {
        let path = run.file().path().to_path_buf();
        let outcome = mishandle::falsify(resolved, run, |done| {
            report(target, progress.as_ref(), done.simulations, done.max_simulations)
        })?;
        Ok((outcome, path))
    };
    let (outcome, path) = in_run(py, target, &plan, out, run)?;
    let dict = campaign(py, &target.space, &outcome)?;
    dict.set_item("path", path)?;
    Ok(dict)
}

/// Simulates random scenarios and the corners of the space. Returns the metrics as a dictionary.
#[pyfunction]
#[pyo3(signature = (target, *, episodes, batch, seed, out, progress))]
pub fn evaluate<'py>(
    py: Python<'py>,
    target: &PyTarget,
    episodes: u64,
    batch: u32,
    seed: u64,
    out: Out,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let evaluate = EvaluatePlan { episodes, batch, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), ..plan(target, seed) };
    let run = |resolved: &ResolvedPlan, run: RunWriter| {
        let path = run.file().path().to_path_buf();
        let total = mishandle::run::evaluation_simulations(resolved);
        let outcome =
            mishandle::evaluate(resolved, run, |done| report(target, progress.as_ref(), done, total))?;
        Ok((outcome, path))
    };
    let (outcome, path) = in_run(py, target, &plan, out, run)?;
    let found = &outcome.report;
    let dict = PyDict::new(py);
    dict.set_item("path", path)?;
    for (name, count) in [
        ("simulations", found.simulations),
        ("diverged", found.diverged),
        ("invalid", found.invalid),
        ("failed", found.failed),
        ("undecided", found.undecided),
    ] {
        dict.set_item(name, count)?;
    }
    dict.set_item("success_rate", estimate(&found.success_rate))?;
    for (name, rate) in [
        ("strict_success_rate", &found.strict_success_rate),
        ("dangerous_behavior_rate", &found.dangerous_behavior_rate),
        ("dangerous_episode_rate", &found.dangerous_episode_rate),
        ("task_completion_time", &found.task_completion_time),
    ] {
        dict.set_item(name, rate.as_ref().map(estimate))?;
    }
    let corners = PyList::empty(py);
    for point in outcome.corners.iter().flat_map(|corners| &corners.points) {
        let corner = PyDict::new(py);
        corner.set_item("scenario", scenario(py, &target.space, point.scenario.values())?)?;
        corner.set_item("simulations", point.n)?;
        corner.set_item("successes", point.successes)?;
        corners.append(corner)?;
    }
    dict.set_item("corners", corners)?;
    Ok(dict)
}

/// Simulates the given scenarios and returns one dictionary per simulation.
#[pyfunction]
#[pyo3(signature = (target, *, formula, scenarios, seeds))]
pub fn simulate<'py>(
    py: Python<'py>,
    target: &PyTarget,
    formula: Option<String>,
    scenarios: Vec<Vec<Option<f64>>>,
    seeds: Vec<u64>,
) -> PyResult<Bound<'py, PyList>> {
    let falsify = FalsifyPlan { formula, ..FalsifyPlan::default() };
    let plan = Plan { falsify: Some(falsify), ..plan(target, 0) };
    let requests: Vec<Request> = scenarios
        .into_iter()
        .zip(seeds)
        .map(|(values, seed)| Request::new(Scenario::new(values), Seed(seed)))
        .collect();
    let episodes = detached(py, target, || {
        let resolved = ResolvedPlan::with_target(&plan, target.target.clone())?;
        Ok(resolved.system()?.rollout(&requests)?)
    })?;
    let list = PyList::empty(py);
    for found in &episodes {
        list.append(episode(py, &target.space, found)?)?;
    }
    Ok(list)
}

/// Replays a recorded simulation; by default the first counterexample, or else the simulation with the minimum robustness.
#[pyfunction]
#[pyo3(signature = (target, *, path, trial, number))]
pub fn replay<'py>(
    py: Python<'py>,
    target: &PyTarget,
    path: PathBuf,
    trial: Option<u32>,
    number: Option<u32>,
) -> PyResult<Bound<'py, PyDict>> {
    let replayed = detached(py, target, || {
        let run = RunFile::open(&path)?;
        let Some((trial, number)) = mishandle::replay::select_simulation(&run, trial, number)? else {
            return Ok(None);
        };
        let mut found = target.target.clone();
        found.is_deterministic = run.header().target.is_deterministic;
        let resolved = ResolvedPlan::with_target(&Plan::from_toml(&run.header().plan)?, found)?;
        mishandle::replay::replay_with(&run, trial, number, &resolved).map(Some)
    })?;
    let Some(replayed) = replayed else {
        return Err(InvalidValueError::new_err(
            "no simulation of the run has a robustness; name a trial and a simulation",
        ));
    };
    let dict = episode(py, &target.space, &replayed.episode)?;
    dict.set_item("trial", replayed.recorded.trial)?;
    dict.set_item("number", replayed.recorded.number)?;
    dict.set_item("recorded_robustness", replayed.recorded.robustness)?;
    dict.set_item("differences", replayed.differences)?;
    dict.set_item("build_differences", replayed.build_differences)?;
    Ok(dict)
}

/// Returns the plan of a target with this seed.
pub(crate) fn plan(target: &PyTarget, seed: u64) -> Plan {
    Plan { seed, ..target.plan.clone() }
}

/// Calls `work` with the plan and its new or continued run, without the interpreter lock.
fn in_run<T: Send>(
    py: Python<'_>,
    target: &PyTarget,
    plan: &Plan,
    out: Out,
    work: impl FnOnce(&ResolvedPlan, RunWriter) -> Result<T, Error> + Send,
) -> PyResult<T> {
    match in_run_until(py, target, plan, out, work)? {
        (_, Some(exception)) => Err(exception),
        (done, None) => Ok(done),
    }
}

/// Does `work` in a run. Returns its result also if an exception that Python raised meanwhile ended it early, with that
/// exception.
pub(crate) fn in_run_until<T: Send>(
    py: Python<'_>,
    target: &PyTarget,
    plan: &Plan,
    (path, is_resumed, is_durable): Out,
    work: impl FnOnce(&ResolvedPlan, RunWriter) -> Result<T, Error> + Send,
) -> PyResult<(T, Option<PyErr>)> {
    detached_until(py, target, || {
        let mut found = target.target.clone();
        let mut run = match &path {
            Some(path) if is_resumed => {
                let run = RunWriter::resume(path)?;
                // The probe of a target that is not deterministic can find no difference by chance.
                found.is_deterministic = run.file().header().target.is_deterministic;
                run
            }
            _ => {
                mishandle::run::create_run(&ResolvedPlan::with_target(plan, found.clone())?, path.as_deref())?
            }
        };
        if is_durable {
            run.set_durable()?;
        }
        work(&ResolvedPlan::with_target(plan, found)?, run)
    })
}

/// Calls `work` without the interpreter lock. An exception that Python raised meanwhile is raised again.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    target: &PyTarget,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<T> {
    match detached_until(py, target, work)? {
        (_, Some(exception)) => Err(exception),
        (done, None) => Ok(done),
    }
}

/// Calls `work` without the interpreter lock. Returns its result also if an exception that Python raised meanwhile ended it early,
/// with that exception.
pub(crate) fn detached_until<T: Send>(
    py: Python<'_>,
    target: &PyTarget,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<(T, Option<PyErr>)> {
    target.check_process()?;
    let done = py.detach(work);
    let pending = target.pending.lock().unwrap_or_else(PoisonError::into_inner).take();
    match (done, pending) {
        (Ok(done), pending) => Ok((done, pending)),
        (Err(_), Some(exception)) => Err(exception),
        (Err(error), None) => Err(raised(error)),
    }
}

/// Reports the progress after a batch. An exception, also of Ctrl-C, ends the run.
pub(crate) fn report(
    target: &PyTarget,
    progress: Option<&Py<PyAny>>,
    done: u64,
    total: u64,
) -> ControlFlow<()> {
    let reported = Python::attach(|py| {
        py.check_signals()?;
        progress.map_or(Ok(()), |progress| progress.call1(py, (done, total)).map(drop))
    });
    match reported {
        Ok(()) => ControlFlow::Continue(()),
        Err(exception) => {
            *target.pending.lock().unwrap_or_else(PoisonError::into_inner) = Some(exception);
            ControlFlow::Break(())
        }
    }
}

/// Value, lower and upper bound, and sample size.
pub(crate) type EstimateFields = (Option<f64>, Option<f64>, Option<f64>, u64);

/// Returns the fields of an estimate.
pub(crate) fn estimate(estimate: &Estimate) -> EstimateFields {
    let Estimate { value, low, high, n } = *estimate;
    (value, low, high, n)
}

fn campaign<'py>(
    py: Python<'py>,
    space: &Space,
    outcome: &FalsificationOutcome,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let trials = PyList::empty(py);
    for found in &outcome.trials {
        trials.append(trial(py, space, found)?)?;
    }
    dict.set_item("trials", trials)?;
    dict.set_item("falsified_trials", outcome.falsified_trials)?;
    dict.set_item("falsification_rate", estimate(&outcome.falsification_rate))?;
    dict.set_item("mean_simulations", outcome.mean_simulations)?;
    dict.set_item("median_simulations", outcome.median_simulations)?;
    for (name, count) in [
        ("simulations", outcome.simulations),
        ("diverged", outcome.diverged),
        ("invalid", outcome.invalid),
        ("failed", outcome.failed),
        ("undecided", outcome.undecided),
    ] {
        dict.set_item(name, count)?;
    }
    Ok(dict)
}

fn trial<'py>(py: Python<'py>, space: &Space, outcome: &TrialOutcome) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let end = match outcome.end {
        None => "interrupted",
        Some(TrialEnd::Falsified) => "falsified",
        Some(TrialEnd::BudgetSpent) => "budget spent",
        Some(TrialEnd::ModesDriedUp) => "modes dried up",
        Some(TrialEnd::SearchEnded(_)) => "search ended",
    };
    dict.set_item("trial", outcome.trial)?;
    dict.set_item("end", end)?;
    dict.set_item("simulations", outcome.simulations)?;
    dict.set_item("first_violation", outcome.first_violation)?;
    let Some(minimum) = &outcome.minimum else { return Ok(dict) };
    dict.set_item("robustness", minimum.robustness)?;
    dict.set_item("scenario", scenario(py, space, minimum.scenario.values())?)?;
    dict.set_item("seed", minimum.seed.0)?;
    dict.set_item("number", minimum.number)?;
    Ok(dict)
}

/// Replays a counterexample file.
#[pyfunction]
pub fn replay_counterexample<'py>(
    py: Python<'py>,
    target: &PyTarget,
    path: PathBuf,
) -> PyResult<Bound<'py, PyDict>> {
    let (recorded, replayed) = detached(py, target, || {
        let recorded = Counterexample::read(&path)?;
        let resolved = ResolvedPlan::with_target(&recorded.plan, target.target.clone())?;
        let replayed = recorded.replay(&resolved)?;
        Ok((recorded, replayed))
    })?;
    let dict = episode(py, &target.space, &replayed.episode)?;
    dict.set_item("trial", recorded.trial)?;
    dict.set_item("number", recorded.simulation)?;
    dict.set_item("recorded_robustness", recorded.expected.robustness)?;
    dict.set_item("differences", replayed.differences)?;
    dict.set_item("build_differences", replayed.build_differences)?;
    Ok(dict)
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
        EpisodeEnd::Undefined { step } => format!("the formula has no finite value at sample {step}"),
        EpisodeEnd::InvalidAction { step, index } => format!("invalid action {index} in control step {step}"),
        EpisodeEnd::InvalidObservation { step, index } => {
            format!("invalid observation {index} at sample {step}")
        }
        EpisodeEnd::InvalidReward { step, index } => format!("invalid reward {index} in control step {step}"),
        EpisodeEnd::InvalidSignal { step, index } => format!("invalid signal {index} at sample {step}"),
        EpisodeEnd::InvalidScenario => "invalid scenario".to_string(),
        EpisodeEnd::Crashed { step } => format!("crashed in control step {step}"),
        EpisodeEnd::TimedOut { step } => format!("timed out in control step {step}"),
    }
}
