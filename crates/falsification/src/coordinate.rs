use mishandle_rollout::{Axis, AxisValues};
use mishandle_search::Coordinate;

/// Returns the type of the coordinate of an axis.
pub fn coordinate(axis: &Axis) -> Coordinate {
    match (&axis.values, axis.levels()) {
        _ if axis.is_fixed() => Coordinate::Integer { levels: 1 },
        (AxisValues::Categorical(_), Some(levels)) => Coordinate::Categorical { levels },
        (_, Some(levels)) => Coordinate::Integer { levels },
        (_, None) => Coordinate::Continuous,
    }
}
