//! Simulation of recorded plans by other processes: requests go out and episodes come back through
//! a Python function.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use mishandle::campaign::{CampaignRun, campaign_runs as runs_in};
use mishandle::harden::HardenProgress;
use mishandle::rollout::{
    Episode, Request, RolloutError, Scenario, Seed, Space, Specification, System, Target, Verdict,
};
use mishandle::run::{CONTROL_TRIAL, Engine, Opening, system_of};
use mishandle::stl::{Trace, Vacuity};
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use numpy::ndarray::Array2;
use numpy::{PyArray2, PyReadonlyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::target::{Pending, end_of, end_parts, keep, trace};
use crate::{InvalidStateError, raised};

/// A simulation to run: scenario, seed, and whether the parts of the robustness are needed.
type RequestTuple = (Vec<Option<f64>>, u64, bool, Option<f64>);

/// Robustness of requirement, success, strict and careful success, dangerous steps, completion
/// step, the parts, the other requirements, and the codes of why each asks nothing.
type VerdictTuple = (
    Option<f64>,
    Option<f64>,
    Option<f64>,
    Option<f64>,
    Option<usize>,
    Option<usize>,
    Vec<f64>,
    Vec<Option<f64>>,
    (u8, Vec<u8>),
);

/// An episode: end, step, index, number of control steps, verdict, sum of the rewards, digest of
/// the trace, and the samples of a counterexample.
type EpisodeTuple<S> = (String, usize, usize, usize, VerdictTuple, f64, u128, Option<S>);

/// Simulates requests of a plan in this process.
#[pyclass(frozen, module = "mishandle._native", name = "PlanWorker")]
pub struct PlanWorker {
    resolved: ResolvedPlan,
    pool: ThreadPool,
}

#[pymethods]
impl PlanWorker {
    /// Rebuilds the target of a plan. `hashes` are those of the target and its components.
    #[new]
    fn new(py: Python<'_>, plan: &str, hashes: Vec<String>, threads: usize) -> PyResult<Self> {
        let resolved = py.detach(|| ResolvedPlan::new(&Plan::from_toml(plan)?)).map_err(raised)?;
        let found = target_hashes(&resolved.target);
        if found != hashes {
            return Err(InvalidStateError::new_err(format!(
                "the target `{}` has the hashes {found:?} on this worker, {hashes:?} where the run is stored: install the same \
                 version of Mishandle, and give every worker the same files of controller and target",
                resolved.target.identity.name
            )));
        }
        Ok(PlanWorker { resolved, pool: pool_of(threads)? })
    }

    /// Simulates a batch. Only counterexamples have samples, because a run file contains no others.
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        requests: Vec<RequestTuple>,
    ) -> PyResult<Vec<EpisodeTuple<Bound<'py, PyArray2<f64>>>>> {
        let requests: Vec<Request> = requests
            .into_iter()
            .map(|(values, seed, needs_parts, stop_threshold)| Request {
                needs_parts,
                stop_threshold,
                ..Request::new(Scenario::new(values), Seed(seed))
            })
            .collect();
        // Only the control arm can be outside of the space, whose axes may be narrowed.
        let is_inside = |request: &Request| self.resolved.space.check(&request.scenario).is_ok();
        let trial = if requests.iter().all(is_inside) { 1 } else { CONTROL_TRIAL };
        let simulate = || Ok::<_, Error>(system_of(&self.resolved, trial)?.0.rollout(&requests)?);
        let episodes = py.detach(|| self.pool.install(simulate)).map_err(raised)?;
        Ok(episodes.iter().map(|episode| sent(py, episode)).collect())
    }
}

fn pool_of(threads: usize) -> PyResult<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

fn target_hashes(target: &Target) -> Vec<String> {
    let components = target.components.iter().map(|component| component.hash.clone());
    std::iter::once(target.identity.hash.clone()).chain(components).collect()
}

