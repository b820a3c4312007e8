//! Robustness as a function of a point of \[0, 1\]^d, for optimizers outside of this program.

use mishandle::ResolvedPlan;
use mishandle::rollout::{Request, Seed};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::raised;
use crate::target::{PyTarget, scenario};
use crate::work::detached;

/// A target with its requirement.
#[pyclass(frozen, module = "mishandle._native", name = "Objective")]
pub struct Objective {
    target: Py<PyTarget>,
    resolved: ResolvedPlan,
}

#[pymethods]
impl Objective {
    #[new]
    fn new(py: Python<'_>, target: Py<PyTarget>) -> PyResult<Self> {
        let of = target.get();
        let resolved = py.detach(|| of.simulated()).map_err(raised)?;
        Ok(Objective { target, resolved })
    }

    /// Returns the robustness at each point; `None` without a verdict. A simulation ends as soon as
    /// its robustness is certain, or certain to be above `threshold`; then a lower bound above it
    /// is returned.
    fn robustness(
        &self,
        py: Python<'_>,
        points: Vec<Vec<f64>>,
        seed: u64,
        threshold: f64,
    ) -> PyResult<Vec<Option<f64>>> {
        let space = &self.resolved.space;
        let request = |point: &Vec<f64>| Request {
            stop_threshold: Some(threshold),
            ..Request::new(space.at(point), Seed(seed))
        };
        let requests: Vec<Request> = points.iter().map(request).collect();
        let episodes = detached(py, self.target.get(), || Ok(self.resolved.system()?.rollout(&requests)?))?;
        Ok(episodes.iter().map(|episode| episode.verdict.robustness).collect())
    }

    /// Returns the scenario at a point.
    fn scenario<'py>(&self, py: Python<'py>, point: Vec<f64>) -> PyResult<Bound<'py, PyDict>> {
        let space = &self.resolved.space;
        scenario(py, space, space.at(&point).values())
    }
}
