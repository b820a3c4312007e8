//! Categories: a margin varies numbers only, so it is searched at one category of each axis, or
//! once for each combination of categories.

use mishandle_rollout::{Axis, AxisKind, AxisValues, Episode, Request, RolloutError, Space, System};

use super::amplitude::is_disturbed;
use crate::FalsificationError;

/// Largest number of combinations of categories.
const MOST: u64 = 1000;

/// Returns the indices of the axes whose category a margin keeps: those with a choice.
pub fn category_axes(space: &Space) -> Vec<usize> {
    let has_choice = |axis: &Axis| matches!(axis.values, AxisValues::Categorical(_)) && !axis.is_fixed();
    (0..space.dimension()).filter(|index| has_choice(&space.axes()[*index])).collect()
}

/// Returns the space once for each combination of categories, with these axes fixed. A category
/// that has no effect in a combination stays nominal.
///
/// # Errors
/// If there are more than 1000 combinations.
///
/// # Example
/// ```
/// use mishandle_falsification::each_category;
/// use mishandle_rollout::{Axis, AxisKind, AxisValues, Space};
/// let floor = Axis::new(AxisKind::Model, "floor", "", [0.0, 1.0], Some(0.0))
///     .with_values(AxisValues::Categorical(["dry".to_string(), "wet".to_string()].into()));
/// let push = Axis::new(AxisKind::Input, "push", "N", [0.0, 9.0], Some(0.0));
/// let spaces = each_category(&Space::new("s", vec![floor, push])?)?;
/// let floors: Vec<f64> = spaces.iter().map(|space| space.axes()[0].low).collect();
/// assert_eq!(floors, [0.0, 1.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn each_category(space: &Space) -> Result<Vec<Space>, FalsificationError> {
    let mut spaces = vec![space.clone()];
    for index in category_axes(space) {
        let mut parts = Vec::new();
        for part in &spaces {
            if part.axes()[index].is_fixed() {
                parts.push(part.clone());
                continue;
            }
            for value in values(&space.axes()[index]) {
                parts.push(with_fixed(part, &[(index, value)])?);
            }
        }
        if parts.len() as u64 > MOST {
            return Err(FalsificationError::InvalidValue {
                what: "the number of combinations of categories",
                value: format!("{} or more", parts.len()),
                expected: "at most 1000: fix an axis",
            });
        }
        spaces = parts;
    }
    Ok(with_disturbances(spaces))
}

/// Returns the space once for each kind of each fault, the only fault then; the space itself if it
/// has no fault. Without a kind, a fault has no number that a margin could vary.
///
/// # Errors
/// If a part is not a valid space.
pub fn each_fault(space: &Space) -> Result<Vec<Space>, FalsificationError> {
    let is_fault = |index: &usize| space.axes()[*index].kind == AxisKind::Fault && decides(space, *index);
    let faults: Vec<usize> = category_axes(space).into_iter().filter(is_fault).collect();
    if faults.is_empty() {
        return Ok(vec![space.clone()]);
    }
    let nominal = |index: usize| space.axes()[index].nominal.unwrap_or_default();
    let healthy: Vec<(usize, f64)> = faults.iter().map(|index| (*index, nominal(*index))).collect();
    let mut spaces = vec![with_fixed(space, &healthy)?];
    for (place, index) in faults.iter().enumerate() {
        for value in values(&space.axes()[*index]).filter(|value| *value != nominal(*index)) {
            let mut fixed = healthy.clone();
            fixed[place].1 = value;
            spaces.push(with_fixed(space, &fixed)?);
        }
    }
    Ok(with_disturbances(spaces))
}

/// Returns whether other axes have an effect only for some values of an axis.
fn decides(space: &Space, index: usize) -> bool {
    let name = &space.axes()[index].name;
    space.axes().iter().any(|axis| axis.conditions.iter().any(|condition| condition.axis == *name))
}

/// Returns the values of a categorical axis.
fn values(axis: &Axis) -> impl Iterator<Item = f64> + use<> {
    let low = axis.low;
    (0..axis.levels().unwrap_or(1)).map(move |level| low + level as f64)
}

/// Returns the space with fixed values on some axes, and the nominal value on those that have no
/// effect with them.
fn with_fixed(space: &Space, fixed: &[(usize, f64)]) -> Result<Space, FalsificationError> {
    let mut axes = space.axes().to_vec();
    let fix = |axis: &mut Axis, value: f64| {
        (axis.low, axis.high, axis.nominal) = (value, value, Some(value));
    };
    fixed.iter().for_each(|(index, value)| fix(&mut axes[*index], *value));
    let part = Space::new(space.name(), axes.clone())?;
    for index in part.idle_axes() {
        let nominal = axes[index].nominal.unwrap_or_default();
        fix(&mut axes[index], nominal);
    }
    Ok(Space::new(space.name(), axes)?)
}

/// Returns the parts with an axis that a margin varies; all parts if no part has one.
fn with_disturbances(spaces: Vec<Space>) -> Vec<Space> {
    let (varied, rest): (Vec<Space>, Vec<Space>) =
        spaces.into_iter().partition(|space| space.axes().iter().any(is_disturbed));
    if varied.is_empty() { rest } else { varied }
}

/// A system in a part of its space.
pub struct Narrowed<'a> {
    /// The system.
    pub system: &'a mut dyn System,
    /// The part.
    pub space: &'a Space,
}

impl System for Narrowed<'_> {
    fn space(&self) -> &Space {
        self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        self.system.rollout(requests)
    }
}
