//! Whether simulations depend on their seeds.

use mishandle_rollout::{Axis, Scenario};

use crate::resolve::ResolvedPlan;

/// Returns whether two simulations of `scenario` with different seeds can differ.
pub fn depends_on_seed(resolved: &ResolvedPlan, scenario: &Scenario) -> bool {
    depends_on_seed_at_nominal(resolved)
        || scenario.values().contains(&None)
        || random_values(resolved).any(|(place, nominal)| scenario.get(place) != nominal)
}

/// Returns whether two simulations with different seeds can differ although every axis that adds
/// randomness is at its nominal value.
pub(crate) fn depends_on_seed_at_nominal(resolved: &ResolvedPlan) -> bool {
    let ResolvedPlan { plan, target, .. } = resolved;
    target.depends_on_seed
        || !target.is_deterministic
        || plan.stochastic
        || plan.action_noise > 0.0
        || plan.observation_noise > 0.0
}

/// Returns whether two simulations of a scenario of the plan's space with different seeds can
/// differ.
pub fn space_depends_on_seed(resolved: &ResolvedPlan) -> bool {
    depends_on_seed(resolved, &resolved.space.nominal()) || random_values(resolved).next().is_some()
}

/// Returns the index in the space and the nominal value of each axis that adds randomness.
fn random_values(resolved: &ResolvedPlan) -> impl Iterator<Item = (usize, Option<f64>)> {
    let is_off = |axis: &Axis| axis.is_fixed() && Some(axis.low) == axis.nominal;
    let is_random = move |axis: &Axis| resolved.target.random_axes.contains(&axis.name) && !is_off(axis);
    let axes = resolved.space.axes().iter().enumerate();
    axes.filter(move |(_, axis)| is_random(axis)).map(|(i, axis)| (i, axis.nominal))
}
