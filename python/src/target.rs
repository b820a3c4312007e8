//! A target whose episodes a Python function simulates.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use mishandle::plan::{FalsifyPlan, Settings};
use mishandle::rollout::{
    Axis, AxisKind, AxisValues, Component, Condition, Distribution, Episode, EpisodeEnd, Holds, Identity,
    NamedFormula, Request, RolloutError, Signal, Space, Specification, SpecificationMonitor, System, Target,
    Verdict,
};
use mishandle::stl::{MonitorError, Trace};
use mishandle::store::ComponentRecord;
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use numpy::PyReadonlyArray2;
use numpy::ndarray::ArrayView2;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde::{Deserialize, Serialize};

use crate::call::Call;
use crate::work::json;
use crate::{InvalidValueError, formula, in_this_process, plain, raised};

/// Name of the space of all axes.
pub(crate) const SPACE: &str = "scenarios";

/// An exception that must end the run, kept while errors of Rust pass it.
pub(crate) type Pending = Arc<Mutex<Option<PyErr>>>;

/// How the formulas see an episode that its target terminated before the last control step.
#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Termination {
    /// The last sample is repeated until the last control step.
    Hold,
    /// The trace is a whole episode.
    Evaluate,
    /// The trace is the start of an episode.
    Undecided,
}

/// An axis as Python passes it.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AxisDocument {
    pub name: String,
    low: f64,
    high: f64,
    unit: String,
    values: Values,
    nominal: Option<f64>,
    kind: String,
    meaning: String,
    /// The fraction of the range below which no random value is.
    #[serde(default)]
    drawn_from: f64,
    /// Other axes by name, and their values with an effect.
    when: Vec<(String, Levels)>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(untagged)]
enum Values {
    Numbers(String),
    Names(Vec<String>),
}

/// Values of another axis with an effect, or the one value without.
#[derive(Clone, Serialize, Deserialize)]
#[serde(untagged)]
enum Levels {
    OneOf(Vec<Level>),
    Except { except: Level },
}

/// A value of another axis: a number, or the name of a category.
#[derive(Clone, FromPyObject, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum Level {
    Number(f64),
    Name(String),
}

/// A system of Python: what is known before its first question.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SystemDocument {
    name: String,
    content: String,
    axes: Vec<AxisDocument>,
    signals: Vec<(String, String)>,
    formulas: Vec<(String, String)>,
    control_dt: f64,
    episode_steps: usize,
    is_deterministic: bool,
    depends_on_seed: bool,
    termination: Termination,
    /// Role, name and hash of each.
    components: Vec<(String, String, String)>,
    not_covered: Vec<String>,
    versions: Vec<(String, String)>,
    random_axes: Vec<String>,
}

/// A target whose episodes a Python function simulates.
#[pyclass(frozen, module = "mishandle._native", name = "Target")]
pub struct PyTarget {
    pub(crate) target: Target,
    /// The plan of the call, with the target and its space.
    pub(crate) plan: Plan,
    pub(crate) settings: Settings,
    pub(crate) space: Space,
    pub(crate) pending: Pending,
    /// Draws pictures of simulations, if the system has pictures.
    pub(crate) painter: Option<Arc<Py<PyAny>>>,
    /// Says where bodies are in simulations, if the system has a scene.
    pub(crate) mover: Option<Arc<Py<PyAny>>>,
    process: u32,
}

