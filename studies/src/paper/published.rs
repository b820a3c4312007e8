//! The values that the paper prints, from the copies of its tables in
//! `studies/experiments/paper/published`.

use std::sync::LazyLock;

use serde::Deserialize;
use serde::de::DeserializeOwned;

const PERFORMANCE: &str = include_str!("../../experiments/paper/published/performance.csv");
const FALSIFICATION: &str = include_str!("../../experiments/paper/published/falsification.csv");

/// Number of starts of each row of the paper's table of performance.
pub const PAPER_STARTS: u64 = 100;

/// Number of trials of each row of the paper's table of falsification, and the budget of each.
pub const PAPER_TRIALS: u64 = 30;
/// Largest number of simulations of a trial.
pub const PAPER_BUDGET: u32 = 300;

/// Abbreviation of the paper and name of the task.
const TASKS: [(&str, &str); 8] = [
    ("PR", "point-reaching"),
    ("CS", "cube-stacking"),
    ("PH", "peg-in-hole"),
    ("BB", "ball-balancing"),
    ("BC", "ball-catching"),
    ("BP", "ball-pushing"),
    ("DO", "door-opening"),
    ("CP", "cloth-placing"),
];

#[derive(Debug, Deserialize)]
struct PerformanceRow {
    task: String,
    controller: String,
    tt: u32,
    sr: f64,
    dbr: f64,
    tct: f64,
    sr_noise: f64,
    dbr_noise: f64,
    tct_noise: f64,
}

#[derive(Debug, Deserialize)]
struct FalsificationRow {
    task: String,
    controller: String,
    optimizer: String,
    successes: u64,
    avg_time_s: Option<f64>,
    avg_sims: Option<f64>,
}

static PERFORMANCE_ROWS: LazyLock<Vec<PerformanceRow>> = LazyLock::new(|| rows(PERFORMANCE));
static FALSIFICATION_ROWS: LazyLock<Vec<FalsificationRow>> = LazyLock::new(|| rows(FALSIFICATION));

/// Reads a copy of a table. A test checks that every row can be read.
fn rows<T: DeserializeOwned>(text: &str) -> Vec<T> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().filter_map(Result::ok).collect()
}

/// Performance that the paper reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperPerformance {
    /// Success rate, percent.
    pub success: f64,
    /// Dangerous behavior rate, percent.
    pub danger: f64,
    /// Task completion time, control steps.
    pub completion: f64,
}

/// Result of a search that the paper reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperFalsification {
    /// Number of falsified trials of [`PAPER_TRIALS`].
    pub falsified: u64,
    /// Mean wall-clock time of the falsified trials, s.
    pub mean_secs: Option<f64>,
    /// Mean number of simulations of the falsified trials.
    pub mean_simulations: Option<f64>,
}

impl PaperFalsification {
    /// Returns the number of violations per simulation that the row implies, if each simulation
    /// violates the formula with the same probability: falsified trials by simulations. The paper's
    /// code counts the simulations before the violation.
    pub fn violations_per_simulation(&self) -> f64 {
        let found = self.falsified as f64;
        let before = self.mean_simulations.unwrap_or(0.0) * found;
        let unfound = (PAPER_TRIALS - self.falsified) as f64 * f64::from(PAPER_BUDGET);
        found / (found + before + unfound)
    }
}

/// Returns the performance of the paper's controller without and with noise; `None` if the paper
/// has no such controller.
pub fn paper_performance(task: &str, algorithm: &str) -> Option<[PaperPerformance; 2]> {
    let row = performance_row(task, algorithm)?;
    let found = [[row.sr, row.dbr, row.tct], [row.sr_noise, row.dbr_noise, row.tct_noise]];
    Some(found.map(|[success, danger, completion]| PaperPerformance { success, danger, completion }))
}

/// Returns the training time of the paper's controller, in control steps of each environment.
pub fn paper_training_time(task: &str, algorithm: &str) -> Option<u32> {
    performance_row(task, algorithm).map(|row| row.tt)
}

/// Returns the result of a search against the paper's controller; `None` if the paper has no such
/// row.
pub fn paper_falsification(task: &str, algorithm: &str, search: &str) -> Option<PaperFalsification> {
    let task = abbreviation(task)?;
    let controller = algorithm.to_uppercase();
    let search = search.replace('-', "_");
    let mut rows = FALSIFICATION_ROWS.iter();
    let row = rows.find(|row| row.task == task && row.controller == controller && row.optimizer == search)?;
    Some(PaperFalsification {
        falsified: row.successes,
        mean_secs: row.avg_time_s,
        mean_simulations: row.avg_sims,
    })
}

fn performance_row(task: &str, algorithm: &str) -> Option<&'static PerformanceRow> {
    let task = abbreviation(task)?;
    let controller = algorithm.to_uppercase();
    PERFORMANCE_ROWS.iter().find(|row| row.task == task && row.controller == controller)
}

fn abbreviation(task: &str) -> Option<&'static str> {
    TASKS.iter().find(|(_, name)| *name == task).map(|(short, _)| *short)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_of_the_copies_is_read() {
        for (text, read) in [(PERFORMANCE, PERFORMANCE_ROWS.len()), (FALSIFICATION, FALSIFICATION_ROWS.len())]
        {
            assert_eq!(text.lines().count() - 1, read);
        }
        assert_eq!((PERFORMANCE_ROWS.len(), FALSIFICATION_ROWS.len()), (8 * 2, 8 * 2 * 3));
        assert_eq!(paper_training_time("ball-pushing", "trpo"), Some(175_100));
        assert_eq!(paper_performance("door-opening", "ppo").map(|found| found[1].danger), Some(39.22));
        assert_eq!(paper_falsification("cube-stacking", "ppo", "random").map(|row| row.falsified), Some(1));
        assert_eq!(
            (paper_performance("ball-pushing", "sac"), paper_falsification("x", "ppo", "random")),
            (None, None)
        );
    }

    /// The page says so.
    #[test]
    fn the_rows_of_peg_in_hole_and_ball_pushing_are_identical() {
        for controller in ["ppo", "trpo"] {
            for search in ["random", "nelder-mead", "dual-annealing"] {
                let of = |task| paper_falsification(task, controller, search).unwrap();
                assert_eq!(of("peg-in-hole"), of("ball-pushing"));
            }
        }
    }

    #[test]
    fn the_implied_rate_matches_a_hand_calculation() {
        // 30 of 30 trials after 8.57 simulations each: 30 / (30 * 9.57).
        let found = paper_falsification("point-reaching", "ppo", "random").unwrap();
        assert!((found.violations_per_simulation() - 1.0 / 9.57).abs() < 1e-12);
        let none = paper_falsification("point-reaching", "trpo", "random").unwrap();
        assert_eq!((none.violations_per_simulation(), none.mean_simulations), (0.0, None));
    }
}
