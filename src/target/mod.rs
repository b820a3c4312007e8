//! From a plan to what it tests: the one place that knows which kinds of targets there are.

mod task;

use mishandle_rollout::{RolloutError, Space, Specification, SpecificationMonitor, System, Target};
use mishandle_stl::{Clock, Formula, Monitor};
use mishandle_toys::TOYS;

use crate::{MishandleError, Plan};

pub(crate) use task::{EXPERT, is_path};
pub use task::{preset, task, task_target};

/// The target that `plan` names.
///
/// # Errors
/// If a name is unknown, a file cannot be read or does not fit, or a number makes no sense.
pub fn target(plan: &Plan) -> Result<Target, MishandleError> {
    if let Some(toy) = mishandle_toys::target(&plan.target) {
        refuse_task_options(plan)?;
        return Ok(toy?);
    }
    if mishandle_tasks::task(&plan.target).is_none() {
        let known = target_names();
        return Err(MishandleError::Name { kind: "target", name: plan.target.clone(), known });
    }
    Ok(task_target(plan)?.target()?)
}

/// Names of all targets: tasks first, then toys.
pub fn target_names() -> Vec<String> {
    let toys = TOYS.iter().map(|toy| format!("toy/{}", toy.name()));
    task::task_names().into_iter().chain(toys).collect()
}

/// Refuses what only a task takes.
fn refuse_task_options(plan: &Plan) -> Result<(), MishandleError> {
    let given = [
        ("controller", !plan.controller.is_empty()),
        ("action noise", plan.action_noise != 0.0),
        ("observation noise", plan.observation_noise != 0.0),
        ("sampling of actions", plan.stochastic),
        ("task preset but the default", plan.preset != Plan::new("", "").preset),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(MishandleError::NotForTarget { target: plan.target.clone(), option }),
        None => Ok(()),
    }
}

/// A plan with all that it names looked up and checked: nothing after this depends on the kind of target.
#[derive(Debug)]
pub struct ResolvedPlan {
    /// The plan.
    pub plan: Plan,
    /// What is tested.
    pub target: Target,
    /// What a scenario may set.
    pub space: Space,
    /// The formulas; the requirement is what a falsification tries to violate.
    pub specification: Specification,
    /// How many sub-formulas of the requirement have their minima stored: all of them if the search needs them, so that a
    /// resumed run can tell them again; otherwise none.
    pub stored_subformulas: usize,
}

impl ResolvedPlan {
    /// Looks up and checks all that `plan` names.
    ///
    /// # Errors
    /// If a name is unknown, a file cannot be read or does not fit, a formula is wrong or longer than an episode, or
    /// a number makes no sense.
    pub fn new(plan: &Plan) -> Result<ResolvedPlan, MishandleError> {
        let target = target(plan)?;
        let space = target.space(&plan.space).map_err(|error| match error {
            RolloutError::UnknownSpace { name, known } => MishandleError::Name { kind: "space", name, known },
            error => error.into(),
        })?;
        let mut needs_subformulas = false;
        if let Some(evaluate) = &plan.evaluate {
            crate::evaluate::check(evaluate, &target, &space)?;
        }
        let mut text = target.formulas.first().map_or("", |formula| &formula.name).to_string();
        if let Some(falsify) = &plan.falsify {
            needs_subformulas = crate::falsify::check(falsify, &space)?;
            text = falsify.formula.clone().unwrap_or(text);
        }
        let requirement = requirement(&text, &target)?;
        check_decided(&requirement, &target)?;
        let mut specification = Specification::from_formulas(&target.formulas, requirement)?;
        // A target without a formula of that name is measured by what it requires.
        specification.success.get_or_insert_with(|| specification.requirement.clone());
        SpecificationMonitor::new(&specification, &target.signal_names(), target.control_dt)?;
        let stored_subformulas =
            if needs_subformulas { specification.requirement.subformulas().count() } else { 0 };
        Ok(ResolvedPlan { plan: plan.clone(), target, space, specification, stored_subformulas })
    }

    /// The system that runs its simulations.
    ///
    /// # Errors
    /// If the parts of the target do not fit each other.
    pub fn system(&self) -> Result<Box<dyn System>, MishandleError> {
        Ok(self.target.system(&self.space, &self.specification)?)
    }
}

/// A formula by its name or its text. A single word is a name, or else a signal.
fn requirement(text: &str, target: &Target) -> Result<Formula, MishandleError> {
    let named = target.formulas.iter().find(|formula| formula.name == text);
    let source = named.map_or(text, |formula| &formula.text);
    let formula = Formula::parse(source).map_err(|source| {
        MishandleError::Rollout(RolloutError::Parse { formula: text.to_string(), source })
    })?;
    let is_word = named.is_none() && formula.signals() == [text];
    if is_word && target.signals.iter().all(|signal| signal.name != text) {
        let names = target.formulas.iter().map(|formula| formula.name.clone());
        return Err(MishandleError::Name {
            kind: "formula or signal",
            name: text.to_string(),
            known: names.chain(target.signals.iter().map(|signal| signal.name.clone())).collect(),
        });
    }
    Ok(formula)
}

/// Refuses a formula that an episode could never decide.
fn check_decided(formula: &Formula, target: &Target) -> Result<(), MishandleError> {
    let clock = Clock::steps(target.control_dt);
    let monitor = Monitor::new(formula, &target.signal_names(), clock).map_err(|source| {
        MishandleError::Rollout(RolloutError::Monitor { formula: formula.to_string(), source })
    })?;
    match monitor.horizon() {
        Some(needed) if needed > target.episode_steps => Err(MishandleError::Undecidable {
            formula: formula.to_string(),
            needed: needed.to_string(),
            steps: target.episode_steps,
        }),
        _ => Ok(()),
    }
}
