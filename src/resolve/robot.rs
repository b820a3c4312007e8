//! Robots that a file describes, as targets: file, controller and noise of a plan, and as targets
//! of training.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::guard::Guard;
use mishandle_controllers::{ActionLimiter, ControllerFile, Layout};
use mishandle_results::{Choice, Key, Remedy};
use mishandle_robots::{
    ControlledRobot, RobotBatches, RobotEnvironment, RobotFile, RobotPolicy, RobotTraining,
};
use mishandle_rollout::{Component, Controller, Environment, Identity, Noise, Space, Specification, Target};
use mishandle_text::path_text;
use mishandle_training::{AlgorithmSettings, RewardSettings};

use crate::error::{MishandleError, invalid, unsupported};
use crate::plan::{GuardPlan, Plan};
use crate::resolve::guard::{GuardedLoop, guarded, training_guard};
use crate::resolve::policy::{
    Identified, NeededPolicy, controller_file, not_stochastic, of_file, of_program,
};
use crate::resolve::simulator::simulator_file;
use crate::resolve::training::{TrainingEnvironment, TrainingScene, TrainingTarget, noise, not_a_start};
use crate::resolve::{is_onnx, is_target_file};
use crate::shipped::ShippedFile;

/// Reads the target file of a plan.
///
/// # Errors
/// If a file cannot be read or is wrong.
pub fn robot_file(plan: &Plan) -> Result<RobotFile, MishandleError> {
    Ok(RobotFile::read(Path::new(&plan.target))?)
}

/// Looks up and checks the file, the controller and the noise of `plan`.
pub(crate) fn robot_target(plan: &Plan) -> Result<Target, MishandleError> {
    if plan.preset != Plan::new("", "").preset {
        let option = "a task preset other than `paper`";
        return Err(unsupported(&plan.target, option));
    }
    let (robot, (controller, components), noise) = parts(plan)?;
    Ok(robot.target(controller, components, noise)?)
}

/// As [`robot_target`], for recordings of its states and for other engines.
pub(crate) fn controlled_robot(plan: &Plan) -> Result<(RobotFile, ControlledRobot), MishandleError> {
    let (file, (controller, _), noise) = parts(plan)?;
    let robot = file.controlled(controller, noise)?;
    Ok((file, robot))
}

fn parts(plan: &Plan) -> Result<(RobotFile, Identified, Noise), MishandleError> {
    let robot = robot_file(plan)?;
    let noise = noise(plan);
    noise.check()?;
    let own = controller(&robot, plan)?;
    let controller = guarded(plan, own, guarded_loop(&robot)?, |name| fallback(&robot, name))?;
    Ok((robot, controller, noise))
}

/// Returns what a guard must know about a robot.
fn guarded_loop(robot: &RobotFile) -> Result<GuardedLoop, MishandleError> {
    let environment = robot.starts()?;
    Ok(GuardedLoop {
        layout: robot.layout(),
        task: None,
        signals: environment.signals().to_vec(),
        control_dt: environment.control_dt(),
        episode_steps: environment.episode_steps(),
        action_limit: environment.action_limit(),
        meanings: None,
    })
}

/// Loads the fallback of a guard: a file, or `policy`, the policy of the target file.
fn fallback(robot: &RobotFile, name: &str) -> Result<Identified, MishandleError> {
    match name {
        "policy" => controller(robot, &Plan::new("", "")),
        path => of_file(&needed(robot), Path::new(path), [None, None], false),
    }
}

fn needed(robot: &RobotFile) -> NeededPolicy {
    NeededPolicy {
        name: robot.name().to_string(),
        layout: robot.layout(),
        observation: robot.observation_text(),
    }
}

/// Loads the controller of a plan, or the one that the file names.
fn controller(robot: &RobotFile, plan: &Plan) -> Result<Identified, MishandleError> {
    if !plan.controller.is_empty() {
        return of_file(&needed(robot), Path::new(&plan.controller), [None, None], plan.stochastic);
    }
    match robot.policy() {
        RobotPolicy::File { path, interface } => {
            let names = [0, 1].map(|index| interface[index].as_deref());
            of_file(&needed(robot), path, names, plan.stochastic)
        }
        RobotPolicy::Open => {
            Err(invalid("the controller", "missing", "a path, because the target file has no policy")
                .with(Remedy::set(Key::CONTROLLER, Choice::FILE)))
        }
        RobotPolicy::Program(policy) => of_program(policy, plan.stochastic),
        RobotPolicy::Expression(policy) => of_the_file(policy, "expression", plan),
        RobotPolicy::BuiltIn(policy) => of_the_file(policy, "task-space", plan),
    }
}

