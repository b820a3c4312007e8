//! The tables in two sentences.

use crate::tables::{Shown, missed};
use crate::{SHIPPED_SEED, algorithms, seeds};

/// How many controllers reach all their thresholds, which do not, and how many seeds were run.
pub(super) fn table(shown: &Shown<'_>) -> String {
    let shipped = Tally::of(shown, |seed| seed == SHIPPED_SEED);
    let further = Tally::of(shown, |seed| seed != SHIPPED_SEED);
    format!(
        "Of {} shipped controllers {} meet every threshold{}.\n\nOf {} further seeds of the plan {} were run, and {} of these meet \
         every threshold{}.\n",
        shipped.planned,
        shipped.reaching(),
        shipped.others(),
        further.planned,
        further.run,
        further.reaching(),
        further.others(),
    )
}

/// Counts of training runs.
#[derive(Default)]
struct Tally {
    planned: usize,
    run: usize,
    /// Each controller that misses a threshold, with the thresholds.
    missing: Vec<String>,
}

impl Tally {
    fn of(shown: &Shown<'_>, counts: impl Fn(u64) -> bool) -> Tally {
        let mut tally = Tally::default();
        for task in shown.names() {
            for algorithm in algorithms() {
                for seed in seeds(algorithm).into_iter().filter(|seed| counts(*seed)) {
                    tally.planned += 1;
                    let Some((entry, record)) = shown.recorded(task, algorithm, seed) else { continue };
                    tally.run += 1;
                    let missed = missed(entry, record);
                    if !missed.is_empty() {
                        let name = entry.training.controller();
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

    fn others(&self) -> String {
        match self.missing.is_empty() {
            true => String::new(),
            false => format!("; the others are below: {}", self.missing.join(", ")),
        }
    }
}
