//! A designed sample of corners: an orthogonal array of strength 3.

use std::collections::BTreeSet;

use mishandle_random::Sequence;

use super::hadamard::Hadamard;
use super::permutation::Permutation;
use super::set::n_bounds;
use crate::Coordinate;

/// Returns the bounds of the designed corners: rows of a Hadamard matrix, each followed by the
/// opposite row.
///
/// For d coordinates with two bounds there are about 2 d + 2 rows, in which every combination of
/// bounds of three coordinates occurs equally often; for d up to 4, they are all corners. Signs of
/// columns and the order of rows are random. A category with more than two levels has a column of
/// its own, in which each level occurs equally often, up to one.
pub(super) fn designed_corners(coordinates: &[Coordinate], random: &mut Sequence) -> Vec<Vec<u64>> {
    let n_columns = coordinates.iter().filter(|c| n_bounds(**c) == 2).count();
    let matrix = Hadamard::with_columns(n_columns + 1);
    let n_rows = matrix.order() as u64;
    let rows = Permutation::new(n_rows, random);
    let flips: Vec<bool> = (0..n_columns).map(|_| random.bits() >> 63 == 1).collect();
    let levels: Vec<Permutation> = coordinates.iter().map(|_| Permutation::new(2 * n_rows, random)).collect();
    let mut seen = BTreeSet::new();
    let corner = |run: u64| -> Vec<u64> {
        let row = rows.at(run / 2) as usize;
        let is_opposite = run % 2 == 1;
        let mut column = 0;
        let bound = |(c, order): (&Coordinate, &Permutation)| match n_bounds(*c) {
            2 => {
                column += 1;
                u64::from(matrix.is_positive(row, column) ^ flips[column - 1] ^ is_opposite)
            }
            n => order.at(run) % n,
        };
        coordinates.iter().zip(&levels).map(bound).collect()
    };
    (0..2 * n_rows).map(corner).filter(|corner| seen.insert(corner.clone())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each combination of bounds of three coordinates occurs equally often.
    #[test]
    fn the_design_has_strength_three() {
        for d in [3, 4, 5, 7, 11, 12, 20, 30] {
            let space = vec![Coordinate::Continuous; d];
            let corners = designed_corners(&space, &mut Sequence::new(d as u64, 0));
            for a in 0..d {
                for b in 0..a {
                    for c in 0..b {
                        let mut counts = [0; 8];
                        for corner in &corners {
                            counts[(corner[a] + 2 * corner[b] + 4 * corner[c]) as usize] += 1;
                        }
                        assert_eq!(counts, [corners.len() / 8; 8], "coordinates {a}, {b}, {c} of {d}");
                    }
                }
            }
        }
    }

    #[test]
    fn all_corners_are_designed_in_up_to_four_dimensions_and_about_2d_above() {
        for (d, n) in [(1, 2), (2, 4), (3, 8), (4, 16), (5, 16), (11, 24), (30, 64), (100, 208)] {
            let space = vec![Coordinate::Continuous; d];
            assert_eq!(designed_corners(&space, &mut Sequence::new(1, 0)).len(), n, "d = {d}");
        }
    }

    #[test]
    fn the_levels_of_a_category_occur_equally_often() {
        let mut space = vec![Coordinate::Continuous; 11];
        space[4] = Coordinate::Categorical { levels: 6 };
        space[7] = Coordinate::Integer { levels: 1 };
        let corners = designed_corners(&space, &mut Sequence::new(1, 0));
        assert_eq!(corners.len(), 24);
        let count = |level| corners.iter().filter(|corner| corner[4] == level).count();
        assert_eq!([0, 1, 2, 3, 4, 5].map(count), [4; 6]);
        assert!(corners.iter().all(|corner| corner[7] == 0));
    }
}
