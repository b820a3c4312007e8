//! Resolved plans: names become targets, controllers, spaces, formulas and searches.
//!
//! Every mistake in a plan is found here, before the first simulation. Only this room knows the
//! kinds of targets.

mod axis_setting;
mod catalog;
mod check;
pub(crate) mod controller;
mod described;
mod first_file;
pub(crate) mod guard;
mod import;
mod kind;
mod metamorphic;
mod policy;
mod randomness;
mod recorded;
mod remedies;
mod requirements;
mod robot;
mod scene;
pub(crate) mod search;
mod simulator;
mod subject;
mod target_file;
mod task;
mod training;

use mishandle_falsification::{PhysicsChecks, search_space};
use mishandle_random::Seed;
use mishandle_results::{Command, Remedy};
use mishandle_rollout::{RolloutError, Signal, Space, Specification, SpecificationMonitor, System, Target};
use mishandle_search::SearchSpace;
use mishandle_stl::{Clock, Formula, Monitor};
use mishandle_text::plural;
use mishandle_toys::TOYS;
use mishandle_toys::arch::PROBLEMS;

use crate::error::{MishandleError, invalid, problem, unsupported};
use crate::plan::{Plan, ScreeningPlan};
use crate::resolve::requirements::{joined, named_requirements, table_formula};
use crate::resolve::robot::robot_target;
use crate::resolve::search::new_search;
use crate::resolve::simulator::simulator_target;

pub use axis_setting::with_settings;
pub use catalog::{search_result, target_result, task_result};
pub use check::{check_compare, check_evaluate, check_falsify, check_metamorphic, check_risk};
pub(crate) use controller::{ONNX_SIDES, is_path, onnx_side, shipped_file};
pub use controller::{controller_name, find_controller};
pub use described::{described_target, described_warnings};
pub use first_file::{FirstInputs, first_target_file};
pub use guard::{monitor as guard_monitor, recorded_guard};
pub use import::{OnnxController, import_controller, is_onnx, onnx_policy};
pub use kind::{has_scene, is_python};
pub use metamorphic::{MetamorphicCases, metamorphic_cases};
pub(crate) use policy::check_allowed;
pub(crate) use randomness::depends_on_seed_at_nominal;
pub use randomness::{depends_on_seed, space_depends_on_seed};
pub(crate) use recorded::resolve_recorded;
pub use recorded::{Moved, plan_without_program, recorded_plan};
pub(crate) use requirements::missing_signals;
pub use robot::contract_warnings;
pub use robot::robot_file;
pub(crate) use scene::{SceneEnvironment, SceneTarget, TargetSight, scene_start, scene_target, target_sight};
pub use scene::{camera_names, picture_model, recorded_picture, recorded_target};
pub use search::search_entry;
pub use simulator::check_protocol;
pub(crate) use simulator::simulator_file;
pub use subject::{axis_facts, named_scenario, nominal_scenario, nominal_values};
pub use target_file::{command, command_target, has_files, is_target_file};
pub(crate) use target_file::{file_label, files_of, starts_program};
pub(crate) use task::reachable_starts;
pub use task::{preset, task, task_target};
pub(crate) use training::STARTS;
pub use training::{
    TrainingEnvironment, TrainingScene, TrainingTarget, default_reward, reward, training_target,
};

/// Returns the target of a plan.
///
/// # Errors
/// If a name is unknown, a file cannot be read or is for another task, or a number is out of its
/// range.
pub fn target(plan: &Plan) -> Result<Target, MishandleError> {
    let built_in =
        mishandle_toys::target(&plan.target).or_else(|| mishandle_toys::arch::target(&plan.target));
    if let Some(target) = built_in {
        check_no_task_options(plan)?;
        return Ok(target?);
    }
    if let Some(file) = simulator_file(plan)? {
        return simulator_target(plan, &file);
    }
    if is_target_file(&plan.target) {
        return robot_target(plan);
    }
    if mishandle_tasks::task(&plan.target).is_none() {
        check_no_path(&plan.target)?;
        let known = target_names();
        return Err(MishandleError::UnknownName { kind: "target", name: plan.target.clone(), known });
    }
    Ok(task_target(plan)?.target()?)
}

