//! Robots that a file describes, as targets: file, controller and noise of a plan, and as targets
//! of training.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Layout, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_interchange::{InterchangeError, OnnxPolicy, OnnxProblem};
use mishandle_robots::{
    ControlledRobot, ProgramPolicy, RobotBatches, RobotEnvironment, RobotError, RobotFile, RobotPolicy,
    RobotTraining,
};
use mishandle_rollout::{Component, Controller, Identity, Noise, Space, Specification, Target};
use mishandle_text::path_text;
use mishandle_training::{AlgorithmSettings, RewardSettings};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::training::{TrainingEnvironment, TrainingScene, TrainingTarget, noise, not_a_start};
use crate::resolve::{controller_name, is_onnx};
use crate::shipped::ShippedFile;

/// Returns whether the name of a target is the path of a target file.
pub fn is_robot_file(target: &str) -> bool {
    Path::new(target).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"))
}

impl Plan {
    /// Returns the plan with the absolute path of its target file, if it has one.
    pub(crate) fn with_absolute_target(&self) -> Plan {
        let mut plan = self.clone();
        if let (true, Ok(path)) = (is_robot_file(&plan.target), std::path::absolute(&plan.target)) {
            plan.target = path.to_string_lossy().into_owned();
        }
        plan
    }
}

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
        return Err(MishandleError::UnsupportedOption { target: plan.target.clone(), option });
    }
    let (robot, controller, noise) = parts(plan)?;
    Ok(robot.target(controller, noise)?)
}

/// As [`robot_target`], for recordings of its states and for other engines.
pub(crate) fn controlled_robot(plan: &Plan) -> Result<(RobotFile, ControlledRobot), MishandleError> {
    let (file, (controller, _), noise) = parts(plan)?;
    let robot = file.controlled(controller, noise)?;
    Ok((file, robot))
}

/// A controller, and its identity.
type Identified = (Arc<dyn Controller>, Component);

fn parts(plan: &Plan) -> Result<(RobotFile, Identified, Noise), MishandleError> {
    let robot = robot_file(plan)?;
    let noise = noise(plan);
    noise.check()?;
    let controller = controller(&robot, plan)?;
    Ok((robot, controller, noise))
}

/// Loads the controller of a plan, or the one that the file names.
fn controller(robot: &RobotFile, plan: &Plan) -> Result<Identified, MishandleError> {
    if !plan.controller.is_empty() {
        return of_file(robot, Path::new(&plan.controller), [None, None], plan.stochastic);
    }
    match robot.policy() {
        RobotPolicy::File { path, interface } => {
            let names = [0, 1].map(|index| interface[index].as_deref());
            of_file(robot, path, names, plan.stochastic)
        }
        RobotPolicy::Open => Err(MishandleError::InvalidValue {
            what: "the controller",
            value: "missing".to_string(),
            expected: "a path, because the target file has no policy: --controller FILE",
        }),
        RobotPolicy::Program(policy) => of_program(policy, plan),
        RobotPolicy::Expression(policy) => of_the_file(policy, "expression", plan),
        RobotPolicy::BuiltIn(policy) => of_the_file(policy, "task-space", plan),
    }
}

/// Returns a controller that the target file defines; its hash is that of the file.
fn of_the_file(
    policy: &Arc<dyn Controller>,
    name: &str,
    plan: &Plan,
) -> Result<(Arc<dyn Controller>, Component), MishandleError> {
    if plan.stochastic {
        return Err(not_stochastic(name));
    }
    let hash = format!("{name} of the target file");
    let component =
        Component { role: "controller".to_string(), name: name.to_string(), hash, file_hash: String::new() };
    Ok((policy.clone(), component))
}

/// Variable of the environment that allows target files to start programs.
const ALLOW_PROGRAMS: &str = "MISHANDLE_ALLOW_PROGRAMS";

/// Returns the policy of a program, which the user must have allowed: nothing else in a target file
/// is code.
fn of_program(policy: &Arc<ProgramPolicy>, plan: &Plan) -> Result<Identified, MishandleError> {
    let command = policy.command();
    if plan.stochastic {
        return Err(not_stochastic("a program"));
    }
    if std::env::var_os(ALLOW_PROGRAMS).is_none_or(|value| value != "1") {
        return Err(RobotError::NotAllowed { command, variable: ALLOW_PROGRAMS }.into());
    }
    policy.check()?;
    let component = Component {
        role: "controller".to_string(),
        name: command,
        hash: policy.hash()?,
        file_hash: String::new(),
    };
    Ok((policy.clone(), component))
}

