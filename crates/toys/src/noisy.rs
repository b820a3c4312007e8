//! A valley with noise: the same scenario fails with some seeds and not with others.

use mishandle_rollout::{Axis, AxisKind, Distribution, Seed, Stream};

use crate::Toy;

pub(crate) struct Noisy;

/// Standard deviation of the noise.
const STD: f64 = 0.1;

impl Toy for Noisy {
    fn name(&self) -> &'static str {
        "noisy"
    }

    fn summary(&self) -> &'static str {
        "A valley with noise: half of all seeds violate the requirement at x = 0.7, and almost none at a distance of 0.3."
    }

    fn axes(&self) -> Vec<Axis> {
        let mut draw = Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None)
            .meaning("the noise in units of its standard deviation");
        draw.distribution = Distribution::Normal;
        vec![Axis::start("x", "", 0.0, 1.0).meaning("place; the valley is at 0.7"), draw]
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("height", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(height >= 0)")]
    }

    fn simulate(&self, values: &[Option<f64>], seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let mut drawn = [0.0];
        seed.normals(Stream::ObservationNoise, 0, &mut drawn);
        let x = values[0].unwrap_or_default();
        let height = (x - 0.7).abs() + STD * values[1].unwrap_or(drawn[0]);
        (0..2).for_each(|_| push(&[height]));
    }
}
