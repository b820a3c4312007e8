//! Targets of training: a task, and a robot that a file describes, give the same parts.

use std::sync::Arc;

use mishandle_controllers::guard::Guard;
use mishandle_controllers::{ActionLimiter, ControllerFile, Layout};
use mishandle_rollout::{
    Axis, BatchFactory, Disturbance, Environment, Identity, Noise, Space, Specification,
};
use mishandle_tasks::{MannerWeights, Preset, Reward, Task, TaskEnvironment, target_identity, task_hash};
use mishandle_training::{AlgorithmSettings, RewardSettings};

use crate::error::{MishandleError, invalid, unsupported};
use crate::plan::{GPU, GuardPlan, Plan};
use crate::resolve::controller::shipped_file;
use crate::resolve::guard::training_guard;
use crate::resolve::robot::RobotToTrain;
use crate::resolve::task::{guarded_loop, load_controller};
use crate::resolve::{check_no_path, is_onnx, is_target_file, preset, task};
use crate::shipped::{SETTINGS, ShippedFile, check_home, shipped_settings};

/// Name of the space of the initial states.
pub(crate) const STARTS: &str = "starts";

/// A target whose controllers this program trains.
pub trait TrainingTarget {
    /// Returns its name in controller files.
    fn name(&self) -> &str;

    /// Returns its name on the command line.
    fn given(&self) -> String;

    /// Returns the layout of observations and actions of a policy that trains with these settings.
    fn layout(&self, settings: &AlgorithmSettings) -> Layout;

    /// Returns the limiter of the action interface of the settings, if they have one.
    ///
    /// # Errors
    /// If the interface does not fit the target.
    fn limiter(&self, settings: &AlgorithmSettings) -> Result<Option<ActionLimiter>, MishandleError>;

    /// Returns the name of its task preset in controller files.
    fn preset(&self) -> &'static str;

    /// Returns the hash of all that training with a reward depends on.
    ///
    /// # Errors
    /// If there is no such reward, or the scene does not compile.
    fn hash(&self, reward: &str) -> Result<String, MishandleError>;

    /// Returns the formulas of validations.
    ///
    /// # Errors
    /// If a formula is wrong.
    fn specification(&self) -> Result<Specification, MishandleError>;

    /// Returns the scene with a reward and the reward terms that the settings weigh.
    ///
    /// # Errors
    /// If there is no such reward, or the target has no such reward terms.
    fn scene(&self, reward: &str, settings: &AlgorithmSettings) -> Result<TrainingScene, MishandleError>;

    /// Returns a controller from which training can start.
    ///
    /// # Errors
    /// If it cannot be read, is not a trained network, or belongs to another target.
    fn start_controller(&self, name: &str) -> Result<ControllerFile, MishandleError>;

    /// Returns a guard under which its policy trains.
    ///
    /// # Errors
    /// If the guard is wrong, or privileged.
    fn guard(&self, guard: &GuardPlan, settings: &AlgorithmSettings) -> Result<Guard, MishandleError>;

    /// Returns the settings that are shipped for it, if any.
    ///
    /// # Errors
    /// If the folder of shipped files is incomplete.
    fn shipped_settings(&self, algorithm: &str, device: &str) -> Result<Option<ShippedFile>, MishandleError>;

    /// Returns its present identity with the preset and the noise of a plan and a controller of
    /// this hash.
    ///
    /// # Errors
    /// If the preset is unknown, or the scene does not compile.
    fn identity(&self, plan: &Plan, controller_hash: &str) -> Result<Identity, MishandleError>;
}

/// Environment, disturbances and spaces of a target.
pub struct TrainingScene {
    /// The environment over the axes of the initial state.
    pub starts: TrainingEnvironment,
    /// Disturbances of observations and actions.
    pub disturbances: Vec<Disturbance>,
    /// All axes of the environment and of the disturbances.
    pub axes: Vec<Axis>,
    /// The named spaces, with `starts`.
    pub spaces: Vec<Space>,
    over: Box<Over>,
}

