//! Starts elsewhere for long budgets, with steps that set a run of coordinates to one value.

use mishandle_random::Sequence;

use crate::gp::space::TypedSpace;
use crate::gp::trust_region::is_success;

/// The number of evaluations before the first start.
pub(super) const FIRST: usize = 300;
/// The share of the points while the search finds no lower value, at most, and the numbers of
/// coordinates at which it would be 0 and 1. Sobol points cover a box of few coordinates.
const SHARE: f64 = 0.8;
const COORDINATES: (f64, f64) = (10.0, 40.0);
/// The number of points from which a start chooses the first best one.
const INITIAL: usize = 12;
/// The number of evaluations without an improvement that ends a start: a constant, and more per
/// coordinate.
const PATIENCE: (usize, usize) = (30, 3);
/// The most runs of a step.
const RUNS: u64 = 3;
/// The longest run is the number of coordinates divided by this.
const LONGEST: usize = 4;
/// The probability that a run moves to a face.
const TO_FACE: f64 = 0.5;

/// Starts one after the other, each of which knows its own evaluations only.
///
/// A start has a few random points, each with a random share of its coordinates on faces. Then it
/// changes its best point: one to three runs of neighboring coordinates get one random value each,
/// half of them a bound. Runs of k and more coordinates have the probability 1 / k. Neighbors are
/// often the knots of one signal, so a run keeps an input constant over an interval of time.
#[derive(Debug, Clone)]
pub(super) struct Restarts {
    /// The value and the point that this start changes.
    best: Option<(f64, Vec<f64>)>,
    n_proposed: usize,
    since_improvement: usize,
    stream: Sequence,
}

impl Restarts {
    /// Creates the sequence of starts.
    pub(super) fn new(seed: u64) -> Self {
        Self { best: None, n_proposed: 0, since_improvement: 0, stream: Sequence::new(seed, 4) }
    }

    /// Returns the share of the points after `n` evaluations, for `d` coordinates. `stalled` says
    /// how certain it is that the search finds no lower value, from 0 to 1.
    pub(super) fn share(n: usize, d: usize, stalled: f64) -> f64 {
        let many = (d as f64 - COORDINATES.0) / (COORDINATES.1 - COORDINATES.0);
        if n < FIRST { 0.0 } else { many.clamp(0.0, SHARE) * stalled }
    }

    /// Returns the next point.
    pub(super) fn propose(&mut self, space: &TypedSpace) -> Vec<f64> {
        if self.since_improvement >= PATIENCE.0 + PATIENCE.1 * space.dimension() {
            (self.best, self.n_proposed, self.since_improvement) = (None, 0, 0);
        }
        self.n_proposed += 1;
        let mut point = match &self.best {
            Some((_, best)) if self.n_proposed > INITIAL => changed_runs(best, space, &mut self.stream),
            _ => with_faces(space, &mut self.stream),
        };
        space.snap(&mut point);
        point
    }

    /// Takes the value of a proposed point into account.
    pub(super) fn receive(&mut self, point: &[f64], value: f64) {
        let best = self.best.as_ref().map_or(f64::INFINITY, |(best, _)| *best);
        self.since_improvement = if is_success(value, best) { 0 } else { self.since_improvement + 1 };
        // An equal value, too: the start moves on plateaus.
        if value <= best {
            self.best = Some((value, point.to_vec()));
        }
    }
}

/// Returns a random point of which a random share of the coordinates is on faces.
fn with_faces(space: &TypedSpace, stream: &mut Sequence) -> Vec<f64> {
    let share = stream.uniform();
    let mut point = vec![0.0; space.dimension()];
    for (k, x) in point.iter_mut().enumerate() {
        *x = if stream.uniform() < share {
            let upper = stream.bits() & 1 == 1;
            space.face(k, upper, stream)
        } else {
            stream.uniform()
        };
    }
    point
}

/// Returns `best` with new values of one to [`RUNS`] runs of coordinates.
fn changed_runs(best: &[f64], space: &TypedSpace, stream: &mut Sequence) -> Vec<f64> {
    let d = best.len();
    let mut point = best.to_vec();
    for _ in 0..=stream.below(RUNS) {
        let longest = (d / LONGEST).max(1);
        let length = (1.0 / (1.0 - stream.uniform())).min(longest as f64) as usize;
        let first = stream.below(d as u64) as usize;
        let face = (stream.uniform() < TO_FACE).then(|| stream.bits() & 1 == 1);
        let value = stream.uniform();
        for (k, x) in point.iter_mut().enumerate().skip(first).take(length) {
            *x = face.map_or(value, |upper| space.face(k, upper, stream));
        }
    }
    point
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Coordinate;

    #[test]
    fn starts_take_part_after_300_evaluations_once_no_lower_values_come() {
        assert_eq!((Restarts::share(299, 25, 1.0), Restarts::share(300, 25, 0.0)), (0.0, 0.0));
        assert_eq!((Restarts::share(300, 25, 1.0), Restarts::share(300, 100, 1.0)), (0.5, 0.8));
        assert_eq!(Restarts::share(300, 10, 1.0), 0.0, "Sobol points cover a box of few coordinates");
    }

    /// One of 78,125 random points has seven coordinates below 0.2.
    #[test]
    fn a_run_of_coordinates_changes_together() {
        let space = TypedSpace::new(&[Coordinate::Continuous; 40]);
        let mut restarts = Restarts::new(3);
        let value = |u: &[f64]| if u[12..19].iter().all(|x| *x < 0.2) { -1.0 } else { 1.0 };
        let found = (0..2000).any(|_| {
            let point = restarts.propose(&space);
            let value = value(&point);
            restarts.receive(&point, value);
            value < 0.0
        });
        assert!(found);
    }

    /// With 2 coordinates, 36 evaluations without an improvement end a start.
    #[test]
    fn a_new_start_forgets_the_best_point() {
        let space = TypedSpace::new(&[Coordinate::Continuous; 2]);
        let mut restarts = Restarts::new(5);
        (0..37).for_each(|i| {
            let point = restarts.propose(&space);
            restarts.receive(&point, f64::from(i));
        });
        assert_eq!(restarts.best.as_ref().map(|(value, _)| *value), Some(0.0));
        let point = restarts.propose(&space);
        restarts.receive(&point, 50.0);
        assert_eq!(restarts.best, Some((50.0, point)));
    }
}
