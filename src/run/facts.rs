//! Parts of a plan that an answer names, with the target or from a run file alone.

use mishandle_evaluation::{Corners, FormulaRoles};
use mishandle_results::{AxisFacts, BoxPoint, Named, Scenario, Seed, Subject};
use mishandle_rollout::{AxisKind, Space};
use mishandle_simulators::SIMULATOR;
use mishandle_store::{AxisRecord, RunHeader, RunKind};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::guard::recorded_guard;
use crate::resolve::{ResolvedPlan, axis_facts};
use crate::run::{recorded_axis, rejects_scenarios};

/// Plan, space and formulas of an answer.
pub(crate) struct Facts {
    pub plan: Plan,
    pub subject: Subject,
    pub space: Space,
    pub roles: FormulaRoles,
    /// The requirement.
    pub formula: String,
    /// Names of the signals.
    pub signals: Vec<String>,
    /// Whether the evaluation rejects any scenario as unreachable.
    pub leaves_out_starts: bool,
}

impl Facts {
    /// Returns the facts of a plan with its target.
    pub fn of(resolved: &ResolvedPlan) -> Facts {
        Facts {
            plan: resolved.plan.clone(),
            subject: resolved.subject(),
            space: resolved.space.clone(),
            roles: FormulaRoles::of(&resolved.specification),
            formula: resolved.specification.requirement.to_string(),
            signals: resolved.signals.iter().map(|signal| signal.name.clone()).collect(),
            leaves_out_starts: rejects_scenarios(resolved),
        }
    }

    /// Returns the facts that the header of a run has. Only targets that are always here know which
    /// scenarios are reachable.
    ///
    /// # Errors
    /// If the plan or the axes are invalid.
    pub fn recorded(header: &RunHeader) -> Result<Facts, MishandleError> {
        let plan = Plan::from_toml(&header.plan)?;
        let space = Space::new(&header.space, header.axes.iter().map(recorded_axis).collect())?;
        let has = |name: &str| header.formulas.iter().any(|formula| formula.name == name);
        let controller = header.components.iter().find(|component| component.role != SIMULATOR);
        let axes = header.axes.iter().map(|axis| axis.name.clone());
        let set = axes.clone().filter(|axis| plan.axes.contains_key(axis));
        let subject = Subject {
            target: plan.target.clone(),
            task: plan.target.clone(),
            target_kind: header.target.kind.clone(),
            target_hash: header.target.hash.clone(),
            preset: controller.is_some().then(|| plan.preset.clone()),
            controller: controller.map(|controller| controller.name.clone()),
            controller_given: Some(plan.controller.clone()).filter(|controller| !controller.is_empty()),
            controller_hash: controller.map(|controller| controller.hash.clone()),
            guard: recorded_guard(header),
            stochastic: plan.stochastic,
            action_noise: plan.action_noise,
            observation_noise: plan.observation_noise,
            seed: Seed(plan.seed),
            space: plan.space.clone(),
            axes: axes.collect(),
            space_axes: recorded_axes(&header.axes),
            set_axes: set.collect(),
            control_dt: header.control_dt,
            episode_steps: header.episode_steps.into(),
            offered: None,
        };
        Ok(Facts {
            subject,
            space,
            roles: FormulaRoles {
                strict: has("strict"),
                careful: has("careful"),
                safe: has("safe"),
                completion: has("completion"),
            },
            formula: header.formula.clone(),
            signals: header.signals.iter().map(|signal| signal.name.clone()).collect(),
            leaves_out_starts: false,
            plan,
        })
    }
}

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

/// Returns the point of a simulation at the corners of the initial box, which an
/// evaluation runs in a trial of its own.
pub fn box_point(header: &RunHeader, trial: u32, scenario: &[Option<f64>]) -> Option<BoxPoint> {
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
    Some(if is_center { BoxPoint::Center } else { BoxPoint::Corner })
}