/// Checks that the name of an unknown target is not a path: a list of names does not help then.
fn check_no_path(name: &str) -> Result<(), MishandleError> {
    let is_name = ["toy/", "arch/"].iter().any(|group| name.starts_with(group));
    if is_path(name) && !is_name {
        Err(MishandleError::NotATarget { name: name.to_string() })
    } else {
        Ok(())
    }
}

/// Returns the names of all targets: tasks first, then toys, then the problems of the ARCH
/// competition.
pub fn target_names() -> Vec<String> {
    let toys = TOYS.iter().map(|toy| format!("toy/{}", toy.name()));
    let problems = PROBLEMS.iter().map(|problem| format!("arch/{}", problem.name()));
    task::task_names().into_iter().chain(toys).chain(problems).collect()
}

/// Returns whether a name is that of a target of this program, not of a file, a program or a Python
/// system.
pub fn is_built_in(name: &str) -> bool {
    target_names().iter().any(|known| known == name)
}

/// Checks that the plan sets no option that only tasks support.
fn check_no_task_options(plan: &Plan) -> Result<(), MishandleError> {
    let given = [
        ("a controller", !plan.controller.is_empty()),
        ("action noise", plan.action_noise != 0.0),
        ("observation noise", plan.observation_noise != 0.0),
        ("sampled actions", plan.stochastic),
        ("a task preset other than `paper`", plan.preset != Plan::new("", "").preset),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(unsupported(&plan.target, option)),
        None => Ok(()),
    }
}

/// A plan whose names are looked up and checked. Later steps do not depend on the kind of target.
#[derive(Debug)]
pub struct ResolvedPlan {
    /// The plan itself.
    pub plan: Plan,
    /// The target under test.
    pub target: Target,
    /// The scenario space.
    pub space: Space,
    /// The formulas. A falsification tries to violate the requirement.
    pub specification: Specification,
    /// The signals of the traces.
    pub signals: Vec<Signal>,
    /// Number of parts of the robustness that are stored. Some searches need them; a resumed run
    /// reads them from the run file. Zero for the other searches.
    pub stored_parts: usize,
    /// The space as a search sees it, without units.
    pub search_space: SearchSpace,
}

impl ResolvedPlan {
    /// Looks up and checks the names and values of `plan`.
    ///
    /// # Errors
    /// If a name is unknown, a file cannot be read or is for another task, a formula is invalid or
    /// reaches past the end of an episode, or a number is out of its range.
    pub fn new(plan: &Plan) -> Result<ResolvedPlan, MishandleError> {
        ResolvedPlan::with_target(plan, target(plan)?)
    }

