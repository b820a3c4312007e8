//! Work of the library for a Python target: without the interpreter lock, with the exceptions that
//! Python raises meanwhile.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::PoisonError;

use mishandle::store::{RunFile, RunWriter};
use mishandle::{MishandleError as Error, Plan, ResolvedPlan};
use pyo3::prelude::*;
use serde::Serialize;

use crate::target::PyTarget;
use crate::{MishandleError, raised};

/// Where a run is stored: path, whether to continue the run there, and whether to sync each batch.
pub(crate) type Out = (Option<PathBuf>, bool, bool);

/// Returns the plan of a target with this seed.
pub(crate) fn plan(target: &PyTarget, seed: u64) -> Plan {
    Plan { seed, ..target.plan.clone() }
}

/// Does `work` in a run. Returns its result also if an exception that Python raised meanwhile ended
/// it early, with that exception.
pub(crate) fn in_run<T: Send>(
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
