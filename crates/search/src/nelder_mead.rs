//! The simplex search of Nelder and Mead, equal to SciPy's `minimize(method="Nelder-Mead")` with
//! bounds 0 and 1.
//!
//! # Reference
//! Virtanen et al., "SciPy 1.0: fundamental algorithms for scientific computing in Python", Nature
//! Methods 17, 2020.

use std::cmp::Ordering;

use crate::coordinate::check_dimension;
use crate::options::{
    ANY, AT_LEAST_1, FROM_0_TO_1, NOT_NEGATIVE, POINT_OF_THE_BOX, Range, check_start, options,
};
use crate::registry::SearchEntry;
use mishandle_random::Sequence;

use crate::{AskTell, RoundBased, SearchEnd, SearchError};

const NAME: &str = "nelder-mead";

/// The first simplex increases each offset from the origin by this fraction.
const RELATIVE_STEP: f64 = 0.05;
/// The offset in the first simplex of a coordinate at the origin.
const STEP_FROM_ZERO: f64 = 0.00025;

pub(crate) const ENTRY: SearchEntry = SearchEntry {
    name: NAME,
    summary: "the simplex search of Nelder and Mead as in SciPy, from one start or with restarts",
    reference: "Nelder and Mead, \"A simplex method for function minimization\", The Computer Journal 7, 1965. Gao and \
                Han, \"Implementing the Nelder-Mead simplex algorithm with adaptive parameters\", Comput. Optim. Appl. \
                51, 2012.",
    options: NelderMeadOptions::specs,
    make: |space, seed, options| {
        let options = NelderMeadOptions::read(options)?;
        Ok(Box::new(AskTell::new(NelderMead::new(space.coordinates.len(), seed, &options)?)))
    },
};

options! {
    /// The options of [`NelderMead`], with SciPy's defaults.
    pub struct NelderMeadOptions of NAME {
        /// First vertex, in `[0,1]^d`. The other vertices follow from it and `simplex-origin`.
        pub start: Option<Vec<f64>> = None, or "drawn uniformly from the seed", in POINT_OF_THE_BOX;
        /// Number from which the first simplex measures coordinates: vertex k + 1 has coordinate k
        /// moved away from it by 5 % of the distance, or raised by 0.00025 if the distance is 0.
        /// The center of each axis is 0.5.
        pub simplex_origin: f64 = 0.0, in FROM_0_TO_1;
        /// The d + 1 vertices of the first simplex; replaces `start`. A coordinate above 1 is
        /// reflected into the box (2 - u), then all coordinates are clipped to it.
        pub initial_simplex: Option<Vec<Vec<f64>>> = None, or "made from `start` and `simplex-origin`",
            in Range::described("d + 1 points of d finite numbers");
        /// Absolute tolerance on points. The search ends when every coordinate of every vertex is
        /// within `xatol` of the best vertex's and `fatol` holds too.
        pub xatol: f64 = 1e-4, in NOT_NEGATIVE;
        /// Absolute tolerance on values. The search ends when every value is within `fatol` of the
        /// best one and `xatol` holds too.
        pub fatol: f64 = 1e-4, in NOT_NEGATIVE;
        /// Maximum number of iterations from one start, counted from 1 as SciPy does.
        pub max_iterations: Option<usize> = None, or "200 d, or no limit if `max-evaluations` is set",
            in AT_LEAST_1;
        /// Maximum number of evaluations. `falsify` sets it to the budget of a trial.
        pub max_evaluations: Option<usize> = None, or "200 d, or no limit if `max-iterations` is set",
            in AT_LEAST_1;
        /// Chooses the coefficients by dimension (Gao and Han) instead of 2, 1/2, 1/2.
        pub adaptive: bool = false, in ANY;
        /// Number of restarts: each one starts from a new point, drawn uniformly, after the
        /// tolerances are met or `max-iterations` is reached. SciPy has none. A large number spends
        /// the whole budget of a trial.
        pub restarts: usize = 0, in ANY;
    }
}

