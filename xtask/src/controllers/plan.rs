//! Which trainings there are, in which order, and what each is held to.

use std::ops::RangeInclusive;

/// Algorithms, in the order of the tables: a copy of the list in `crates/training`, which xtask does not link. A test
/// compares it with the settings page, which is made from that list.
pub const ALGORITHMS: [&str; 5] = ["ppo", "trpo", "sac", "td3", "ddpg"];

/// The seed whose controller is shipped.
pub const SHIPPED_SEED: u64 = 0;

/// Whose controllers are put to the test, and the tasks where none is: a trial takes hours there.
const FALSIFIED: &str = "ppo";
const NOT_FALSIFIED: &str = "cloth-placing";

/// Trainings of one step of the plan, on every task.
struct Group {
    algorithms: &'static [&'static str],
    seeds: RangeInclusive<u64>,
}

/// The plan: a group begins when every training of the one before has begun.
const GROUPS: [Group; 4] = [
    Group { algorithms: &ALGORITHMS, seeds: SHIPPED_SEED..=SHIPPED_SEED },
    Group { algorithms: &["ppo"], seeds: 1..=4 },
    Group { algorithms: &["trpo"], seeds: 1..=4 },
    Group { algorithms: &["sac", "td3", "ddpg"], seeds: 1..=2 },
];

/// One training.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Training {
    pub task: String,
    pub algorithm: String,
    pub seed: u64,
}

impl Training {
    /// What its controller is called among those of its task.
    pub fn controller(&self) -> String {
        match self.seed {
            SHIPPED_SEED => self.algorithm.clone(),
            seed => format!("{}-s{seed}", self.algorithm),
        }
    }

    /// What its files are called where all trainings lie together.
    pub fn name(&self) -> String {
        format!("{}-{}-s{}", self.task, self.algorithm, self.seed)
    }

    /// Whether its controller is put to the test when it is measured.
    pub fn is_falsified(&self) -> bool {
        self.is_shipped() && self.algorithm == FALSIFIED && self.task != NOT_FALSIFIED
    }

    /// Whether its controller is shipped.
    pub fn is_shipped(&self) -> bool {
        self.seed == SHIPPED_SEED
    }
}

/// All trainings of these tasks, group by group.
pub fn plan(tasks: &[String]) -> Vec<Vec<Training>> {
    let of_group = |group: &Group| {
        let pairs = tasks.iter().flat_map(|task| group.algorithms.iter().map(move |name| (task, *name)));
        let seeds = |(task, algorithm): (&String, &str)| {
            let (task, algorithm) = (task.clone(), algorithm.to_string());
            let training = move |seed| Training { task: task.clone(), algorithm: algorithm.clone(), seed };
            group.seeds.clone().map(training)
        };
        pairs.flat_map(seeds).collect()
    };
    GROUPS.iter().map(of_group).collect()
}

/// The seeds that are planned for an algorithm, in ascending order.
pub fn seeds(algorithm: &str) -> Vec<u64> {
    let of = GROUPS.iter().filter(|group| group.algorithms.contains(&algorithm));
    of.flat_map(|group| group.seeds.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_algorithms_are_those_of_the_settings_page() {
        let page = include_str!("../../../docs/algorithms/settings.md");
        let headings: Vec<String> =
            page.lines().filter_map(|line| line.strip_prefix("## ")).map(str::to_lowercase).collect();
        assert_eq!(headings, ALGORITHMS);
    }

    #[test]
    fn every_controller_comes_before_further_seeds_and_none_comes_twice() {
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
    fn five_seeds_on_policy_and_three_off_policy() {
        assert_eq!(seeds("ppo"), [0, 1, 2, 3, 4]);
        assert_eq!(seeds("trpo"), [0, 1, 2, 3, 4]);
        for algorithm in ["sac", "td3", "ddpg"] {
            assert_eq!(seeds(algorithm), [0, 1, 2], "{algorithm}");
        }
    }

    #[test]
    fn the_shipped_controller_is_called_by_its_algorithm() {
        let training =
            |seed| Training { task: "ball-pushing".to_string(), algorithm: "sac".to_string(), seed };
        assert_eq!((training(0).controller(), training(2).controller()), ("sac".into(), "sac-s2".into()));
        assert_eq!(training(2).name(), "ball-pushing-sac-s2");
    }
}