#[pymethods]
impl PyTarget {
    /// Makes the target of a system in Python, for a call.
    #[new]
    #[pyo3(signature = (call, system, *, simulate, painter=None, mover=None))]
    fn new(
        call: &str,
        system: &str,
        simulate: Py<PyAny>,
        painter: Option<Py<PyAny>>,
        mover: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let call = Call::read(call)?;
        call.check_keys(&[])?;
        let SystemDocument {
            name,
            content,
            axes,
            signals,
            formulas,
            control_dt,
            episode_steps,
            is_deterministic,
            depends_on_seed,
            termination,
            components,
            not_covered,
            versions,
            random_axes,
        } = serde_json::from_str(system).map_err(plain)?;
        if !(control_dt.is_finite() && control_dt > 0.0) {
            let message = format!("control_dt is {control_dt}; it must be positive and finite, in seconds");
            return Err(InvalidValueError::new_err(message));
        }
        if !(1..=MAX_STEPS).contains(&episode_steps) {
            let message = format!("episode_steps is {episode_steps}; it must be from 1 to {MAX_STEPS}");
            return Err(InvalidValueError::new_err(message));
        }
        let space = space(axes)?;
        let pending = Pending::default();
        let shared =
            Arc::new(Shared { simulate, termination, episode_steps, control_dt, pending: pending.clone() });
        let names: Arc<[String]> = signals.iter().map(|(name, _)| name.clone()).collect();
        let factory =
            move |space: &Space, specification: &Specification| -> Result<Box<dyn System>, RolloutError> {
                Ok(Box::new(PythonSystem {
                    monitor: SpecificationMonitor::new(specification, &names, shared.control_dt)?,
                    requirement: specification.requirement.to_string(),
                    space: space.clone(),
                    names: names.clone(),
                    shared: shared.clone(),
                }))
            };
        let component = |(role, name, hash): (String, String, String)| Component {
            role,
            name,
            hash,
            file_hash: String::new(),
        };
        let uncovered = |name| (ComponentRecord::NOT_COVERED.to_string(), name, String::new());
        let components = components.into_iter().chain(not_covered.into_iter().map(uncovered));
        let target = Target {
            identity: Identity::new("python", &name, &content),
            components: components.map(component).collect(),
            axes: space.axes().to_vec(),
            spaces: vec![space.clone()],
            signals: signals.into_iter().map(|(name, unit)| Signal { name, unit }).collect(),
            formulas: formulas.into_iter().map(|(name, text)| NamedFormula { name, text }).collect(),
            control_dt,
            episode_steps,
            is_deterministic,
            signals_on_request: Vec::new(),
            controller_signals: Vec::new(),
            can_fail: true,
            depends_on_seed: depends_on_seed || !is_deterministic,
            random_axes,
            versions,
            reachable: None,
            factory: Arc::new(factory),
            solver_variants: Vec::new(),
        };
        // The axes have the settings of the call already.
        let plan = Plan {
            target: target.identity.name.clone(),
            space: SPACE.to_string(),
            axes: BTreeMap::new(),
            ..call.plan
        };
        let (painter, mover) = (painter.map(Arc::new), mover.map(Arc::new));
        let made = PyTarget::of_parts(target, plan, call.settings, space, pending);
        Ok(PyTarget { painter, mover, ..made })
    }

    /// Axes of the space. A nominal value of `None` is drawn with the seed of the simulation.
    #[getter]
    fn axes(&self) -> PyResult<String> {
        axes_text(self.space.axes())
    }

    /// Hashes of the target and of its parts.
    #[getter]
    fn hashes(&self) -> Vec<String> {
        let parts = self.target.components.iter().map(|component| component.hash.clone());
        std::iter::once(self.target.identity.hash.clone()).chain(parts).collect()
    }

    /// Name and unit of each signal.
    #[getter]
    fn signals(&self) -> Vec<(String, String)> {
        self.target.all_signals().map(|signal| (signal.name.clone(), signal.unit.clone())).collect()
    }

    /// Name and text of each formula, the requirement first.
    #[getter]
    fn formulas(&self) -> Vec<(String, String)> {
        self.target.formulas.iter().map(|formula| (formula.name.clone(), formula.text.clone())).collect()
    }
}

impl PyTarget {
    /// Makes a target without pictures and scene.
    pub(crate) fn of_parts(
        target: Target,
        plan: Plan,
        settings: Settings,
        space: Space,
        pending: Pending,
    ) -> PyTarget {
        let process = std::process::id();
        PyTarget { target, plan, settings, space, pending, painter: None, mover: None, process }
    }

    /// Returns the plan of single simulations.
    pub(crate) fn simulated(&self) -> Result<ResolvedPlan, Error> {
        let falsify = Some(self.plan.falsify.clone().unwrap_or_default());
        let plan = Plan { falsify, screening: None, ..self.plan.clone().without_questions() };
        ResolvedPlan::with_target(&plan, self.target.clone())
    }

    /// Returns the exception that ended the simulations, once.
    pub(crate) fn take_exception(&self) -> Option<PyErr> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Checks that this process made the target.
    pub(crate) fn check_process(&self) -> PyResult<()> {
        in_this_process(self.process)
    }
}

/// Returns the target that a call names, which this program looks up.
#[pyfunction]
pub fn target(py: Python<'_>, call: &str) -> PyResult<PyTarget> {
    let Call { plan, settings, .. } = Call::read(call)?;
    let resolved = py.detach(|| {
        let falsify = Some(FalsifyPlan::default());
        ResolvedPlan::new(&Plan { falsify, ..plan.clone().without_questions() })
    });
    // Its axes have the settings.
    let ResolvedPlan { target, space, .. } = resolved.map_err(raised)?;
    Ok(PyTarget::of_parts(target, plan, settings, space, Pending::default()))
}

