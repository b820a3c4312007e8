//! Hardening of the controller of a task.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::MishandleError as Error;
use mishandle::harden::{FinalRun, HardenProgress, final_runs, finished, harden_folder, resume_plan};
use mishandle::store::RunFile;
use mishandle_cli::words::shell_command;
use mishandle_report::{HardenedModes, hardening_page};
use pyo3::prelude::*;

use crate::call::Call;
use crate::run::{Contents, NOT_SIMULATED, contents_of, run_report};
use crate::work::json;
use crate::{InvalidStateError, gpu, raised};

/// Hardens the controller of the task that a call names, or continues to. Returns the document.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch. What was recorded
/// remains, so that the hardening can continue.
#[pyfunction]
#[pyo3(signature = (call, *, out, resume, progress))]
pub fn harden(
    py: Python<'_>,
    call: &str,
    out: PathBuf,
    resume: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let Call { plan, .. } = Call::read(call)?;
    let device = gpu::device();
    let mut exception = None;
    let mut watch = |done: &HardenProgress| match report(progress.as_ref(), done) {
        Ok(()) => ControlFlow::Continue(()),
        Err(error) => {
            exception = Some(error);
            ControlFlow::Break(())
        }
    };
    let found = py.detach(|| {
        if resume {
            resume_plan(&harden_folder(&out), &plan, Some(&device), &mut watch)
        } else {
            mishandle::harden::harden(&plan, &out, Some(&device), &mut watch)
        }
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(Some(found)), None) => {
            Ok((json(&found)?, mishandle_cli::verdict_text(&mishandle::verdict::hardening(&found))))
        }
        (Ok(None), None) => Err(InvalidStateError::new_err("the hardening was interrupted")),
        (Err(error), None) => Err(raised(error)),
    }
}

/// Reports the phase, its finished part, and the whole.
fn report(progress: Option<&Py<PyAny>>, done: &HardenProgress) -> PyResult<()> {
    Python::attach(|py| {
        py.check_signals()?;
        let arguments = (&done.phase, done.done, done.all);
        progress.map_or(Ok(()), |progress| progress.call1(py, arguments).map(drop))
    })
}

/// Returns the report of a finished hardening as HTML.
#[pyfunction]
pub fn hardening_report(py: Python<'_>, folder: PathBuf, call: &str) -> PyResult<String> {
    let contents = contents_of(call)?;
    let found = finished(&folder).map_err(raised)?.ok_or_else(|| {
        InvalidStateError::new_err("the hardening is not finished; continue it with `resume=True`")
    })?;
    let made = || -> Result<String, Error> {
        let runs = final_runs(&folder, &found);
        let reports = runs.iter().map(|FinalRun { run, controller }| {
            run_report(&RunFile::open(run)?, Some(&controller.to_string_lossy()), contents)
        });
        let failures = match contents {
            None => HardenedModes::skipped(NOT_SIMULATED),
            Some(Contents { has_replay, .. }) => {
                HardenedModes::simulate(&folder, &found, has_replay, || false).unwrap_or_default()
            }
        };
        Ok(hardening_page(&found, &failures, &reports.collect::<Result<Vec<_>, _>>()?, None, shell_command))
    };
    py.detach(made).map_err(raised)
}