    /// Checks a plan for a target that this program cannot look up, for instance one that a user
    /// wrote in Python.
    ///
    /// # Errors
    /// The errors of [`new`](Self::new), except that the name of the target is not looked up.
    pub fn with_target(plan: &Plan, target: Target) -> Result<ResolvedPlan, MishandleError> {
        let mut plan = plan.clone();
        if let (true, Some(first)) = (plan.space.is_empty(), target.spaces.first()) {
            plan.space = first.name().to_string();
        }
        let space = target.space(&plan.space).map_err(|error| match error {
            RolloutError::UnknownSpace { name, known } => {
                MishandleError::UnknownName { kind: "space", name, known }
            }
            error => error.into(),
        })?;
        if plan.guard.is_some() && target.controller_signals.is_empty() {
            let expected =
                "left out: this program runs no controller of the target, so nothing can be guarded";
            return Err(invalid("the guard", "given", expected));
        }
        let named_axes = target.named_axes();
        let mut space = with_settings(space, &plan.axes, &named_axes)?;
        if let Some(table) = &plan.metamorphic {
            check_metamorphic(table, space.clone(), &named_axes, plan.seed)?;
            space = metamorphic::space_of_both(table, &space, &named_axes)?;
        }
        if let Some(evaluate) = &plan.evaluate {
            check::check_evaluate_in(evaluate, &target, &space)?;
        }
        if let Some(compare) = &plan.compare {
            check_compare(compare)?;
        }
        let mut text = target.formulas.first().map_or("", |formula| &formula.name).to_string();
        if let Some(screening) = &plan.screening {
            check_screening(screening, &plan, &target)?;
        }
        if let Some(risk) = &plan.risk {
            check_risk(risk, &space)?;
        }
        if let Some(falsify) = &plan.falsify {
            check_falsify(falsify, &space)?;
        }
        let others = named_requirements(&plan, &target)?;
        if let (false, Some(formula)) = (others.is_empty(), table_formula(&mut plan)) {
            let text = match formula {
                Some(text) => text.clone(),
                None => joined(&others, &target, &space)?,
            };
            *formula = Some(text);
        }
        if let Some(Some(formula)) = table_formula(&mut plan) {
            text.clone_from(formula);
        }
        let requirement = requirement(&text, &target)?;
        check_decidable(&requirement, &target)?;
        let mut specification = Specification::from_formulas(&target.formulas, requirement)?;
        specification.others = others;
        leave_out_careful(&plan, &target, &mut specification);
        // Without a formula `success`, the success rate is the rate of the requirement.
        specification.success.get_or_insert_with(|| specification.requirement.clone());
        SpecificationMonitor::new(&specification, &target.signal_names(), target.control_dt)?;
        let signals = target.traced_signals(&specification);
        let steps = target.episode_steps;
        let parts = specification.decomposition(target.control_dt, steps + 1)?;
        let search_space = search_space(&space, &parts, steps);
        let needs_parts = match &plan.falsify {
            Some(falsify) => new_search(falsify, &search_space)(0)?.needs_parts(),
            None => false,
        };
        let stored_parts = if needs_parts { parts.ends().len() } else { 0 };
        Ok(ResolvedPlan { plan, target, space, specification, signals, stored_parts, search_space })
    }

    /// Returns the names of the signals of the traces.
    pub fn signal_names(&self) -> std::sync::Arc<[String]> {
        self.signals.iter().map(|signal| signal.name.clone()).collect()
    }

    /// Returns the recorded seed of a trial: its own in a falsification, otherwise that of the run.
    pub(crate) fn trial_seed(&self, trial: u32) -> u64 {
        match &self.plan.falsify {
            Some(_) => mishandle_falsification::trial_seed(Seed(self.plan.seed), trial.max(1)).0,
            None => self.plan.seed,
        }
    }

    /// Returns the system that runs the simulations.
    ///
    /// # Errors
    /// If the components of the target are incompatible.
    pub fn system(&self) -> Result<Box<dyn System>, MishandleError> {
        Ok(self.target.system(&self.space, &self.specification)?)
    }

    /// Returns the checks of the physics of failures.
    ///
    /// # Errors
    /// As for [`system`](Self::system).
    pub fn physics_checks(&self) -> Result<PhysicsChecks, MishandleError> {
        Ok(PhysicsChecks::new(self.target.solver_systems(&self.space, &self.specification)?))
    }
}

/// Leaves out the formula of careful success where it would need signals that nothing else reads:
/// only an evaluation without a screening has a metric of it, and a plan may ask for it.
fn leave_out_careful(plan: &Plan, target: &Target, specification: &mut Specification) {
    let on_request: Vec<&str> = target.signals_on_request.iter().map(|signal| signal.name.as_str()).collect();
    let careful = specification.careful.take();
    let is_read = specification.reads_any(&on_request);
    let is_free = careful
        .as_ref()
        .is_none_or(|formula| formula.signals().iter().all(|name| !on_request.contains(name)));
    let is_asked = (plan.careful || plan.evaluate.is_some()) && plan.screening.is_none();
    specification.careful = careful.filter(|_| is_free || is_read || is_asked);
}

