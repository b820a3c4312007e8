//! Four tasks of the benchmark as target files, with a shipped controller.

use mishandle::Plan;
use mishandle::resolve::task_target;
use mishandle_robots::RobotFile;
use mishandle_rollout::{Component, Episode, Noise, Request, Seed, Specification, Target};
use mishandle_stl::Formula;

const FILES: [(&str, &str); 4] = [
    ("point-reaching", include_str!("point-reaching.toml")),
    ("ball-balancing", include_str!("ball-balancing.toml")),
    ("ball-pushing", include_str!("ball-pushing.toml")),
    ("door-opening", include_str!("door-opening.toml")),
];

/// Returns a task as a file with `more` at its end.
///
/// # Panics
/// If it cannot be made.
pub fn file(task: &str, more: &str) -> RobotFile {
    let folder = tempfile::tempdir().unwrap();
    let (_, text) = FILES.iter().find(|(name, _)| *name == task).unwrap();
    let scene = mishandle_tasks::compose(mishandle_tasks::task(task).unwrap()).unwrap();
    std::fs::write(folder.path().join("scene.xml"), scene).unwrap();
    std::fs::write(folder.path().join("task.toml"), format!("{text}\n{more}")).unwrap();
    RobotFile::read(&folder.path().join("task.toml")).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns a task as the built-in target and as a file.
///
/// # Panics
/// If one of them cannot be made.
pub fn targets(task: &str) -> [Target; 2] {
    let built_in = task_target(&Plan::new(task, "ppo")).unwrap();
    let robot = file(task, "");
    let component = Component {
        role: "controller".to_string(),
        name: "ppo".to_string(),
        hash: String::new(),
        file_hash: String::new(),
    };
    let file = robot.target(built_in.controller().clone(), vec![component], Noise::default()).unwrap();
    [built_in.target().unwrap(), file]
}

/// Simulates random starts.
///
/// # Panics
/// If a simulation cannot run.
pub fn simulate(target: &Target, count: u64) -> Vec<Episode> {
    let space = target.space("starts").unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas[..1], requirement).unwrap();
    let requests: Vec<Request> =
        (0..count).map(|index| Request::new(space.sample(Seed(5), index), Seed(index))).collect();
    target.system(&space, &specification).unwrap().rollout(&requests).unwrap()
}
