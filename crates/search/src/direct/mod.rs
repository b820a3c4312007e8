//! DIRECT: dividing rectangles.

mod rectangles;

use crate::coordinate::dimension;
use crate::options::{ANY, NOT_NEGATIVE, options};
use crate::registry::SearchEntry;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError};
use rectangles::{Rectangles, third};

const NAME: &str = "direct";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "DIRECT: divides the most promising boxes of every size, without random numbers",
    reference: "Jones, Perttunen and Stuckman, \"Lipschitzian optimization without the Lipschitz constant\", J. Optim. Theory \
                Appl. 79, 1993. Gablonsky and Kelley, \"A locally-biased form of the DIRECT algorithm\", J. Global Optim. \
                21, 2001.",
    options: DirectOptions::specs,
    make: |space, _, options| {
        let options = DirectOptions::read(options)?;
        Ok(Box::new(AskTell::new(Direct::new(&space.coordinates, &options)?)))
    },
};

options! {
    /// The options of [`Direct`], with the names and defaults of SciPy's `direct`.
    pub struct DirectOptions of NAME {
        /// Least improvement that a rectangle must make possible to be divided, relative to the
        /// lowest value.
        pub eps: f64 = 1e-4, in NOT_NEGATIVE;
        /// Uses DIRECT-L, which divides one rectangle of each size and measures sizes by the
        /// longest side. It is better for functions with few local minima. Otherwise the original
        /// DIRECT.
        pub locally_biased: bool = true, in ANY;
    }
}

/// DIRECT in `[0,1]^d`: evaluates the centers of rectangles that partition the box, and divides in
/// each iteration those that could contain the minimum for some Lipschitz constant.
///
/// Use it for smooth robustness in up to about six dimensions: it is deterministic, needs no
/// parameters and no scale of the values, and searches globally and locally at once. It never
/// proposes a point on a bound: after k divisions the outermost points have a distance of 3^-k / 2
/// from it. So combine it with `corners`. In many dimensions its first iteration already takes 2
/// d + 1 points. It uses no random numbers: all seeds give the same points.
///
/// The points are those of NLopt 2.11.0 (`GN_ORIG_DIRECT_L`, `GN_ORIG_DIRECT`), in its order, if no
/// two values are equal. SciPy 1.17.1 also divides rectangles above the convex hull, so its points
/// differ. There are no tolerances: the search continues until all sides are shorter than 3e-12 of
/// the box. The sides of integers and categories are divided until each level has a point. The
/// levels of a category are taken in their order. A value of +∞ counts as the largest finite value
/// plus 1. Memory grows by 9 d bytes and more for each point.
///
/// # Reference
/// Jones, Perttunen and Stuckman, "Lipschitzian optimization without the Lipschitz constant", J.
/// Optim. Theory Appl. 79,
/// 1993. Gablonsky and Kelley, "A locally-biased form of the DIRECT algorithm", J. Global Optim.
///       21, 2001.
#[derive(Debug, Clone)]
pub struct Direct {
    epsilon: f64,
    rectangles: Rectangles,
    /// The rectangles that the round divides. Empty until the whole box is evaluated.
    divisions: Vec<Division>,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

/// The division of a rectangle along its longest sides, with two points for each.
#[derive(Debug, Clone)]
struct Division {
    rectangle: usize,
    sides: Vec<usize>,
}

impl Direct {
    /// Creates the search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for a negative `eps`.
    pub fn new(coordinates: &[Coordinate], options: &DirectOptions) -> Result<Self, SearchError> {
        let dimension = dimension(coordinates)?;
        options.check_ranges()?;
        Ok(Self {
            epsilon: options.eps,
            rectangles: Rectangles::new(coordinates, options.locally_biased),
            divisions: Vec::new(),
            round: vec![vec![0.5; dimension]],
            end: None,
        })
    }

    fn propose(&mut self) {
        self.round.clear();
        self.divisions.clear();
        for rectangle in self.rectangles.take_potentially_optimal(self.epsilon) {
            let (depth, sides) = self.rectangles.longest_sides(rectangle);
            let step = third(depth + 1);
            for k in &sides {
                for step in [step, -step] {
                    let mut u = self.rectangles.center(rectangle).to_vec();
                    u[*k] += step;
                    self.round.push(u);
                }
            }
            self.divisions.push(Division { rectangle, sides });
        }
        if self.round.is_empty() {
            self.end = Some(SearchEnd::Converged);
        }
    }

    /// Divides a rectangle, given the points and values of its new rectangles. The side with the
    /// lowest value is divided first, so that its new rectangles are the largest.
    fn divide(&mut self, division: &Division, points: &[Vec<f64>], values: &[f64]) {
        let parent = division.rectangle;
        let mut pairs: Vec<usize> = (0..division.sides.len()).collect();
        let lower = |pair: &usize| values[2 * pair].min(values[2 * pair + 1]);
        pairs.sort_by(|a, b| lower(a).total_cmp(&lower(b)));
        let mut children = vec![0; values.len()];
        for pair in pairs {
            self.rectangles.shorten(parent, division.sides[pair]);
            let depths = self.rectangles.depths(parent).to_vec();
            for i in [2 * pair, 2 * pair + 1] {
                children[i] = self.rectangles.add(&points[i], &depths, values[i]);
            }
        }
        // Gablonsky's order, which decides between equal values.
        children.into_iter().chain([parent]).for_each(|rectangle| self.rectangles.insert(rectangle));
    }
}

impl RoundBased for Direct {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let points = std::mem::take(&mut self.round);
        let divisions = std::mem::take(&mut self.divisions);
        if divisions.is_empty() {
            let whole = self.rectangles.add(&points[0], &vec![0; points[0].len()], values[0]);
            self.rectangles.insert(whole);
        }
        let mut from = 0;
        for division in &divisions {
            let to = from + 2 * division.sides.len();
            self.divide(division, &points[from..to], &values[from..to]);
            from = to;
        }
        self.propose();
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }

    fn keeps_exploring(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Search;
    use crate::categories::level_of;
    use std::collections::BTreeSet;

    /// A space of integers and categories only is exhausted: the search proposes every combination,
    /// then ends.
    #[test]
    fn every_combination_of_levels_is_proposed_before_the_end() {
        let space = [
            Coordinate::Integer { levels: 5 },
            Coordinate::Categorical { levels: 3 },
            Coordinate::Integer { levels: 1 },
        ];
        let mut search = AskTell::new(Direct::new(&space, &DirectOptions::default()).expect("a space"));
        let mut found = BTreeSet::new();
        while let Some(u) = search.ask() {
            found.insert((level_of(u[0], 5), level_of(u[1], 3)));
            search.tell(&u, &(u[0] - u[1]).into()).expect("a pending point");
        }
        assert_eq!(found.len(), 15);
        assert_eq!(search.finished(), Some(SearchEnd::Converged));
    }
}
