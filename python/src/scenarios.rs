//! Scenarios for trainers in Python, with the shares and distributions of training in Rust.

use std::path::PathBuf;

use mishandle::archive::recorded_failures;
use mishandle::plan::AxisSetting;
use mishandle::rollout::{Axis, AxisKind, AxisValues, Scenario, Seed, Space, TrainingScenarios};
use mishandle::training::{ScenarioDraw, ScenarioOrigin, ScenarioSettings};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::target::{axes_from, scenario, space};
use crate::{InvalidValueError, raised};

/// Draws the scenario of each episode.
#[pyclass(frozen, module = "mishandle._native")]
pub struct Scenarios {
    /// All axes, also with faults that show NaN.
    whole: Space,
    draw: ScenarioDraw,
}

#[pymethods]
impl Scenarios {
    /// `archive` are run files, counterexamples and folders of counterexamples, from which the
    /// share `archived` of the episodes is drawn.
    #[new]
    #[pyo3(signature = (axes, *, nominal, corners, archived, archive))]
    fn new(
        py: Python<'_>,
        axes: &str,
        nominal: f64,
        corners: f64,
        archived: f64,
        archive: Vec<PathBuf>,
    ) -> PyResult<Self> {
        let whole = space(axes_from(axes)?)?;
        let given = if archive.is_empty() {
            Vec::new()
        } else {
            py.detach(|| recorded_failures(&archive, &whole, None)).map_err(raised)?
        };
        let settings =
            ScenarioSettings { nominal, corners, file_share: archived, ..ScenarioSettings::default() };
        let scenarios = TrainingScenarios { given, ..TrainingScenarios::of(without_nan(whole.clone())?) };
        Ok(Scenarios { whole, draw: ScenarioDraw::new(scenarios, &settings) })
    }

    /// Returns where the scenario of episode `episode` comes from, its values by name, and the seed
    /// of the episode.
    fn draw<'py>(
        &self,
        py: Python<'py>,
        seed: u64,
        episode: u64,
    ) -> PyResult<(&'static str, Bound<'py, PyDict>, u64)> {
        let seed = Seed(seed).child(episode);
        let (origin, drawn) = self.draw.draw(seed);
        let origin = match origin {
            ScenarioOrigin::Nominal => "nominal",
            ScenarioOrigin::Corner => "corner",
            ScenarioOrigin::Given => "archive",
            ScenarioOrigin::Random => "random",
        };
        Ok((origin, scenario(py, &self.draw.scenarios().space, drawn.values())?, seed.0))
    }

    /// Returns a scenario by name, with the nominal value on each axis that has no effect.
    fn at<'py>(&self, py: Python<'py>, values: Vec<Option<f64>>) -> PyResult<Bound<'py, PyDict>> {
        let given = Scenario::new(values);
        self.whole.check(&given).map_err(raised)?;
        scenario(py, &self.whole, self.whole.canonical(given).values())
    }
}

/// Category of a fault that shows NaN to the policy. No policy can learn from it.
const NAN: &str = "nan";

/// Returns a space without the faults that show NaN to the policy.
fn without_nan(mut space: Space) -> PyResult<Space> {
    let nan = |axis: &Axis| match &axis.values {
        AxisValues::Categorical(names) if axis.kind == AxisKind::Fault => {
            names.iter().position(|name| name == NAN)
        }
        _ => None,
    };
    while let Some((name, low, index)) =
        space.axes().iter().find_map(|axis| Some((axis.name.clone(), axis.low, nan(axis)?)))
    {
        let Some(last) = index.checked_sub(1) else {
            let message = format!(
                "the axis `{name}` always shows NaN to the policy, from which no policy can learn; give it another value"
            );
            return Err(InvalidValueError::new_err(message));
        };
        let setting = AxisSetting::Range([low, low + last as f64]);
        let known = space.axes().to_vec();
        space =
            mishandle::resolve::with_settings(space, &[(name, setting)].into(), &known).map_err(raised)?;
    }
    Ok(space)
}
