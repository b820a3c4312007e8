//! Axes of a scenario space as axes of a chart.

use crate::charts::ChartAxis;
use mishandle::rollout::{Axis, AxisValues};

use crate::html::{number, short};

/// Largest number of ticks of a discrete axis.
const MAX_TICKS: usize = 7;

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
