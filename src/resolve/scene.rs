//! Targets with a scene: tasks, and robots that a file describes. Their states can be drawn and
//! recorded in full, and other engines can simulate them.

use std::path::Path;
use std::sync::Arc;

use mishandle_camera::Size;
use mishandle_camera::sight::{Sight, View};
use mishandle_robots::{ControlledRobot, RobotEnvironment, RobotFile};
use mishandle_rollout::{Controller, Environment, Rollout, Scenario, ScenarioBatch, Space, Specification};
use mishandle_store::RunHeader;
use mishandle_tasks::{
    Definition, JOINT_NAMES, Preset, Reward, TaskBatch, TaskEnvironment, TaskError, TaskTarget,
};
use mishandle_world::{FullState, Model, PictureModel, WorldDevice};

use crate::error::{MishandleError, invalid, problem};
use crate::plan::Plan;
use crate::resolve::guard::quantities;
use crate::resolve::robot::controlled_robot;
use crate::resolve::{ResolvedPlan, has_scene, is_target_file, task, task_target};

/// An environment whose state rows begin with a state of its scene.
pub(crate) trait SceneEnvironment: Environment {
    /// Makes a recorder for state rows of this environment.
    fn full_state(&self) -> Result<FullState, MishandleError>;
}

impl SceneEnvironment for TaskEnvironment {
    fn full_state(&self) -> Result<FullState, MishandleError> {
        let task = self.definition().name;
        Ok(TaskEnvironment::full_state(self).map_err(|source| TaskError::Scene { task, source })?)
    }
}

impl SceneEnvironment for RobotEnvironment {
    fn full_state(&self) -> Result<FullState, MishandleError> {
        Ok(RobotEnvironment::full_state(self))
    }
}

/// A target with a scene, and its controller.
pub(crate) enum SceneTarget {
    Task(TaskTarget),
    Robot(Box<RobotFile>, ControlledRobot),
}

/// Returns the target of a plan as one with a scene.
pub(crate) fn scene_target(resolved: &ResolvedPlan) -> Result<SceneTarget, MishandleError> {
    let plan = &resolved.plan;
    check_scene(&resolved.target.identity.kind, &plan.target)?;
    if is_target_file(&plan.target) {
        let (file, robot) = controlled_robot(plan)?;
        Ok(SceneTarget::Robot(Box::new(file), robot))
    } else {
        Ok(SceneTarget::Task(task_target(plan)?))
    }
}

impl SceneTarget {
    /// Returns the environment over the axes of `space` that belong to the scene. With
    /// `all_signals` it computes the signals on request also if no formula reads them.
    pub(crate) fn environment(
        &self,
        space: &Space,
        specification: &Specification,
        all_signals: bool,
    ) -> Result<Arc<dyn SceneEnvironment>, MishandleError> {
        Ok(match self {
            SceneTarget::Task(target) => {
                let environment = target.environment(space, specification)?;
                Arc::new(if all_signals { environment.with_manner() } else { environment })
            }
            SceneTarget::Robot(_, target) => Arc::new(target.environment(space)?),
        })
    }

    /// Makes batches whose physics `device` steps, with these numbers of rows.
    ///
    /// # Errors
    /// If the device cannot simulate the target over the axes of `space`.
    pub(crate) fn batches(
        &self,
        space: &Space,
        specification: &Specification,
        device: &dyn WorldDevice,
        rows: impl Iterator<Item = usize>,
    ) -> Result<Vec<Box<dyn ScenarioBatch>>, MishandleError> {
        type Boxed = Box<dyn ScenarioBatch>;
        match self {
            SceneTarget::Task(target) => {
                let environment = target.environment(space, specification)?;
                rows.map(|rows| Ok(Box::new(TaskBatch::new(&environment, device, rows)?) as Boxed)).collect()
            }
            SceneTarget::Robot(file, target) => {
                let robot = file.on_device(target, space)?;
                rows.map(|rows| Ok(Box::new(robot.batch(device, rows)?) as Boxed)).collect()
            }
        }
    }

    /// Returns the target, and another controller of it, in an environment that writes what both
    /// read.
    pub(crate) fn beside(
        self,
        other: Arc<dyn Controller>,
    ) -> Result<(SceneTarget, Arc<dyn Controller>), MishandleError> {
        match self {
            SceneTarget::Task(target) => {
                let (target, other) = target.beside(other)?;
                Ok((SceneTarget::Task(target), other))
            }
            SceneTarget::Robot(..) => Ok((self, other)),
        }
    }

    /// Makes the system of the controller in an environment that wraps one of this target.
    pub(crate) fn system_in(
        &self,
        environment: Arc<dyn Environment>,
        space: &Space,
        specification: &Specification,
    ) -> Result<Rollout, MishandleError> {
        Ok(match self {
            SceneTarget::Task(target) => target.system_in(environment, space, specification)?,
            SceneTarget::Robot(_, target) => target.system_in(environment, space, specification)?,
        })
    }

    /// Returns the controller.
    pub(crate) fn controller(&self) -> &Arc<dyn Controller> {
        match self {
            SceneTarget::Task(target) => target.controller(),
            SceneTarget::Robot(_, target) => target.controller(),
        }
    }

    /// Returns what the controller has to do, in words: the summary of a task, or the name of a
    /// target file.
    pub(crate) fn instruction(&self) -> &str {
        match self {
            SceneTarget::Task(target) => target.starts().definition().summary,
            SceneTarget::Robot(file, _) => file.name(),
        }
    }

    /// Returns the name of the robot: that of the tasks, or that of a target file.
    pub(crate) fn robot(&self) -> &str {
        match self {
            SceneTarget::Task(_) => "panda",
            SceneTarget::Robot(file, _) => file.name(),
        }
    }

