//! Test functions on `[0,1]^d` with known minima, for benchmarks of searches.
//!
//! The classical functions are scaled from their usual domains. [`FUNCTIONS`] lists all functions.

use std::f64::consts::{E, TAU};

/// A function on `[0,1]^d` with a known minimum.
#[derive(Debug, Clone, Copy)]
pub struct TestFunction {
    /// The name.
    pub name: &'static str,
    /// The function, defined for at least `min_dimension` coordinates.
    pub at: fn(&[f64]) -> f64,
    /// The minimum number of coordinates.
    pub min_dimension: usize,
    /// The minimum on `[0,1]^d`, the same for all d.
    pub minimum: f64,
    /// A minimizer, given as the common value of all its coordinates.
    pub minimizer: f64,
}

/// All test functions.
pub const FUNCTIONS: &[TestFunction] = &[
    TestFunction { name: "sphere", at: sphere, min_dimension: 1, minimum: 0.0, minimizer: 0.3 },
    TestFunction { name: "rosenbrock", at: rosenbrock, min_dimension: 2, minimum: 0.0, minimizer: 0.75 },
    TestFunction { name: "rastrigin", at: rastrigin, min_dimension: 1, minimum: 0.0, minimizer: 0.6 },
    TestFunction { name: "ackley", at: ackley, min_dimension: 1, minimum: 0.0, minimizer: 0.4 },
    TestFunction { name: "min-max", at: min_max, min_dimension: 1, minimum: -0.25, minimizer: 0.8125 },
    TestFunction { name: "hole", at: hole, min_dimension: 1, minimum: -1.0, minimizer: 0.7 },
];

/// Evaluates the sphere function Σ (uᵢ - 0.3)².
pub fn sphere(u: &[f64]) -> f64 {
    u.iter().map(|x| (x - 0.3) * (x - 0.3)).sum()
}

/// Evaluates Rosenbrock's function Σ 100 (xᵢ₊₁ - xᵢ²)² + (1 - xᵢ)², x = 4u - 2: a curved valley.
pub fn rosenbrock(u: &[f64]) -> f64 {
    let term = |pair: &[f64]| {
        let x = 4.0 * pair[0] - 2.0;
        let y = 4.0 * pair[1] - 2.0;
        100.0 * (y - x * x) * (y - x * x) + (1.0 - x) * (1.0 - x)
    };
    u.windows(2).map(term).sum()
}

/// Evaluates Rastrigin's function Σ 10 + x² - 10 cos 2πx, x = 10 (u - 0.6): many local minima on a
/// grid.
pub fn rastrigin(u: &[f64]) -> f64 {
    u.iter().map(|u| 10.0 * (u - 0.6)).map(|x| 10.0 + x * x - 10.0 * (TAU * x).cos()).sum()
}

/// Evaluates Ackley's function, x = 60 (u - 0.4): a cone with ripples.
pub fn ackley(u: &[f64]) -> f64 {
    let d = u.len() as f64;
    let x = || u.iter().map(|u| 60.0 * (u - 0.4));
    let radius = (x().map(|x| x * x).sum::<f64>() / d).sqrt();
    let ripple = x().map(|x| (TAU * x).cos()).sum::<f64>() / d;
    20.0 + E - 20.0 * (-0.2 * radius).exp() - ripple.exp()
}

/// Evaluates a function shaped like a robustness: the maximum over coordinates of the minimum of
/// two ramps, in steps of 1/64.
///
/// ```text
/// max over i of min(|uᵢ - 0.2| - 0.125, 2 |uᵢ - 0.8125| - 0.25), rounded down to multiples of 1/64
/// ```
pub fn min_max(u: &[f64]) -> f64 {
    let ramps = |x: &f64| ((x - 0.2).abs() - 0.125).min(2.0 * (x - 0.8125).abs() - 0.25);
    let worst = u.iter().map(ramps).fold(f64::NEG_INFINITY, f64::max);
    (worst * 64.0).floor() / 64.0
}

/// Evaluates a function with a narrow hole of radius 0.05 and depth 1 at 0.7, in a bowl with its
/// minimum at 0.2.
///
/// ```text
/// 400 r² - 1 where r² = Σ (uᵢ - 0.7)² < 1/400, else Σ (uᵢ - 0.2)² / (10 d)
/// ```
pub fn hole(u: &[f64]) -> f64 {
    let squared_distance = |center: f64| u.iter().map(|x| (x - center) * (x - center)).sum::<f64>();
    let squared = squared_distance(0.7);
    if squared < 0.0025 { 400.0 * squared - 1.0 } else { squared_distance(0.2) / (10.0 * u.len() as f64) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_random::Sequence;

    #[test]
    fn every_minimum_is_attained_and_is_a_lower_bound() {
        for function in FUNCTIONS {
            for d in function.min_dimension..=4 {
                let at_minimizer = (function.at)(&vec![function.minimizer; d]);
                assert!(
                    (at_minimizer - function.minimum).abs() < 1e-12,
                    "{} at d = {d}: {at_minimizer}",
                    function.name
                );
                let mut stream = Sequence::new(1, d as u64);
                for _ in 0..10_000 {
                    let u: Vec<f64> = (0..d).map(|_| stream.uniform()).collect();
                    assert!((function.at)(&u) >= function.minimum - 1e-12, "{} at {u:?}", function.name);
                }
            }
        }
    }
}
