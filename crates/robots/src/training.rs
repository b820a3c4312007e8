//! Robots as targets of training: environment, disturbances, formulas and a hash.

use std::sync::Arc;

use mishandle_rollout::{
    Axis, AxisKind, BatchFactory, Disturbance, EnvironmentBatch, EnvironmentSpec, Identity, RolloutError,
    Space, Specification,
};
use mishandle_stl::Formula;

use crate::environment::RobotEnvironment;
use crate::error::{Problem, RobotError};
use crate::target::{KIND, RobotFile};

/// Name of the space of the initial states.
const STARTS: &str = "starts";

/// Length of the part of the hash in the name of a training environment.
const SHORT_HASH: usize = 16;

/// A robot as training needs it.
#[derive(Clone)]
pub struct RobotTraining {
    /// Hash of all that training and its validations depend on: the text of the file and the model.
    pub hash: String,
    /// The environment over the axes of the initial state.
    pub environment: Arc<RobotEnvironment>,
    /// Disturbances of observations and actions.
    pub disturbances: Vec<Disturbance>,
    /// All axes of the environment and of the disturbances.
    pub axes: Vec<Axis>,
    /// The named spaces, `starts` first: it has all axes of the initial state, possibly none.
    pub spaces: Vec<Space>,
    /// The formulas of validations.
    pub specification: Specification,
}

impl RobotFile {
    /// Returns what training needs of this robot.
    ///
    /// Success is the formula `success`, or else the first one; strict success is the formula
    /// `strict`, or else success.
    ///
    /// # Errors
    /// If the file has no rewards or bounds no actions, or a formula is wrong.
    pub fn training(&self) -> Result<RobotTraining, RobotError> {
        let description = &self.description;
        if description.rewards.is_empty() {
            let message = "it has no rewards; add a table [rewards] of expressions, whose sum is the reward, such as \
                           `upright = \"1 - angle ** 2\"`";
            return Err(RobotError::Untrainable {
                path: self.path().to_path_buf(),
                message: message.to_string(),
            });
        }
        if !description.policy.limit.is_finite() {
            let message = "training needs bounded actions, from -1 to 1; set `policy.limit = 1` and let `policy.action` \
                           scale `action` to controls";
            return Err(self.at(Problem::new(&description.policy.action.text.span, message)));
        }
        if let Some(hold) = &description.policy.hold {
            let message =
                "training does not know `hold`: an action that has not arrived is 0 there; remove it";
            return Err(self.at(Problem::new(&hold.text.span, message)));
        }
        let robot = Arc::new(self.compiled(self.actions())?);
        let disturbances = self.disturbances_of(robot.action_size);
        let (axes, mut spaces) = self.axes_and_spaces(&robot.axes, &disturbances)?;
        // Every training episode has a random start, if the robot has any.
        let is_start = |axis: &&Axis| axis.kind == AxisKind::Start;
        let starts = Space::new(STARTS, axes.iter().filter(is_start).cloned().collect())?;
        spaces.retain(|space| space.name() != STARTS);
        spaces.insert(0, starts.clone());
        let content = format!("{}\n{}", self.text_hash, self.model.hash);
        Ok(RobotTraining {
            hash: Identity::new(KIND, self.name(), &content).hash,
            environment: Arc::new(RobotEnvironment::over(robot, &starts)?),
            disturbances,
            axes,
            spaces,
            specification: self.validation()?,
        })
    }

    fn validation(&self) -> Result<Specification, RobotError> {
        let formulas = self.formulas();
        let success = formulas.iter().find(|formula| formula.name == "success").or(formulas.first());
        let text = success.map(|formula| formula.text.clone()).unwrap_or_default();
        let success =
            Formula::parse(&text).map_err(|source| RolloutError::Parse { formula: text.clone(), source })?;
        let mut specification = Specification::from_formulas(&formulas, success.clone())?;
        specification.strict.get_or_insert(success.clone());
        specification.success = Some(success);
        // Validations have no measure of it.
        specification.careful = None;
        Ok(specification)
    }
}

/// Makes environment batches of a robot on the CPU.
pub struct RobotBatches {
    environment: Arc<RobotEnvironment>,
    hash: String,
}

impl RobotBatches {
    /// Makes a factory; `hash` is that of the robot's [training](RobotTraining::hash).
    pub fn new(environment: Arc<RobotEnvironment>, hash: &str) -> RobotBatches {
        RobotBatches { environment, hash: hash.chars().take(SHORT_HASH).collect() }
    }
}

impl BatchFactory for RobotBatches {
    fn spec(&self) -> EnvironmentSpec {
        let spec = self.environment.spec();
        // A checkpoint of one version of a file is not resumed on another.
        EnvironmentSpec { name: format!("{} {}", spec.name, self.hash), ..spec }
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        self.environment.batch(rows)
    }
}