/// Checks the settings of a screening.
fn check_screening(screening: &ScreeningPlan, plan: &Plan, target: &Target) -> Result<(), MishandleError> {
    if !has_scene(&target.identity.kind) {
        return Err(unsupported(&plan.target, "screening"));
    }
    let method = plan.risk.as_ref().map_or("auto", |risk| &risk.method);
    let keeps_going = plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going);
    let (what, value, expected) = if !plan.requirements.is_empty() {
        (
            "the number of named requirements of a screening",
            plan.requirements.len().to_string(),
            "0, because a device returns one robustness; ask without screening",
        )
    } else if let Some(until) = plan.evaluate.as_ref().and_then(|evaluate| evaluate.until) {
        let expected = "left out, because a screened rate is that of a two-phase sample, whose interval holds for one number only; ask without screening";
        ("the rule of a screened evaluation", until.to_string(), expected)
    } else if plan.compare.is_some() {
        ("the question of a screening", "compare".to_string(), "evaluate, falsify or risk")
    } else if plan.margin.is_some() {
        ("the question of a screening", "margin".to_string(), "evaluate, falsify or risk")
    } else if plan.metamorphic.is_some() {
        ("the question of a screening", "metamorphic".to_string(), "evaluate, falsify or risk")
    } else if keeps_going {
        (
            "keep-going of a screened search",
            "true".to_string(),
            "false, because a device cannot tell failure modes apart",
        )
    } else if !matches!(method, "auto" | "monte-carlo") {
        ("the method of a screened estimation", method.to_string(), "auto or monte-carlo")
    } else if !(0.0..=1.0).contains(&screening.confirm) {
        ("the share of the audit sample", screening.confirm.to_string(), "from 0 to 1")
    } else if !(1..=1 << 20).contains(&screening.rows) {
        ("the number of worlds", screening.rows.to_string(), "from 1 to 1048576")
    } else {
        return Ok(());
    };
    Err(invalid(what, value, expected))
}

/// Parses a formula that is given by its name or its text. A single word is the name of a formula
/// or of a signal.
fn requirement(text: &str, target: &Target) -> Result<Formula, MishandleError> {
    let named = target.formulas.iter().find(|formula| formula.name == text);
    let source = named.map_or(text, |formula| &formula.text);
    let formula = Formula::parse(source).map_err(|source| {
        MishandleError::Rollout(RolloutError::Parse { formula: text.to_string(), source })
    })?;
    let is_word = named.is_none() && formula.signals() == [text];
    if is_word && target.all_signals().all(|signal| signal.name != text) {
        let names = target.formulas.iter().map(|formula| formula.name.clone());
        return Err(MishandleError::UnknownName {
            kind: "formula or signal",
            name: text.to_string(),
            known: names.chain(target.all_signals().map(|signal| signal.name.clone())).collect(),
        });
    }
    Ok(formula)
}

/// Checks that the formula depends on the episode, and does not reach past its end.
fn check_decidable(formula: &Formula, target: &Target) -> Result<(), MishandleError> {
    if formula.signals().is_empty() {
        let text = "contains no signal, so every episode has the same verdict; use signals of the target";
        let list = Command::List { what: "targets".to_string(), is_long: false };
        return Err(problem(format!("`{formula}` {text}")).with(Remedy::Run(list)));
    }
    let clock = Clock::steps(target.control_dt);
    let monitor = Monitor::new(formula, &target.signal_names(), clock).map_err(|source| {
        MishandleError::Rollout(RolloutError::Monitor { formula: formula.to_string(), source })
    })?;
    match monitor.horizon() {
        Some(needed) if needed > target.episode_steps => Err(problem(format!(
            "`{formula}` needs {}, an episode has {}: no episode can decide it",
            plural(needed, "control step"),
            target.episode_steps
        ))),
        _ => Ok(()),
    }
}
