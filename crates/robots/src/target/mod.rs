//! A robot that a file describes, as a target.

mod compile;
mod device;
mod read;
mod spaces;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{Entry, Layout};
use mishandle_rollout::{
    AxisKind, Component, Controller, Identity, NamedFormula, Noise, RolloutError, Signal, Space,
    Specification, Target,
};
use mishandle_simulators::ProgramPolicy;
use mishandle_world::{Model, PictureModel};

use crate::axes::{Axes, ObservedPart};
use crate::cameras::RobotCameras;
use crate::controlled::ControlledRobot;
use crate::description::{Description, Named, Quantity};
use crate::document;
use crate::environment::RobotEnvironment;
use crate::error::{Problem, RobotError};
use crate::library::RememberedPart;
use crate::model::RobotModel;
use crate::phase::PhaseBuilder;

pub use device::DeviceRobot;
pub(crate) use read::read_text;

/// Kind of the targets that a file describes.
pub const KIND: &str = "robot";

/// Roles of the components that are files of the robot, not its controller.
pub const FILE_ROLES: [&str; 2] = ["target file", "model"];

/// Where the actions of a robot come from, as its file says.
pub enum RobotPolicy {
    /// A file beside the target file.
    File {
        /// Its path.
        path: PathBuf,
        /// Names of the input and the output of an ONNX model, if the file names them.
        interface: [Option<String>; 2],
    },
    /// An expression of the file.
    Expression(Arc<dyn Controller>),
    /// The built-in controller of a site's position.
    BuiltIn(Arc<dyn Controller>),
    /// A program that answers each observation.
    Program(Arc<ProgramPolicy>),
    /// None: a controller must be given.
    Open,
}

/// A robot that a file describes.
pub struct RobotFile {
    path: PathBuf,
    text: String,
    /// Hash of the text of the file.
    pub(crate) text_hash: String,
    pub(crate) model: RobotModel,
    pub(crate) description: Description,
    axes: Axes,
    parts: Vec<ObservedPart>,
    policy: RobotPolicy,
    /// The robot, except what depends on the number of actions.
    observation_size: usize,
    /// Actuators that get the controls, in the order of the expression.
    actuated: Vec<usize>,
    parameters: Vec<String>,
    memory: Vec<RememberedPart>,
    pub(crate) cameras: Option<RobotCameras>,
}

impl RobotFile {
    /// Returns the name of the robot.
    pub fn name(&self) -> &str {
        &self.description.name
    }

    /// Returns the paths of the files that the target is made of: the file itself, those of the
    /// model and the policy.
    pub fn files(&self) -> Vec<PathBuf> {
        let policy = match &self.policy {
            RobotPolicy::File { path, .. } => vec![path.clone()],
            RobotPolicy::Program(program) => program.files(),
            _ => Vec::new(),
        };
        [self.path.clone()].into_iter().chain(self.model.files.iter().cloned()).chain(policy).collect()
    }

    /// Returns the policy that the file names.
    pub fn policy(&self) -> &RobotPolicy {
        &self.policy
    }

    /// Returns the number of actions that the file expects.
    pub fn actions(&self) -> usize {
        match (self.description.policy.actions, &self.policy) {
            (Some(actions), _) => actions,
            (None, RobotPolicy::Expression(policy) | RobotPolicy::BuiltIn(policy)) => policy.action_size(),
            (None, _) => self.actuated.len(),
        }
    }

    /// Returns the layout of observations and actions, which a controller must have.
    pub fn layout(&self) -> Layout {
        let entry =
            |part: &ObservedPart| Entry { name: part.name.clone(), unit: part.unit.clone(), size: part.size };
        let action = Entry { name: "action".to_string(), unit: String::new(), size: self.actions() };
        Layout { observation: self.parts.iter().map(entry).collect(), action: vec![action] }
    }

    /// Returns the parts of the observation that the policy sees.
    pub(crate) fn observed(&self) -> &[ObservedPart] {
        &self.parts
    }

    /// Returns whether a part of the observation reads more than axes and constants.
    pub(crate) fn part_reads_state(&self, name: &str) -> bool {
        let named = self.description.observation.iter().find(|named| named.key.name == name);
        let library = self.library(&self.memory, Some(self.actions()), &[]);
        let mut phase = PhaseBuilder::new(&library);
        named.is_some_and(|named| phase.add(&named.value.value).is_ok()) && phase.finish().reads_state()
    }

    /// Returns the length of an observation.
    pub fn observation_size(&self) -> usize {
        self.observation_size
    }

    /// Returns the number of actuators of the model.
    pub fn actuators(&self) -> usize {
        self.model.physics.actuators()
    }

    /// Returns the formulas of the file.
    pub(crate) fn formulas(&self) -> Vec<NamedFormula> {
        let formula = |named: &Named<document::Text>| NamedFormula {
            name: named.key.name.clone(),
            text: named.value.text.clone(),
        };
        self.description.formulas.iter().map(formula).collect()
    }

