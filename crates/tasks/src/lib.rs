//! The manipulation tasks of the benchmark: a Franka Panda arm in MuJoCo, with a scripted expert
//! controller per task.
//!
//! A [`Task`] consists of a [`Definition`] (signals, formulas, initial box, observation and reward
//! terms as data) and a [`Scene`] (functions on a compiled MuJoCo model). A [`TaskEnvironment`] is
//! a task as an environment for training. A [`TaskTarget`] is a task with a controller, as a target
//! for evaluation and falsification. A new task is a folder of this crate and one line of
//! [`TASKS`]; a task of another crate is registered by [`add`].

use std::sync::{PoisonError, RwLock};

mod axes;
mod ball_balancing;
mod ball_catching;
mod ball_pushing;
mod batch;
mod cameras;
mod check;
mod cloth_placing;
mod cube_stacking;
mod definition;
mod document;
mod door_opening;
mod environment;
mod events;
mod expert;
mod fit;
mod full_state;
mod further;
mod identity;
pub mod kinematic;
mod manner;
mod manner_reward;
mod notes;
mod peg_in_hole;
mod point_reaching;
mod reward;
mod robot;
mod row_world;
pub mod sight;
mod target;
mod training_batch;

pub use batch::TaskBatch;
pub use cameras::{CAMERA_NAMES, CameraPlace, LAMP};
pub use definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Preset, Quantity, Reward, Scene, Task,
    TaskFormulas, Variations, scalar, vector3,
};
pub use document::{compose, compose_with_start, picture_model};
pub use environment::{TaskEnvironment, TaskError};
pub use expert::{Expert, ExpertInput, ExpertPolicy, clamp_norm};
pub use identity::{target_identity, task_hash};
pub use manner::{ACCELERATION_LIMIT, CAREFUL, MANNER, TORQUE_LIMIT};
pub use manner_reward::{MANNER_REWARD, MannerWeights};
pub use notes::{Note, Topic, notes};
pub use reward::action_penalty;
pub use robot::{
    ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, FINGER_STEP, JOINT_NAMES, JOINTS, Panda, TARGET_STEP,
    VELOCITY_LIMIT,
};
pub use target::TaskTarget;
pub use training_batch::TaskBatches;

/// The tasks of the benchmark, in the order of their listing.
pub static TASKS: &[&dyn Task] = &[
    &point_reaching::PointReaching,
    &cube_stacking::CubeStacking,
    &peg_in_hole::PegInHole,
    &ball_balancing::BallBalancing,
    &ball_catching::BallCatching,
    &ball_pushing::BallPushing,
    &door_opening::DoorOpening,
    &cloth_placing::CLOTH_PLACING,
    &cloth_placing::CLOTH_PLACING_7X7,
];

/// Tasks registered by [`add`].
static ADDED: RwLock<Vec<&'static dyn Task>> = RwLock::new(Vec::new());

/// Registers a task, so that its name is known on the command line and in plans.
///
/// # Errors
/// If its definition is invalid, another task has the same name, or the task that it is a variant
/// of is unknown.
pub fn add(new: &'static dyn Task) -> Result<(), TaskError> {
    let definition = new.definition();
    check::check_definition(definition)?;
    let mut added = ADDED.write().unwrap_or_else(PoisonError::into_inner);
    let is_known = |name| TASKS.iter().chain(added.iter()).any(|task| task.definition().name == name);
    let error = |field, problem| Err(TaskError::Field { task: definition.name, field, problem });
    if is_known(definition.name) {
        return error("name", "another task has the same name".to_string());
    }
    if let Some(base) = definition.variant_of.filter(|base| !is_known(base)) {
        return error("variant_of", format!("there is no task `{base}`"));
    }
    added.push(new);
    Ok(())
}

/// Returns all tasks: those of the benchmark, then the registered ones.
pub fn tasks() -> Vec<&'static dyn Task> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    TASKS.iter().chain(added.iter()).copied().collect()
}

/// Returns the folder of a task of the benchmark in the repository. It contains the task's code,
/// its scene, its page `page.md` and its picture `picture.png`.
///
/// # Example
/// ```
/// assert_eq!(mishandle_tasks::folder("ball-balancing"), "crates/tasks/src/ball_balancing");
/// ```
pub fn folder(name: &str) -> String {
    format!("crates/tasks/src/{}", name.replace('-', "_"))
}

/// Returns the task with this name, if it exists.
///
/// # Example
/// ```
/// let task = mishandle_tasks::task("ball-balancing").unwrap();
/// assert_eq!(task.definition().initial_box.len(), 2);
/// assert!(mishandle_tasks::task("ball_balancing").is_none());
/// ```
pub fn task(name: &str) -> Option<&'static dyn Task> {
    tasks().into_iter().find(|task| task.definition().name == name)
}
