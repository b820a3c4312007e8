//! A smooth convex function: the distance from a point in the plane.

use mishandle_rollout::{Axis, Seed};

use crate::Toy;

pub(crate) struct Sphere;

/// The point that must be avoided, m.
const CENTER: [f64; 2] = [0.3, -0.4];

impl Toy for Sphere {
    fn name(&self) -> &'static str {
        "sphere-2d"
    }

    fn summary(&self) -> &'static str {
        "A smooth function: stay 0.1 m away from a point; 0.8 % of the square of 2 m violates the requirement."
    }

    fn axes(&self) -> Vec<Axis> {
        vec![
            Axis::start("x", "m", -1.0, 1.0).meaning("first coordinate of the point"),
            Axis::start("y", "m", -1.0, 1.0).meaning("second coordinate of the point"),
        ]
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("distance", "m")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(distance >= 0.1)"), ("strict", "always(distance >= 0.2)")]
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let [x, y] = [0, 1].map(|i| values[i].unwrap_or_default() - CENTER[i]);
        (0..2).for_each(|_| push(&[x.hypot(y)]));
    }
}
