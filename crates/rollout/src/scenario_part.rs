//! A part of the scenarios of training around nominal, for a curriculum.

use crate::{Axis, AxisKind, AxisValues, Scenario, Seed, Space, Stream, TrainingScenarios};

/// Scenarios within a share of the range of each axis around its nominal value.
///
/// The nominal value, or the bound nearest to it, is the center. The distance of each bound to it
/// is multiplied by the share:
///
/// - on a logarithmic axis as a ratio: the bounds become center · (bound / center)^share;
/// - on an integer axis it is rounded down, so that a delay of up to 3 steps is 0 until the share
///   reaches a third;
/// - categories have no order: a random category is drawn from all of them, and replaced by the
///   nominal one unless a draw keeps it, with the share as its probability;
/// - axes of the start, and random draws without a nominal value, keep their whole range.
///
/// A share of 1 gives the whole scenarios, bit for bit.
#[derive(Clone, Debug)]
pub struct ScenarioPart {
    /// The scenarios, whose axes have the smaller ranges.
    scenarios: TrainingScenarios,
    share: f64,
}

/// Index of the first draw that keeps or replaces a category. The draws of corners are below it.
const CATEGORIES: u64 = 1 << 32;

/// Tolerance of a share that is a sum of decimal numbers.
const ROUNDING: f64 = 1e-9;

impl TrainingScenarios {
    /// Returns the scenarios within a share, from 0 to 1, of the range of each axis around its
    /// nominal value.
    pub fn part(&self, share: f64) -> ScenarioPart {
        let axes = self.space.axes().iter().map(|axis| shrunk(axis, share)).collect();
        let space = Space::new(self.space.name(), axes).expect("bounds between valid ones are valid");
        let mixture = self.mixture.clone();
        ScenarioPart { scenarios: TrainingScenarios { mixture, ..TrainingScenarios::of(space) }, share }
    }

    /// Returns whether a share of the ranges gives other scenarios than the whole.
    pub fn can_shrink(&self) -> bool {
        self.space.axes().iter().any(|axis| shrinks(axis) && !axis.is_fixed())
    }
}

impl ScenarioPart {
    /// Returns random scenario number `index` of `seed`.
    pub fn random(&self, seed: Seed, index: u64) -> Scenario {
        self.with_categories(self.scenarios.space.draw(seed, index), seed, index)
    }

    /// Returns random corner number `index` of `seed`: each axis is at its lower or upper bound,
    /// with equal probability.
    pub fn corner(&self, seed: Seed, index: u64) -> Scenario {
        self.with_categories(self.scenarios.space.random_corner(seed, index), seed, index)
    }

    /// Draws a set of axes of the mixture, and replaces categories by nominal ones with a
    /// probability of 1 - share.
    fn with_categories(&self, drawn: Scenario, seed: Seed, index: u64) -> Scenario {
        let space = &self.scenarios.space;
        let drawn = self.scenarios.mixed(drawn, seed, index);
        if self.share >= 1.0 {
            return space.canonical(drawn);
        }
        let axes = (0..).zip(space.axes()).zip(drawn.values());
        let values = axes.map(|((number, axis), value)| match axis.values {
            AxisValues::Categorical(_)
                if shrinks(axis)
                    && seed.uniform(Stream::Scenario, CATEGORIES + index, number) >= self.share =>
            {
                Some(center(axis))
            }
            _ => *value,
        });
        space.canonical(Scenario::new(values.collect()))
    }
}

/// Returns whether an axis has a smaller range in a part.
fn shrinks(axis: &Axis) -> bool {
    axis.kind != AxisKind::Start && axis.nominal.is_some()
}

/// Returns the nominal value, or the bound nearest to it.
fn center(axis: &Axis) -> f64 {
    axis.nominal.unwrap_or(axis.low).clamp(axis.low, axis.high)
}

