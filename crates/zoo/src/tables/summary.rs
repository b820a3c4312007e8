//! The tables in two sentences, and the controllers below a threshold.

use crate::tables::{Shown, is_current, missed};
use crate::{SHIPPED_SEED, algorithms, seeds};

/// How many controllers reach all their thresholds, which do not, and how many seeds were run.
pub(super) fn table(shown: &Shown<'_>) -> String {
    let shipped = Tally::of(shown, |seed| seed == SHIPPED_SEED);
    let further = Tally::of(shown, |seed| seed != SHIPPED_SEED);
    format!(
        "Of {} controllers of the first generation {} meet every threshold{}\nOf {} further seeds of the plan {} were run: {} without an \
         evaluation of the corners, because the weights were not kept, and {} with older settings or formulas. {} meet the \
         measured thresholds{}",
        shipped.planned,
        shipped.reaching(),
        shipped.others(),
        further.planned,
        further.run,
        further.without_corners,
        further.out_of_date,
        further.reaching(),
        further.others(),
    )
}

/// Counts of training runs.
#[derive(Default)]
struct Tally {
    planned: usize,
    run: usize,
    without_corners: usize,
    out_of_date: usize,
    /// Each task with its controllers that miss a threshold, with the thresholds.
    missing: Vec<(String, Vec<String>)>,
}

impl Tally {
    fn of(shown: &Shown<'_>, counts: impl Fn(u64) -> bool) -> Tally {
        let mut tally = Tally::default();
        for task in shown.names() {
            let mut missing = Vec::new();
            for algorithm in algorithms() {
                for seed in seeds(algorithm).into_iter().filter(|seed| counts(*seed)) {
                    tally.planned += 1;
                    let Some((entry, record)) = shown.recorded(task, algorithm, seed) else { continue };
                    tally.run += 1;
                    let corners = record.evaluation(0).and_then(|evaluation| evaluation.corners.as_ref());
                    tally.without_corners += usize::from(corners.is_none());
                    tally.out_of_date += usize::from(!is_current(entry));
                    let missed = missed(entry, record);
                    if !missed.is_empty() {
                        let name = entry.training.controller();
                        missing.push(format!("`{name}` ({})", missed.join(", ")));
                    }
                }
            }
            if !missing.is_empty() {
                tally.missing.push((task.to_string(), missing));
            }
        }
        tally
    }

    fn reaching(&self) -> usize {
        self.run - self.missing.iter().map(|(_, controllers)| controllers.len()).sum::<usize>()
    }

    /// Returns the end of the sentence and a list of the other controllers, a line per task.
    fn others(&self) -> String {
        if self.missing.is_empty() {
            return ".\n".to_string();
        }
        let lines = self
            .missing
            .iter()
            .map(|(task, controllers)| format!("- `{task}`: {}\n", controllers.join(", ")));
        format!(". Below a threshold:\n\n{}", lines.collect::<String>())
    }
}
