//! Failures that hold only exactly on a bound of an axis.

use mishandle_rollout::{Axis, Scenario, Space};

/// How far inside of its bounds an axis is moved, in its coordinate from 0 to 1.
const INSIDE: f64 = 1e-6;

/// Returns the indices of the axes of real numbers that are exactly on a bound, and not nominal
/// there.
///
/// # Example
/// ```
/// use mishandle_falsification::{inside_bounds, on_bounds};
/// use mishandle_rollout::{Axis, Scenario, Space};
/// let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 2.0)]).unwrap();
/// let scenario = Scenario::from([2.0]);
/// assert_eq!(on_bounds(&space, &scenario), [0]);
/// assert_eq!(inside_bounds(&space, &scenario, &[0]).get(0), Some(2.0 - 2e-6));
/// ```
pub fn on_bounds(space: &Space, scenario: &Scenario) -> Vec<usize> {
    let is_on_bound = |(axis, value): (&Axis, &Option<f64>)| {
        value.is_some_and(|value| {
            let is_real = axis.levels().is_none() && !axis.is_fixed();
            is_real && (value == axis.low || value == axis.high) && Some(value) != axis.nominal
        })
    };
    let pairs = space.axes().iter().zip(scenario.values()).enumerate();
    pairs.filter(|(_, pair)| is_on_bound(*pair)).map(|(index, _)| index).collect()
}

/// Returns the scenario with these axes, which are on a bound, moved inside by a millionth of the
/// width.
pub fn inside_bounds(space: &Space, scenario: &Scenario, axes: &[usize]) -> Scenario {
    let mut values = scenario.values().to_vec();
    for &index in axes {
        let axis = &space.axes()[index];
        let is_low = values[index] == Some(axis.low);
        values[index] = Some(axis.at(if is_low { INSIDE } else { 1.0 - INSIDE }));
    }
    space.canonical(Scenario::new(values))
}

/// Returns whether a scenario is another one with axes that were moved inside of their bounds.
pub fn is_inside_of(space: &Space, scenario: &Scenario, other: &Scenario) -> bool {
    let differs = |index: &usize| scenario.get(*index) != other.get(*index);
    let moved: Vec<usize> = on_bounds(space, other).into_iter().filter(differs).collect();
    !moved.is_empty() && inside_bounds(space, other, &moved).is_same(scenario)
}