    /// Returns the names of the numbers of an observation.
    pub(crate) fn observation_names(&self) -> Vec<String> {
        quantities(&match self {
            SceneTarget::Task(target) => {
                target.starts().definition().layout_with(target.controller().further_parts())
            }
            SceneTarget::Robot(file, _) => file.layout(),
        })
    }

    /// Returns the name of an action: its joint, or its number from 1.
    pub(crate) fn action_name(&self, index: usize) -> String {
        match self {
            SceneTarget::Task(_) => JOINT_NAMES[index].to_string(),
            SceneTarget::Robot(..) => (index + 1).to_string(),
        }
    }
}

/// Checks that targets of this kind have a scene.
fn check_scene(kind: &str, target: &str) -> Result<(), MishandleError> {
    if has_scene(kind) {
        Ok(())
    } else {
        Err(invalid(
            "the target of pictures and full records",
            target,
            "a task or a target file, because other targets have no scene",
        ))
    }
}

/// Returns the model of the pictures of a target: the name of a task, or the path of a target file.
///
/// # Errors
/// If there is no such task, or a file cannot be read or is wrong.
pub fn picture_model(target: &str) -> Result<PictureModel, MishandleError> {
    if is_target_file(target) {
        return Ok(RobotFile::read(Path::new(target))?.picture_model().clone());
    }
    let task = task(target)?;
    let scene_error = |source| TaskError::Scene { task: task.definition().name, source };
    Ok(mishandle_tasks::picture_model(task).map_err(scene_error)?)
}

/// The cameras of a target, the model whose states they show, and what they see at nominal.
pub(crate) struct TargetSight {
    pub sight: Sight,
    pub model: Model,
    pub view: View,
}

/// Returns the cameras of a target, with images of this size.
pub(crate) fn target_sight(target: &str, size: Size) -> Result<TargetSight, MishandleError> {
    let no_cameras = |expected| invalid("the target of images", target, expected);
    if is_target_file(target) {
        let file = RobotFile::read(Path::new(target))?;
        let expected = "one with cameras: state some in a table [cameras] of the target file";
        let sight = file.sight().cloned().ok_or_else(|| no_cameras(expected))?;
        let (model, view) = file.view(size)?.ok_or_else(|| no_cameras(expected))?;
        return Ok(TargetSight { sight, model, view });
    }
    let task = task(target)
        .map_err(|_| no_cameras("a task or a target file, because other targets have no cameras"))?;
    let scene_error = |source| TaskError::Scene { task: task.definition().name, source };
    let (model, view) = mishandle_tasks::sight::view(task, size).map_err(scene_error)?;
    Ok(TargetSight { sight: mishandle_tasks::sight::sight(task.definition()), model, view })
}

/// Returns the names of the cameras of a target; none if it has no cameras.
///
/// # Errors
/// If the target file cannot be read or is wrong.
pub fn camera_names(target: &str) -> Result<Vec<String>, MishandleError> {
    let sight = if is_target_file(target) {
        RobotFile::read(Path::new(target))?.sight().cloned()
    } else {
        task(target).ok().map(|task| mishandle_tasks::sight::sight(task.definition()))
    };
    Ok(sight.map_or_else(Vec::new, |sight| sight.names().map(ToString::to_string).collect()))
}

/// Returns the model of the pictures of a run.
///
/// # Errors
/// If the target has no scene, or its files cannot be read.
pub fn recorded_picture(header: &RunHeader) -> Result<PictureModel, MishandleError> {
    picture_model(&recorded_target(header)?)
}

/// Returns the target of a run with a scene, as its plan names it.
///
/// # Errors
/// If the target has no scene.
pub fn recorded_target(header: &RunHeader) -> Result<String, MishandleError> {
    let plan = Plan::from_toml(&header.plan)?;
    check_scene(&header.target.kind, &plan.target)?;
    Ok(plan.target)
}

/// Returns the environment of a target over the axes of its start, and a start of it. `x0` has one
/// value per axis, in the unit of the axis; without it, the axes are nominal.
pub(crate) fn scene_start(
    target: &str,
    x0: Option<&[f64]>,
) -> Result<(Arc<dyn SceneEnvironment>, Scenario), MishandleError> {
    let environment: Arc<dyn SceneEnvironment> = if is_target_file(target) {
        Arc::new(RobotFile::read(Path::new(target))?.starts()?)
    } else {
        Arc::new(TaskEnvironment::new(task(target)?, Preset::Paper, Reward::Original)?)
    };
    let scenario = x0.map_or_else(|| environment.space().nominal(), Scenario::from);
    environment.space().check(&scenario)?;
    if let Some(task) = mishandle_tasks::task(target) {
        check_in_box(task.definition(), x0.unwrap_or_default())?;
    }
    Ok((environment, scenario))
}

/// Checks that an initial state is in the box of a task preset. The error names the bounds of task
/// preset `paper`.
fn check_in_box(definition: &Definition, x0: &[f64]) -> Result<(), MishandleError> {
    let outside = |preset| {
        definition.initial_box.iter().zip(x0).find(move |(axis, value)| {
            let [low, high] = axis.bounds(preset);
            !(low..=high).contains(*value)
        })
    };
    match (outside(Preset::Paper), outside(Preset::Code)) {
        (Some((axis, &value)), Some(_)) => {
            let [low, high] = axis.bounds(Preset::Paper);
            let unit = axis.unit;
            Err(problem(format!(
                "{} is {value} {unit}, outside the initial box: from {low} to {high} {unit} in task preset paper",
                axis.name
            )))
        }
        _ => Ok(()),
    }
}