fn not_stochastic(what: &str) -> MishandleError {
    MishandleError::InvalidValue {
        what: "controller",
        value: what.to_string(),
        expected: "a .safetensors file, because --stochastic samples the policy's actions",
    }
}

/// Returns the warnings about the policy of a plan whose target is a file; none for other targets.
///
/// # Errors
/// If the policy cannot be read, or no episode can start with it.
pub fn contract_warnings(plan: &Plan) -> Result<Vec<String>, MishandleError> {
    if !is_robot_file(&plan.target) {
        return Ok(Vec::new());
    }
    let robot = robot_file(plan)?;
    let (controller, _) = controller(&robot, plan)?;
    Ok(robot.check_contract(&*controller)?)
}

/// Adds the parts of the observation to the error of a model that expects another number of them.
fn with_parts(error: InterchangeError, robot: &RobotFile) -> MishandleError {
    match &error {
        InterchangeError::Onnx { problem: OnnxProblem::Shape { side: "observation", .. }, .. } => {
            let parts = robot.observation_text();
            let message = format!("{error}. The observation of the file: {parts}");
            RobotError::Policy { message }.into()
        }
        _ => error.into(),
    }
}

fn of_file(
    robot: &RobotFile,
    path: &Path,
    names: [Option<&str>; 2],
    stochastic: bool,
) -> Result<Identified, MishandleError> {
    let component = |hash: String, file_hash: String| Component {
        role: "controller".to_string(),
        name: controller_name(&path.to_string_lossy()),
        hash,
        file_hash,
    };
    let layout = robot.layout();
    if is_onnx(path) {
        if stochastic {
            return Err(not_stochastic("an ONNX model"));
        }
        let policy = OnnxPolicy::load_named(path, &[robot.name()], &layout, names)
            .map_err(|error| with_parts(error, robot))?;
        let component = component(policy.hash().to_string(), policy.file_hash().to_string());
        return Ok((Arc::new(policy), component));
    }
    let (file, bytes) = controller_file(robot, path)?;
    let policy = file.policy.sampling(stochastic);
    let component = component(policy.hash(), bytes_hash(&bytes));
    Ok((Arc::new(policy), component))
}

/// Reads a controller file of a robot; returns it with its bytes.
fn controller_file(robot: &RobotFile, path: &Path) -> Result<(ControllerFile, Vec<u8>), MishandleError> {
    let read = |source| mishandle_controllers::ControllerError::Read { path: path.to_path_buf(), source };
    let bytes = read_bounded(path, limits::CONTROLLER).map_err(read)?;
    let wrong = |problem| mishandle_controllers::ControllerError::File { path: path.to_path_buf(), problem };
    let file = ControllerFile::from_bytes(&bytes).map_err(wrong)?;
    file.check(robot.name(), &robot.layout())?;
    Ok((file, bytes))
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
        match reward == RobotToTrain::REWARD {
            true => Ok(()),
            false => Err(MishandleError::InvalidValue {
                what: "--reward",
                value: reward.to_string(),
                expected: "left out: the rewards of a robot are those of its file, in the table [rewards]",
            }),
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

    fn layout(&self) -> Layout {
        self.file.layout()
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
            return Err(MishandleError::UnsupportedOption { target: self.name().to_string(), option });
        }
        let RobotTraining { environment, hash, disturbances, axes, spaces, .. } = self.training.clone();
        let named = (axes, spaces);
        let starts = of_robot(environment.clone(), &hash);
        let over = move |space: &Space| Ok(of_robot(Arc::new(environment.with_own_axes(space)?), &hash));
        Ok(TrainingScene::new(named, disturbances, starts, over))
    }

    fn start_controller(&self, name: &str) -> Result<ControllerFile, MishandleError> {
        if is_onnx(Path::new(name)) {
            return Err(not_a_start("an ONNX model"));
        }
        Ok(controller_file(&self.file, Path::new(name))?.0)
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
