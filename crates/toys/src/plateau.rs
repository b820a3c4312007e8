//! A staircase: the robustness is constant on rings, so its gradient is zero almost everywhere.

use mishandle_rollout::{Axis, Seed};

use crate::Toy;

pub(crate) struct Plateau;

/// The center of the rings and their width, m.
const CENTER: [f64; 2] = [-0.5, 0.45];
const WIDTH: f64 = 0.1;

impl Toy for Plateau {
    fn name(&self) -> &'static str {
        "plateau"
    }

    fn summary(&self) -> &'static str {
        "A staircase of rings around a point: `ring` counts them from 0; the innermost violates, 0.8 % of the square."
    }

    fn axes(&self) -> Vec<Axis> {
        vec![
            Axis::start("x", "m", -1.0, 1.0).meaning("first coordinate of the point"),
            Axis::start("y", "m", -1.0, 1.0).meaning("second coordinate of the point"),
        ]
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("ring", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(ring >= 0.5)")]
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let [x, y] = [0, 1].map(|i| values[i].unwrap_or_default() - CENTER[i]);
        (0..2).for_each(|_| push(&[(x.hypot(y) / WIDTH).floor()]));
    }
}
