//! Sobol search: points of a scrambled Sobol sequence.

mod sequence;

use mishandle_random::Sequence;

use crate::SearchError;
use crate::coordinate::check_dimension;
use crate::indexed::{InSequence, PointSequence};
use crate::options::{ANY, options};
use crate::registry::SearchEntry;
pub(crate) use sequence::{MAX_DIMENSION, SobolSequence};

const NAME: &str = "sobol";

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "points of a scrambled Sobol sequence, more even than random ones",
    reference: "Sobol, \"On the distribution of points in a cube and the approximate evaluation of integrals\", USSR Comput. \
                Math. Math. Phys. 7, 1967. Joe and Kuo, \"Constructing Sobol sequences with better two-dimensional \
                projections\", SIAM J. Sci. Comput. 30, 2008.",
    options: SobolOptions::specs,
    make: |space, seed, options| {
        let options = SobolOptions::read(options)?;
        Ok(Box::new(InSequence::new(Sobol::new(space.coordinates.len(), seed, &options)?)))
    },
};

options! {
    /// The options of [`Sobol`].
    pub struct SobolOptions of NAME {
        /// Scrambles the sequence with the random seed. Without it, all seeds give the same points,
        /// and the first one is the lower corner of the box.
        pub scramble: bool = true, in ANY;
    }
}

/// Sobol search: point i is point i of a scrambled Sobol sequence. The search never ends.
///
/// Use it instead of [`random`](crate::Random) to cover a space: n points fill every coordinate,
/// and most pairs of coordinates, evenly, for every n, most evenly if n is a power of 2. It has no
/// advantage over `random` for a small failure region in many dimensions.
///
/// Coordinates of all types are covered evenly: of n points, a level of an axis with L levels gets
/// n/L, up to rounding to the next power of 2. From the 1025th on, coordinates are independent and
/// uniform, because there are no direction numbers for them in the table.
///
/// The crates `sobol_burley` 0.5.0 (at most 65,536 points of 24 bits) and `sobol` 1.0.2 (no
/// scramble, last released in
/// 2020) were considered.
///
/// # Reference
/// Sobol, "On the distribution of points in a cube and the approximate evaluation of integrals",
/// USSR Comput. Math. Math. Phys. 7, 1967. Joe and Kuo, "Constructing Sobol sequences with better
/// two-dimensional projections", SIAM J. Sci. Comput. 30, 2008.
#[derive(Debug, Clone)]
pub struct Sobol {
    dimension: usize,
    seed: u64,
    sequence: SobolSequence,
}

impl Sobol {
    /// Creates a Sobol search on `[0,1]^dimension`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] if `dimension` is 0.
    pub fn new(dimension: usize, seed: u64, options: &SobolOptions) -> Result<Self, SearchError> {
        check_dimension(dimension)?;
        options.check_ranges()?;
        let scramble = options.scramble.then(|| Sequence::new(seed, 0));
        let sequence = SobolSequence::new(dimension.min(MAX_DIMENSION), scramble);
        Ok(Self { dimension, seed, sequence })
    }

    /// Writes point `i`.
    fn write(&self, i: u64, point: &mut [f64]) {
        self.sequence.write(i, point);
        if let Some(rest) = point.get_mut(MAX_DIMENSION..) {
            // Stream 0 made the scramble.
            let mut padding = Sequence::new(self.seed, i + 1);
            rest.iter_mut().for_each(|x| *x = padding.uniform());
        }
    }
}

impl PointSequence for Sobol {
    fn name(&self) -> &'static str {
        NAME
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn point(&self, i: u64) -> Vec<f64> {
        let mut u = vec![0.0; self.dimension];
        self.write(i, &mut u);
        u
    }
}

/// The points of a Sobol search, one after another, for searches that need some of them.
#[derive(Debug, Clone)]
pub(crate) struct SobolPoints {
    points: Sobol,
    next: u64,
}

impl SobolPoints {
    /// Starts with the first point of the scrambled sequence.
    pub(crate) fn new(dimension: usize, seed: u64) -> Self {
        let sequence = SobolSequence::new(dimension.min(MAX_DIMENSION), Some(Sequence::new(seed, 0)));
        Self { points: Sobol { dimension, seed, sequence }, next: 0 }
    }

    /// Writes the next point to `point`, which has one number per dimension.
    pub(crate) fn write_next(&mut self, point: &mut [f64]) {
        self.points.write(self.next, point);
        self.next += 1;
    }

    /// Returns the next point.
    pub(crate) fn next_point(&mut self) -> Vec<f64> {
        let mut point = vec![0.0; self.points.dimension];
        self.write_next(&mut point);
        point
    }
}
