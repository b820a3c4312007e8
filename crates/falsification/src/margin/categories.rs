//! Categories: a margin varies numbers only, so it is searched at one category of each axis, or
//! once for each combination of categories.

use mishandle_rollout::{Axis, AxisValues, Episode, Request, RolloutError, Space, System};

use crate::FalsificationError;

/// Largest number of combinations of categories.
const MOST: u64 = 1000;

/// Returns the indices of the axes whose category a margin keeps: those with a choice.
pub fn category_axes(space: &Space) -> Vec<usize> {
    let has_choice = |axis: &Axis| matches!(axis.values, AxisValues::Categorical(_)) && !axis.is_fixed();
    (0..space.dimension()).filter(|index| has_choice(&space.axes()[*index])).collect()
}

/// Returns the space once for each combination of categories, with these axes fixed.
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
    let axes = category_axes(space);
    let levels = |index: &usize| space.axes()[*index].levels().unwrap_or(1) as u64;
    let count = axes.iter().map(levels).fold(1_u64, u64::saturating_mul);
    if count > MOST {
        return Err(FalsificationError::InvalidValue {
            what: "the number of combinations of categories",
            value: count.to_string(),
            expected: "at most 1000: fix an axis",
        });
    }
    let mut spaces = vec![space.axes().to_vec()];
    for index in axes {
        let fixed = |known: &Vec<Axis>, category: u64| {
            let mut axes = known.clone();
            let value = axes[index].low + category as f64;
            (axes[index].low, axes[index].high, axes[index].nominal) = (value, value, Some(value));
            axes
        };
        let all = |known: &Vec<Axis>| (0..levels(&index)).map(|c| fixed(known, c)).collect::<Vec<_>>();
        spaces = spaces.iter().flat_map(all).collect();
    }
    Ok(spaces.into_iter().map(|axes| Space::new(space.name(), axes)).collect::<Result<_, _>>()?)
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
