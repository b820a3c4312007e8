use mishandle_rollout::Space;
use mishandle_store::{RunHeader, RunKind};

use crate::plan::Plan;
use crate::resolve::search::{coordinates, new_search};
use crate::run::recorded_axis;

/// Returns whether the simulations of a run are random scenarios of its space. Only then do they
/// tell which axes have an effect: points that a search, a margin or a screening chose lie where
/// earlier results were low, whatever the reason.
pub fn has_random_rows(header: &RunHeader) -> bool {
    let Ok(plan) = Plan::from_toml(&header.plan) else { return false };
    match (header.kind, &plan.falsify) {
        _ if plan.screening.is_some() => false,
        (RunKind::Evaluate, _) => true,
        (RunKind::Falsify, Some(falsify)) => {
            let axes = header.axes.iter().map(recorded_axis).collect();
            let Ok(space) = Space::new(&header.space, axes) else { return false };
            new_search(falsify, &coordinates(&space))(0).is_ok_and(|search| search.samples_uniformly())
        }
        _ => false,
    }
}
