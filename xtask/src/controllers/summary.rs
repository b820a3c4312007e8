//! What the tables come to, in a few lines.

use super::plan::{self, ALGORITHMS, SHIPPED_SEED};
use super::tables::{Shown, misses};

/// How many controllers reach all their bars, which do not, and which seeds were not run.
pub fn summary(shown: &Shown<'_>) -> String {
    let shipped = Tally::of(shown, |seed| seed == SHIPPED_SEED);
    let further = Tally::of(shown, |seed| seed != SHIPPED_SEED);
    format!(
        "Of {} shipped controllers {} reach every bar{}.\n\nOf {} further seeds of the plan {} were run, and {} of these reach \
         every bar{}.\n",
        shipped.planned,
        shipped.reaching(),
        listed("; the others miss: ", &shipped.missing),
        further.planned,
        further.run,
        further.reaching(),
        listed("; the others miss: ", &further.missing),
    )
}

/// How trainings of the plan stand.
#[derive(Default)]
struct Tally {
    planned: usize,
    run: usize,
    /// Each that misses a bar, and what it misses.
    missing: Vec<String>,
}

impl Tally {
    fn of(shown: &Shown<'_>, counts: impl Fn(u64) -> bool) -> Tally {
        let mut tally = Tally::default();
        for task in shown.names() {
            for algorithm in ALGORITHMS {
                for seed in plan::seeds(algorithm).into_iter().filter(|seed| counts(*seed)) {
                    tally.planned += 1;
                    let Some((standing, record)) = shown.recorded(task, algorithm, seed) else { continue };
                    tally.run += 1;
                    let missed = misses(standing, record);
                    if !missed.is_empty() {
                        let name = standing.training.controller();
                        tally.missing.push(format!("`{task}` `{name}` ({})", missed.join(", ")));
                    }
                }
            }
        }
        tally
    }

    fn reaching(&self) -> usize {
        self.run - self.missing.len()
    }
}

fn listed(before: &str, names: &[String]) -> String {
    if names.is_empty() { String::new() } else { before.to_string() + &names.join(", ") }
}
