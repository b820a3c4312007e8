//! Guards of policies in Python: the monitor and the switch; Python has the policies.

use mishandle::guard::{Switch, Watch};
use mishandle::plan::GuardPlan;
use mishandle::resolve::guard_monitor;
use pyo3::prelude::*;

use crate::{InvalidValueError, raised};

/// The monitor and the switch of a guard in one simulation.
#[pyclass(module = "mishandle._native")]
pub struct GuardMonitor {
    watch: Watch,
    switch: Switch,
    state: Vec<f64>,
    quantities: usize,
    /// Control steps for which the fallback has acted without a break.
    steps: usize,
}

#[pymethods]
impl GuardMonitor {
    /// `settings` are the keys of a guard as TOML, `period` is the control period (s).
    #[new]
    fn new(settings: &str, quantities: Vec<String>, period: f64, steps: usize) -> PyResult<GuardMonitor> {
        let plan = GuardPlan::from_toml(settings).map_err(raised)?;
        let (watch, switch) = guard_monitor(&plan, &quantities, period, steps).map_err(raised)?;
        let state = vec![0.0; watch.state_size()];
        let mut monitor = GuardMonitor { watch, switch, state, quantities: quantities.len(), steps: 0 };
        monitor.reset();
        Ok(monitor)
    }

    /// Starts an episode.
    fn reset(&mut self) {
        self.watch.reset(&mut self.state);
        self.steps = 0;
    }

    /// Takes a control step; returns whether the fallback acts, whether it has just taken over, and
    /// the robustness that decided it.
    fn step(&mut self, quantities: Vec<f64>, is_usable: bool) -> PyResult<(bool, bool, f64)> {
        if quantities.len() != self.quantities {
            let found = quantities.len();
            let expected = self.quantities;
            let message = format!("the guard has {expected} quantities, and the observation {found} numbers");
            return Err(InvalidValueError::new_err(message));
        }
        let robustness = self.watch.push(&mut self.state, |index| quantities[index]);
        let is_active = self.switch.is_active(self.steps, robustness, is_usable);
        let takes_over = is_active && self.steps == 0;
        self.steps = if is_active { self.steps + 1 } else { 0 };
        Ok((is_active, takes_over, robustness))
    }

    /// Whether the policy may get the control back, so that it must still be asked.
    #[getter]
    fn needs_action(&self) -> bool {
        self.steps == 0 || self.switch.has_way_back()
    }
}
