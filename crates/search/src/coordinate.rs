//! The types of coordinates.

use crate::SearchError;

/// The type of one coordinate of a search space.
///
/// Every coordinate of a point is a number in [0, 1], whatever its type. The caller maps it to a
/// value with a unit, or to one of `levels` levels: level `min(⌊levels u⌋, levels - 1)`.
///
/// A search may exploit the type, for example to avoid two points of the same level. Its
/// documentation says how it treats each type. The searches [`random`](crate::Random),
/// [`sobol`](crate::Sobol), [`nelder-mead`](crate::NelderMead) and
/// [`dual-annealing`](crate::DualAnnealing) treat every coordinate as continuous in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Coordinate {
    /// A real number.
    Continuous,
    /// An integer: the levels are ordered, and neighbors are similar.
    Integer {
        /// Number of levels, at least 1.
        levels: usize,
    },
    /// A categorical value: the levels have no order.
    Categorical {
        /// Number of levels, at least 1.
        levels: usize,
    },
}

/// Returns the number of coordinates.
///
/// # Errors
/// [`SearchError::Dimension`] if there is no coordinate, [`SearchError::NoLevels`] if one has no
/// levels.
pub(crate) fn dimension(coordinates: &[Coordinate]) -> Result<usize, SearchError> {
    let has_no_levels = |coordinate: &Coordinate| match coordinate {
        Coordinate::Continuous => false,
        Coordinate::Integer { levels } | Coordinate::Categorical { levels } => *levels == 0,
    };
    if let Some(coordinate) = coordinates.iter().position(has_no_levels) {
        return Err(SearchError::NoLevels { coordinate });
    }
    check_dimension(coordinates.len())
}

/// Returns the dimension if it is at least 1.
pub(crate) fn check_dimension(dimension: usize) -> Result<usize, SearchError> {
    if dimension == 0 { Err(SearchError::Dimension { found: 0 }) } else { Ok(dimension) }
}
