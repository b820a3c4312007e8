//! The paper's results for its own controllers, from its table of performance.

/// Task, algorithm, training time in control steps, then success rate (percent), dangerous behavior rate (percent) and
/// task completion time (control steps), without and with noise.
type Row = (&'static str, &'static str, u32, [[f64; 3]; 2]);

const REPORTED: &[Row] = &[
    ("point-reaching", "ppo", 10_500, [[93.0, 0.26, 29.29], [87.0, 0.27, 29.83]]),
    ("point-reaching", "trpo", 26_700, [[100.0, 0.07, 16.21], [98.0, 0.12, 18.39]]),
    ("cube-stacking", "ppo", 11_300, [[100.0, 7.13, 75.66], [98.0, 24.77, 75.74]]),
    ("cube-stacking", "trpo", 12_600, [[99.0, 8.98, 66.44], [98.0, 15.62, 66.80]]),
    ("peg-in-hole", "ppo", 154_000, [[85.0, 3.59, 16.79], [78.0, 4.41, 17.83]]),
    ("peg-in-hole", "trpo", 259_600, [[92.0, 1.90, 43.53], [90.0, 2.41, 46.57]]),
    ("ball-balancing", "ppo", 11_500, [[98.0, 0.47, 6.41], [89.0, 3.44, 10.24]]),
    ("ball-balancing", "trpo", 12_900, [[100.0, 0.01, 5.91], [93.0, 2.23, 6.01]]),
    ("ball-catching", "ppo", 20_800, [[100.0, 6.34, 23.14], [99.0, 6.96, 23.39]]),
    ("ball-catching", "trpo", 28_100, [[97.0, 8.69, 21.60], [93.0, 9.14, 21.86]]),
    ("ball-pushing", "ppo", 60_300, [[98.0, 9.28, 53.53], [97.0, 13.78, 55.45]]),
    ("ball-pushing", "trpo", 175_100, [[100.0, 6.85, 37.12], [100.0, 7.88, 38.27]]),
    ("door-opening", "ppo", 124_400, [[89.0, 36.60, 136.62], [81.0, 39.22, 154.63]]),
    ("door-opening", "trpo", 128_300, [[97.0, 31.11, 126.36], [94.0, 32.74, 127.06]]),
    ("cloth-placing", "ppo", 34_700, [[100.0, 2.44, 12.15], [99.0, 2.85, 14.87]]),
    ("cloth-placing", "trpo", 22_400, [[99.0, 14.38, 27.45], [99.0, 15.08, 29.25]]),
];

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

/// Returns the performance of the paper's controller without and with noise; `None` if the paper has no such controller.
pub fn paper_performance(task: &str, algorithm: &str) -> Option<[PaperPerformance; 2]> {
    let (.., found) = row(task, algorithm)?;
    Some(found.map(|[success, danger, completion]| PaperPerformance { success, danger, completion }))
}

/// Returns the training time of the paper's controller, in control steps of each environment.
pub fn paper_training_time(task: &str, algorithm: &str) -> Option<u32> {
    row(task, algorithm).map(|(_, _, steps, _)| *steps)
}

fn row(task: &str, algorithm: &str) -> Option<&'static Row> {
    REPORTED.iter().find(|(t, a, ..)| *t == task && *a == algorithm)
}
