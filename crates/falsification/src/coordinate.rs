use mishandle_rollout::{Axis, AxisValues, Space};
use mishandle_search::{Composition, Coordinate, Parts, SearchSpace};
use mishandle_stl::Decomposition;

/// Returns the type of the coordinate of an axis.
pub fn coordinate(axis: &Axis) -> Coordinate {
    match (&axis.values, axis.levels()) {
        _ if axis.is_fixed() => Coordinate::Integer { levels: 1 },
        (AxisValues::Categorical(_), Some(levels)) => Coordinate::Categorical { levels },
        (_, Some(levels)) => Coordinate::Integer { levels },
        (_, None) => Coordinate::Continuous,
    }
}

/// Returns what a search may know of a space: the types of the coordinates, when they begin to act,
/// and the parts of the robustness on episodes of `steps` control steps.
pub fn search_space(space: &Space, parts: &Decomposition, steps: usize) -> SearchSpace {
    SearchSpace {
        coordinates: space.axes().iter().map(coordinate).collect(),
        begins: space.axes().iter().map(|axis| axis.acts_from).collect(),
        parts: Some(Parts {
            ends: parts.ends().map(|end| end as f64 / steps.max(1) as f64).collect(),
            signals: parts.leaves().collect(),
            composition: composition(parts.composition()),
        }),
    }
}

fn composition(tree: &mishandle_stl::Composition) -> Composition {
    let all = |operands: &[mishandle_stl::Composition]| operands.iter().map(composition).collect();
    match tree {
        mishandle_stl::Composition::Part(index) => Composition::Part(*index),
        mishandle_stl::Composition::Min(operands) => Composition::Min(all(operands)),
        mishandle_stl::Composition::Max(operands) => Composition::Max(all(operands)),
    }
}
