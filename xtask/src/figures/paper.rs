//! What the paper reports of its own controllers, from its table of performance.

/// One controller: task, algorithm, success rate in percent without and with noise.
const REPORTED: &[(&str, &str, [f64; 2])] = &[
    ("point-reaching", "ppo", [93.0, 87.0]),
    ("point-reaching", "trpo", [100.0, 98.0]),
    ("cube-stacking", "ppo", [100.0, 98.0]),
    ("cube-stacking", "trpo", [99.0, 98.0]),
    ("peg-in-hole", "ppo", [85.0, 78.0]),
    ("peg-in-hole", "trpo", [92.0, 90.0]),
    ("ball-balancing", "ppo", [98.0, 89.0]),
    ("ball-balancing", "trpo", [100.0, 93.0]),
    ("ball-catching", "ppo", [100.0, 99.0]),
    ("ball-catching", "trpo", [97.0, 93.0]),
    ("ball-pushing", "ppo", [98.0, 97.0]),
    ("ball-pushing", "trpo", [100.0, 100.0]),
    ("door-opening", "ppo", [89.0, 81.0]),
    ("door-opening", "trpo", [97.0, 94.0]),
    ("cloth-placing", "ppo", [100.0, 99.0]),
    ("cloth-placing", "trpo", [99.0, 99.0]),
];

/// The paper's success rates in percent, without and with noise.
pub fn success_rates(task: &str, algorithm: &str) -> Option<[f64; 2]> {
    REPORTED.iter().find(|(t, a, _)| *t == task && *a == algorithm).map(|(.., rates)| *rates)
}
