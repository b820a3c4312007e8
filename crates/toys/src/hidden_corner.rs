//! A smooth landscape that leads away from the corner where most failures are.

use mishandle_rollout::{Axis, Seed};

use crate::Toy;

pub(crate) struct HiddenCorner;

/// The disc toward which the landscape falls, with the area 1e-4.
const CENTER: [f64; 2] = [0.7, 0.6];
const RADIUS: f64 = 0.005_641_895_835_477_563;

/// Side of the failing square at (0, 0), with the area 1.9e-3.
const SIDE: f64 = 0.043_588_989_435_406_74;

impl Toy for HiddenCorner {
    fn name(&self) -> &'static str {
        "hidden-corner"
    }

    fn summary(&self) -> &'static str {
        "A smooth landscape that leads to a small failing disc, 0.01 % of the square, away from a failing corner with 0.19 %."
    }

    fn axes(&self) -> Vec<Axis> {
        vec![
            Axis::start("x", "", 0.0, 1.0).meaning("first coordinate of the point"),
            Axis::start("y", "", 0.0, 1.0).meaning("second coordinate of the point"),
        ]
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("clearance", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(clearance >= 0)")]
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let [x, y] = [0, 1].map(|i| values[i].unwrap_or_default());
        let is_corner = x < SIDE && y < SIDE;
        let clearance = if is_corner { -1.0 } else { (x - CENTER[0]).hypot(y - CENTER[1]) - RADIUS };
        (0..2).for_each(|_| push(&[clearance]));
    }
}
