//! A rough landscape with many local minima and one narrow well elsewhere.

use std::f64::consts::TAU;

use mishandle_rollout::{Axis, Seed};

use crate::Toy;

pub(crate) struct Needle;

/// Position, width and depth of the well.
const WELL: [f64; 2] = [0.62, 0.27];
const WIDTH: f64 = 0.02;
const DEPTH: f64 = 1.0;

impl Toy for Needle {
    fn name(&self) -> &'static str {
        "needle"
    }

    fn summary(&self) -> &'static str {
        "A rough landscape: `height` has 100 local minima above 0, and one narrow well below 0 on 0.2 % of the square."
    }

    fn axes(&self) -> Vec<Axis> {
        vec![
            Axis::start("x", "", 0.0, 1.0).meaning("first coordinate of the point"),
            Axis::start("y", "", 0.0, 1.0).meaning("second coordinate of the point"),
        ]
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("height", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(height >= 0)")]
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let [x, y] = [0, 1].map(|i| values[i].unwrap_or_default());
        let ripples = 0.1 * (2.0 - (10.0 * TAU * x).cos() - (10.0 * TAU * y).cos());
        let squared = (x - WELL[0]).powi(2) + (y - WELL[1]).powi(2);
        let height = 0.3 + ripples - DEPTH * (-squared / (2.0 * WIDTH * WIDTH)).exp();
        (0..2).for_each(|_| push(&[height]));
    }
}
