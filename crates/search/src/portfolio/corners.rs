//! Corners of the box: all of them or a designed sample first, then the remaining ones in random
//! order.

use mishandle_random::Sequence;

use crate::Coordinate;
use crate::corners::CornerSet;
use crate::gp::history::History;
use crate::gp::space::TypedSpace;

/// The number of corners of a designed sample, a power of 2.
const SAMPLE: usize = 8;
/// The most coordinates of which all corners are evaluated.
const ALL: usize = 4;

/// Returns all 2^d corners for d ≤ 4, otherwise 8 corners, in random order.
///
/// In the sample each coordinate is high in half of the corners. The columns are those of a
/// Hadamard matrix of order 8 with random signs: for up to 7 coordinates, all combinations of two
/// of them occur equally often (a fractional factorial design of resolution III), so that eight
/// evaluations show the effect of each coordinate. Beyond 7, columns repeat with permuted rows.
///
/// # Reference
/// Box and Hunter, "The 2^(k-p) fractional factorial designs", Technometrics 3(3), 1961.
pub(super) fn corners(space: &TypedSpace, stream: &mut Sequence) -> Vec<Vec<f64>> {
    let d = space.dimension();
    let mut designs: Vec<Vec<bool>> = if d <= ALL { all_signs(d) } else { sample(d, stream) };
    shuffle(&mut designs, stream);
    let mut corners: Vec<Vec<f64>> = Vec::with_capacity(designs.len());
    for design in designs {
        let corner: Vec<f64> =
            design.iter().enumerate().map(|(k, high)| space.face(k, *high, stream)).collect();
        if !corners.contains(&corner) {
            corners.push(corner);
        }
    }
    corners
}

/// The corners of the box in random order, each once.
#[derive(Debug, Clone)]
pub(super) struct RemainingCorners {
    all: CornerSet,
    next: u64,
}

impl RemainingCorners {
    /// Creates the sequence; `seed` determines the order.
    pub(super) fn new(coordinates: &[Coordinate], seed: u64) -> Self {
        Self { all: CornerSet::new(coordinates, seed), next: 0 }
    }

    /// Returns whether all corners have been proposed.
    pub(super) fn is_empty(&self) -> bool {
        self.all.count().is_some_and(|n| self.next >= n)
    }

    /// Returns the next corner that is not in `history`; `None` if no corner remains.
    pub(super) fn next(&mut self, space: &TypedSpace, history: &History) -> Option<Vec<f64>> {
        while !self.is_empty() {
            let mut corner = self.all.corner(self.next);
            space.snap(&mut corner);
            self.next += 1;
            if !history.contains(&corner) {
                return Some(corner);
            }
        }
        None
    }
}

fn all_signs(d: usize) -> Vec<Vec<bool>> {
    (0..1_usize << d).map(|bits| (0..d).map(|k| bits >> k & 1 == 1).collect()).collect()
}

fn sample(d: usize, stream: &mut Sequence) -> Vec<Vec<bool>> {
    let mut rows = vec![Vec::new(); SAMPLE];
    let mut columns: Vec<usize> = Vec::new();
    let mut order: Vec<usize> = (0..SAMPLE).collect();
    for _ in 0..d {
        if columns.is_empty() {
            // Without column 0, which is constant.
            columns = (1..SAMPLE).collect();
            shuffle(&mut columns, stream);
            shuffle(&mut order, stream);
        }
        let column = columns.pop().unwrap_or_default();
        let flipped = stream.bits() & 1 == 1;
        for (row, i) in rows.iter_mut().zip(&order) {
            // Element (i, column) of the Hadamard matrix is (-1)^(number of common bits).
            row.push(((i & column).count_ones() % 2 == 1) != flipped);
        }
    }
    rows
}

fn shuffle<T>(items: &mut [T], stream: &mut Sequence) {
    for i in (1..items.len()).rev() {
        items.swap(i, stream.below(i as u64 + 1) as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corners_of(d: usize) -> Vec<Vec<f64>> {
        corners(&TypedSpace::new(&vec![Coordinate::Continuous; d]), &mut Sequence::new(3, 0))
    }

    #[test]
    fn few_coordinates_have_all_their_corners() {
        for d in 1..=4 {
            let mut found = corners_of(d);
            found.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
            found.dedup();
            assert_eq!(found.len(), 1 << d);
        }
    }

    /// Every combination of two of up to 7 coordinates occurs twice in 8 corners.
    #[test]
    fn two_coordinates_have_all_combinations_equally_often() {
        for d in 5..=7 {
            let found = corners_of(d);
            assert_eq!(found.len(), 8);
            for (i, j) in (0..d).flat_map(|i| (0..i).map(move |j| (i, j))) {
                let mut counts = [0; 4];
                found.iter().for_each(|c| counts[(2.0 * c[i] + c[j]) as usize] += 1);
                assert_eq!(counts, [2; 4], "coordinates {i} and {j} of {d}");
            }
        }
    }

    #[test]
    fn every_coordinate_is_high_in_half_of_the_corners() {
        let found = corners_of(100);
        for k in 0..100 {
            assert_eq!(found.iter().map(|corner| corner[k]).sum::<f64>(), 4.0);
        }
    }

    /// Eight of 2^6 corners are evaluated; the other 56 follow, each once.
    #[test]
    fn remaining_corners_are_the_others() {
        let coordinates = [Coordinate::Continuous; 6];
        let space = TypedSpace::new(&coordinates);
        let mut history = History::default();
        corners_of(6).iter().for_each(|corner| history.push(corner, 1.0));
        let mut remaining = RemainingCorners::new(&coordinates, 5);
        let mut count = 0;
        while let Some(corner) = remaining.next(&space, &history) {
            assert!(!history.contains(&corner));
            history.push(&corner, 1.0);
            count += 1;
        }
        assert_eq!(count, 56);
        assert!(remaining.is_empty());
    }
}
