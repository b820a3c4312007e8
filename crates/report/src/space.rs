//! Axes of a scenario space as axes of a chart, and parts of a space as text.

use crate::charts::ChartAxis;
use mishandle::rollout::{Axis, AxisValues, Scenario};

use crate::html::{number, percent, short};

/// Largest number of ticks of a discrete axis.
const MAX_TICKS: usize = 7;

/// How parts of a space are measured: a space whose axes all have separate values has points, and
/// any other one a volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// The number of points.
    Points(u64),
    Volume,
}

/// An end of an interval, or the value in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    Low,
    Value,
    High,
}

impl Extent {
    /// Returns the extent of a space. Where a condition decides whether an axis counts, its values
    /// do not all make points of their own, so it has a volume.
    pub fn of(axes: &[Axis]) -> Extent {
        let points = axes.iter().try_fold(1_u64, |points, axis| match axis.levels() {
            _ if !axis.conditions.is_empty() => None,
            _ if axis.is_fixed() => Some(points),
            levels => points.checked_mul(levels? as u64),
        });
        points.map_or(Extent::Volume, Extent::Points)
    }

    /// Names a share of the space: `6 of 16 points`, or `35 % of the space`.
    pub fn part(self, share: f64, bound: Bound) -> String {
        match self {
            Extent::Points(all) => {
                format!("{} of {}", self.size(share, bound), mishandle_text::plural(all, "point"))
            }
            Extent::Volume => format!("{} of the space", self.size(share, bound)),
        }
    }

    /// Names the size of a share of the space: a number of points, or `35 %`. A bound of a number
    /// of points is the next one inside.
    pub fn size(self, share: f64, bound: Bound) -> String {
        let Extent::Points(all) = self else { return percent(share) };
        // A product with a share that comes from points is not exact.
        let points = share * all as f64;
        let points = match bound {
            Bound::Low => (points - 1e-6).ceil(),
            Bound::Value => points.round(),
            Bound::High => (points + 1e-6).floor(),
        };
        points.max(0.0).to_string()
    }

    /// Returns all scenarios of a space with at most `most` points; `None` of a larger one.
    pub fn scenarios(self, axes: &[Axis], most: u64) -> Option<Vec<Scenario>> {
        let Extent::Points(all) = self else { return None };
        let scenario = |index: u64| {
            let mut rest = index;
            let value = |axis: &Axis| {
                let levels = axis.levels().filter(|_| !axis.is_fixed()).unwrap_or(1) as u64;
                let level = rest % levels;
                rest /= levels;
                axis.low + level as f64
            };
            Scenario::from(axes.iter().map(value).collect::<Vec<f64>>())
        };
        (all <= most).then(|| (0..all).map(scenario).collect())
    }
}

/// Returns a linear chart axis whose labels are short. The range may be anything.
pub fn linear(label: &str, range: [f64; 2]) -> ChartAxis {
    let [low, high] = sane(range);
    let mut axis = ChartAxis::linear(label, [low, high]);
    for (value, label) in &mut axis.ticks {
        if label.chars().count() > 6 {
            *label = number(*value);
        }
    }
    axis
}

/// Returns a range that a chart can show: finite and not empty.
pub fn sane([low, high]: [f64; 2]) -> [f64; 2] {
    let limit = |value: f64| if value.is_finite() { value.clamp(-1e100, 1e100) } else { 0.0 };
    let (low, high) = (limit(low.min(high)), limit(high.max(low)));
    let least = 1e-9 * low.abs().max(high.abs()).max(1e-12);
    if high - low > least { [low, high] } else { [low - least.max(0.5), high + least.max(0.5)] }
}

/// Returns a range around the values, with a margin, that contains 0.
pub fn around(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let finite = values.into_iter().filter(|value| value.is_finite());
    let (low, high) = finite.fold((0.0_f64, 0.0_f64), |(low, high), x| (low.min(x), high.max(x)));
    let margin = 0.06 * (high - low);
    [low - margin, high + margin]
}

/// Returns the name of an axis with its unit.
pub fn label(axis: &Axis) -> String {
    let unit = if axis.unit.is_empty() { String::new() } else { format!(" ({})", short(&axis.unit, 14)) };
    format!("{}{unit}", short(&axis.name, 30))
}

/// Returns the lowest and highest position of an axis: a discrete value takes half a step on both
/// sides.
fn ends(axis: &Axis) -> [f64; 2] {
    match axis.levels() {
        Some(_) => sane([axis.low - 0.5, axis.high + 0.5]),
        None => sane([axis.low, axis.high]),
    }
}