/// Returns whether a system is a target file.
#[pyfunction]
pub fn is_file(system: &str) -> bool {
    mishandle::resolve::is_target_file(system)
}

/// Longest episode, in control steps.
const MAX_STEPS: usize = 10_000_000;

/// Reads axes of Python.
pub(crate) fn axes_from(text: &str) -> PyResult<Vec<AxisDocument>> {
    serde_json::from_str(text).map_err(plain)
}

/// Returns axes as Python reads them.
pub(crate) fn axes_text(axes: &[Axis]) -> PyResult<String> {
    json(&axes.iter().map(document).collect::<Vec<_>>())
}

/// Returns an axis as Python reads it.
pub(crate) fn document(axis: &Axis) -> AxisDocument {
    let values = match &axis.values {
        AxisValues::Continuous => Values::Numbers("continuous".to_string()),
        AxisValues::Logarithmic => Values::Numbers("logarithmic".to_string()),
        AxisValues::Integer => Values::Numbers("integer".to_string()),
        AxisValues::Categorical(names) => Values::Names(names.to_vec()),
    };
    let Axis { name, unit, low, high, nominal, meaning, .. } = axis.clone();
    let levels = |condition: &Condition| match &condition.holds {
        Holds::OneOf(values) => Levels::OneOf(values.iter().copied().map(Level::Number).collect()),
        Holds::Except(value) => Levels::Except { except: Level::Number(*value) },
    };
    let when = axis.conditions.iter().map(|condition| (condition.axis.clone(), levels(condition)));
    let (kind, when) = (axis.kind.name().to_string(), when.collect());
    let drawn_from = match axis.distribution {
        Distribution::Upper(from) => from,
        Distribution::Uniform | Distribution::Normal => 0.0,
    };
    AxisDocument { name, low, high, unit, values, nominal, kind, meaning, drawn_from, when }
}

/// Returns the conditions of an axis in a space of these axes.
fn conditions(axis: &AxisDocument, axes: &[AxisDocument]) -> PyResult<Vec<Condition>> {
    let error = |problem: String| InvalidValueError::new_err(format!("axis `{}` needs {problem}", axis.name));
    let condition = |(name, levels): &(String, Levels)| {
        // Without the other axis nobody could say whether this one has an effect.
        let Some(other) = axes.iter().find(|other| other.name == *name) else {
            return Err(error(format!("the axis `{name}`, which is not among the axes; add it")));
        };
        let number = |level: &Level| match level {
            Level::Number(number) => Ok(*number),
            Level::Name(level) => {
                let index = match &other.values {
                    Values::Names(names) => names.iter().position(|known| known == level),
                    Values::Numbers(_) => None,
                };
                let unknown =
                    || error(format!("the value `{level}` of the axis `{name}`, which has no such value"));
                index.map(|index| other.low + index as f64).ok_or_else(unknown)
            }
        };
        let holds = match levels {
            Levels::Except { except } => Holds::Except(number(except)?),
            Levels::OneOf(values) => {
                Holds::OneOf(values.iter().map(number).collect::<PyResult<Vec<f64>>>()?.into())
            }
        };
        Ok(Condition { axis: name.clone(), nominal: other.nominal.unwrap_or_default(), holds })
    };
    axis.when.iter().map(condition).collect()
}

/// Returns the space of all axes.
pub(crate) fn space(axes: Vec<AxisDocument>) -> PyResult<Space> {
    let made = |given: &AxisDocument| Ok(axis(given.clone())?.only_if(conditions(given, &axes)?));
    let axes = axes.iter().map(made).collect::<PyResult<Vec<Axis>>>()?;
    Space::new(SPACE, axes).map_err(raised)
}

