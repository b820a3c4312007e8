//! The early stop of simulations that Python steps.

use mishandle::rollout::{EarlyStop, Request, Seed, Specification};
use mishandle::stl::Formula;
use pyo3::prelude::*;

use crate::{plain, raised};

/// The requirement of a running simulation, which ends the simulation when the rest of it does not
/// matter.
#[pyclass(module = "mishandle._native", name = "EarlyStop")]
pub struct PyEarlyStop {
    stop: EarlyStop,
    request: Request,
    threshold: f64,
    /// Whether the trace may only end where it has all bounded windows of the requirement.
    needs_windows: bool,
    /// The number of samples.
    samples: usize,
}

#[pymethods]
impl PyEarlyStop {
    #[new]
    fn new(
        formula: &str,
        signals: Vec<String>,
        control_dt: f64,
        steps: usize,
        threshold: f64,
        needs_windows: bool,
    ) -> PyResult<Self> {
        let specification = Specification::new(Formula::parse(formula).map_err(plain)?);
        let mut stop =
            EarlyStop::new(&specification, &signals.into(), control_dt, steps + 1).map_err(raised)?;
        stop.start();
        let request = Request { stop_threshold: Some(threshold), ..Request::new(Vec::new(), Seed(0)) };
        Ok(PyEarlyStop { stop, request, threshold, needs_windows, samples: 0 })
    }

    /// Adds a sample and returns whether the simulation may end with it.
    fn push(&mut self, sample: Vec<f64>) -> bool {
        self.stop.push(&sample);
        let step = self.samples;
        self.samples += 1;
        step > 0
            && self.request.may_stop_after(step)
            && (!self.needs_windows || self.stop.has_windows())
            && self.stop.can_stop(self.threshold)
    }
}
