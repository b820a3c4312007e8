use mishandle::stl::nearest;

use crate::zoo::{Training, ZooError, algorithms};

/// The controller of a task that is a program.
const EXPERT: &str = "expert";

/// A part of the plan.
///
/// # Example
/// ```
/// use mishandle_studies::zoo::{Selection, Training};
/// let selection = Selection { only: Some("ball-pushing/sac".into()) };
/// let training = |name: &str| Training { task: "ball-pushing".into(), algorithm: name.into() };
/// assert!(selection.includes(&training("sac")) && !selection.includes(&training("ppo")));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// `TASK` or `TASK/CONTROLLER`; `None` for all.
    pub only: Option<String>,
}

impl Selection {
    /// Checks that the task and the controller of the selection exist.
    ///
    /// # Errors
    /// If one does not.
    pub(crate) fn check<'a>(&self, tasks: impl Iterator<Item = &'a str>) -> Result<(), ZooError> {
        let Some(only) = &self.only else { return Ok(()) };
        let tasks: Vec<&str> = tasks.collect();
        let controllers: Vec<&str> = algorithms().chain([EXPERT]).collect();
        let with_controllers = tasks
            .iter()
            .flat_map(|task| controllers.iter().map(move |controller| format!("{task}/{controller}")));
        let known: Vec<String> = tasks.iter().map(ToString::to_string).chain(with_controllers).collect();
        if known.contains(only) {
            return Ok(());
        }
        Err(ZooError::UnknownSelection {
            only: only.clone(),
            nearest: nearest(only, known.iter().map(String::as_str)).map(String::from),
            tasks: tasks.into_iter().map(String::from).collect(),
            controllers: controllers.into_iter().map(String::from).collect(),
        })
    }

    /// Returns whether a training run is selected.
    pub fn includes(&self, training: &Training) -> bool {
        self.names(&training.task, &training.algorithm)
    }

    /// Returns whether the expert of a task is selected.
    pub fn includes_expert(&self, task: &str) -> bool {
        self.names(task, EXPERT)
    }

    fn names(&self, task: &str, controller: &str) -> bool {
        self.only.as_ref().is_none_or(|only| *only == task || *only == format!("{task}/{controller}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn selection(only: &str) -> Selection {
        Selection { only: Some(only.to_string()).filter(|only| !only.is_empty()) }
    }

    #[test]
    fn trainings_and_experts_are_selected_by_task_and_name() {
        let training = |task: &str, algorithm: &str| Training {
            task: task.to_string(),
            algorithm: algorithm.to_string(),
        };
        let one = selection("ball-pushing/sac");
        assert!(one.includes(&training("ball-pushing", "sac")));
        for (task, algorithm) in [("ball-pushing", "td3"), ("ball-catching", "sac")] {
            assert!(!one.includes(&training(task, algorithm)), "{task} {algorithm}");
        }
        assert!(selection("").includes(&training("ball-pushing", "ppo")));
        assert!(selection("ball-pushing").includes_expert("ball-pushing"));
        assert!(selection("ball-pushing/expert").includes_expert("ball-pushing"));
        assert!(!selection("ball-pushing/ppo").includes_expert("ball-pushing"));
    }

    #[test]
    fn a_selection_that_does_not_exist_is_an_error_that_says_what_does() {
        let check = |only| selection(only).check(["ball-pushing", "ball-catching"].into_iter());
        for only in ["", "ball-pushing", "ball-catching/sac", "ball-pushing/expert"] {
            assert!(check(only).is_ok(), "{only}");
        }
        let error = check("ball-puhsing/sac").unwrap_err().to_string();
        assert_eq!(
            error,
            "--only is `ball-puhsing/sac`; it must be TASK or TASK/CONTROLLER, with a task of ball-pushing, ball-catching \
             and a controller of ppo, trpo, sac, td3, ddpg, expert; did you mean `ball-pushing/sac`?"
        );
        for only in ["ppo", "ball-pushing/ppo-s1", "ball-pushing/", "/ppo"] {
            assert!(check(only).is_err(), "{only}");
        }
    }
}