fn axis(given: AxisDocument) -> PyResult<Axis> {
    let AxisDocument { name, low, high, unit, values, nominal, kind, meaning, drawn_from, .. } = given;
    let kinds = AxisKind::ALL;
    let known = || kinds.map(|(_, name)| name).join(", ");
    let (kind, _) = kinds.into_iter().find(|(_, known)| *known == kind).ok_or_else(|| {
        InvalidValueError::new_err(format!(
            "axis `{name}` has the kind `{kind}`; available kinds: {}",
            known()
        ))
    })?;
    let values = match values {
        Values::Names(names) => AxisValues::Categorical(names.into()),
        Values::Numbers(word) => match &*word {
            "logarithmic" => AxisValues::Logarithmic,
            "integer" => AxisValues::Integer,
            _ => AxisValues::Continuous,
        },
    };
    let axis = Axis::new(kind, &name, &unit, [low, high], nominal).with_values(values).meaning(&meaning);
    let distribution =
        if drawn_from == 0.0 { Distribution::Uniform } else { Distribution::Upper(drawn_from) };
    Ok(Axis { distribution, ..axis })
}

/// Facts that all systems of a target share.
struct Shared {
    simulate: Py<PyAny>,
    termination: Termination,
    episode_steps: usize,
    control_dt: f64,
    pending: Pending,
}

struct PythonSystem {
    space: Space,
    names: Arc<[String]>,
    monitor: SpecificationMonitor,
    requirement: String,
    shared: Arc<Shared>,
}

/// A simulation as Python returns it: end, step, index, trace of samples by signals, number of
/// control steps, sum of the rewards, and the reason of the end.
type Outcome<'py> = (String, usize, usize, PyReadonlyArray2<'py, f64>, usize, f64, String);

impl System for PythonSystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        requests.iter().try_for_each(|request| self.space.check(&request.scenario))?;
        let episodes = Python::attach(|py| {
            // Between two batches, so that Ctrl-C works however short a simulation is.
            py.check_signals()?;
            self.simulate(py, requests)
        });
        episodes.map_err(|error: PyErr| keep(&self.shared.pending, error))
    }
}

impl PythonSystem {
    fn simulate(&mut self, py: Python<'_>, requests: &[Request]) -> PyResult<Vec<Episode>> {
        let scenarios = PyList::empty(py);
        let needs_windows = self.shared.termination == Termination::Evaluate;
        for request in requests {
            // Requirement, threshold, and whether an episode that ends early is a whole one.
            let stop = request.stop_threshold.map(|threshold| (&self.requirement, threshold, needs_windows));
            let scenario = scenario(py, &self.space, request.scenario.values())?;
            scenarios.append((scenario, request.seed.0, stop))?;
        }
        let outcomes: Vec<Outcome<'_>> = self.shared.simulate.bind(py).call1((scenarios,))?.extract()?;
        if outcomes.len() != requests.len() {
            let message =
                format!("{} simulations were requested, {} returned", requests.len(), outcomes.len());
            return Err(PyRuntimeError::new_err(message));
        }
        requests.iter().zip(outcomes).map(|(request, outcome)| self.episode(request, &outcome)).collect()
    }

    fn episode(&mut self, request: &Request, outcome: &Outcome<'_>) -> PyResult<Episode> {
        let (end, step, index, samples, steps, total_reward, reason) = outcome;
        let mut end = end_of(end, *step, *index)?;
        let mut trace = trace(&self.names, samples.as_array(), self.shared.episode_steps)?;
        if let Some((sample, index)) = first_not_finite(samples.as_array()) {
            end = EpisodeEnd::InvalidSignal { step: sample, index };
        }
        let is_terminated = matches!(end, EpisodeEnd::Terminated { .. });
        if is_terminated && self.shared.termination == Termination::Hold {
            hold(&mut trace, self.shared.episode_steps);
        }
        // Number of samples of a whole episode, of which the trace can be the start.
        let is_stopped = matches!(end, EpisodeEnd::Stopped { .. });
        let whole = match self.shared.termination {
            Termination::Hold | Termination::Evaluate if !is_stopped => trace.len(),
            _ => self.shared.episode_steps + 1,
        };
        let mut verdict = Verdict::default();
        if end.has_verdict() {
            match self.monitor.verdict(&trace, whole) {
                Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                    end = EpisodeEnd::Undefined { step };
                }
                found => verdict = found.map_err(raised)?,
            }
            if request.needs_parts && verdict.robustness.is_some() {
                verdict.parts = self.monitor.parts(&trace, self.shared.episode_steps + 1).map_err(raised)?;
            }
        }
        Ok(Episode {
            request: request.clone(),
            end,
            reason: reason.clone(),
            steps: *steps,
            verdict,
            total_reward: *total_reward,
            trace,
            trace_digest: None,
        })
    }
}