fn sent<'py>(py: Python<'py>, episode: &Episode) -> EpisodeTuple<Bound<'py, PyArray2<f64>>> {
    let Episode { end, steps, verdict, total_reward, trace, .. } = episode;
    let (end, step, index) = end_parts(*end);
    let columns = (0..trace.names().len()).map(|signal| trace.column(signal));
    let digest = mishandle::store::trace_digest(columns);
    let samples = episode.is_violated().then(|| {
        let shape = (trace.len(), trace.names().len());
        let samples = Array2::from_shape_fn(shape, |(sample, signal)| trace.column(signal)[sample]);
        PyArray2::from_owned_array(py, samples)
    });
    let parts = verdict.parts.clone();
    let Verdict { robustness, success, strict, careful, dangerous_steps, completion_step, .. } = *verdict;
    let others = verdict.others.clone();
    let codes = verdict.other_vacuities.iter().copied().map(Vacuity::code).collect();
    let vacuities = (Vacuity::code(verdict.vacuity), codes);
    let verdict =
        (robustness, success, strict, careful, dangerous_steps, completion_step, parts, others, vacuities);
    (end.to_string(), step, index, *steps, verdict, *total_reward, digest, samples)
}

/// A system whose episodes come from a Python function of a list of requests.
struct RemoteSystem {
    space: Space,
    shared: Arc<Shared>,
}

struct Shared {
    simulate: Py<PyAny>,
    names: Arc<[String]>,
    episode_steps: usize,
    pending: Pending,
}

impl System for RemoteSystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let sent: Vec<RequestTuple> = requests
            .iter()
            .map(|request| {
                let Request { scenario, seed, needs_parts, stop_threshold, .. } = request;
                (scenario.values().to_vec(), seed.0, *needs_parts, *stop_threshold)
            })
            .collect();
        let episodes = Python::attach(|py| {
            py.check_signals()?;
            let found: Vec<EpisodeTuple<PyReadonlyArray2<'_, f64>>> =
                self.shared.simulate.bind(py).call1((sent,))?.extract()?;
            if found.len() != requests.len() {
                let message =
                    format!("{} simulations were requested, {} returned", requests.len(), found.len());
                return Err(PyRuntimeError::new_err(message));
            }
            requests.iter().zip(found).map(|(request, found)| self.received(request, found)).collect()
        });
        episodes.map_err(|error: PyErr| keep(&self.shared.pending, error))
    }
}

impl RemoteSystem {
    fn received(
        &self,
        request: &Request,
        found: EpisodeTuple<PyReadonlyArray2<'_, f64>>,
    ) -> PyResult<Episode> {
        let (end, step, index, steps, verdict, total_reward, digest, samples) = found;
        let Shared { names, episode_steps, .. } = &*self.shared;
        let trace = match &samples {
            Some(samples) => trace(names, samples.as_array(), *episode_steps)?,
            None => Trace::new(names.clone()),
        };
        let (
            robustness,
            success,
            strict,
            careful,
            dangerous_steps,
            completion_step,
            parts,
            others,
            vacuities,
        ) = verdict;
        let (vacuity, codes) = vacuities;
        Ok(Episode {
            request: request.clone(),
            end: end_of(&end, step, index)?,
            steps,
            verdict: Verdict {
                robustness,
                success,
                strict,
                careful,
                dangerous_steps,
                completion_step,
                parts,
                others,
                vacuity: Vacuity::from_code(vacuity),
                other_vacuities: codes.into_iter().map(Vacuity::from_code).collect(),
            },
            reason: String::new(),
            total_reward,
            trace,
            trace_digest: Some(digest),
        })
    }
}

/// Completes a run of the campaign in a folder. `simulate` simulates a list of requests.
///
/// Returns whether the run is complete.
#[pyfunction]
#[pyo3(signature = (folder, name, *, simulate, durable, any_build, progress))]
pub fn complete_run(
    py: Python<'_>,
    folder: PathBuf,
    name: String,
    simulate: Py<PyAny>,
    durable: bool,
    any_build: bool,
    progress: Py<PyAny>,
) -> PyResult<bool> {
    let pending = Pending::default();
    let kept = pending.clone();
    let done = py.detach(|| {
        let (run, mut resolved) = run_of(&folder, &name)?.resume(Opening { durable, any_build })?;
        let shared = Arc::new(Shared {
            simulate,
            names: resolved.signal_names(),
            episode_steps: resolved.target.episode_steps,
            pending: kept.clone(),
        });
        resolved.target.factory =
            Arc::new(move |space: &Space, _: &Specification| -> Result<Box<dyn System>, RolloutError> {
                Ok(Box::new(RemoteSystem { space: space.clone(), shared: shared.clone() }))
            });
        let mut is_complete = true;
        let mut report = |done: u64, total: u64| {
            let flow = report(&kept, &progress, done, total);
            is_complete &= flow.is_continue();
            flow
        };
        mishandle::run::ask(&resolved, run, Engine::Direct, &mut |done| {
            report(done.simulations, done.max_simulations)
        })?;
        Ok::<_, Error>(is_complete)
    });
    match pending.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take() {
        Some(exception) => Err(exception),
        None => done.map_err(raised),
    }
}

