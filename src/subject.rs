use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, bytes_hash};
use mishandle_rollout::{Controller, Environment, Judge, Noise, Rollout, RolloutError, Specification};
use mishandle_stl::{Clock, Formula, Monitor};
use mishandle_tasks::{Preset, Reward, Task, TaskEnvironment};

use crate::home::check_home;
use crate::{MishandleError, Plan, controller_path, shipped_controllers};

/// The task of that name.
///
/// # Errors
/// If there is none; the message lists those there are.
pub fn task(name: &str) -> Result<&'static dyn Task, MishandleError> {
    mishandle_tasks::task(name).ok_or_else(|| MishandleError::Name {
        kind: "task",
        name: name.to_string(),
        known: mishandle_tasks::tasks().iter().map(|task| task.definition().name.to_string()).collect(),
    })
}

/// The task preset of that name: `paper` or `code`.
///
/// # Errors
/// If there is none.
pub fn preset(name: &str) -> Result<Preset, MishandleError> {
    match name {
        "paper" => Ok(Preset::Paper),
        "code" => Ok(Preset::Code),
        _ => Err(MishandleError::Name {
            kind: "task preset",
            name: name.to_string(),
            known: ["paper", "code"].map(String::from).to_vec(),
        }),
    }
}

/// What a plan puts to the test: a task, a controller and what they are judged by, all looked up and checked.
pub struct Subject {
    /// The task.
    pub task: &'static dyn Task,
    /// The task as an environment.
    pub environment: Arc<TaskEnvironment>,
    /// The formulas; the requirement is what a falsification tries to violate.
    pub specification: Specification,
    /// The controller.
    pub controller: Arc<dyn Controller>,
    /// Hash of all that decides the controller's actions; of an expert, which has no file, its name.
    pub controller_hash: String,
    /// Hash of the controller's file; empty for an expert.
    pub controller_bytes_hash: String,
    noise: Noise,
}

impl Subject {
    /// Looks up and checks all that `plan` names.
    ///
    /// # Errors
    /// If a name is unknown, a file cannot be read or does not fit, a formula is wrong or longer than an episode, or
    /// a number makes no sense.
    pub fn new(plan: &Plan) -> Result<Subject, MishandleError> {
        let task = task(&plan.task)?;
        let preset = preset(&plan.preset)?;
        let environment = Arc::new(TaskEnvironment::new(task, preset, Reward::Original)?);
        let mut specification = task.definition().formulas(preset).specification()?;
        if let Some(evaluate) = &plan.evaluate {
            crate::evaluate::check(evaluate)?;
        }
        if let Some(falsify) = &plan.falsify {
            crate::falsify::check(falsify, environment.initial_box().dimension())?;
            specification.requirement = requirement(&falsify.formula, &specification, environment.signals())?;
        }
        check_decided(&specification.requirement, &environment)?;
        Judge::new(&specification, environment.signals(), environment.control_dt())?;
        let noise = Noise { action_std: plan.action_noise, observation_std: plan.observation_noise };
        noise.check()?;
        let loaded = load_controller(task, &plan.controller, plan.stochastic)?;
        Ok(Subject {
            task,
            environment,
            specification,
            controller: loaded.controller,
            controller_hash: loaded.hash,
            controller_bytes_hash: loaded.bytes_hash,
            noise,
        })
    }

    /// The system that runs its simulations.
    ///
    /// # Errors
    /// If the controller does not fit the environment.
    pub fn system(&self) -> Result<Rollout, MishandleError> {
        self.system_in(self.environment.clone())
    }

    /// The same in another environment that does the same.
    pub(crate) fn system_in(&self, environment: Arc<dyn Environment>) -> Result<Rollout, MishandleError> {
        Ok(Rollout::new(environment, self.controller.clone(), self.specification.clone(), self.noise)?)
    }
}

/// A formula by its name or its text. A single word is a name, or else a signal.
fn requirement(
    text: &str,
    specification: &Specification,
    signals: &[String],
) -> Result<Formula, MishandleError> {
    let named = [("success", &specification.success), ("strict", &specification.strict)];
    if let Some((_, formula)) = named.iter().find(|(name, _)| *name == text) {
        return Ok((*formula).clone());
    }
    let formula = Formula::parse(text).map_err(|source| {
        MishandleError::Rollout(RolloutError::Parse { formula: text.to_string(), source })
    })?;
    if formula.signals() == [text] && !signals.iter().any(|signal| signal == text) {
        let names = named.iter().map(|(name, _)| (*name).to_string());
        return Err(MishandleError::Name {
            kind: "formula or signal",
            name: text.to_string(),
            known: names.chain(signals.iter().cloned()).collect(),
        });
    }
    Ok(formula)
}

/// Refuses a formula that an episode could never decide.
fn check_decided(formula: &Formula, environment: &TaskEnvironment) -> Result<(), MishandleError> {
    let clock = Clock::steps(environment.control_dt());
    let monitor = Monitor::new(formula, environment.signals(), clock).map_err(|source| {
        MishandleError::Rollout(RolloutError::Monitor { formula: formula.to_string(), source })
    })?;
    match monitor.horizon() {
        Some(needed) if needed > environment.episode_steps() => Err(MishandleError::Undecidable {
            formula: formula.to_string(),
            needed: needed.to_string(),
            steps: environment.episode_steps(),
        }),
        _ => Ok(()),
    }
}

/// Name of the controller that is no file.
pub(crate) const EXPERT: &str = "expert";

/// Whether a controller is named by a path, not by the name of a shipped one.
pub(crate) fn is_path(controller: &str) -> bool {
    controller.contains(std::path::MAIN_SEPARATOR) || Path::new(controller).extension().is_some()
}

struct Loaded {
    controller: Arc<dyn Controller>,
    hash: String,
    bytes_hash: String,
}

/// Loads a controller: the expert, a shipped one by name, or a file by its path.
fn load_controller(task: &dyn Task, name: &str, stochastic: bool) -> Result<Loaded, MishandleError> {
    let definition = task.definition();
    if name == EXPERT {
        if stochastic {
            return Err(MishandleError::Value {
                what: "controller",
                value: "the expert".to_string(),
                wanted: "a learned policy, for its actions to be sampled",
            });
        }
        let controller = task
            .expert()
            .map_err(|source| MishandleError::Expert { task: definition.name.to_string(), source })?;
        return Ok(Loaded { controller, hash: EXPERT.to_string(), bytes_hash: String::new() });
    }
    let path = if is_path(name) { Path::new(name).to_path_buf() } else { controller_path(definition, name) };
    if !is_path(name) && !path.is_file() {
        check_home("controllers")?;
        return Err(MishandleError::Name {
            kind: "controller",
            name: name.to_string(),
            known: shipped_controllers(definition),
        });
    }
    let file = ControllerFile::load(&path)?;
    // What a variant is given may be made for it, or for the task that it varies.
    let made_for = definition.variant_of.filter(|base| file.header.task == *base).unwrap_or(definition.name);
    file.check(made_for, &definition.layout())?;
    let policy = file.policy.sampling(stochastic);
    let bytes = std::fs::read(&path).map_err(|source| MishandleError::File { path, source })?;
    Ok(Loaded { hash: policy.hash(), bytes_hash: bytes_hash(&bytes), controller: Arc::new(policy) })
}