/// Returns a scenario as a dictionary: a float, an integer or a name for each axis. A draw without
/// a value is absent.
pub(crate) fn scenario<'py>(
    py: Python<'py>,
    space: &Space,
    values: &[Option<f64>],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (axis, value) in space.axes().iter().zip(values) {
        let Some(value) = *value else { continue };
        match &axis.values {
            // The first name is that of the lower bound.
            AxisValues::Categorical(names) => {
                dict.set_item(&axis.name, names.get((value - axis.low) as usize))?;
            }
            AxisValues::Integer => dict.set_item(&axis.name, value as i64)?,
            AxisValues::Continuous | AxisValues::Logarithmic => dict.set_item(&axis.name, value)?,
        }
    }
    Ok(dict)
}

/// Keeps an exception, and returns the error of Rust that ends the run.
pub(crate) fn keep(pending: &Pending, exception: PyErr) -> RolloutError {
    let message = exception.to_string();
    *pending.lock().unwrap_or_else(PoisonError::into_inner) = Some(exception);
    RolloutError::System(message)
}

/// Returns the name of an end, its control step or sample, and its index. [`end_of`] is the
/// inverse.
pub(crate) fn end_parts(end: EpisodeEnd) -> (&'static str, usize, usize) {
    match end {
        EpisodeEnd::Completed => ("completed", 0, 0),
        EpisodeEnd::Terminated { step } => ("terminated", step, 0),
        EpisodeEnd::Stopped { step } => ("stopped", step, 0),
        EpisodeEnd::Diverged { step } => ("diverged", step, 0),
        EpisodeEnd::Undefined { step } => ("undefined", step, 0),
        EpisodeEnd::InvalidAction { step, index } => ("invalid action", step, index),
        EpisodeEnd::InvalidObservation { step, index } => ("invalid observation", step, index),
        EpisodeEnd::InvalidReward { step, index } => ("invalid reward", step, index),
        EpisodeEnd::InvalidSignal { step, index } => ("invalid signal", step, index),
        EpisodeEnd::InvalidScenario => ("invalid scenario", 0, 0),
        EpisodeEnd::Crashed { step } => ("crashed", step, 0),
        EpisodeEnd::TimedOut { step } => ("timed out", step, 0),
    }
}

pub(crate) fn end_of(name: &str, step: usize, index: usize) -> PyResult<EpisodeEnd> {
    Ok(match name {
        "completed" => EpisodeEnd::Completed,
        "terminated" => EpisodeEnd::Terminated { step },
        "stopped" => EpisodeEnd::Stopped { step },
        "diverged" => EpisodeEnd::Diverged { step },
        "undefined" => EpisodeEnd::Undefined { step },
        "invalid signal" => EpisodeEnd::InvalidSignal { step, index },
        "invalid scenario" => EpisodeEnd::InvalidScenario,
        "invalid action" => EpisodeEnd::InvalidAction { step, index },
        "invalid observation" => EpisodeEnd::InvalidObservation { step, index },
        "invalid reward" => EpisodeEnd::InvalidReward { step, index },
        "crashed" => EpisodeEnd::Crashed { step },
        "timed out" => EpisodeEnd::TimedOut { step },
        _ => {
            return Err(InvalidValueError::new_err(format!("unknown end `{name}` of a simulation")));
        }
    })
}

pub(crate) fn trace(
    names: &Arc<[String]>,
    samples: ArrayView2<'_, f64>,
    episode_steps: usize,
) -> PyResult<Trace> {
    let (rows, columns) = samples.dim();
    if rows > 0 && columns != names.len() {
        let message =
            format!("a trace has {columns} signals; expected {}: {}", names.len(), names.join(", "));
        return Err(InvalidValueError::new_err(message));
    }
    if rows > episode_steps + 1 {
        let message = format!(
            "a trace has {rows} samples; an episode of {episode_steps} control steps has at most {}: pass a larger `steps`",
            episode_steps + 1
        );
        return Err(InvalidValueError::new_err(message));
    }
    Ok(formula::trace(names.clone(), samples))
}

fn first_not_finite(samples: ArrayView2<'_, f64>) -> Option<(usize, usize)> {
    samples.indexed_iter().find(|(_, value)| !value.is_finite()).map(|(position, _)| position)
}

/// Repeats the last sample until the last control step.
fn hold(trace: &mut Trace, episode_steps: usize) {
    let signals = trace.names().len();
    let Some(last) = trace.len().checked_sub(1) else { return };
    let sample: Vec<f64> = (0..signals).map(|signal| trace.column(signal)[last]).collect();
    while trace.len() <= episode_steps {
        trace.push(&sample);
    }
}
