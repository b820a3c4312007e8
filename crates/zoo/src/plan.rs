use std::ops::RangeInclusive;

use mishandle::training::ALGORITHMS;

/// The seed whose controller is shipped, in the first generation of controllers: the plan has no
/// other.
pub const SHIPPED_SEED: u64 = 0;

/// The algorithm whose shipped controllers are falsified when they are measured.
const FALSIFIED: &str = "ppo";

/// One step of the plan, on every task.
struct Group {
    /// `None`: all algorithms.
    algorithms: Option<&'static [&'static str]>,
    seeds: RangeInclusive<u64>,
}

/// The plan. The training runs of a group start when all of the group before have started.
const GROUPS: [Group; 4] = [
    Group { algorithms: None, seeds: SHIPPED_SEED..=SHIPPED_SEED },
    Group { algorithms: Some(&["ppo"]), seeds: 1..=4 },
    Group { algorithms: Some(&["trpo"]), seeds: 1..=4 },
    Group { algorithms: Some(&["sac", "td3", "ddpg"]), seeds: 1..=2 },
];

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

impl Group {
    fn algorithms(&self) -> Vec<&'static str> {
        self.algorithms.map_or_else(|| algorithms().collect(), <[&str]>::to_vec)
    }
}

/// Returns the names of the algorithms in the order of the tables.
pub fn algorithms() -> impl Iterator<Item = &'static str> {
    ALGORITHMS.iter().map(|entry| entry.name)
}

/// One training run of the plan.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Training {
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm.
    pub algorithm: String,
    /// Random seed.
    pub seed: u64,
}

impl Training {
    /// Returns the name of its controller among those of its task: `ppo`, or `ppo-s2` for seed 2.
    pub fn controller(&self) -> String {
        match self.seed {
            SHIPPED_SEED => self.algorithm.clone(),
            seed => format!("{}-s{seed}", self.algorithm),
        }
    }

    /// Returns the name of its files in a folder of training runs: `ball-pushing-ppo-s0`.
    pub fn name(&self) -> String {
        format!("{}-{}-s{}", self.task, self.algorithm, self.seed)
    }

    /// Returns whether its controller is falsified when it is measured.
    pub fn is_falsified(&self) -> bool {
        self.is_shipped() && self.algorithm == FALSIFIED
    }

    /// Returns whether its controller is shipped.
    pub fn is_shipped(&self) -> bool {
        self.seed == SHIPPED_SEED
    }
}

/// Returns all training runs on these tasks, group by group.
pub fn plan(tasks: &[String]) -> Vec<Vec<Training>> {
    let of_group = |group: &Group| {
        let algorithms = group.algorithms();
        let pairs = tasks.iter().flat_map(|task| algorithms.iter().map(move |name| (task, *name)));
        let seeds = |(task, algorithm): (&String, &str)| {
            let (task, algorithm) = (task.clone(), algorithm.to_string());
            let training = move |seed| Training { task: task.clone(), algorithm: algorithm.clone(), seed };
            group.seeds.clone().map(training)
        };
        pairs.flat_map(seeds).collect()
    };
    GROUPS.iter().map(of_group).collect()
}

/// Returns the seeds that the plan has for an algorithm, in ascending order.
pub fn seeds(algorithm: &str) -> Vec<u64> {
    let groups = GROUPS.iter().filter(|group| group.algorithms().contains(&algorithm));
    groups.flat_map(|group| group.seeds.clone()).collect()
}

#[cfg(test)]
mod tests {
    use mishandle::shipped::Generation;

    use super::*;

    #[test]
    fn tables_list_the_on_policy_algorithms_first() {
        assert_eq!(algorithms().collect::<Vec<_>>(), ["ppo", "trpo", "sac", "td3", "ddpg"]);
    }

    #[test]
    fn the_plan_has_every_shipped_controller_first_and_no_training_twice() {
        let tasks = ["a", "b"].map(String::from);
        let groups = plan(&tasks);
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [10, 8, 8, 12]);
        assert!(groups[0].iter().all(Training::is_shipped));
        let mut all: Vec<&Training> = groups.iter().flatten().collect();
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 38);
    }

    #[test]
    fn on_policy_algorithms_have_five_seeds_and_off_policy_algorithms_three() {
        assert_eq!(seeds("ppo"), [0, 1, 2, 3, 4]);
        assert_eq!(seeds("trpo"), [0, 1, 2, 3, 4]);
        for algorithm in ["sac", "td3", "ddpg"] {
            assert_eq!(seeds(algorithm), [0, 1, 2], "{algorithm}");
        }
    }

    #[test]
    fn a_shipped_controller_has_the_name_of_its_algorithm() {
        let training =
            |seed| Training { task: "ball-pushing".to_string(), algorithm: "sac".to_string(), seed };
        assert_eq!((training(0).controller(), training(2).controller()), ("sac".into(), "sac-s2".into()));
        assert_eq!(training(2).name(), "ball-pushing-sac-s2");
    }

    #[test]
    fn a_name_of_the_plan_is_of_the_first_generation_or_of_none() {
        for training in plan(&["ball-pushing".to_string()]).concat() {
            let name = training.controller();
            let expected = training.is_shipped().then(|| (&training.algorithm[..], Generation::of_paper()));
            assert_eq!(Generation::of(&name), expected, "{name}");
        }
    }

    #[test]
    fn every_shipped_ppo_controller_is_falsified_and_no_other() {
        let tasks: Vec<String> = ["cloth-placing", "ball-pushing"].map(String::from).to_vec();
        let falsified: Vec<String> = plan(&tasks)
            .concat()
            .iter()
            .filter(|training| training.is_falsified())
            .map(Training::name)
            .collect();
        assert_eq!(falsified, ["cloth-placing-ppo-s0", "ball-pushing-ppo-s0"]);
    }
}
