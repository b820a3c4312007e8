//! A plane with six pits: six known failure modes.

use mishandle_rollout::{Axis, AxisKind, Seed};

use crate::Toy;

pub(crate) struct Pits;

/// Center and radius of a pit, the signal that becomes negative in it, and the sample at which it
/// does.
struct Pit {
    center: [f64; 2],
    radius: f64,
    signal: usize,
    sample: usize,
}

const fn pit(center: [f64; 2], radius: f64, signal: usize, sample: usize) -> Pit {
    Pit { center, radius, signal, sample }
}

/// The pits, the largest first: 4.5, 2.5, 1.5, 0.8, 0.4 and 0.2 % of the square. Two with the same
/// signal are more than 0.2 apart.
const PITS: [Pit; 6] = [
    pit([0.20, 0.20], 0.12, 0, 5),
    pit([0.75, 0.25], 0.09, 1, 5),
    pit([0.25, 0.75], 0.07, 0, 10),
    pit([0.55, 0.55], 0.05, 1, 15),
    pit([0.85, 0.60], 0.035, 0, 5),
    pit([0.80, 0.90], 0.025, 1, 10),
];

/// Value of a signal far from every pit.
const PLAIN: f64 = 0.25;

/// Number of axes without effect.
const IDLE: usize = 4;

impl Toy for Pits {
    fn name(&self) -> &'static str {
        "pits"
    }

    fn summary(&self) -> &'static str {
        "A plane with six pits of 0.2 to 4.5 % of the square: six failure modes of two predicates, at three times."
    }

    fn axes(&self) -> Vec<Axis> {
        let start = |name, meaning| Axis::start(name, "", 0.0, 1.0).meaning(meaning);
        let mut axes =
            vec![start("x", "first coordinate of the point"), start("y", "second coordinate of the point")];
        axes.extend((1..=IDLE).map(|index| {
            Axis::new(AxisKind::Model, &format!("idle_{index}"), "", [0.0, 1.0], Some(0.5))
                .meaning("has no effect")
        }));
        axes
    }

    fn signals(&self) -> &'static [(&'static str, &'static str)] {
        &[("height", ""), ("clearance", "")]
    }

    fn formulas(&self) -> &'static [(&'static str, &'static str)] {
        &[("success", "always(height >= 0 and clearance >= 0)")]
    }

    fn episode_steps(&self) -> usize {
        20
    }

    fn simulate(&self, values: &[Option<f64>], _seed: Seed, push: &mut dyn FnMut(&[f64])) {
        let [x, y] = [0, 1].map(|i| values[i].unwrap_or_default());
        for sample in 0..=self.episode_steps() {
            let mut signals = [PLAIN; 2];
            for pit in PITS.iter().filter(|pit| pit.sample <= sample) {
                let outside = (x - pit.center[0]).hypot(y - pit.center[1]) - pit.radius;
                signals[pit.signal] = signals[pit.signal].min(outside);
            }
            push(&signals);
        }
    }
}
