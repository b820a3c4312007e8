//! Corner search: the corners of the space, then its faces.

mod design;
mod hadamard;
mod permutation;
mod set;

use mishandle_random::{Seed, Sequence};

use crate::indexed::{InSequence, PointSequence};
use crate::registry::SearchEntry;
use crate::sobol::{MAX_DIMENSION, SobolSequence};
use crate::{Coordinate, SearchError, coordinate, options};
pub(crate) use set::CornerSet;
use set::{bound_value, n_bounds};

const NAME: &str = "corners";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "corners of the space, from a designed sample to all of them, then its faces",
    reference: "Plackett and Burman, \"The design of optimum multifactorial experiments\", Biometrika 33, 1946. Box and \
                Wilson, \"On the experimental attainment of optimum conditions\", J. R. Stat. Soc. B 13, 1951.",
    options: Vec::new,
    make: |space, seed, options| {
        options::check_names(NAME, options, &[])?;
        Ok(Box::new(InSequence::new(Corners::new(&space.coordinates, seed)?)))
    },
};

/// Corner search: points at which all coordinates are at their bounds. The search never ends.
///
/// Use it first: controllers often fail at an extreme of every axis, and the robustness of a system
/// that is monotone in each axis is lowest in a corner. It proposes, in this order,
///
/// 1. designed corners: an orthogonal array of strength 3, a Plackett-Burman design and its
///    foldover. They are all corners for up to 4 axes, 16 for 5 to 7, 64 for 30 and 208 for 100
///    axes. Any combination of bounds of three axes is among the first 8 · ⌈(d + 1) / 4⌉ corners,
///    rounded up to the next known design, so a failure that needs at most three axes at certain
///    bounds is found;
/// 2. the center of the space;
/// 3. the remaining corners in random order, each once;
/// 4. the centers of the facets, that is, one axis at a bound and the others in the middle;
/// 5. points on faces: each axis is free with a probability of 1/2 and otherwise at a random bound;
///    at least one is free. Free coordinates come from a scrambled Sobol sequence.
///
/// Steps 4 and 5 are reached if the budget exceeds the number of corners, for example for 2 axes
/// after 5 points.
///
/// The bounds of an integer axis are its first and last level. The levels of a category have no
/// order, so each of them counts as a bound, and the center has a random level. In a space with
/// more than 2^62 corners, step 3 takes independent random corners.
///
/// # Reference
/// Plackett and Burman, "The design of optimum multifactorial experiments", Biometrika 33, 1946.
/// Box and Wilson, "On the experimental attainment of optimum conditions", J. R. Stat. Soc. B 13,
/// 1951 (foldover).
#[derive(Debug, Clone)]
pub struct Corners {
    coordinates: Vec<Coordinate>,
    designed: Vec<Vec<u64>>,
    all: CornerSet,
    /// The indices of the designed corners in the order of all corners, sorted.
    designed_indices: Vec<u64>,
    sobol: SobolSequence,
    /// Seed of the points after the designed ones.
    seed: u64,
}

impl Corners {
    /// Creates a corner search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels.
    pub fn new(coordinates: &[Coordinate], seed: u64) -> Result<Self, SearchError> {
        let dimension = coordinate::dimension(coordinates)?;
        let child = |index| Seed(seed).child(index).0;
        let designed = design::designed_corners(coordinates, &mut Sequence::new(seed, 0));
        let all = CornerSet::new(coordinates, child(0));
        let mut designed_indices: Vec<u64> =
            designed.iter().filter_map(|corner| all.index_of(corner)).collect();
        designed_indices.sort_unstable();
        let sobol = SobolSequence::new(dimension.min(MAX_DIMENSION), Some(Sequence::new(child(1), 0)));
        Ok(Self { coordinates: coordinates.to_vec(), designed, all, designed_indices, sobol, seed: child(2) })
    }

    fn designed_corner(&self, i: usize) -> Vec<f64> {
        self.coordinates.iter().zip(&self.designed[i]).map(|(c, bound)| bound_value(*c, *bound)).collect()
    }

    /// Returns remaining corner `i`: corner `i` of the random order without the designed ones.
    fn remaining_corner(&self, i: u64) -> Vec<f64> {
        let mut index = i;
        for designed in &self.designed_indices {
            if *designed > index {
                break;
            }
            index += 1;
        }
        self.all.corner(index)
    }

    fn center(&self, random: &mut Sequence) -> Vec<f64> {
        let middle = |c: &Coordinate| match c {
            Coordinate::Continuous | Coordinate::Integer { .. } => 0.5,
            Coordinate::Categorical { levels } => bound_value(*c, random.below(*levels as u64)),
        };
        self.coordinates.iter().map(middle).collect()
    }

    /// Returns the indices of the coordinates with two bounds and numbers between them.
    fn ordered(&self) -> Vec<usize> {
        let is_ordered = |c: &Coordinate| !matches!(c, Coordinate::Categorical { .. }) && n_bounds(*c) == 2;
        (0..self.coordinates.len()).filter(|k| is_ordered(&self.coordinates[*k])).collect()
    }

