//! The manipulation tasks, one folder each, with their experts.
//!
//! A task states each fact once: its scene, signals, formulas, initial box, observation and reward. A new task is a
//! folder and one line of [`TASKS`].

mod ball_balancing;
mod ball_pushing;
mod definition;
mod environment;
mod expert;
mod point_reaching;
mod reward;
mod robot;

pub use definition::{BoxAxis, Definition, Formulas, Held, Preset, Quantity, Reward, Scene, Task};
pub use environment::{TaskEnvironment, TaskError};
pub use robot::{
    CONTROL_DT, EPISODE_STEPS, JOINT_NAMES, JOINTS, Panda, TARGET_STEP, VELOCITY_LIMIT, compose,
};

/// All tasks, in the order in which they are listed.
pub static TASKS: &[&dyn Task] =
    &[&point_reaching::PointReaching, &ball_balancing::BallBalancing, &ball_pushing::BallPushing];

/// The task of that name.
///
/// # Example
/// ```
/// let task = mishandle_tasks::task("ball-balancing").unwrap();
/// assert_eq!(task.definition().initial_box.len(), 2);
/// assert!(mishandle_tasks::task("ball_balancing").is_none());
/// ```
pub fn task(name: &str) -> Option<&'static dyn Task> {
    TASKS.iter().copied().find(|task| task.definition().name == name)
}