/// Returns a controller that the target file defines; its hash is that of the file.
fn of_the_file(policy: &Arc<dyn Controller>, name: &str, plan: &Plan) -> Result<Identified, MishandleError> {
    if plan.stochastic {
        return Err(not_stochastic(name));
    }
    let hash = format!("{name} of the target file");
    let component =
        Component { role: "controller".to_string(), name: name.to_string(), hash, file_hash: String::new() };
    Ok((policy.clone(), vec![component]))
}

/// Returns the warnings about the policy of a plan whose target is the file of a robot; none for
/// other targets.
///
/// # Errors
/// If the policy cannot be read, or no episode can start with it.
pub fn contract_warnings(plan: &Plan) -> Result<Vec<String>, MishandleError> {
    if !is_target_file(&plan.target) || simulator_file(plan)?.is_some() {
        return Ok(Vec::new());
    }
    let robot = robot_file(plan)?;
    let (controller, _) = controller(&robot, plan)?;
    Ok(robot.check_contract(&*controller)?)
}

/// A robot of a file as a target of training.
pub(crate) struct RobotToTrain {
    file: RobotFile,
    training: RobotTraining,
}

impl RobotToTrain {
    /// Name of the reward: that of the file.
    pub(crate) const REWARD: &str = "file";

    /// Reads a target file.
    ///
    /// # Errors
    /// If it cannot be read or is wrong, has no rewards or bounds no actions.
    pub(crate) fn read(path: &str) -> Result<RobotToTrain, MishandleError> {
        let file = RobotFile::read(Path::new(path))?;
        let training = file.training()?;
        Ok(RobotToTrain { file, training })
    }

    fn check_reward(reward: &str) -> Result<(), MishandleError> {
        if reward == RobotToTrain::REWARD {
            Ok(())
        } else {
            let expected = "left out: the rewards of a robot are those of its file, in the table [rewards]";
            Err(invalid("the reward", reward, expected).with(Remedy::Unset(Key::REWARD)))
        }
    }
}

impl TrainingTarget for RobotToTrain {
    fn name(&self) -> &str {
        self.file.name()
    }

    fn given(&self) -> String {
        path_text(self.file.path())
    }

    fn layout(&self, _: &AlgorithmSettings) -> Layout {
        self.file.layout()
    }

    fn limiter(&self, settings: &AlgorithmSettings) -> Result<Option<ActionLimiter>, MishandleError> {
        let episodes = settings.episodes();
        if episodes.action_interface.is_some() || !episodes.further_parts.is_empty() {
            let option = "an action interface or further parts of the observation (the table [episodes] of the \
                          training settings)";
            return Err(unsupported(self.name(), option));
        }
        Ok(None)
    }

    fn preset(&self) -> &'static str {
        "none"
    }

    fn hash(&self, reward: &str) -> Result<String, MishandleError> {
        RobotToTrain::check_reward(reward)?;
        Ok(self.training.hash.clone())
    }

    fn specification(&self) -> Result<Specification, MishandleError> {
        Ok(self.training.specification.clone())
    }

    fn scene(&self, reward: &str, settings: &AlgorithmSettings) -> Result<TrainingScene, MishandleError> {
        RobotToTrain::check_reward(reward)?;
        if *settings.rewards() != RewardSettings::default() {
            let option = "reward terms for the manner (the table [rewards] of the training settings)";
            return Err(unsupported(self.name(), option));
        }
        let RobotTraining { environment, hash, disturbances, axes, spaces, .. } = self.training.clone();
        let starts = of_robot(environment.clone(), &hash);
        let over = move |space: &Space| Ok(of_robot(Arc::new(environment.with_own_axes(space)?), &hash));
        Ok(TrainingScene::new(axes, spaces, disturbances, starts, over))
    }

    fn start_controller(&self, name: &str) -> Result<ControllerFile, MishandleError> {
        if is_onnx(Path::new(name)) {
            return Err(not_a_start("an ONNX model"));
        }
        Ok(controller_file(&needed(&self.file), Path::new(name))?.0)
    }

    fn guard(&self, guard: &GuardPlan, _: &AlgorithmSettings) -> Result<Guard, MishandleError> {
        training_guard(guard, guarded_loop(&self.file)?, |name| fallback(&self.file, name))
    }

    fn shipped_settings(&self, _: &str, _: &str) -> Result<Option<ShippedFile>, MishandleError> {
        Ok(None)
    }

    fn identity(&self, plan: &Plan, controller_hash: &str) -> Result<Identity, MishandleError> {
        Ok(self.file.identity(controller_hash, noise(plan)))
    }
}

fn of_robot(environment: Arc<RobotEnvironment>, hash: &str) -> TrainingEnvironment {
    let batches = Arc::new(RobotBatches::new(environment.clone(), hash));
    TrainingEnvironment { environment, batches, task: None }
}
