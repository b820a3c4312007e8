//! The manipulation tasks, one folder each, with their experts.
//!
//! A task states each fact once: its scene, signals, formulas, initial box, observation and reward. A new task is a
//! folder and one line of [`TASKS`].

use std::sync::{PoisonError, RwLock};

mod axes;
mod ball_balancing;
mod ball_catching;
mod ball_pushing;
mod check;
mod cloth_placing;
mod cube_stacking;
mod definition;
mod document;
mod door_opening;
mod environment;
mod expert;
mod identity;
pub mod kinematic;
mod peg_in_hole;
mod point_reaching;
mod reward;
mod robot;
mod target;

pub use definition::{
    BoxAxis, Definition, Grip, Held, Hold, Preset, Quantity, Reward, Scene, Task, TaskFormulas, Variations,
    one, three,
};
pub use document::{compose, compose_with_start};
pub use environment::{TaskEnvironment, TaskError};
pub use expert::{Expert, ExpertInput, ExpertPolicy, limited};
pub use identity::task_hash;
pub use reward::effort;
pub use robot::{
    CONTROL_DT, EPISODE_STEPS, FINGER_STEP, JOINT_NAMES, JOINTS, Panda, TARGET_STEP, VELOCITY_LIMIT,
};
pub use target::TaskTarget;

/// The benchmark's tasks, in the order in which they are listed.
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

/// Tasks beside the benchmark's.
static ADDED: RwLock<Vec<&'static dyn Task>> = RwLock::new(Vec::new());

/// Adds a task to those that are known by name.
///
/// # Errors
/// If its definition has a mistake, another task has the same name, or the task that it varies is unknown.
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

/// All tasks: the benchmark's, then those that were added.
pub fn tasks() -> Vec<&'static dyn Task> {
    let added = ADDED.read().unwrap_or_else(PoisonError::into_inner);
    TASKS.iter().chain(added.iter()).copied().collect()
}

/// The task of that name.
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