fn shrunk(axis: &Axis, share: f64) -> Axis {
    if share >= 1.0 || !shrinks(axis) || matches!(axis.values, AxisValues::Categorical(_)) {
        return axis.clone();
    }
    let center = center(axis);
    let toward = |bound: f64| match axis.values {
        AxisValues::Integer => {
            center + ((bound - center).abs() * share + ROUNDING).floor().copysign(bound - center)
        }
        AxisValues::Logarithmic => center * (bound / center).powf(share),
        _ => center + share * (bound - center),
    };
    Axis { low: toward(axis.low), high: toward(axis.high), ..axis.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axes() -> Vec<Axis> {
        let model = |name: &str, bounds, nominal, values| {
            Axis::new(AxisKind::Model, name, "", bounds, Some(nominal)).with_values(values)
        };
        let names = ["none", "freeze", "bias", "gain"].map(String::from);
        vec![
            Axis::start("x", "m", -1.0, 1.0),
            model("bias", [-0.2, 0.6], 0.0, AxisValues::Continuous),
            model("mass", [0.25, 16.0], 1.0, AxisValues::Logarithmic),
            model("delay", [0.0, 3.0], 0.0, AxisValues::Integer),
            model("fault", [0.0, 3.0], 0.0, AxisValues::Categorical(names.into())),
            model("late", [2.0, 4.0], 0.0, AxisValues::Continuous),
            Axis::new(AxisKind::Noise, "draw", "", [-3.0, 3.0], None),
        ]
    }

    fn scenarios() -> TrainingScenarios {
        TrainingScenarios::of(Space::new("all", axes()).unwrap())
    }

    #[test]
    fn bounds_move_towards_the_nominal_value_by_the_rule_of_their_axis() {
        let bounds = |share: f64| {
            let part = scenarios().part(share);
            part.scenarios.space.axes().iter().map(|axis| [axis.low, axis.high]).collect::<Vec<_>>()
        };
        let quarter = bounds(0.25);
        assert_eq!((quarter[0], quarter[4], quarter[6]), ([-1.0, 1.0], [0.0, 3.0], [-3.0, 3.0]));
        // -0.2 and 0.6 times a quarter.
        assert!((quarter[1][0] + 0.05).abs() < 1e-15 && (quarter[1][1] - 0.15).abs() < 1e-15);
        // A quarter of the logarithms: the fourth roots of 1/4 and of 16.
        assert!((quarter[2][0] - 0.5_f64.sqrt()).abs() < 1e-15 && (quarter[2][1] - 2.0).abs() < 1e-15);
        // The bound nearest to the nominal value is the center.
        assert_eq!((quarter[3], quarter[5]), ([0.0, 0.0], [2.0, 2.5]));
        // 3 steps: one third of the range each. 0.1 + 0.2 + ... is not exactly a decimal number.
        let delays =
            [0.33, 1.0 / 3.0, 0.65, 0.1 + 0.2 + 0.3 + 0.1, 0.99, 1.0].map(|share| bounds(share)[3][1]);
        assert_eq!(delays, [0.0, 1.0, 1.0, 2.0, 2.0, 3.0]);
        assert_eq!(bounds(0.0)[1..4], [[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]]);
    }

    #[test]
    fn the_whole_share_has_the_bits_of_the_whole_scenarios() {
        let whole = scenarios();
        let part = scenarios().part(1.0);
        for index in 0..100 {
            assert!(part.random(Seed(4), index).is_same(&whole.random(Seed(4), index)));
            assert!(part.corner(Seed(4), index).is_same(&whole.corner(Seed(4), index)));
        }
    }

    #[test]
    fn a_category_is_not_nominal_with_the_share_as_its_probability() {
        let whole = scenarios();
        let part = scenarios().part(0.3);
        let count = 20_000;
        for (what, of_whole) in [("random", 0.75), ("corner", 0.5)] {
            let draw = |index| match what {
                "random" => part.random(Seed(1), index),
                _ => part.corner(Seed(1), index),
            };
            let drawn: Vec<f64> = (0..count).map(|index| draw(index).get(4).unwrap()).collect();
            let share = 0.3 * of_whole;
            let faults = drawn.iter().filter(|fault| **fault > 0.0).count() as f64;
            let bound = 5.0 * (count as f64 * share * (1.0 - share)).sqrt();
            assert!((faults - share * count as f64).abs() < bound, "{what}: {faults} of {count}");
            assert!(drawn.contains(&3.0));
        }
        // Starts have the numbers of the whole.
        assert_eq!(part.random(Seed(1), 7).get(0), whole.random(Seed(1), 7).get(0));
        assert_eq!(part.random(Seed(1), 7).get(6), whole.random(Seed(1), 7).get(6));
    }

    #[test]
    fn starts_alone_do_not_shrink() {
        let of =
            |axes: &[Axis]| TrainingScenarios::of(Space::new("some", axes.to_vec()).unwrap()).can_shrink();
        let all = axes();
        assert!(of(&all) && of(&all[4..5]));
        assert!(!of(&all[..1]) && !of(&all[6..]));
        let fixed = Axis { low: 0.1, high: 0.1, ..all[1].clone() };
        assert!(!of(&[all[0].clone(), fixed]));
    }
}
