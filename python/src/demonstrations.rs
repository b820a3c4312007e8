//! Demonstrations as data sets.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::plan::{EvaluatePlan, GuardPlan, RecordSettings};
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use pyo3::prelude::*;

use crate::target::{SettingArgument, task_plan};
use crate::work::json;
use crate::{InvalidStateError, raised};

/// Records the random simulations of an evaluation as a data set in the new folder `out`. Without
/// cameras, `cameras` is empty. Returns the document.
///
/// Ctrl-C and exceptions of `progress` are raised after the running batch, and nothing is written.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "the arguments are keywords in Python")]
#[pyo3(signature = (
    target, controller, *, preset, space, axes, noise, guard, requirements, seed, episodes, format, relabel,
    cameras, size, only_successful, archive, archive_share, out, progress
))]
pub fn record(
    py: Python<'_>,
    target: &str,
    controller: &str,
    preset: &str,
    space: &str,
    axes: BTreeMap<String, SettingArgument>,
    noise: (bool, f64, f64),
    guard: Option<&str>,
    requirements: BTreeMap<String, String>,
    seed: u64,
    episodes: u64,
    format: String,
    relabel: Option<String>,
    cameras: Vec<String>,
    size: [u16; 2],
    only_successful: bool,
    archive: Option<PathBuf>,
    archive_share: f64,
    out: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let guard = guard.map(GuardPlan::from_toml).transpose().map_err(raised)?;
    let plan = Plan {
        seed,
        guard,
        requirements,
        evaluate: Some(EvaluatePlan { episodes, ..EvaluatePlan::default() }),
        ..task_plan(target, controller, preset, space, axes, noise)
    };
    let settings = RecordSettings {
        format,
        relabel,
        camera: cameras,
        size,
        archive,
        archive_share,
        successful: only_successful,
    };
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
        mishandle::record::record(&resolved, &settings, &out, watch)
    });
    match (found, exception) {
        (_, Some(exception)) => Err(exception),
        (Ok(Some(found)), None) => json(&found),
        (Ok(None), None) => Err(InvalidStateError::new_err("the recording was interrupted")),
        (Err(error), None) => Err(raised(error)),
    }
}
