//! Typed coordinates: levels, faces and features.

use mishandle_random::Sequence;
use nalgebra::DMatrix;

use crate::Coordinate;

/// One-hot features of a category: two different levels have the squared distance 1.
const ONE_HOT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The coordinates of a search with their types.
///
/// All points of a search are *snapped*: an integer or categorical coordinate is the center of its
/// level, so that two points of the same level are equal.
#[derive(Debug, Clone)]
pub(crate) struct TypedSpace {
    coordinates: Vec<Coordinate>,
    /// The coordinate of each feature.
    coordinate_of: Vec<usize>,
}

impl TypedSpace {
    /// Creates the space.
    pub(crate) fn new(coordinates: &[Coordinate]) -> Self {
        let features = |coordinate: &Coordinate| match coordinate {
            Coordinate::Categorical { levels } => *levels,
            Coordinate::Continuous | Coordinate::Integer { .. } => 1,
        };
        let counts = coordinates.iter().map(features).enumerate();
        let coordinate_of = counts.flat_map(|(k, count)| std::iter::repeat_n(k, count)).collect();
        Self { coordinates: coordinates.to_vec(), coordinate_of }
    }

    /// Returns the number of coordinates.
    pub(crate) fn dimension(&self) -> usize {
        self.coordinates.len()
    }

    /// Returns the coordinate of each feature.
    pub(super) fn coordinate_of(&self) -> &[usize] {
        &self.coordinate_of
    }

    /// Returns whether coordinate `k` is a real number.
    pub(super) fn is_continuous(&self, k: usize) -> bool {
        self.coordinates[k] == Coordinate::Continuous
    }

    /// Moves integer and categorical coordinates to the centers of their levels.
    pub(crate) fn snap(&self, point: &mut [f64]) {
        for (x, coordinate) in point.iter_mut().zip(&self.coordinates) {
            *x = snapped(*x, *coordinate);
        }
    }

    /// Returns the snapped center of the box.
    pub(crate) fn center(&self) -> Vec<f64> {
        let mut center = vec![0.5; self.dimension()];
        self.snap(&mut center);
        center
    }

    /// Returns coordinate `k` on the lower or upper face. A category has no faces: it gets a random
    /// level.
    pub(crate) fn face(&self, k: usize, upper: bool, stream: &mut Sequence) -> f64 {
        let x = match self.coordinates[k] {
            Coordinate::Categorical { .. } => stream.uniform(),
            Coordinate::Continuous | Coordinate::Integer { .. } => f64::from(u8::from(upper)),
        };
        snapped(x, self.coordinates[k])
    }

    /// Returns coordinate `k` after a step from `x`, clipped to the box. An integer moves by at
    /// least one level; a category gets a random level.
    pub(crate) fn stepped(&self, k: usize, x: f64, step: f64, stream: &mut Sequence) -> f64 {
        match self.coordinates[k] {
            Coordinate::Continuous => (x + step).clamp(0.0, 1.0),
            Coordinate::Integer { levels } => {
                let level = (levels as f64).recip();
                let step = if step.abs() < level { level.copysign(step) } else { step };
                snapped((x + step).clamp(0.0, 1.0), self.coordinates[k])
            }
            Coordinate::Categorical { .. } => snapped(stream.uniform(), self.coordinates[k]),
        }
    }

    /// Returns the features of snapped points as columns: a number as it is, a category as one-hot
    /// vector.
    pub(super) fn features<'a>(&self, points: impl ExactSizeIterator<Item = &'a [f64]>) -> DMatrix<f64> {
        let mut features = DMatrix::zeros(self.coordinate_of.len(), points.len());
        for (point, mut column) in points.zip(features.column_iter_mut()) {
            let mut row = 0;
            for (x, coordinate) in point.iter().zip(&self.coordinates) {
                match *coordinate {
                    Coordinate::Categorical { levels } => {
                        column[row + level(*x, levels)] = ONE_HOT;
                        row += levels;
                    }
                    Coordinate::Continuous | Coordinate::Integer { .. } => {
                        column[row] = *x;
                        row += 1;
                    }
                }
            }
        }
        features
    }
}

/// Returns the level of `x` in [0, 1], as callers compute it.
fn level(x: f64, levels: usize) -> usize {
    ((levels as f64 * x) as usize).min(levels - 1)
}

fn snapped(x: f64, coordinate: Coordinate) -> f64 {
    match coordinate {
        Coordinate::Continuous => x,
        Coordinate::Integer { levels } | Coordinate::Categorical { levels } => {
            (level(x, levels) as f64 + 0.5) / levels as f64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mixed() -> TypedSpace {
        TypedSpace::new(&[
            Coordinate::Continuous,
            Coordinate::Integer { levels: 4 },
            Coordinate::Categorical { levels: 3 },
        ])
    }

    #[test]
    fn levels_have_one_point_each() {
        let mut point = [0.3, 0.6, 1.0];
        mixed().snap(&mut point);
        assert_eq!(point, [0.3, 0.625, 2.5 / 3.0]);
        let once = point;
        mixed().snap(&mut point);
        assert_eq!(point, once);
    }

    #[test]
    fn categories_are_equally_distant() {
        let space = mixed();
        let points = [[0.5, 0.125, 0.1], [0.5, 0.125, 0.5], [0.5, 0.125, 0.9]];
        let features = space.features(points.iter().map(<[f64; 3]>::as_slice));
        assert_eq!((features.nrows(), space.coordinate_of()), (5, &[0, 1, 2, 2, 2][..]));
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            assert!(((features.column(i) - features.column(j)).norm_squared() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn steps_stay_in_the_box_and_change_the_level_of_an_integer() {
        let space = mixed();
        let mut stream = Sequence::new(1, 0);
        assert_eq!(space.stepped(0, 0.9, 0.3, &mut stream), 1.0);
        assert_eq!(space.stepped(1, 0.375, 1e-6, &mut stream), 0.625);
        assert_eq!(space.stepped(1, 0.375, -1e-6, &mut stream), 0.125);
        assert_eq!((space.face(0, true, &mut stream), space.face(1, false, &mut stream)), (1.0, 0.125));
    }
}
