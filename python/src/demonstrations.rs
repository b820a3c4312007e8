//! Demonstrations as data sets.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::ResolvedPlan;
use mishandle::store::RunKind;
use pyo3::prelude::*;

use crate::call::Call;
use crate::work::json;
use crate::{InvalidStateError, raised};

/// Records the random simulations of an evaluation as a data set in the new folder `out`. Returns
/// the document.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch, and nothing is written.
#[pyfunction]
#[pyo3(signature = (call, *, out, progress))]
pub fn record(py: Python<'_>, call: &str, out: PathBuf, progress: Option<Py<PyAny>>) -> PyResult<String> {
    let Call { mut plan, settings, .. } = Call::read(call)?;
    let episodes = plan.evaluate.get_or_insert_default().episodes;
    let mut exception = None;
    let watch = |done: u64| {
        let reported = Python::attach(|py| {
            py.check_signals()?;
            progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, (done, episodes)).map(drop))
        });
        match reported {
            Ok(()) => ControlFlow::Continue(()),
            Err(error) => {
                exception = Some(error);
                ControlFlow::Break(())
            }
        }
    };
    let found = py.detach(|| {
        let resolved = ResolvedPlan::new(&plan.only(RunKind::Evaluate))?;
        mishandle::record::record(&resolved, &settings.record, &out, watch)
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(Some(found)), None) => json(&found),
        (Ok(None), None) => Err(InvalidStateError::new_err("the recording was interrupted")),
        (Err(error), None) => Err(raised(error)),
    }
}
