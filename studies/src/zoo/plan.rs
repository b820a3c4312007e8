use mishandle::training::ALGORITHMS;

/// The seed of every training run.
pub(crate) const SEED: u64 = 0;

/// The algorithm whose controllers are falsified when they are measured.
const FALSIFIED: &str = "ppo";

/// Bars that controllers must reach without noise, percent: [`thresholds`](super::thresholds)
/// combines it with the paper's results.
pub(crate) struct Thresholds {
    /// Least success rate of PPO and TRPO, which the paper reports; at least the paper's.
    pub on_policy: f64,
    /// Least success rate of the other algorithms.
    pub off_policy: f64,
    /// Least strict success rate of `strict_algorithm`.
    pub strict: f64,
    pub strict_algorithm: &'static str,
}

/// The thresholds of all tasks.
pub(crate) const THRESHOLDS: Thresholds =
    Thresholds { on_policy: 95.0, off_policy: 90.0, strict: 90.0, strict_algorithm: "ppo" };

/// Returns the names of the algorithms in the order of the tables.
pub fn algorithms() -> impl Iterator<Item = &'static str> {
    ALGORITHMS.iter().map(|entry| entry.name)
}

/// One training run of the plan.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Training {
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm, and of its controller within its task.
    pub algorithm: String,
}

impl Training {
    /// Returns the name of its files in a folder of training runs: `ball-pushing-ppo`.
    pub fn name(&self) -> String {
        format!("{}-{}", self.task, self.algorithm)
    }

    /// Returns whether its controller is falsified when it is measured.
    pub fn is_falsified(&self) -> bool {
        self.algorithm == FALSIFIED
    }
}

/// Returns all training runs on these tasks: one for each algorithm.
pub fn plan(tasks: &[String]) -> Vec<Training> {
    let training =
        |task: &String, algorithm: &str| Training { task: task.clone(), algorithm: algorithm.to_string() };
    tasks.iter().flat_map(|task| algorithms().map(move |algorithm| training(task, algorithm))).collect()
}

#[cfg(test)]
mod tests {
    use crate::Generation;

    use super::*;

    #[test]
    fn tables_list_the_on_policy_algorithms_first() {
        assert_eq!(algorithms().collect::<Vec<_>>(), ["ppo", "trpo", "sac", "td3", "ddpg"]);
    }

    #[test]
    fn the_plan_has_a_controller_of_the_first_generation_for_each_algorithm() {
        let all = plan(&["a", "b"].map(String::from));
        assert_eq!((all.len(), all[5].name()), (10, "b-ppo".to_string()));
        for Training { algorithm, .. } in &all {
            assert_eq!(Generation::of(algorithm), Some((&algorithm[..], Generation::of_paper())));
        }
    }

    #[test]
    fn every_ppo_controller_is_falsified_and_no_other() {
        let all = plan(&["cloth-placing", "ball-pushing"].map(String::from));
        let falsified = all.iter().filter(|training| training.is_falsified()).map(Training::name);
        assert_eq!(falsified.collect::<Vec<_>>(), ["cloth-placing-ppo", "ball-pushing-ppo"]);
    }
}
