//! The generations of the shipped controllers.

use mishandle::training::ALGORITHMS;

/// A generation of shipped controllers: all that were trained by one protocol.
#[derive(Debug, PartialEq, Eq)]
pub struct Generation {
    /// Name in texts.
    pub name: &'static str,
    /// End of the names of its controllers, after the name of the algorithm.
    pub suffix: &'static str,
    /// How its controllers were trained.
    pub training: &'static str,
    /// Whether that is the protocol of the benchmark's paper.
    pub is_of_paper: bool,
}

/// The generations, in the order of the tables.
pub static GENERATIONS: [Generation; 2] = [
    Generation { name: "first", suffix: "", training: "trained on plain random starts", is_of_paper: true },
    Generation {
        name: "second",
        suffix: "-2",
        training: "trained on mixtures of delays, sensor errors, other models and events, PPO and TRPO also on faults",
        is_of_paper: false,
    },
];

impl Generation {
    /// Returns the generation that was trained by the protocol of the benchmark's paper.
    pub fn of_paper() -> &'static Generation {
        GENERATIONS.iter().find(|generation| generation.is_of_paper).unwrap_or(&GENERATIONS[0])
    }

    /// Returns the algorithm and the generation that the name of a shipped controller states;
    /// `None` for an expert, a path or another name.
    ///
    /// # Example
    /// ```
    /// use mishandle_studies::{GENERATIONS, Generation};
    ///
    /// assert_eq!(Generation::of("sac-2"), Some(("sac", &GENERATIONS[1])));
    /// assert_eq!(Generation::of("expert"), None);
    /// ```
    pub fn of(controller: &str) -> Option<(&'static str, &'static Generation)> {
        GENERATIONS.iter().find_map(|generation| {
            let algorithm = controller.strip_suffix(generation.suffix)?;
            let entry = ALGORITHMS.iter().find(|entry| entry.name == algorithm)?;
            Some((entry.name, generation))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_generation_is_that_of_the_paper() {
        let of_paper: Vec<&Generation> =
            GENERATIONS.iter().filter(|generation| generation.is_of_paper).collect();
        assert_eq!(of_paper, [Generation::of_paper()]);
    }

    #[test]
    fn each_name_states_one_algorithm_and_one_generation() {
        for entry in ALGORITHMS {
            for generation in &GENERATIONS {
                let name = format!("{}{}", entry.name, generation.suffix);
                assert_eq!(Generation::of(&name), Some((entry.name, generation)), "{name}");
            }
        }
        for other in ["", "expert", "-2", "ppo-3", "ppo-s2", "ppo-2-2", "./ppo-2.safetensors", "PPO"] {
            assert_eq!(Generation::of(other), None, "{other}");
        }
    }
}