type Over = dyn Fn(&Space) -> Result<TrainingEnvironment, MishandleError>;

impl TrainingScene {
    /// Makes a scene. `over` returns the environment over its axes of a space.
    pub(crate) fn new(
        axes: Vec<Axis>,
        spaces: Vec<Space>,
        disturbances: Vec<Disturbance>,
        starts: TrainingEnvironment,
        over: impl Fn(&Space) -> Result<TrainingEnvironment, MishandleError> + 'static,
    ) -> TrainingScene {
        TrainingScene { starts, disturbances, axes, spaces, over: Box::new(over) }
    }

    /// Returns the environment over the axes of `space` that belong to it.
    ///
    /// # Errors
    /// If two axes have the same name.
    pub fn over(&self, space: &Space) -> Result<TrainingEnvironment, MishandleError> {
        (self.over)(space)
    }
}

/// An environment of training episodes and of validations.
#[derive(Clone)]
pub struct TrainingEnvironment {
    /// The environment itself.
    pub environment: Arc<dyn Environment>,
    /// Its batches on the CPU.
    pub batches: Arc<dyn BatchFactory>,
    /// The environment as that of a task, whose physics another engine can step.
    pub task: Option<Arc<TaskEnvironment>>,
}

/// Returns the target of a training run on a device: the name of a task, or the path of a target
/// file.
///
/// # Errors
/// If there is no such task, the file cannot be read or is wrong, or its robot cannot be trained
/// there.
pub fn training_target(target: &str, device: &str) -> Result<Box<dyn TrainingTarget>, MishandleError> {
    if !is_target_file(target) {
        let task = task(target).or_else(|error| check_no_path(target).and(Err(error)));
        return Ok(Box::new(TaskToTrain(task?)));
    }
    if device == GPU {
        let option = "training on a GPU";
        Err(unsupported(target, option))
    } else {
        Ok(Box::new(RobotToTrain::read(target)?))
    }
}

/// Returns the name of the reward of a target if the user names none.
pub fn default_reward(target: &str) -> &'static str {
    if is_target_file(target) { RobotToTrain::REWARD } else { "shaped" }
}

/// Returns the reward of a task named `shaped` or `original`.
///
/// # Errors
/// If the name is unknown.
pub fn reward(name: &str) -> Result<Reward, MishandleError> {
    match name {
        "shaped" => Ok(Reward::Shaped),
        "original" => Ok(Reward::Original),
        _ => Err(MishandleError::UnknownName {
            kind: "reward",
            name: name.to_string(),
            known: ["shaped", "original"].map(String::from).to_vec(),
        }),
    }
}

/// Returns the error of a controller from which training cannot start.
pub(crate) fn not_a_start(controller: &str) -> MishandleError {
    invalid(
        "the controller to start from",
        controller,
        "a controller file of this program: training continues its network",
    )
}