/// The simplex search of Nelder and Mead in `[0,1]^d`: d + 1 vertices that reflect, expand,
/// contract and shrink.
///
/// Let the vertices be sorted by value, w the worst vertex and c the mean of all others. The trial
/// points are
///
/// ```text
/// u = clip((1 + t) c - t w, 0, 1)    t = 1 reflect, χ expand, ψ contract outside, -ψ contract inside
/// v ← v₀ + σ (v - v₀)                shrink toward the best vertex v₀
/// χ = 2, ψ = 1/2, σ = 1/2            adaptive: χ = 1 + 2/d, ψ = 3/4 - 1/(2d), σ = 1 - 1/d
/// ```
///
/// Given the same first simplex and values, the points equal SciPy's bit for bit. Vertices of equal
/// value keep their order. SciPy's order of ties depends on the processor, since NumPy's vectorized
/// sort is not stable; it is the same as here if NumPy runs without that sort and d < 16. If all
/// values are +∞, the simplex shrinks until a limit is reached, as in SciPy. Every coordinate is
/// treated as continuous.
///
/// Use it to improve a point that is nearly a counterexample (`start`), on robustness without
/// steps, in up to about ten dimensions. It is a local search: set `restarts` to search globally. A
/// restart keeps nothing but the count of evaluations. While restarts are left, a simplex within
/// `xatol` of its best vertex without a finite value ends a start, too.
///
/// # Units
/// All lengths are fractions of the box: the `xatol` of 1e-4 and the first simplex, which raises a
/// coordinate u by 5 % of its distance from `simplex-origin`, by default the lower bound. SciPy
/// 1.17.1 has the same numbers in the units of its bounds, where the first simplex raises a
/// coordinate x by 5 % of x. So both agree for the bounds 0 and 1. `docs/reference/plans.md`
/// compares all parameters.
///
/// # Reference
/// Nelder and Mead, "A simplex method for function minimization", The Computer Journal 7, 1965. Gao
/// and Han, "Implementing the Nelder-Mead simplex algorithm with adaptive parameters", Comput.
/// Optim. Appl. 51, 2012.
#[derive(Debug, Clone)]
pub struct NelderMead {
    xatol: f64,
    fatol: f64,
    max_iterations: usize,
    max_evaluations: usize,
    seed: u64,
    simplex_origin: f64,
    /// Restarts so far, and at most.
    n_restarts: usize,
    max_restarts: usize,
    expansion: f64,
    contraction: f64,
    shrinkage: f64,
    /// Sorted by value between iterations.
    vertices: Vec<Vertex>,
    /// The mean of all vertices but the worst.
    centroid: Vec<f64>,
    iteration: usize,
    n_evaluations: usize,
    step: Step,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

#[derive(Debug, Clone)]
struct Vertex {
    u: Vec<f64>,
    value: f64,
}

/// The kind of points of the current round.
#[derive(Debug, Clone)]
enum Step {
    FirstSimplex,
    Reflection,
    Expansion { reflected: Vertex },
    OutsideContraction { reflected_value: f64 },
    InsideContraction,
    Shrink,
}

impl NelderMead {
    /// Creates a simplex search on `[0,1]^dimension`. Without a start in the options, it is sampled
    /// uniformly from `seed`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] for dimension 0; [`SearchError::Option`] for a start outside
    /// `[0,1]^d` or of the wrong length, a simplex that is not d + 1 finite points, a negative or
    /// NaN tolerance, or a limit of 0.
    pub fn new(dimension: usize, seed: u64, options: &NelderMeadOptions) -> Result<Self, SearchError> {
        check(dimension, options)?;
        let simplex = match &options.initial_simplex {
            Some(simplex) => simplex.clone(),
            None => {
                let start = options.start.clone().unwrap_or_else(|| uniform_point(dimension, seed, 0));
                simplex_around(&start, options.simplex_origin)
            }
        };
        let (default_iterations, default_evaluations) =
            match (options.max_iterations, options.max_evaluations) {
                (None, None) => (200 * dimension, 200 * dimension),
                _ => (usize::MAX, usize::MAX),
            };
        let d = dimension as f64;
        let (expansion, contraction, shrinkage) = if options.adaptive {
            (1.0 + 2.0 / d, 0.75 - 1.0 / (2.0 * d), 1.0 - 1.0 / d)
        } else {
            (2.0, 0.5, 0.5)
        };
        let mut search = Self {
            xatol: options.xatol,
            fatol: options.fatol,
            max_iterations: options.max_iterations.unwrap_or(default_iterations),
            max_evaluations: options.max_evaluations.unwrap_or(default_evaluations),
            seed,
            simplex_origin: options.simplex_origin,
            n_restarts: 0,
            max_restarts: options.restarts,
            expansion,
            contraction,
            shrinkage,
            vertices: Vec::new(),
            centroid: vec![0.0; dimension],
            iteration: 1,
            n_evaluations: 0,
            step: Step::FirstSimplex,
            round: Vec::new(),
            end: None,
        };
        search.propose(simplex.into_iter().map(reflected_into_box).collect(), Step::FirstSimplex);
        Ok(search)
    }

