//! Kinds of targets, as run files name them.

/// Kind of the targets that are tasks.
const TASK: &str = "task";

/// Kind of the targets that are written in Python.
const PYTHON: &str = "python";

/// Returns whether targets of this kind have a scene, joints and pictures, and can be screened by
/// other engines: tasks, and robots that a file describes.
pub fn has_scene(kind: &str) -> bool {
    kind == TASK || kind == mishandle_robots::KIND
}

/// Returns whether targets of this kind are written in Python, so that this program cannot simulate
/// them without the system.
pub fn is_python(kind: &str) -> bool {
    kind == PYTHON
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::resolve::target;

    #[test]
    fn the_kinds_are_those_of_the_targets() {
        let kind = |name, controller| target(&Plan::new(name, controller)).unwrap().identity.kind;
        let task = kind("ball-balancing", "expert");
        assert!(has_scene(&task));
        let toy = kind("toy/noisy", "");
        assert!(!has_scene(&toy) && !is_python(&toy));
    }
}