/// Returns the axis of a chart.
pub fn chart_axis(axis: &Axis) -> ChartAxis {
    let label = label(axis);
    let [low, high] = ends(axis);
    match (&axis.values, axis.levels()) {
        (AxisValues::Logarithmic, _) if low > 0.0 => {
            let first = low.log10().floor() as i32;
            let last = high.log10().ceil() as i32;
            let powers = (first..=last).flat_map(|power| {
                let factors: &[f64] = if last - first > 3 { &[1.0] } else { &[1.0, 2.0, 5.0] };
                factors.iter().map(move |factor| factor * 10.0_f64.powi(power))
            });
            let inside = powers.filter(|value| (low..=high).contains(value));
            ChartAxis::logarithmic(&label, [low, high], inside.map(|value| (value, number(value))).collect())
        }
        (values, Some(levels)) => {
            let every = levels.div_ceil(MAX_TICKS).max(1);
            let name = |index: usize| match values {
                AxisValues::Categorical(names) => {
                    names.get(index).map_or(String::new(), |name| short(name, 10))
                }
                _ => number(axis.low + index as f64),
            };
            let ticks = (0..levels).step_by(every).take(MAX_TICKS);
            let ticks = ticks.map(|index| (axis.low + index as f64, name(index))).collect();
            ChartAxis { ticks, ..linear(&label, [low, high]) }
        }
        _ => linear(&label, [low, high]),
    }
}

/// Returns the positions between `n` cells of equal size, or the middles between the levels of a
/// discrete axis with at most `n` levels.
pub fn edges(axis: &Axis, n: usize) -> Vec<f64> {
    let [low, high] = ends(axis);
    let cells = cells(axis, n);
    let at = |index: usize| {
        let u = index as f64 / cells as f64;
        match axis.values {
            AxisValues::Logarithmic if low > 0.0 => low * (high / low).powf(u),
            _ => low + (high - low) * u,
        }
    };
    (0..=cells).map(at).collect()
}

/// Returns the number of cells of an axis.
pub fn cells(axis: &Axis, n: usize) -> usize {
    axis.levels().map_or(n, |levels| levels.min(n)).max(1)
}

/// Formats a value of an axis: a number with its unit, or a name.
pub fn value_text(axis: &Axis, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => "random".to_string(),
        (Some(value), AxisValues::Categorical(names)) => {
            let index = value - axis.low;
            let name = (index >= 0.0).then(|| names.get(index as usize)).flatten();
            name.map_or(number(value), |name| short(name, 40))
        }
        (Some(value), _) => format!("{} {}", number(value), short(&axis.unit, 20)).trim_end().to_string(),
    }
}

#[cfg(test)]
mod tests {
    use mishandle::rollout::{Condition, Holds};

    use super::*;

    #[test]
    fn a_discrete_axis_has_a_cell_for_each_value() {
        let axis = Axis::start("delay", "steps", 0.0, 3.0).with_values(AxisValues::Integer);
        assert_eq!(edges(&axis, 20), [-0.5, 0.5, 1.5, 2.5, 3.5]);
        let names = AxisValues::Categorical(["ice".to_string(), "mud".to_string()].into());
        let axis = Axis::start("ground", "", 0.0, 1.0).with_values(names);
        assert_eq!(chart_axis(&axis).ticks, [(0.0, "ice".to_string()), (1.0, "mud".to_string())]);
        assert_eq!(value_text(&axis, Some(1.0)), "mud");
    }

    #[test]
    fn a_space_of_separate_values_has_points_and_any_other_one_a_volume() {
        let integer =
            |name: &str, high: f64| Axis::start(name, "", 0.0, high).with_values(AxisValues::Integer);
        let fixed = Axis::start("fixed", "m", 0.5, 0.5);
        let axes = [integer("a", 3.0), fixed.clone(), integer("b", 3.0)];
        let extent = Extent::of(&axes);
        assert_eq!(extent, Extent::Points(16));
        let named = [Bound::Low, Bound::Value, Bound::High].map(|bound| extent.part(0.35, bound));
        assert_eq!(named, ["6 of 16 points", "6 of 16 points", "5 of 16 points"]);
        assert_eq!([Bound::Low, Bound::High].map(|bound| extent.size(0.375, bound)), ["6", "6"]);
        let all = extent.scenarios(&axes, 16).unwrap();
        let mut values: Vec<Vec<Option<f64>>> = all.iter().map(|found| found.values().to_vec()).collect();
        assert!(
            values.iter().all(|values| axes.iter().zip(values).all(|(axis, v)| axis.accepts(v.unwrap())))
        );
        values.sort_by(|a, b| a.partial_cmp(b).unwrap());
        values.dedup();
        assert_eq!(values.len(), 16);
        assert_eq!(extent.scenarios(&axes, 15), None);
        let volume = Extent::of(&[integer("a", 3.0), Axis::start("x", "m", 0.0, 1.0)]);
        assert_eq!(volume.part(0.35, Bound::Value), "35 % of the space");
        assert_eq!(volume.scenarios(&[], 16), None);
        let holds = Holds::OneOf([1.0].into());
        let condition = Condition { axis: "a".to_string(), nominal: 0.0, holds };
        assert_eq!(Extent::of(&[integer("a", 3.0), integer("b", 3.0).only_if([condition])]), Extent::Volume);
    }

    #[test]
    fn the_range_of_a_chart_is_finite_and_not_empty() {
        for range in
            [[1.0, 1.0], [f64::NAN, 1.0], [f64::NEG_INFINITY, f64::INFINITY], [1e300, 1e308], [1e20, 1e20]]
        {
            let [low, high] = sane(range);
            assert!(low < high && (high - low).is_finite(), "{range:?}");
            assert!(linear("", range).ticks.iter().all(|(_, label)| label.chars().count() < 12), "{range:?}");
        }
    }
}
