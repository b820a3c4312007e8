use crate::Training;

/// A part of the plan.
///
/// # Example
/// ```
/// use mishandle_experiments::{Selection, Training};
/// let selection = Selection { only: Some("ball-pushing/sac".into()), seeds: vec![0, 2] };
/// let training = |seed| Training { task: "ball-pushing".into(), algorithm: "sac".into(), seed };
/// assert!(selection.includes(&training(2)) && !selection.includes(&training(1)));
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// `TASK` or `TASK/CONTROLLER`; `None` for all.
    pub only: Option<String>,
    /// Random seeds; empty for all.
    pub seeds: Vec<u64>,
}

impl Selection {
    /// Returns whether a training run is selected.
    pub fn includes(&self, training: &Training) -> bool {
        (self.seeds.is_empty() || self.seeds.contains(&training.seed))
            && self.names(&training.task, &training.algorithm)
    }

    /// Returns whether the expert of a task is selected. A selection of seeds has no experts.
    pub fn includes_expert(&self, task: &str) -> bool {
        self.seeds.is_empty() && self.names(task, "expert")
    }

    fn names(&self, task: &str, controller: &str) -> bool {
        self.only.as_ref().is_none_or(|only| *only == task || *only == format!("{task}/{controller}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn selection(only: &str, seeds: &[u64]) -> Selection {
        Selection { only: Some(only.to_string()).filter(|only| !only.is_empty()), seeds: seeds.to_vec() }
    }

    fn training(task: &str, algorithm: &str, seed: u64) -> Training {
        Training { task: task.to_string(), algorithm: algorithm.to_string(), seed }
    }

    #[test]
    fn trainings_are_selected_by_task_algorithm_and_seed() {
        let one = selection("ball-pushing/sac", &[0, 2]);
        assert!(one.includes(&training("ball-pushing", "sac", 2)));
        for (task, algorithm, seed) in
            [("ball-pushing", "sac", 1), ("ball-pushing", "td3", 0), ("ball-catching", "sac", 0)]
        {
            assert!(!one.includes(&training(task, algorithm, seed)), "{task} {algorithm} {seed}");
        }
        assert!(selection("", &[]).includes(&training("ball-pushing", "ppo", 4)));
    }

    #[test]
    fn experts_are_selected_by_task_or_name_but_not_by_seed() {
        assert!(selection("ball-pushing", &[]).includes_expert("ball-pushing"));
        assert!(selection("ball-pushing/expert", &[]).includes_expert("ball-pushing"));
        assert!(!selection("ball-pushing/ppo", &[]).includes_expert("ball-pushing"));
        assert!(!selection("ball-pushing", &[0]).includes_expert("ball-pushing"));
    }
}
