//! Axes and scenarios of run files, as results have them.

use mishandle_evaluation::Corners;
use mishandle_results::{AxisFacts, Named, Scenario};
use mishandle_rollout::AxisKind;
use mishandle_store::{AxisRecord, RunHeader, RunKind};

use crate::resolve::axis_facts;
use crate::run::recorded_axis;

/// Describes the axes of a run file.
pub fn recorded_axes(axes: &[AxisRecord]) -> Vec<AxisFacts> {
    let facts = |axis: &AxisRecord| AxisFacts { kind: axis.kind.clone(), ..axis_facts(&recorded_axis(axis)) };
    axes.iter().map(facts).collect()
}

/// Returns a recorded scenario with the names of its axes.
pub fn recorded_scenario(axes: &[AxisRecord], values: &[Option<f64>]) -> Scenario {
    recorded_named(axes, values.iter().copied())
}

/// Returns one value per axis with the names of the axes.
pub(crate) fn recorded_named<T>(axes: &[AxisRecord], values: impl Iterator<Item = T>) -> Named<T> {
    axes.iter().map(|axis| axis.name.clone()).zip(values).collect()
}

/// Returns `corner` or `center` for a simulation at the corners of the initial box, which an
/// evaluation runs in a trial of its own.
pub fn box_point(header: &RunHeader, trial: u32, scenario: &[Option<f64>]) -> Option<&'static str> {
    if header.kind != RunKind::Evaluate || trial != Corners::TRIAL {
        return None;
    }
    let is_between = |(axis, value): (&AxisRecord, &Option<f64>)| {
        let is_numeric = !axis.values.starts_with("categorical");
        let margin = 1e-6 * (axis.high - axis.low);
        let inner = axis.low + margin..axis.high - margin;
        axis.kind == AxisKind::Start.name() && is_numeric && value.is_some_and(|value| inner.contains(&value))
    };
    let is_center = header.axes.iter().zip(scenario).any(is_between);
    Some(if is_center { "center" } else { "corner" })
}
