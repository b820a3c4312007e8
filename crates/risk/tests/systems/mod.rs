//! Systems in closed form with known failure probabilities.

use mishandle_risk::{Marginal, Scenarios};
use mishandle_rollout::{Axis, AxisKind, Request, Space};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

/// A system with a known failure probability.
pub struct Known {
    pub name: &'static str,
    pub probability: f64,
    dimension: usize,
    is_normal: bool,
    robustness: fn(&[f64]) -> f64,
}

/// Quantiles of the standard normal distribution: SciPy 1.17.1, `norm.isf(p)` and
/// `norm.isf(p / 2)`.
const TAIL_2: f64 = 2.326_347_874_040_840_8;
const TAIL_4: f64 = 3.719_016_485_455_680_4;
const TAIL_6: f64 = 4.753_424_308_822_899;
const HALF_TAIL_4: f64 = 3.890_591_886_413_094;
const HALF_TAIL_6: f64 = 4.891_638_475_698_591;

/// Side of the corner of the system `corner`: 1.9e-3 of the square.
const CORNER: f64 = 0.043_588_989_435_406_74;

/// Radius of the smooth mode of the system `corner`: π r² = 1e-4.
const SMOOTH: f64 = 0.005_641_895_835_477_563;

impl Known {
    pub fn system(&self) -> (FunctionSystem, Scenarios) {
        let bounds = if self.is_normal { [-9.0, 9.0] } else { [0.0, 1.0] };
        let axis = |i: usize| Axis::new(AxisKind::Model, &format!("x{i}"), "", bounds, Some(0.5));
        let space = Space::new("model", (0..self.dimension).map(axis).collect()).unwrap();
        let marginal =
            if self.is_normal { Marginal::Normal { mean: 0.0, std: 1.0 } } else { Marginal::Uniform };
        let declared: Vec<(String, Marginal)> =
            space.axes().iter().map(|axis| (axis.name.clone(), marginal.clone())).collect();
        let pairs = declared.iter().map(|(name, marginal)| (name, marginal));
        let scenarios = Scenarios::new(&space, pairs, false).unwrap();
        let robustness = self.robustness;
        let outcome = move |request: &Request| {
            let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
            SimulatedEnd::Robustness(robustness(&values))
        };
        (FunctionSystem::new(space, outcome), scenarios)
    }
}

/// Returns the projection on the diagonal, which is standard normal.
fn diagonal(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / (x.len() as f64).sqrt()
}

/// A third of the way from 0 to 1 is far from the failure; the robustness is the largest coordinate
/// less the side.
fn cube(x: &[f64], side: f64) -> f64 {
    x.iter().copied().fold(f64::NEG_INFINITY, f64::max) - side
}

/// A smooth valley that ends in a small failing disc at (0.7, 0.6), and a failing corner at (0, 0)
/// with nothing around it that leads there: the robustness rises toward it.
fn corner(x: &[f64]) -> f64 {
    if x[0] < CORNER && x[1] < CORNER {
        return -1.0;
    }
    (x[0] - 0.7).hypot(x[1] - 0.6) - SMOOTH
}

/// Two modes on opposite sides: each coordinate alone.
fn two_modes(x: &[f64], threshold: f64) -> f64 {
    (threshold - x[0]).min(threshold + x[1])
}

/// A failing ball of the probability 1e-6 in a flat landscape without a gradient.
fn needle(x: &[f64]) -> f64 {
    if x.iter().zip([0.37, 0.81, 0.55]).all(|(x, center)| (x - center).abs() < 0.005) { -1.0 } else { 1.0 }
}

/// A staircase: the diagonal in steps.
fn stairs(x: &[f64]) -> f64 {
    ((TAIL_4 - diagonal(x)) / 0.5).ceil() - 0.5
}

/// The probability of the union of two independent halves of p: 1 - (1 - p / 2)².
fn union(p: f64) -> f64 {
    p - 0.25 * p * p
}

/// The systems, in the order of the table of studies/notebook/2026-11-23-risk.md.
pub fn systems() -> Vec<Known> {
    let normal = |name, probability, dimension, robustness| Known {
        name,
        probability,
        dimension,
        is_normal: true,
        robustness,
    };
    let uniform = |name, probability, dimension, robustness| Known {
        name,
        probability,
        dimension,
        is_normal: false,
        robustness,
    };
    vec![
        normal("half-space, 1e-2, 10 axes", 1e-2, 10, |x| TAIL_2 - diagonal(x)),
        normal("half-space, 1e-4, 10 axes", 1e-4, 10, |x| TAIL_4 - diagonal(x)),
        normal("half-space, 1e-6, 10 axes", 1e-6, 10, |x| TAIL_6 - diagonal(x)),
        normal("half-space, 1e-6, 37 axes", 1e-6, 37, |x| TAIL_6 - diagonal(x)),
        normal("two modes, 1e-4, 2 axes", union(1e-4), 2, |x| two_modes(x, HALF_TAIL_4)),
        normal("two modes, 1e-6, 2 axes", union(1e-6), 2, |x| two_modes(x, HALF_TAIL_6)),
        uniform("corner cube, 1e-4, 4 axes", 1e-4, 4, |x| cube(x, 0.1)),
        uniform("corner cube, 1e-6, 3 axes", 1e-6, 3, |x| cube(x, 0.01)),
        normal("staircase, 1e-4, 10 axes", 1e-4, 10, stairs),
        uniform("hidden corner, 2e-3, 2 axes", 2e-3, 2, corner),
        uniform("needle, 1e-4, 2 axes", 1e-4, 2, needle),
        uniform("needle, 1e-6, 3 axes", 1e-6, 3, needle),
    ]
}