    /// Proposes `points`, truncated to the remaining number of evaluations.
    fn propose(&mut self, mut points: Vec<Vec<f64>>, step: Step) {
        points.truncate(self.max_evaluations - self.n_evaluations);
        if points.is_empty() {
            self.end = Some(SearchEnd::EvaluationLimit);
        }
        self.round = points;
        self.step = step;
    }

    /// Proposes the point (1 + t) c - t w on the line through the worst vertex w and the centroid
    /// c.
    fn propose_on_line(&mut self, t: f64, step: Step) {
        let worst = &self.vertices[self.vertices.len() - 1].u;
        let point = self.centroid.iter().zip(worst).map(|(c, w)| clip((1.0 + t) * c - t * w)).collect();
        self.propose(vec![point], step);
    }

    fn propose_shrink(&mut self) {
        let best = &self.vertices[0].u;
        let shrunk = |v: &Vertex| {
            let toward_best = v.u.iter().zip(best).map(|(x, b)| clip(b + self.shrinkage * (x - b)));
            toward_best.collect::<Vec<f64>>()
        };
        let points = self.vertices[1..].iter().map(shrunk).collect();
        self.propose(points, Step::Shrink);
    }

    /// Ends the search, or starts the next iteration with a reflection.
    fn start_iteration(&mut self) {
        self.vertices.sort_by(|a, b| a.value.partial_cmp(&b.value).unwrap_or(Ordering::Equal));
        let end = if self.n_evaluations >= self.max_evaluations {
            Some(SearchEnd::EvaluationLimit)
        } else if self.iteration >= self.max_iterations {
            Some(SearchEnd::IterationLimit)
        } else if self.has_converged() {
            Some(SearchEnd::Converged)
        } else {
            None
        };
        match end {
            Some(end) if end != SearchEnd::EvaluationLimit && self.n_restarts < self.max_restarts => {
                return self.restart();
            }
            Some(_) => {
                self.end = end;
                self.round.clear();
                return;
            }
            None => {}
        }
        let d = self.centroid.len();
        self.centroid.fill(0.0);
        for vertex in &self.vertices[..d] {
            self.centroid.iter_mut().zip(&vertex.u).for_each(|(c, x)| *c += x);
        }
        self.centroid.iter_mut().for_each(|c| *c /= d as f64);
        self.propose_on_line(1.0, Step::Reflection);
    }

    /// Proposes a simplex around a new random point.
    fn restart(&mut self) {
        self.n_restarts += 1;
        self.iteration = 1;
        let start = uniform_point(self.centroid.len(), self.seed, self.n_restarts as u64);
        let simplex = simplex_around(&start, self.simplex_origin);
        self.propose(simplex.into_iter().map(reflected_into_box).collect(), Step::FirstSimplex);
    }

    /// Returns whether the simplex meets both tolerances. If all values are +∞, their differences
    /// are NaN, so it meets them only while restarts are left.
    fn has_converged(&self) -> bool {
        let best = &self.vertices[0];
        let values_are_irrelevant = best.value == f64::INFINITY && self.n_restarts < self.max_restarts;
        self.vertices[1..].iter().all(|v| {
            v.u.iter().zip(&best.u).all(|(x, b)| (x - b).abs() <= self.xatol)
                && (values_are_irrelevant || (best.value - v.value).abs() <= self.fatol)
        })
    }

    fn end_iteration(&mut self) {
        self.iteration += 1;
        self.start_iteration();
    }

    fn replace_worst(&mut self, vertex: Vertex) {
        let worst = self.vertices.len() - 1;
        self.vertices[worst] = vertex;
        self.end_iteration();
    }

