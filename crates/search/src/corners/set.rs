//! The corners of a space, numbered.

use mishandle_random::Sequence;

use super::permutation::Permutation;
use crate::Coordinate;

/// The number of corners up to which they are numbered. In a space with more, two of a million
/// random corners are equal with a probability of 1e-7.
const MAX_NUMBERED: u64 = 1 << 62;

/// The corners of a space in random order.
///
/// In a corner, every continuous or integer coordinate is at a bound, 0 or 1. The levels of a
/// category have no order, so each of them counts as a bound; its coordinate is the middle of the
/// level's interval.
#[derive(Debug, Clone)]
pub(crate) struct CornerSet {
    coordinates: Vec<Coordinate>,
    order: Order,
}

#[derive(Debug, Clone)]
enum Order {
    /// Every corner once.
    Permuted(Permutation),
    /// Independent random corners of the seed.
    Independent(u64),
}

/// Returns the number of bounds of a coordinate.
pub(crate) fn n_bounds(coordinate: Coordinate) -> u64 {
    match coordinate {
        Coordinate::Continuous => 2,
        Coordinate::Integer { levels } => levels.min(2) as u64,
        Coordinate::Categorical { levels } => levels as u64,
    }
}

/// Returns the value of bound number `bound` of a coordinate.
pub(crate) fn bound_value(coordinate: Coordinate, bound: u64) -> f64 {
    match coordinate {
        Coordinate::Continuous | Coordinate::Integer { .. } => bound as f64,
        Coordinate::Categorical { levels } => (bound as f64 + 0.5) / levels as f64,
    }
}

impl CornerSet {
    /// Creates the set; `seed` determines the order of the corners.
    pub(crate) fn new(coordinates: &[Coordinate], seed: u64) -> Self {
        let count = coordinates.iter().try_fold(1u64, |n, c| n.checked_mul(n_bounds(*c)));
        let order = match count {
            Some(n) if n <= MAX_NUMBERED => Order::Permuted(Permutation::new(n, &mut Sequence::new(seed, 0))),
            _ => Order::Independent(seed),
        };
        Self { coordinates: coordinates.to_vec(), order }
    }

    /// Returns the number of corners; `None` if they are too many to be numbered.
    pub(crate) fn count(&self) -> Option<u64> {
        match &self.order {
            Order::Permuted(permutation) => Some(permutation.len()),
            Order::Independent(_) => None,
        }
    }

    /// Returns corner `i` of the random order. The order repeats after [`count`](Self::count)
    /// corners.
    pub(crate) fn corner(&self, i: u64) -> Vec<f64> {
        match &self.order {
            Order::Permuted(permutation) => {
                let mut rest = permutation.at(i % permutation.len());
                let value = |c: &Coordinate| {
                    let n = n_bounds(*c);
                    let bound = rest % n;
                    rest /= n;
                    bound_value(*c, bound)
                };
                self.coordinates.iter().map(value).collect()
            }
            Order::Independent(seed) => {
                let mut random = Sequence::new(*seed, i + 1);
                let mut value = |c: &Coordinate| bound_value(*c, random.below(n_bounds(*c)));
                self.coordinates.iter().map(&mut value).collect()
            }
        }
    }

    /// Returns the index of the corner with these bounds in the random order; `None` if corners are
    /// not numbered.
    pub(crate) fn index_of(&self, bounds: &[u64]) -> Option<u64> {
        let Order::Permuted(permutation) = &self.order else { return None };
        let pairs = self.coordinates.iter().zip(bounds).rev();
        let number = pairs.fold(0, |number, (c, bound)| number * n_bounds(*c) + bound);
        Some(permutation.index_of(number))
    }
}
