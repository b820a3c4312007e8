//! The subject of a plan as a result: target, controller, noise and scenario space.

use mishandle_results::{AxisFacts, AxisValues, Named, NeededAxis, Scenario, Seed, Subject};
use mishandle_rollout as rollout;
use mishandle_simulators::SIMULATOR;

use crate::resolve::ResolvedPlan;
use crate::resolve::guard::guard_facts;

impl ResolvedPlan {
    /// Returns what the question of the plan is about.
    pub fn subject(&self) -> Subject {
        let ResolvedPlan { plan, target, space, .. } = self;
        let controller = target.components.iter().find(|component| component.role != SIMULATOR);
        let axes = space.axes();
        let set = axes.iter().filter(|axis| plan.axes.contains_key(&axis.name));
        Subject {
            target: plan.target.clone(),
            task: plan.target.clone(),
            target_kind: target.identity.kind.clone(),
            target_hash: target.identity.hash.clone(),
            preset: controller.is_some().then(|| plan.preset.clone()),
            controller: controller.map(|controller| controller.name.clone()),
            controller_given: Some(plan.controller.clone()).filter(|controller| !controller.is_empty()),
            controller_hash: controller.map(|controller| controller.hash.clone()),
            guard: plan.guard.as_ref().map(guard_facts),
            stochastic: plan.stochastic,
            action_noise: plan.action_noise,
            observation_noise: plan.observation_noise,
            seed: Seed(plan.seed),
            space: plan.space.clone(),
            axes: axes.iter().map(|axis| axis.name.clone()).collect(),
            space_axes: axes.iter().map(axis_facts).collect(),
            set_axes: set.map(|axis| axis.name.clone()).collect(),
            control_dt: target.control_dt,
            episode_steps: target.episode_steps as u64,
        }
    }
}

/// Describes an axis.
pub fn axis_facts(axis: &rollout::Axis) -> AxisFacts {
    AxisFacts {
        name: axis.name.clone(),
        kind: axis.kind.name().to_string(),
        unit: axis.unit.clone(),
        low: axis.low,
        high: axis.high,
        nominal: axis.nominal,
        values: match &axis.values {
            rollout::AxisValues::Continuous => AxisValues::Kind("continuous".to_string()),
            rollout::AxisValues::Logarithmic => AxisValues::Kind("logarithmic".to_string()),
            rollout::AxisValues::Integer => AxisValues::Kind("integer".to_string()),
            rollout::AxisValues::Categorical(names) => AxisValues::Categories(names.to_vec()),
        },
        only_if: Some(axis.conditions.iter().map(needed).collect())
            .filter(|needed: &Vec<_>| !needed.is_empty()),
    }
}

fn needed(condition: &rollout::Condition) -> NeededAxis {
    let (one_of, other_than) = match &condition.holds {
        rollout::Holds::OneOf(values) => (Some(values.to_vec()), None),
        rollout::Holds::Except(value) => (None, Some(*value)),
    };
    NeededAxis { axis: condition.axis.clone(), one_of, other_than }
}

/// Returns a scenario with the names of its axes.
pub fn named_scenario(axes: &[rollout::Axis], values: &[Option<f64>]) -> Scenario {
    Named(axes.iter().map(|axis| axis.name.clone()).zip(values.iter().copied()).collect())
}
