//! Conclusions from a random search without a failure about a smooth robustness.

use std::path::Path;

use mishandle_evaluation::{NotSmooth, smooth_region};
use mishandle_falsification::{FalsificationOutcome, unit_scenario};
use mishandle_results::SmoothRegion;
use mishandle_rollout::AxisValues;
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, space_depends_on_seed};
use crate::run::failure_rate_bound;

/// Returns the part of the space in which no scenario fails if the robustness is as smooth as its
/// samples, or why that cannot be said: see
/// [`smooth_region()`](mishandle_evaluation::smooth_region()). `None` if a simulation failed, or
/// the search does not draw uniform samples. `run` is the path of the run file.
///
/// # Errors
/// If the run cannot be read.
pub fn smooth_region_of(
    resolved: &ResolvedPlan,
    outcome: &FalsificationOutcome,
    run: &Path,
) -> Result<Option<SmoothRegion>, MishandleError> {
    if failure_rate_bound(resolved, outcome).is_none() {
        return Ok(None);
    }
    if let Some(reason) = obstacle(resolved) {
        return Ok(Some(refused(reason)));
    }
    let axes = resolved.space.axes();
    let (mut points, mut values) = (Vec::new(), Vec::new());
    let run = RunFile::open(run)?;
    for simulation in run.simulations() {
        let simulation = simulation?;
        let Some(robustness) = simulation.robustness.filter(|rho| rho.is_finite()) else { continue };
        let unit = unit_scenario(axes, &simulation.scenario);
        let free = axes.iter().zip(unit).filter(|(axis, _)| !axis.is_fixed());
        points.push(free.map(|(_, u)| u.unwrap_or(0.5)).collect());
        values.push(robustness);
    }
    Ok(Some(match smooth_region(&points, &values, resolved.plan.seed) {
        Ok(found) => SmoothRegion {
            slope: Some(found.slope),
            largest_slope: Some(found.largest_slope),
            covered: Some(found.covered),
            refusal: None,
        },
        Err(reason) => refused(reason),
    }))
}

fn refused(reason: NotSmooth) -> SmoothRegion {
    SmoothRegion { refusal: Some(reason.to_string()), ..SmoothRegion::default() }
}

/// Returns why the robustness is not a smooth function of the scenario; `None` if it may be one.
fn obstacle(resolved: &ResolvedPlan) -> Option<NotSmooth> {
    let is_discrete =
        |values: &AxisValues| matches!(values, AxisValues::Integer | AxisValues::Categorical(_));
    let axes = resolved.space.axes();
    if space_depends_on_seed(resolved) {
        Some(NotSmooth::Random)
    } else if axes.iter().any(|axis| is_discrete(&axis.values) && !axis.is_fixed()) {
        Some(NotSmooth::DiscreteAxes)
    } else if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.early_stopping) {
        Some(NotSmooth::Bounds)
    } else {
        None
    }
}
