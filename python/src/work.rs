//! Work of the library for a Python target: without the interpreter lock, with the exceptions that
//! Python raises meanwhile.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::PoisonError;

use mishandle::plan::EngineChoice;
use mishandle::run::Probes;
use mishandle::store::{RunFile, RunWriter};
use mishandle::{Compared, MishandleError as Error, Plan, ResolvedPlan, RunError};
use pyo3::prelude::*;
use serde::Serialize;

use crate::target::{PyTarget, keep};
use crate::{MishandleError, gpu, raised};

/// Does `work` in a run of a target, which continues that in `path` if it `is_resumed`. Returns its
/// result also if an exception that Python raised meanwhile ended it early, with that exception.
pub(crate) fn in_run<T: Send>(
    py: Python<'_>,
    target: &PyTarget,
    path: Option<PathBuf>,
    is_resumed: bool,
    work: impl FnOnce(&ResolvedPlan, RunWriter, Probes) -> Result<T, Error> + Send,
) -> PyResult<(T, Option<PyErr>)> {
    detached_until(py, target, || {
        let (resolved, run, probes) = open_run(target, path, is_resumed)?;
        work(&resolved, run, probes)
    })
}

/// Creates or opens a run of a target and resolves its plan. Returns also what the probes of a new
/// run cost. The caller has released the
/// interpreter lock.
pub(crate) fn open_run(
    target: &PyTarget,
    path: Option<PathBuf>,
    is_resumed: bool,
) -> Result<(ResolvedPlan, RunWriter, Probes), Error> {
    let PyTarget { settings, .. } = target;
    let mut found = target.target.clone();
    let is_auto = settings.engine.screening == Some(EngineChoice::Auto);
    let plan = match &path {
        // As it was chosen when the run began.
        Some(path) if is_resumed && is_auto => {
            let recorded = Plan::from_toml(&RunFile::open_unchecked(path)?.header().plan)?;
            &Plan { screening: recorded.screening, ..target.plan.clone() }
        }
        _ if is_auto => &faster(target)?,
        _ => &target.plan,
    };
    let (mut run, probes) = match &path {
        Some(path) if is_resumed => {
            let mut run = RunWriter::resume(path)?;
            // The probe of a target that is not deterministic can find no difference by chance.
            found.is_deterministic = run.file().header().target.is_deterministic;
            let resolved = ResolvedPlan::with_target(plan, found.clone())?;
            if settings.engine.any_build {
                mishandle::run::admit_build(&mut run, &resolved)?;
            }
            guard(target, run.file(), &resolved)?;
            (run, Probes::default())
        }
        _ => {
            let resolved = ResolvedPlan::with_target(plan, found.clone())?;
            mishandle::run::create_probed_run(&resolved, path.as_deref())?
        }
    };
    if settings.engine.durable {
        run.set_durable()?;
    }
    Ok((ResolvedPlan::with_target(plan, found)?, run, probes))
}

/// Returns the plan of a target with the engine that is faster, and says which.
fn faster(target: &PyTarget) -> Result<Plan, Error> {
    let resolve = |plan: &Plan| ResolvedPlan::with_target(plan, target.target.clone());
    let watch = |_| report(target, None, 0, 0);
    let device = gpu::device().worlds;
    let found = mishandle::run::with_faster_engine(&resolve, &target.plan, &*device, &watch)?;
    // The exception that ended the measurement is raised.
    let (plan, speeds) = found.ok_or(Error::Run(RunError::NoEpisode))?;
    warn(target, &speeds.text())?;
    Ok(plan)
}

/// Checks that the system of a run to continue does what it did, as far as that can be checked, and
/// warns of the rest.
fn guard(target: &PyTarget, run: &RunFile, resolved: &ResolvedPlan) -> Result<(), Error> {
    let header = run.header();
    let not_covered: Vec<&str> = header
        .components
        .iter()
        .filter(|component| component.is_not_covered())
        .map(|component| component.name.as_str())
        .collect();
    if !header.target.is_deterministic {
        return warn(
            target,
            "the resumed system is not deterministic, so no recorded simulation was repeated to check it: that it is the \
             system of the run is known from the hash of its code and settings only",
        );
    }
    match mishandle::replay::replay_first(run, resolved)? {
        Some(differences) if !differences.is_empty() => Err(Error::differs(Compared::System, differences)),
        Some(_) if !not_covered.is_empty() => warn(
            target,
            &format!(
                "the hash of the resumed system does not cover {}: it was checked by repeating the first recorded simulation, \
                 and not by the others",
                not_covered.join("; ")
            ),
        ),
        _ => Ok(()),
    }
}

/// Warns in Python. A warning can be an exception there.
fn warn(target: &PyTarget, message: &str) -> Result<(), Error> {
    crate::warn(message, 3).map_err(|exception| keep(&target.pending, exception).into())
}

/// Returns the plan of a run with a target.
pub(crate) fn recorded(target: &PyTarget, run: &RunFile) -> Result<ResolvedPlan, Error> {
    let mut found = target.target.clone();
    // The probe of a target that is not deterministic can find no difference by chance.
    found.is_deterministic = run.header().target.is_deterministic;
    ResolvedPlan::with_target(&Plan::from_toml(&run.header().plan)?, found)
}

/// Calls `work` without the interpreter lock. An exception that Python raised meanwhile is raised
/// again.
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

/// Calls `work` without the interpreter lock. Returns its result also if an exception that Python
/// raised meanwhile ended it early, with that exception.
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

/// Returns a result as the JSON text of its document.
pub(crate) fn json(result: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(result).map_err(|error| MishandleError::new_err(error.to_string()))
}

/// Stops at a signal, such as Ctrl-C, whose exception it keeps.
pub(crate) fn signals(exception: &mut Option<PyErr>) -> ControlFlow<()> {
    match Python::attach(|py| py.check_signals().err()) {
        None => ControlFlow::Continue(()),
        Some(raised) => {
            *exception = Some(raised);
            ControlFlow::Break(())
        }
    }
}
