//! Candidates for the next points: the box, its faces and corners, and neighborhoods of good
//! points.

use mishandle_random::Sequence;

use super::history::History;
use super::space::TypedSpace;
use crate::sobol::SobolPoints;

/// The expected number of coordinates that a neighbor changes, at most. In many dimensions a change
/// of all coordinates moves too far.
const CHANGED: f64 = 20.0;
/// The shortest and the longest step of a neighbor, as fractions of the box.
const STEPS: (f64, f64) = (0.003, 0.3);
/// The probability that a changed coordinate of a neighbor moves to a face.
const TO_FACE: f64 = 0.15;
/// The number of best points whose neighborhoods are searched.
const BEST: usize = 6;

/// Points to choose from, in one block of memory.
#[derive(Debug, Clone)]
pub(crate) struct Candidates {
    dimension: usize,
    values: Vec<f64>,
}

impl Candidates {
    fn new(dimension: usize) -> Self {
        Self { dimension, values: Vec::new() }
    }

    /// Returns the number of points.
    pub(crate) fn len(&self) -> usize {
        self.values.len() / self.dimension
    }

    /// Returns point `i`.
    pub(crate) fn point(&self, i: usize) -> &[f64] {
        &self.values[i * self.dimension..(i + 1) * self.dimension]
    }

    /// Replaces point `i`.
    pub(crate) fn replace(&mut self, i: usize, point: &[f64]) {
        self.values[i * self.dimension..(i + 1) * self.dimension].copy_from_slice(point);
    }

    /// Adds the points of `others` behind the others.
    pub(crate) fn append(&mut self, others: Candidates) {
        self.values.extend(others.values);
    }

    /// Returns all points.
    pub(crate) fn points(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.dimension)
    }
}

/// A box around a point: the center, and half of the edge of each coordinate.
#[derive(Debug, Clone)]
pub(crate) struct Region {
    pub center: Vec<f64>,
    pub half_edges: Vec<f64>,
}

impl Region {
    /// Returns the whole box.
    pub(crate) fn whole(dimension: usize) -> Self {
        Self { center: vec![0.5; dimension], half_edges: vec![0.5; dimension] }
    }
}

/// Generates candidates that have not been evaluated.
#[derive(Debug, Clone)]
pub(crate) struct CandidateGenerator {
    space: TypedSpace,
    sobol: SobolPoints,
    stream: Sequence,
}

impl CandidateGenerator {
    /// Creates a generator with random numbers of its own.
    pub(crate) fn new(space: TypedSpace, seed: u64, stream: u64) -> Self {
        let mut stream = Sequence::new(seed, stream);
        let sobol = SobolPoints::new(space.dimension(), stream.bits());
        Self { space, sobol, stream }
    }

    /// Returns candidates in the whole box: `n` of them evenly spread, `n` on faces and corners if
    /// `with_faces`, and `n` near the best points.
    pub(crate) fn global(&mut self, history: &History, n: usize, with_faces: bool) -> Candidates {
        let mut candidates = Candidates::new(self.space.dimension());
        let mut point = vec![0.0; self.space.dimension()];
        for _ in 0..n {
            self.sobol.write_next(&mut point);
            self.add(&mut candidates, &mut point, history);
        }
        if with_faces {
            for _ in 0..n {
                self.sobol.write_next(&mut point);
                self.move_to_faces(&mut point);
                self.add(&mut candidates, &mut point, history);
            }
        }
        let best = history.by_value();
        let best = &best[..best.len().min(BEST)];
        for i in 0..if best.is_empty() { 0 } else { n } {
            point.copy_from_slice(&history.points()[best[i % best.len()]]);
            self.move_nearby(&mut point, with_faces);
            self.add(&mut candidates, &mut point, history);
        }
        candidates
    }

    /// Returns `n` candidates in a region. Each differs from the center in a random subset of the
    /// coordinates.
    ///
    /// # Reference
    /// Regis and Shoemaker, "Combining radial basis function surrogates and dynamic coordinate
    /// search in high-dimensional expensive black-box optimization", Engineering Optimization
    /// 45(5), 2013.
    pub(crate) fn local(&mut self, history: &History, region: &Region, n: usize) -> Candidates {
        let d = self.space.dimension();
        let mut candidates = Candidates::new(d);
        let mut point = vec![0.0; d];
        let mut offsets = vec![0.0; d];
        let share = (CHANGED / d as f64).min(1.0);
        for _ in 0..n {
            self.sobol.write_next(&mut offsets);
            point.copy_from_slice(&region.center);
            let always = self.stream.below(d as u64) as usize;
            for k in 0..d {
                if k == always || share >= 1.0 || self.stream.uniform() < share {
                    let step = (2.0 * offsets[k] - 1.0) * region.half_edges[k];
                    point[k] = self.space.stepped(k, point[k], step, &mut self.stream);
                }
            }
            self.add(&mut candidates, &mut point, history);
        }
        candidates
    }

    /// Returns `n` points near `point`: each differs from it in a random subset of the coordinates,
    /// by normal steps, or is on a face.
    pub(crate) fn around(&mut self, history: &History, point: &[f64], step: f64, n: usize) -> Candidates {
        let d = self.space.dimension();
        let mut candidates = Candidates::new(d);
        for _ in 0..n {
            let mut near = point.to_vec();
            let share = self.stream.uniform();
            let always = self.stream.below(d as u64) as usize;
            for (k, x) in near.iter_mut().enumerate() {
                if k != always && self.stream.uniform() >= share {
                    continue;
                }
                let (normal, _) = self.stream.normal_pair();
                *x = self.space.stepped(k, *x, step * normal, &mut self.stream);
            }
            self.add(&mut candidates, &mut near, history);
        }
        candidates
    }

    fn add(&self, candidates: &mut Candidates, point: &mut [f64], history: &History) {
        self.space.snap(point);
        if !history.contains(point) {
            candidates.values.extend_from_slice(point);
        }
    }

    /// Moves a random number of coordinates, from 1 to all, to faces.
    fn move_to_faces(&mut self, point: &mut [f64]) {
        let d = point.len();
        let mut missing = 1 + self.stream.below(d as u64) as usize;
        for (k, x) in point.iter_mut().enumerate() {
            // Selection sampling: every subset of the size is equally likely.
            if self.stream.below((d - k) as u64) < missing as u64 {
                missing -= 1;
                let upper = self.stream.bits() & 1 == 1;
                *x = self.space.face(k, upper, &mut self.stream);
            }
        }
    }

    /// Moves some coordinates by normal steps of a random scale.
    fn move_nearby(&mut self, point: &mut [f64], with_faces: bool) {
        let d = point.len();
        let scale = STEPS.0 * (STEPS.1 / STEPS.0).powf(self.stream.uniform());
        let share = (CHANGED / d as f64).min(1.0) * self.stream.uniform();
        let always = self.stream.below(d as u64) as usize;
        for (k, x) in point.iter_mut().enumerate() {
            if k != always && self.stream.uniform() >= share {
                continue;
            }
            let (step, _) = self.stream.normal_pair();
            *x = if with_faces && self.stream.uniform() < TO_FACE {
                self.space.face(k, step > 0.0, &mut self.stream)
            } else {
                self.space.stepped(k, *x, scale * step, &mut self.stream)
            };
        }
    }
}
