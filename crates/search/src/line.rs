//! Line search along sign vectors: the smallest deviation from a point that violates the
//! requirement.

use std::mem;

use crate::coordinate::dimension;
use crate::corners::CornerSet;
use crate::options::{ANY, AT_LEAST_1, POINT_OF_THE_BOX, Range, check_start, options};
use crate::registry::SearchEntry;
use crate::{AskTell, Coordinate, RoundBased, SearchEnd, SearchError};

const NAME: &str = "line";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "lines from the center to random corners, with bisection for the smallest violating deviation",
    reference: "Chen and Gu, \"RayS: a ray searching method for hard-label adversarial attack\", KDD 2020.",
    options: LineOptions::specs,
    make: |space, seed, options| {
        let options = LineOptions::read(options)?;
        Ok(Box::new(AskTell::new(Line::new(&space.coordinates, seed, &options)?)))
    },
};

const OPEN_UNIT_INTERVAL: Range = Range { words: "in (0, 1)", holds: |x| x > 0.0 && x < 1.0 };

options! {
    /// The options of [`Line`].
    pub struct LineOptions of NAME {
        /// Point from which all lines start, for example the undisturbed scenario.
        pub start: Option<Vec<f64>> = None, or "the center of the box", in POINT_OF_THE_BOX;
        /// A point violates the requirement if its value is below this number.
        pub threshold: f64 = 0.0, in Range { words: "a number", holds: |x| !x.is_nan() };
        /// The bisection of the amplitude ends at an interval of this length. An amplitude of 1 is
        /// a corner.
        pub amplitude_tolerance: f64 = 1e-3, in OPEN_UNIT_INTERVAL;
        /// Number of lines that are tried at once.
        pub lines: usize = 16, in AT_LEAST_1;
        /// Bisects the amplitude of violations. Without it, the search is one for any violation.
        pub bisect: bool = true, in ANY;
    }
}

/// Line search: points `s + a (c - s)` on the lines from a start s to random corners c, with
/// amplitudes a in [0, 1].
///
/// Use it for disturbances, whose axes have the undisturbed value in the middle: worst cases of
/// many small disturbances tend to have all of them at their bounds, with unknown signs. And use it
/// for the question how small a disturbance may be: after a violation, the amplitude is bisected,
/// and from then on a line is tried at the smallest violating amplitude so far, less the tolerance.
/// So each further violation is a smaller one.
///
/// ```text
/// 1. evaluate the start
/// 2. evaluate the next `lines` corner directions at the amplitude a; a = 1 at first
/// 3. if some violate, bisect: evaluate them in the middle m of (low, high), from (0, a);
///    if some violate, keep these and set high = m, otherwise set low = m, until high - low ≤ tolerance;
///    then a = high - tolerance
/// 4. after all 2^d directions without a violation, repeat them at the amplitudes a/2, a/4, 3a/4, a/8, ...
/// ```
///
/// The bisection finds the smallest amplitude if violations do not end at larger ones. It ends with
/// `Converged` only if the start violates or the smallest amplitude is below the tolerance. A
/// category has no amplitude: a direction contains a random level of it. The best point of the
/// search has the lowest value, often at amplitude 1; [`smallest`](Line::smallest) returns the
/// violation of smallest amplitude.
///
/// # Reference
/// Chen and Gu, "RayS: a ray searching method for hard-label adversarial attack", KDD 2020, with
/// random instead of hierarchical sign vectors.
#[derive(Debug, Clone)]
pub struct Line {
    options: LineOptions,
    coordinates: Vec<Coordinate>,
    start: Vec<f64>,
    corners: CornerSet,
    /// Index of the next direction, and the number of directions in the current sweep.
    next: u64,
    n_tried: u64,
    /// Sweeps over all directions since the last change of the limit.
    n_sweeps: u32,
    /// Largest amplitude to try.
    limit: f64,
    smallest: Option<(Vec<f64>, f64)>,
    phase: Phase,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

#[derive(Debug, Clone)]
enum Phase {
    Start,
    /// Tries the corners at an amplitude.
    Explore {
        corners: Vec<Vec<f64>>,
        amplitude: f64,
    },
    /// Tries the corners, which violate at the amplitude `high`, at `middle`.
    Bisect {
        corners: Vec<Vec<f64>>,
        low: f64,
        high: f64,
        middle: f64,
    },
}

impl Line {
    /// Creates a line search.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] without coordinates, [`SearchError::NoLevels`] for a coordinate
    /// with 0 levels, [`SearchError::Option`] for a start outside `[0,1]^d` or of the wrong length,
    /// or a number outside the documented range of its option.
    pub fn new(coordinates: &[Coordinate], seed: u64, options: &LineOptions) -> Result<Self, SearchError> {
        let dimension = dimension(coordinates)?;
        check_start(NAME, options.start.as_ref(), dimension)?;
        options.check_ranges()?;
        let start = options.start.clone().unwrap_or_else(|| vec![0.5; dimension]);
        Ok(Self {
            options: options.clone(),
            coordinates: coordinates.to_vec(),
            corners: CornerSet::new(coordinates, seed),
            next: 0,
            n_tried: 0,
            n_sweeps: 0,
            limit: 1.0,
            smallest: None,
            phase: Phase::Start,
            round: vec![start.clone()],
            start,
            end: None,
        })
    }