/// A task as a target of training.
struct TaskToTrain(&'static dyn Task);

impl TrainingTarget for TaskToTrain {
    fn name(&self) -> &str {
        self.0.definition().name
    }

    fn given(&self) -> String {
        self.name().to_string()
    }

    fn layout(&self, settings: &AlgorithmSettings) -> Layout {
        self.0.definition().layout_with(&settings.episodes().further_parts)
    }

    fn limiter(&self, settings: &AlgorithmSettings) -> Result<Option<ActionLimiter>, MishandleError> {
        let interface = settings.episodes().action_interface.as_ref();
        let limiter = |interface| self.0.definition().limiter(&self.layout(settings), interface);
        Ok(interface.map(limiter).transpose()?)
    }

    fn preset(&self) -> &'static str {
        "paper"
    }

    fn hash(&self, name: &str) -> Result<String, MishandleError> {
        Ok(task_hash(self.0, reward(name)?)?)
    }

    fn specification(&self) -> Result<Specification, MishandleError> {
        Ok(self.0.definition().formulas(Preset::Paper).specification()?)
    }

    fn scene(&self, name: &str, settings: &AlgorithmSettings) -> Result<TrainingScene, MishandleError> {
        let environment = TaskEnvironment::new(self.0, Preset::Paper, reward(name)?)?;
        let environment = environment.with_further_parts(&settings.episodes().further_parts)?;
        let environment = with_terms(environment, settings);
        let disturbances = environment.disturbances(settings.episodes().action_noise > 0.0);
        let (axes, spaces) = environment.axes_and_spaces(&disturbances, &[])?;
        let starts = of_task(environment.clone());
        let over = move |space: &Space| Ok(of_task(environment.with_scene_axes(space)?));
        Ok(TrainingScene::new(axes, spaces, disturbances, starts, over))
    }

    fn start_controller(&self, name: &str) -> Result<ControllerFile, MishandleError> {
        let definition = self.0.definition();
        let shipped = shipped_file(&Plan::new(definition.name, name))?;
        if is_onnx(shipped.path()) {
            return Err(not_a_start("an ONNX model"));
        }
        let file = shipped.controller()?;
        file.check(definition.name, &definition.layout_for(&file.header.layout))?;
        Ok(file)
    }

    fn guard(&self, guard: &GuardPlan, settings: &AlgorithmSettings) -> Result<Guard, MishandleError> {
        let load = |name: &str| load_controller(self.0, name, false);
        let guarded_loop = guarded_loop(self.0.definition(), &settings.episodes().further_parts);
        training_guard(guard, guarded_loop, load)
    }

    fn shipped_settings(&self, algorithm: &str, device: &str) -> Result<Option<ShippedFile>, MishandleError> {
        check_home(SETTINGS)?;
        Ok(shipped_settings(self.0.definition(), algorithm, device))
    }

    fn identity(&self, plan: &Plan, controller_hash: &str) -> Result<Identity, MishandleError> {
        Ok(target_identity(self.0, preset(&plan.preset)?, controller_hash, noise(plan))?)
    }
}

/// Returns the noise of a plan.
pub(crate) fn noise(plan: &Plan) -> Noise {
    Noise { action_std: plan.action_noise, observation_std: plan.observation_noise }
}

fn of_task(environment: TaskEnvironment) -> TrainingEnvironment {
    let environment = Arc::new(environment);
    TrainingEnvironment {
        environment: environment.clone(),
        batches: Arc::new(environment.clone()),
        task: Some(environment),
    }
}

/// Returns the environment with the reward terms for the manner that the settings weigh.
fn with_terms(environment: TaskEnvironment, settings: &AlgorithmSettings) -> TaskEnvironment {
    let RewardSettings { contact_force, action_rate, speed, rest } = *settings.rewards();
    let weights = MannerWeights { contact_force, action_rate, speed, rest };
    if weights == MannerWeights::default() {
        return environment;
    }
    let steps = settings.episodes().time_limit.unwrap_or(environment.episode_steps());
    environment.with_manner_reward(weights, steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terms(text: &str) -> Vec<String> {
        let scene = |text: &str| {
            let settings = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
            let target = training_target("point-reaching", "cpu").unwrap();
            target.scene("shaped", &settings).unwrap().starts.environment.reward_terms().to_vec()
        };
        scene(text)[scene("").len()..].to_vec()
    }

    #[test]
    fn terms_with_a_weight_exist_under_the_names_of_their_settings() {
        let none: [&str; 0] = [];
        assert_eq!(terms(""), none);
        let all = "rewards = { contact_force = 1, action_rate = 1, speed = 1, rest = 1 }";
        assert_eq!(terms(all), ["contact_force", "action_rate", "speed", "rest"]);
        assert_eq!(terms("rewards.rest = 0.5"), ["rest"]);
    }
}