    fn after_reflection(&mut self, reflected: Vertex) {
        let value = |i: usize| self.vertices[i].value;
        let d = self.centroid.len();
        if reflected.value < value(0) {
            self.propose_on_line(self.expansion, Step::Expansion { reflected });
        } else if reflected.value < value(d - 1) {
            self.replace_worst(reflected);
        } else if reflected.value < value(d) {
            let reflected_value = reflected.value;
            self.propose_on_line(self.contraction, Step::OutsideContraction { reflected_value });
        } else {
            self.propose_on_line(-self.contraction, Step::InsideContraction);
        }
    }
}

impl RoundBased for NelderMead {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        self.n_evaluations += values.len();
        let step = std::mem::replace(&mut self.step, Step::FirstSimplex);
        let evaluated = std::mem::take(&mut self.round).into_iter().zip(values);
        let mut evaluated = evaluated.map(|(u, value)| Vertex { u, value: *value });
        if matches!(step, Step::FirstSimplex | Step::Shrink) {
            let first = usize::from(matches!(step, Step::Shrink));
            self.vertices.truncate(first);
            self.vertices.extend(evaluated);
            self.iteration += first;
            self.start_iteration();
            return;
        }
        // Every other round is a single point.
        let Some(trial) = evaluated.next() else { return };
        let worst_value = self.vertices[self.vertices.len() - 1].value;
        match step {
            Step::FirstSimplex | Step::Shrink => {}
            Step::Reflection => self.after_reflection(trial),
            Step::Expansion { reflected } if trial.value < reflected.value => self.replace_worst(trial),
            Step::Expansion { reflected } => self.replace_worst(reflected),
            Step::OutsideContraction { reflected_value } if trial.value <= reflected_value => {
                self.replace_worst(trial);
            }
            Step::InsideContraction if trial.value < worst_value => self.replace_worst(trial),
            Step::OutsideContraction { .. } | Step::InsideContraction => self.propose_shrink(),
        }
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }
}

fn check(dimension: usize, options: &NelderMeadOptions) -> Result<(), SearchError> {
    check_dimension(dimension)?;
    check_start(NAME, options.start.as_ref(), dimension)?;
    if let Some(simplex) = &options.initial_simplex
        && !(simplex.len() == dimension + 1
            && simplex.iter().all(|u| u.len() == dimension && u.iter().all(|x| x.is_finite())))
    {
        return Err(SearchError::Option {
            search: NAME,
            option: "initial-simplex".to_owned(),
            found: format!("{simplex:?}"),
            expected: format!(
                "{} points of {dimension} finite number{}",
                dimension + 1,
                if dimension == 1 { "" } else { "s" }
            ),
        });
    }
    options.check_ranges()
}

/// Returns the random point from which start number `start` begins, counted from 0.
fn uniform_point(dimension: usize, seed: u64, start: u64) -> Vec<f64> {
    let mut stream = Sequence::new(seed, start);
    (0..dimension).map(|_| stream.uniform()).collect()
}

fn simplex_around(start: &[f64], origin: f64) -> Vec<Vec<f64>> {
    let mut simplex = vec![start.to_vec(); start.len() + 1];
    for (vertex, k) in simplex[1..].iter_mut().zip(0..) {
        let offset = vertex[k] - origin;
        vertex[k] = origin + if offset == 0.0 { STEP_FROM_ZERO } else { (1.0 + RELATIVE_STEP) * offset };
    }
    simplex
}

/// Reflects coordinates at 1 instead of clipping them, so that a start at the upper bound gives no
/// degenerate simplex.
fn reflected_into_box(mut vertex: Vec<f64>) -> Vec<f64> {
    vertex.iter_mut().for_each(|x| *x = clip(if *x > 1.0 { 2.0 - *x } else { *x }));
    vertex
}

fn clip(x: f64) -> f64 {
    x.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::simplex_around;

    #[test]
    fn first_simplex_measures_from_the_origin() {
        for (origin, expected) in [
            (0.0, [[0.7, 0.5], [0.735, 0.5], [0.7, 0.525]]),
            (0.5, [[0.7, 0.5], [0.71, 0.5], [0.7, 0.50025]]),
        ] {
            let simplex = simplex_around(&[0.7, 0.5], origin);
            for (found, expected) in simplex.iter().flatten().zip(expected.as_flattened()) {
                assert!((found - expected).abs() < 1e-15, "origin {origin}: {simplex:?}");
            }
        }
    }
}
