//! Conditional axes: axes that have a meaning only for some values of other axes.

use std::sync::Arc;

use crate::{Axis, Scenario};

/// A condition on another axis, without which an axis has no effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    /// Name of the other axis.
    pub axis: String,
    /// Value of the other axis in a space that does not contain it.
    pub nominal: f64,
    /// Values of the other axis under which the condition holds.
    pub holds: Holds,
}

/// Values of an axis under which a [`Condition`] holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Holds {
    /// One of these values.
    OneOf(Arc<[f64]>),
    /// Any other value than this one.
    Except(f64),
}

impl Condition {
    fn holds(&self, value: f64) -> bool {
        match &self.holds {
            Holds::OneOf(values) => values.contains(&value),
            Holds::Except(excluded) => value != *excluded,
        }
    }

    /// Returns whether the condition holds for a value between two bounds.
    fn holds_within(&self, [low, high]: [f64; 2]) -> bool {
        match &self.holds {
            Holds::OneOf(values) => values.iter().any(|value| (low..=high).contains(value)),
            Holds::Except(excluded) => low != *excluded || high != *excluded,
        }
    }
}

/// The conditions of one axis of a space.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Gate {
    /// Index of the axis.
    axis: usize,
    /// Each condition, with the index of its axis; `None` if the space lacks it.
    conditions: Vec<(Option<usize>, Condition)>,
}

/// Returns the gates of the axes that have conditions.
pub(crate) fn gates(axes: &[Axis]) -> Arc<[Gate]> {
    let place = |name: &str| axes.iter().position(|axis| axis.name == name);
    let gate = |(index, axis): (usize, &Axis)| Gate {
        axis: index,
        conditions: axis.conditions.iter().map(|c| (place(&c.axis), c.clone())).collect(),
    };
    axes.iter().enumerate().filter(|(_, axis)| !axis.conditions.is_empty()).map(gate).collect()
}

/// Returns the indices of the axes that have no effect in a scenario.
pub(crate) fn inactive(gates: &[Gate], scenario: &Scenario) -> impl Iterator<Item = usize> {
    let holds = |(place, condition): &(Option<usize>, Condition)| match place {
        None => condition.holds(condition.nominal),
        // A value that a random stream draws can be any.
        Some(place) => scenario.get(*place).is_none_or(|value| condition.holds(value)),
    };
    gates.iter().filter(move |gate| !gate.conditions.iter().all(holds)).map(|gate| gate.axis)
}

/// Sets the axes without an effect to their nominal values.
pub(crate) fn canonical(gates: &[Gate], axes: &[Axis], scenario: Scenario) -> Scenario {
    if gates.is_empty() {
        return scenario;
    }
    let mut values = scenario.values().to_vec();
    inactive(gates, &scenario).for_each(|index| values[index] = axes[index].nominal);
    Scenario::new(values)
}

/// Returns the index of an axis and those of the axes that its conditions name.
pub(crate) fn needed(gates: &[Gate], index: usize) -> Vec<usize> {
    let own = gates.iter().filter(|gate| gate.axis == index).flat_map(|gate| &gate.conditions);
    std::iter::once(index).chain(own.filter_map(|(place, _)| *place)).collect()
}

/// Returns the indices of the axes that have an effect in no scenario of a space.
pub(crate) fn idle(gates: &[Gate], axes: &[Axis]) -> Vec<usize> {
    let can_hold = |(place, condition): &(Option<usize>, Condition)| match place {
        None => condition.holds(condition.nominal),
        Some(place) => condition.holds_within([axes[*place].low, axes[*place].high]),
    };
    gates.iter().filter(|gate| !gate.conditions.iter().all(can_hold)).map(|gate| gate.axis).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AxisKind, AxisValues, Seed, Space};

    /// A surface (dry, wet or ice), the depth of its water, and the temperature of ice.
    fn axes() -> Vec<Axis> {
        let names = ["dry", "wet", "ice"].map(String::from);
        let surface = Axis::new(AxisKind::Model, "surface", "", [0.0, 2.0], Some(0.0));
        let surface = surface.with_values(AxisValues::Categorical(names.into()));
        let when = |holds| Condition { axis: "surface".to_string(), nominal: 0.0, holds };
        let depth = Axis::new(AxisKind::Model, "depth", "m", [0.0, 0.2], Some(0.1));
        let depth = depth.only_if([when(Holds::OneOf([1.0].into()))]);
        let cold = Axis::new(AxisKind::Model, "cold", "K", [0.0, 30.0], Some(0.0));
        vec![surface, depth, cold.only_if([when(Holds::Except(0.0))])]
    }

    #[test]
    fn an_axis_without_an_effect_is_nominal_so_that_equal_scenarios_are_equal() {
        let space = Space::new("s", axes()).unwrap();
        assert_eq!(space.at(&[0.0, 1.0, 1.0]), [0.0, 0.1, 0.0].into());
        assert_eq!(space.at(&[0.5, 1.0, 1.0]), [1.0, 0.2, 30.0].into());
        assert_eq!(space.at(&[1.0, 1.0, 1.0]), [2.0, 0.1, 30.0].into());
        for index in 0..200 {
            let drawn = space.sample(Seed(3), index);
            assert_eq!(space.canonical(drawn.clone()), drawn);
        }
    }

    #[test]
    fn an_axis_is_idle_if_no_scenario_gives_it_an_effect() {
        let idle = |change: fn(&mut Vec<Axis>)| {
            let mut axes = axes();
            change(&mut axes);
            let space = Space::new("s", axes).unwrap();
            space.idle_axes().into_iter().map(|index| space.axes()[index].name.clone()).collect::<Vec<_>>()
        };
        assert!(idle(|_| {}).is_empty());
        assert_eq!(idle(|axes| axes[0].high = 0.0), ["depth", "cold"]);
        assert_eq!(idle(|axes| axes[0].low = 2.0), ["depth"]);
        assert_eq!(idle(|axes| drop(axes.remove(0))), ["depth", "cold"], "an absent axis is nominal");
    }
}