    /// Returns the violating point of smallest amplitude so far, and its amplitude.
    pub fn smallest(&self) -> Option<(&[f64], f64)> {
        self.smallest.as_ref().map(|(u, amplitude)| (u.as_slice(), *amplitude))
    }

    fn point(&self, corner: &[f64], amplitude: f64) -> Vec<f64> {
        let coordinates = self.coordinates.iter().zip(&self.start).zip(corner);
        let at = |((coordinate, s), c): ((&Coordinate, &f64), &f64)| match coordinate {
            Coordinate::Categorical { .. } => *c,
            // The sum of both terms is exact at the amplitude 1.
            _ => ((1.0 - amplitude) * s + amplitude * c).clamp(0.0, 1.0),
        };
        coordinates.map(at).collect()
    }

    fn propose(&mut self, corners: &[Vec<f64>], amplitude: f64) {
        self.round = corners.iter().map(|corner| self.point(corner, amplitude)).collect();
    }

    fn explore(&mut self) {
        let count = self.corners.count().unwrap_or(u64::MAX);
        if self.n_tried == count {
            self.n_tried = 0;
            self.n_sweeps += 1;
        }
        let n = (count - self.n_tried).min(self.options.lines as u64);
        let corners: Vec<_> = (self.next..self.next + n).map(|i| self.corners.corner(i)).collect();
        self.next += n;
        self.n_tried += n;
        let amplitude = self.limit * fraction(self.n_sweeps);
        self.propose(&corners, amplitude);
        self.phase = Phase::Explore { corners, amplitude };
    }

    /// Continues the bisection, or explores below its result.
    fn bisect(&mut self, corners: Vec<Vec<f64>>, low: f64, high: f64) {
        if let Some(first) = corners.first() {
            self.smallest = Some((self.point(first, high), high));
        }
        if high - low > self.options.amplitude_tolerance {
            let middle = 0.5 * (low + high);
            self.propose(&corners, middle);
            self.phase = Phase::Bisect { corners, low, high, middle };
            return;
        }
        self.limit = high - self.options.amplitude_tolerance;
        (self.n_tried, self.n_sweeps) = (0, 0);
        if self.limit > 0.0 {
            self.explore();
        } else {
            self.stop();
        }
    }