    fn face_point(&self, i: u64, random: &mut Sequence) -> Vec<f64> {
        let mut u = vec![0.0; self.coordinates.len()];
        self.sobol.write(i, &mut u);
        u.iter_mut().skip(MAX_DIMENSION).for_each(|x| *x = random.uniform());
        let ordered = self.ordered();
        let always_free = random.below(ordered.len() as u64) as usize;
        for (j, k) in ordered.into_iter().enumerate() {
            let [is_free, bound] = [random.below(2) == 1, random.below(2) == 1];
            if !is_free && j != always_free {
                u[k] = f64::from(u8::from(bound));
            }
        }
        u
    }
}

impl PointSequence for Corners {
    fn name(&self) -> &'static str {
        NAME
    }

    fn dimension(&self) -> usize {
        self.coordinates.len()
    }

    fn point(&self, i: u64) -> Vec<f64> {
        let n_designed = self.designed.len() as u64;
        if i < n_designed {
            return self.designed_corner(i as usize);
        }
        let mut random = Sequence::new(self.seed, i);
        if i == n_designed {
            return self.center(&mut random);
        }
        let i = i - n_designed - 1;
        let n_remaining = self.all.count().map_or(u64::MAX, |n| n - n_designed);
        if i < n_remaining {
            return self.remaining_corner(i);
        }
        let i = i - n_remaining;
        let ordered = self.ordered();
        // With a single axis, facets are corners.
        let n_facets = if ordered.len() > 1 { 2 * ordered.len() as u64 } else { 0 };
        if i >= n_facets {
            return self.face_point(i - n_facets, &mut random);
        }
        let mut u = self.center(&mut random);
        u[ordered[i as usize / 2]] = (i % 2) as f64;
        u
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn bits(u: &[f64]) -> Vec<u64> {
        u.iter().map(|x| x.to_bits()).collect()
    }

    fn is_corner(u: &[f64]) -> bool {
        u.iter().all(|x| *x == 0.0 || *x == 1.0)
    }

    /// The number of distinct corners among the first points: all 2^d, once, except for the center.
    #[test]
    fn every_corner_is_proposed_once() {
        for d in 1..=12 {
            for seed in 0..3 {
                let search = Corners::new(&vec![Coordinate::Continuous; d], seed).expect("a space");
                let points: Vec<_> = (0..=(1 << d)).map(|i| search.point(i)).collect();
                let corners: HashSet<_> = points.iter().filter(|u| is_corner(u)).map(|u| bits(u)).collect();
                assert_eq!(corners.len(), 1 << d, "d = {d}");
                assert_eq!(points.iter().filter(|u| **u == vec![0.5; d]).count(), 1, "d = {d}");
            }
        }
    }

    /// In two dimensions: 4 corners, the center, 4 edge centers, then points on edges and inside.
    #[test]
    fn faces_follow_the_corners() {
        let search = Corners::new(&[Coordinate::Continuous; 2], 3).expect("a space");
        let points: Vec<_> = (0..1009).map(|i| search.point(i)).collect();
        assert!(points[..4].iter().all(|u| is_corner(u)));
        assert_eq!(points[4], [0.5, 0.5]);
        assert_eq!(points[5..9], [[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]]);
        let n_at_bounds = |u: &Vec<f64>| u.iter().filter(|x| **x == 0.0 || **x == 1.0).count();
        let on_edges = points[9..].iter().filter(|u| n_at_bounds(u) == 1).count();
        assert!(points[9..].iter().all(|u| n_at_bounds(u) < 2));
        // One coordinate is always free, the other one with a probability of 1/2: 500 of 1000, five
        // standard errors.
        assert!(on_edges.abs_diff(500) < 80, "{on_edges}");
    }

    #[test]
    fn every_level_of_a_category_is_a_bound() {
        let space = [
            Coordinate::Categorical { levels: 5 },
            Coordinate::Integer { levels: 4 },
            Coordinate::Integer { levels: 1 },
        ];
        let search = Corners::new(&space, 1).expect("a space");
        let points: Vec<_> = (0..11).map(|i| search.point(i)).collect();
        let corners: HashSet<_> =
            points.iter().map(|u| ((u[0] * 5.0) as usize, (u[1] * 4.0).min(3.0) as usize)).collect();
        for level in 0..5 {
            assert!(corners.contains(&(level, 0)) && corners.contains(&(level, 3)), "{points:?}");
        }
    }

    /// A space with too many corners to be numbered still has distinct ones.
    #[test]
    fn corners_of_large_spaces_differ() {
        let search = Corners::new(&[Coordinate::Continuous; 100], 1).expect("a space");
        let points: HashSet<_> = (0..20_000).map(|i| bits(&search.point(i))).collect();
        assert_eq!(points.len(), 20_000);
    }
}