    /// Returns the error of a problem, with its line in the file.
    pub(crate) fn at(&self, problem: Problem) -> RobotError {
        problem.at(&self.path, &self.text)
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the identity of this robot as a target, with a controller of this hash and noise.
    pub fn identity(&self, controller_hash: &str, noise: Noise) -> Identity {
        let content = format!("{}\n{}\n{controller_hash}\n{noise:?}", self.text_hash, self.model.hash);
        Identity::new(KIND, &self.description.name, &content)
    }

    /// Returns the target of this robot with a controller and its components.
    ///
    /// # Errors
    /// If the controller does not fit, two axes have the same name, or a formula is wrong.
    pub fn target(
        &self,
        controller: Arc<dyn Controller>,
        components: Vec<Component>,
        noise: Noise,
    ) -> Result<Target, RobotError> {
        let controlled = self.controlled(controller, noise)?;
        let ControlledRobot { robot, controller, disturbances, .. } = &controlled;
        let (mut axes, spaces) = self.axes_and_spaces(&robot.axes, disturbances)?;
        let random = disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone());
        let mut random: Vec<String> = random.collect();
        if let Some(sight) = self.sight() {
            // Those that change what the controller sees.
            let unseen = sight.unseen_axes(controller.sees());
            let is_seen = |name: &str| unseen.iter().all(|own| own != name);
            axes.extend(sight.axes().filter(|axis| is_seen(&axis.name)).cloned());
            random.extend(sight.random_axes().filter(|name| is_seen(name)).map(str::to_string));
        }
        let signal =
            |named: &Named<Quantity>| Signal { name: named.key.name.clone(), unit: named.value.unit.clone() };
        let [target_file, model] = FILE_ROLES;
        let component_of = |role: &str, name: String, hash: &str| Component {
            role: role.to_string(),
            name,
            hash: hash.to_string(),
            file_hash: String::new(),
        };
        let file_name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let target = Target {
            identity: self.identity(&Component::joint_hash(&components), noise),
            components: components
                .into_iter()
                .chain([
                    component_of(target_file, file_name(&self.path), &self.text_hash),
                    component_of(model, file_name(&self.model.file), &self.model.hash),
                ])
                .collect(),
            spaces,
            axes,
            signals: self.description.signals.iter().map(signal).collect(),
            signals_on_request: Vec::new(),
            controller_signals: controlled.controller.signals().to_vec(),
            formulas: self.formulas(),
            control_dt: robot.control_dt,
            episode_steps: robot.episode_steps,
            is_deterministic: true,
            can_fail: !self.description.invalid.is_empty() || matches!(self.policy, RobotPolicy::Program(_)),
            depends_on_seed: !self.axes.draws.is_empty()
                || noise.action_std > 0.0
                || noise.observation_std > 0.0,
            random_axes: random,
            versions: vec![("MuJoCo".to_string(), mishandle_world::mujoco_version())],
            reachable: None,
            solver_variants: controlled.solver_variants(),
            factory: controlled.factory(),
        };
        let all = target.space("all")?;
        let names = target.signal_names();
        for named in &self.description.formulas {
            let check = || -> Result<(), String> {
                let formula =
                    mishandle_stl::Formula::parse(&named.value.text).map_err(|error| error.to_string())?;
                let clock = mishandle_stl::Clock::steps(target.control_dt);
                mishandle_stl::Monitor::new(&formula, &names, clock).map_err(|error| error.to_string())?;
                Ok(())
            };
            check().map_err(|message| {
                let message = format!("the formula `{}`: {message}", named.key.name);
                self.at(Problem::new(&named.value.span, message))
            })?;
        }
        let first = target.formulas.first().map(|formula| formula.text.clone()).unwrap_or_default();
        let requirement = mishandle_stl::Formula::parse(&first)
            .map_err(|source| RolloutError::Parse { formula: first.clone(), source })?;
        target.system(&all, &Specification::from_formulas(&target.formulas, requirement)?)?;
        Ok(target)
    }

    /// Returns this robot with a controller, in the systems of which states can be recorded.
    ///
    /// # Errors
    /// If an expression does not fit the number of actions of the controller.
    pub fn controlled(
        &self,
        controller: Arc<dyn Controller>,
        noise: Noise,
    ) -> Result<ControlledRobot, RobotError> {
        let mut robot = self.compiled(controller.action_size())?;
        if !controller.sees().is_empty() {
            robot.seen = self.seen()?;
        }
        let robot = Arc::new(robot);
        let disturbances = self.disturbances_of(robot.action_size);
        Ok(ControlledRobot { robot, controller, noise, disturbances })
    }

    /// Returns the environment over the axes of the start.
    ///
    /// # Errors
    /// As for [`controlled`](Self::controlled).
    pub fn starts(&self) -> Result<RobotEnvironment, RobotError> {
        let robot = Arc::new(self.compiled(self.actions())?);
        let axes = robot.axes.iter().map(|(axis, _)| axis).filter(|axis| axis.kind == AxisKind::Start);
        let space = Space::new("starts", axes.cloned().collect())?;
        Ok(RobotEnvironment::over(robot, &space)?)
    }

    /// Returns the model of pictures, with all visual geoms.
    pub fn picture_model(&self) -> &PictureModel {
        &self.model.picture
    }

    /// Returns the model for physics.
    pub fn model(&self) -> &Model {
        &self.model.physics
    }
}