    fn stop(&mut self) {
        self.round.clear();
        self.end = Some(SearchEnd::Converged);
    }
}

/// Returns the fraction of the amplitude in sweep `i`: 1, then the van der Corput sequence 1/2,
/// 1/4, 3/4, 1/8, ...
fn fraction(i: u32) -> f64 {
    if i == 0 { 1.0 } else { f64::from(i.reverse_bits()) / (f64::from(u32::MAX) + 1.0) }
}

impl RoundBased for Line {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        let threshold = self.options.threshold;
        let violating = |corners: &[Vec<f64>]| -> Vec<Vec<f64>> {
            let violating = corners.iter().zip(values).filter(|(_, value)| **value < threshold);
            violating.map(|(corner, _)| corner.clone()).collect()
        };
        match mem::replace(&mut self.phase, Phase::Start) {
            Phase::Start if self.options.bisect && values.iter().any(|value| *value < threshold) => {
                self.smallest = Some((self.start.clone(), 0.0));
                self.stop();
            }
            Phase::Start => self.explore(),
            Phase::Explore { corners, amplitude } => {
                let found = violating(&corners);
                if found.is_empty() || !self.options.bisect {
                    self.explore();
                } else {
                    self.bisect(found, 0.0, amplitude);
                }
            }
            Phase::Bisect { corners, low, high, middle } => {
                let found = violating(&corners);
                if found.is_empty() {
                    self.bisect(corners, middle, high);
                } else {
                    self.bisect(found, low, middle);
                }
            }
        }
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Search;

    fn run(d: usize, f: impl Fn(&[f64]) -> f64, budget: usize) -> Line {
        let machine = Line::new(&vec![Coordinate::Continuous; d], 3, &LineOptions::default());
        let mut search = AskTell::new(machine.expect("a space"));
        for _ in 0..budget {
            let Some(u) = search.ask() else { break };
            search.tell(&u, &f(&u).into()).expect("a pending point");
        }
        search.machine().clone()
    }

    /// With weights w, the sum Σ wᵢ (2 uᵢ - 1) exceeds b on a line with signs s from the amplitude
    /// b / Σ wᵢ sᵢ on. Of 2^6 sign vectors, that with all signs positive has the smallest one, here
    /// 0.5.
    #[test]
    fn the_smallest_amplitude_of_a_half_space_is_found() {
        let weights = [1.0, 2.0, 0.5, 1.5, 3.0, 2.0];
        let excess = |u: &[f64]| 5.0 - u.iter().zip(weights).map(|(x, w)| w * (2.0 * x - 1.0)).sum::<f64>();
        let line = run(6, excess, 1000);
        let (u, amplitude) = line.smallest().expect("a violation");
        assert!((0.5..0.502).contains(&amplitude), "{amplitude}");
        assert!(excess(u) < 0.0 && u.iter().all(|x| (x - 0.5 - 0.5 * amplitude).abs() < 1e-12), "{u:?}");
    }

    /// The first points: the start, then the four corners, then their lines at 1/2, 1/4 and 3/4.
    #[test]
    fn all_directions_are_repeated_at_other_amplitudes() {
        let machine = Line::new(&[Coordinate::Continuous; 2], 3, &LineOptions::default()).expect("a space");
        let mut search = AskTell::new(machine);
        let mut distances = Vec::new();
        for _ in 0..17 {
            let u = search.ask().expect("no violation");
            assert_eq!((u[0] - 0.5).abs(), (u[1] - 0.5).abs(), "{u:?}");
            distances.push((u[0] - 0.5).abs());
            search.tell(&u, &1.0.into()).expect("a pending point");
        }
        let expected: Vec<f64> = [0.5, 0.25, 0.125, 0.375].iter().flat_map(|x| [*x; 4]).collect();
        assert_eq!(distances[0], 0.0);
        assert_eq!(distances[1..], expected);
    }

    #[test]
    fn a_violating_start_ends_the_search() {
        let line = run(3, |_| -1.0, 10);
        assert_eq!(line.smallest(), Some(([0.5; 3].as_slice(), 0.0)));
        assert_eq!(line.finished(), Some(SearchEnd::Converged));
    }
}
