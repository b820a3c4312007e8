//! All seeds of an algorithm together.

use crate::tables::{NOTHING, Rate, Shown, is_current, missed, percent, strict, success, value};
use crate::{PlanEntry, Record, algorithms, interquartile_mean, seeds};

/// Interquartile mean, least and greatest rate over the seeds of each algorithm, and the seeds
/// below a threshold.
pub(super) fn table(shown: &Shown<'_>) -> String {
    let mut table = String::from(
        "| task | algorithm | seeds | SR: IQM | min | max | SR with noise: IQM | min | max | strict SR: IQM | min | max | \
         seeds below a threshold | seeds out of date | seeds not run |\n|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|---|---|\n",
    );
    for task in shown.names() {
        for algorithm in algorithms() {
            let planned = seeds(algorithm);
            let runs: Vec<(&PlanEntry, &Record)> =
                planned.iter().filter_map(|seed| shown.recorded(task, algorithm, *seed)).collect();
            if runs.is_empty() {
                table += &format!("| `{task}` | `{algorithm}` | 0 | | | | | | | | | | | | all |\n");
                continue;
            }
            let rates: [(Rate, usize); 3] = [(success, 0), (success, 1), (strict, 0)];
            // Figures of different worlds, or of different strict formulas, have no common mean.
            let (current, out_of_date): (Vec<_>, Vec<_>) =
                runs.iter().copied().partition(|(entry, _)| is_current(entry));
            let shown = if current.is_empty() { &out_of_date } else { &current };
            let shown_runs = [shown, shown, &current];
            let cells: Vec<String> = (rates.into_iter().zip(shown_runs))
                .map(|((rate, noise), runs)| spread(runs, noise, rate))
                .collect();
            let cells = cells.join(" | ");
            let missing: Vec<String> = (shown.iter())
                .filter_map(|(entry, record)| {
                    let missed = missed(entry, record);
                    let seed = entry.training.seed;
                    (!missed.is_empty()).then(|| format!("seed {seed}: {}", missed.join(", ")))
                })
                .collect();
            let has_run = |seed: &u64| runs.iter().any(|(entry, _)| entry.training.seed == *seed);
            let not_run: Vec<String> =
                planned.iter().filter(|seed| !has_run(seed)).map(u64::to_string).collect();
            let out_of_date: Vec<String> =
                out_of_date.iter().map(|(entry, _)| entry.training.seed.to_string()).collect();
            table += &format!(
                "| `{task}` | `{algorithm}` | {} | {cells} | {} | {} | {} |\n",
                shown.len(),
                missing.join("; "),
                out_of_date.join(", "),
                not_run.join(", "),
            );
        }
    }
    table
}

/// The cells: interquartile mean, least and greatest value of a rate, in percent. One run has no
/// spread.
fn spread(runs: &[(&PlanEntry, &Record)], noise: usize, rate: Rate) -> String {
    let values: Vec<f64> = runs.iter().filter_map(|(_, record)| value(record, noise, rate)).collect();
    let ends = [values.iter().copied().reduce(f64::min), values.iter().copied().reduce(f64::max)];
    let ends = ends.map(|end| match values.len() {
        0 | 1 => NOTHING.to_string(),
        _ => percent(end, 1),
    });
    [percent(interquartile_mean(&values), 1), ends.join(" | ")].join(" | ")
}