/// Returns the run of the campaign in a folder with this name.
fn run_of(folder: &Path, name: &str) -> Result<CampaignRun, Error> {
    let known = runs_in(folder)?;
    let unknown =
        || Error::UnknownName { kind: "run of the campaign", name: name.to_string(), known: Vec::new() };
    known.into_iter().find(|run| run.name == name).ok_or_else(unknown)
}

/// Time between two looks for a signal.
const PATIENCE: Duration = Duration::from_millis(50);

/// Completes a hardening of the campaign in a folder, in this process. Returns the number of its
/// simulations. A signal ends it: what was recorded remains.
#[pyfunction]
#[pyo3(signature = (folder, name, *, threads, durable, any_build))]
pub fn complete_hardening(
    py: Python<'_>,
    folder: PathBuf,
    name: String,
    threads: usize,
    durable: bool,
    any_build: bool,
) -> PyResult<u64> {
    let pool = pool_of(threads)?;
    let is_stopped = AtomicBool::new(false);
    let mut watch = |_: &HardenProgress| {
        if is_stopped.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let harden = || run_of(&folder, &name)?.harden(Opening { durable, any_build }, None, &mut watch);
    let mut exception = None;
    // Only the calling thread sees signals.
    let found = py.detach(|| {
        std::thread::scope(|scope| {
            let work = scope.spawn(|| pool.install(harden));
            while !work.is_finished() {
                if let Some(error) = Python::attach(|py| py.check_signals().err()) {
                    is_stopped.store(true, Ordering::Relaxed);
                    exception = Some(error);
                }
                std::thread::sleep(PATIENCE);
            }
            work.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(Some(found)), None) => Ok(found.simulations),
        (Ok(None), None) => Err(InvalidStateError::new_err("the hardening was interrupted")),
        (Err(error), None) => Err(raised(error)),
    }
}

/// Reports the progress after a batch. The function returns whether to continue; an exception ends
/// the run as well.
fn report(pending: &Pending, progress: &Py<PyAny>, done: u64, total: u64) -> ControlFlow<()> {
    let continues = Python::attach(|py| {
        py.check_signals()?;
        progress.call1(py, (done, total))?.extract::<bool>(py)
    });
    match continues {
        Ok(true) => ControlFlow::Continue(()),
        Ok(false) => ControlFlow::Break(()),
        Err(exception) => {
            keep(pending, exception);
            ControlFlow::Break(())
        }
    }
}

/// Creates the folder of a campaign from the text of its file. Returns for each run its name, its
/// run file or the folder of its hardening, and whether it is a hardening.
#[pyfunction]
pub fn create_campaign(py: Python<'_>, text: &str, folder: PathBuf) -> PyResult<Vec<NamedRun>> {
    named(py.detach(|| mishandle::campaign::create_campaign(text, &folder)))
}

/// Returns the same for each run of the campaign in a folder.
#[pyfunction]
pub fn campaign_runs(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<NamedRun>> {
    named(py.detach(|| runs_in(&folder)))
}

/// Name, path, and whether it is a hardening.
type NamedRun = (String, PathBuf, bool);

fn named(runs: Result<Vec<CampaignRun>, Error>) -> PyResult<Vec<NamedRun>> {
    let named = |run: CampaignRun| {
        let is_hardening = run.is_hardening();
        (run.name, run.path, is_hardening)
    };
    Ok(runs.map_err(raised)?.into_iter().map(named).collect())
}

/// Returns the plan of a run file, and the hashes of its target and components.
#[pyfunction]
pub fn recorded_plan(py: Python<'_>, path: PathBuf) -> PyResult<(String, Vec<String>)> {
    let found = py.detach(|| {
        let run = mishandle::store::RunFile::open(&path)?;
        let header = run.header();
        let components = header.components.iter().map(|component| component.hash.clone());
        let hashes = std::iter::once(header.target.hash.clone()).chain(components).collect();
        Ok::<_, Error>((header.plan.clone(), hashes))
    });
    found.map_err(raised)
}
