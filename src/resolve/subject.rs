//! The subject of a plan as a result: target, controller, noise and scenario space.

use mishandle_results::{AxisFacts, AxisValues, Named, NeededAxis, Offered, Scenario, Seed, Subject};
use mishandle_rollout as rollout;
use mishandle_simulators::SIMULATOR;
use mishandle_stl::Formula;
use mishandle_text::number_text;

use crate::resolve::guard::guard_facts;
use crate::resolve::{ResolvedPlan, depends_on_seed_at_nominal, has_scene, shipped_file};

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
            offered: Some(self.offered()),
        }
    }

    /// Returns what the target has besides the question.
    fn offered(&self) -> Offered {
        let ResolvedPlan { plan, target, .. } = self;
        let text = |text: &str| Formula::parse(text).map_or(text.to_string(), |formula| formula.to_string());
        Offered {
            spaces: target.spaces.iter().map(|space| space.name().to_string()).collect(),
            formulas: target.formulas.iter().map(|f| (f.name.clone(), text(&f.text))).collect(),
            is_random: depends_on_seed_at_nominal(self),
            random_axes: target.random_axes.clone(),
            can_harden: has_scene(&target.identity.kind) && shipped_file(plan).is_ok(),
        }
    }
}

/// Returns the nominal scenario in words. It has values where the plan sets a range that may
/// exclude the nominal value of the target: `the nominal scenario of this space (x = 0.96 m)`.
pub fn nominal_scenario(subject: &Subject) -> String {
    match nominal_values(subject.moved_axes()) {
        values if values.is_empty() => "the nominal scenario".to_string(),
        values => format!("the nominal scenario of this space ({values})"),
    }
}

/// Returns the nominal values of axes, such as `x = 0.96 m, k = 0.3`.
pub fn nominal_values<'a>(axes: impl Iterator<Item = &'a AxisFacts>) -> String {
    let text = |axis: &AxisFacts| {
        let nominal = axis.nominal?;
        let value = match &axis.values {
            AxisValues::Categories(names) => names.get((nominal - axis.low) as usize)?.clone(),
            AxisValues::Kind(_) => number_text(nominal),
        };
        Some(format!("{} = {value} {}", axis.name, axis.unit).trim_end().to_string())
    };
    axes.filter_map(text).collect::<Vec<_>>().join(", ")
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{AxisSetting, Plan};

    /// Each axis with another range or value: if its nominal value moves, the words name it.
    #[test]
    fn the_nominal_scenario_has_each_value_that_the_plan_moves() {
        let plan = |axes: &[(&str, AxisSetting)]| {
            let axes = axes.iter().map(|(name, setting)| ((*name).to_string(), setting.clone())).collect();
            let plan = Plan { axes, ..Plan::new("toy/car-following", "") };
            ResolvedPlan::new(&Plan { space: "dynamics+events+starts".to_string(), ..plan }).unwrap()
        };
        let whole = plan(&[]);
        assert_eq!(nominal_scenario(&whole.subject()), "the nominal scenario");
        let mut moved = 0;
        for axis in whole.space.axes() {
            let ends = [[0.0, 0.25], [0.25, 1.0], [0.75, 1.0], [0.75, 0.75], [0.0, 1.0]];
            for ends in ends.map(|ends| ends.map(|u| axis.at(u))) {
                let narrowed = plan(&[(&axis.name, AxisSetting::Range(ends))]);
                let found = narrowed.space.axes().iter().find(|found| found.name == axis.name);
                let Some(nominal) = found.and_then(|found| found.nominal) else { continue };
                if Some(nominal) == axis.nominal {
                    continue;
                }
                moved += 1;
                let value = number_text(nominal);
                let said = nominal_scenario(&narrowed.subject());
                let expected = format!("of this space ({} = {value}", axis.name);
                let is_category = matches!(axis.values, rollout::AxisValues::Categorical(_));
                assert!(is_category || said.contains(&expected), "{}: {said}", axis.name);
            }
        }
        assert!(moved > 0);
    }
}
