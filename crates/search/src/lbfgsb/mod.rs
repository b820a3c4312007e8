//! L-BFGS-B on `[0,1]^d` with finite differences: the local search of dual annealing.

mod cauchy;
mod dense;
mod line_search;
mod memory;
mod reduced;
mod subspace;

use std::mem;

use crate::{RoundBased, SearchEnd, SearchError};
use cauchy::cauchy_point;
use dense::dot;
use line_search::{LineSearch, TrialResult};
use memory::Memory;
use reduced::ReducedMatrix;
use subspace::subspace_minimum;

const NAME: &str = "l-bfgs-b";

/// The options of [`Lbfgsb`], with the defaults of SciPy's `minimize(method="L-BFGS-B")`.
#[derive(Debug, Clone, PartialEq)]
pub struct LbfgsbOptions {
    /// The maximum number of correction pairs (10).
    pub memory: usize,
    /// Ends if an iteration decreases the value by at most this fraction of max(|old|, |new|, 1)
    /// (2.2204460492503131e-9).
    pub ftol: f64,
    /// Ends if no component of the projected gradient exceeds this value (1e-5).
    pub gtol: f64,
    /// The step of the finite differences, which are forward, or backward at the upper bound
    /// (1e-8).
    pub difference: f64,
    /// The maximum number of iterations (15,000).
    pub max_iterations: usize,
    /// Ends after the iteration in which the number of evaluations exceeds this value (15,000).
    pub max_evaluations: usize,
    /// The maximum number of evaluations of value and gradient per line search (20).
    pub max_line_search: usize,
}

impl Default for LbfgsbOptions {
    fn default() -> Self {
        Self {
            memory: 10,
            ftol: 2.220_446_049_250_313e-9,
            gtol: 1e-5,
            difference: 1e-8,
            max_iterations: 15_000,
            max_evaluations: 15_000,
            max_line_search: 20,
        }
    }
}

/// The quasi-Newton method L-BFGS-B 3.0 on `[0,1]^d`, as SciPy runs it without a gradient.
///
/// Each round consists of one point u and its d neighbors u + h eᵢ (or u - h eᵢ at the upper
/// bound), from which value and gradient are computed. An iteration computes the generalized Cauchy
/// point of the limited-memory model, minimizes the model over the free coordinates from there, and
/// runs a line search toward that point.
///
/// Given the same start and values, the points equal SciPy's up to rounding in the linear algebra.
/// Values of +∞ can lead to a NaN point; the search then ends as abnormal.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu, "A limited memory algorithm for bound constrained optimization", SIAM
/// J. Sci. Comput. 16, 1995. Zhu, Byrd, Lu and Nocedal, "Algorithm 778: L-BFGS-B", ACM TOMS 23,
/// 1997. Morales and Nocedal, "Remark on Algorithm 778", ACM TOMS 38, 2011.
#[derive(Debug, Clone)]
pub struct Lbfgsb {
    options: LbfgsbOptions,
    memory: Memory,
    reduced: ReducedMatrix,
    /// The current point.
    current: EvaluatedPoint,
    /// The last evaluated point; a trial at the same point needs no new round.
    last_evaluated: EvaluatedPoint,
    iteration: usize,
    n_evaluations: usize,
    line_search: Option<Ray>,
    round: Vec<Vec<f64>>,
    end: Option<SearchEnd>,
}

/// A point with its value and gradient.
#[derive(Debug, Clone)]
struct EvaluatedPoint {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

/// A line search in progress, with its initial point.
#[derive(Debug, Clone)]
struct Ray {
    start: EvaluatedPoint,
    /// The point at step 1.
    target: Vec<f64>,
    direction: Vec<f64>,
    slope: f64,
    line: LineSearch,
    n_trials: usize,
}

impl Ray {
    fn point(&self) -> Vec<f64> {
        let step = self.line.step();
        if step == 1.0 {
            return self.target.clone();
        }
        let x = self.start.x.iter();
        let d = self.direction.iter();
        x.zip(d).map(|(x, d)| clipped(step * d + x)).collect()
    }
}

/// Whether the search can continue or needs values first.
#[derive(PartialEq)]
enum Flow {
    Continue,
    Wait,
}

impl Lbfgsb {
    /// Creates a local search from `start`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] for an empty start; [`SearchError::Option`] for a start outside
    /// `[0,1]^d`, a memory or a limit of 0, a negative or NaN tolerance, or a difference outside
    /// (0, 0.5].
    ///
    /// # Example
    /// ```
    /// use mishandle_search::{AskTell, Lbfgsb, LbfgsbOptions, Observation, Search};
    ///
    /// let mut search = AskTell::new(Lbfgsb::new(&[0.9, 0.4], &LbfgsbOptions::default())?);
    /// while let Some(u) = search.ask() {
    ///     let value = (u[0] - 0.3).powi(2) + 5.0 * (u[1] + 0.2).powi(2);
    ///     search.tell(&u, &Observation::from(value))?;
    /// }
    /// let (u, _) = search.machine().result();
    /// assert!((u[0] - 0.3).abs() < 1e-6 && u[1] == 0.0, "the unconstrained minimizer is outside the bounds");
    /// # Ok::<(), mishandle_search::SearchError>(())
    /// ```
    pub fn new(start: &[f64], options: &LbfgsbOptions) -> Result<Self, SearchError> {
        check(start, options)?;
        Ok(Self::from_inside(start, options.clone()))
    }

    /// Creates a local search from a point in `[0,1]^d`, without checks.
    pub(crate) fn from_inside(start: &[f64], options: LbfgsbOptions) -> Self {
        let current = EvaluatedPoint { x: start.to_vec(), value: f64::NAN, gradient: vec![0.0; start.len()] };
        Self {
            memory: Memory::new(options.memory),
            reduced: ReducedMatrix::new(start.len(), options.memory),
            round: difference_points(start.to_vec(), options.difference),
            options,
            last_evaluated: current.clone(),
            current,
            iteration: 0,
            n_evaluations: 0,
            line_search: None,
            end: None,
        }
    }

    /// Returns point and value of the result.
    ///
    /// As in SciPy, the value is that of the last trial. After a failed line search it does not
    /// belong to the returned point, which is the line search's initial point.
    pub fn result(&self) -> (&[f64], f64) {
        (&self.current.x, self.last_evaluated.value)
    }

    /// Takes value and gradient at the first point of the round, instead of the values of all its
    /// points.
    pub(crate) fn receive_gradient(&mut self, value: f64, gradient: Vec<f64>) {
        self.n_evaluations += 1;
        let Some(x) = mem::take(&mut self.round).into_iter().next() else { return };
        self.take(EvaluatedPoint { x, value, gradient });
    }

    fn take(&mut self, evaluated: EvaluatedPoint) {
        self.last_evaluated = evaluated;
        self.current.clone_from(&self.last_evaluated);
        while self.advance() == Flow::Continue {}
    }

    fn stop(&mut self, end: SearchEnd) -> Flow {
        self.end = Some(end);
        self.round.clear();
        Flow::Wait
    }

    /// Returns the largest absolute component of the projected gradient; NaN if the gradient
    /// contains NaN.
    fn projected_gradient(&self) -> f64 {
        let component = |(x, g): (&f64, &f64)| if *g < 0.0 { (x - 1.0).max(*g) } else { x.min(*g) };
        if self.current.gradient.iter().any(|g| g.is_nan()) {
            return f64::NAN;
        }
        let components = self.current.x.iter().zip(&self.current.gradient).map(component);
        components.fold(0.0, |largest, c| c.abs().max(largest))
    }

    /// Computes a search direction and starts the line search along it.
    fn start_iteration(&mut self) -> Flow {
        let target = self.target();
        let EvaluatedPoint { x, value, gradient } = &self.current;
        let direction: Vec<f64> = target.iter().zip(x).map(|(z, x)| z - x).collect();
        let slope = dot(gradient, &direction);
        let max_step = if self.iteration == 0 { 1.0 } else { longest_step(x, &direction) };
        let line = LineSearch::new(*value, slope, max_step);
        let ray = Ray { start: self.current.clone(), target, direction, slope, line, n_trials: 0 };
        if slope >= 0.0 { self.fail(ray) } else { self.try_point(ray) }
    }

    /// Returns the minimizer of the model on `[0,1]^d`. Clears the memory if the model is not
    /// positive definite.
    fn target(&mut self) -> Vec<f64> {
        let EvaluatedPoint { x, gradient, .. } = &self.current;
        loop {
            let cauchy = cauchy_point(x, gradient, &self.memory);
            self.reduced.set_free(&cauchy.free, self.iteration == 0);
            if cauchy.free.is_empty() || self.memory.len() == 0 {
                return cauchy.x;
            }
            match self.reduced.factor(&self.memory) {
                Some(factor) => {
                    return subspace_minimum(x, gradient, &cauchy, &self.memory, &factor);
                }
                None => self.memory.clear(),
            }
        }
    }

    /// Requests value and gradient at the ray's step, unless they were evaluated last.
    fn try_point(&mut self, mut ray: Ray) -> Flow {
        ray.n_trials += 1;
        if ray.n_trials > self.options.max_line_search {
            return self.fail(ray);
        }
        let point = ray.point();
        if point.iter().any(|x| x.is_nan()) {
            self.current = ray.start;
            return self.stop(SearchEnd::Abnormal);
        }
        self.line_search = Some(ray);
        if point == self.last_evaluated.x {
            self.current.clone_from(&self.last_evaluated);
            return Flow::Continue;
        }
        self.round = difference_points(point, self.options.difference);
        Flow::Wait
    }

    /// Returns to the initial point of the line search, and retries with an empty memory if it was
    /// not empty.
    fn fail(&mut self, ray: Ray) -> Flow {
        self.current = ray.start;
        if self.memory.len() == 0 {
            return self.stop(SearchEnd::Abnormal);
        }
        self.memory.clear();
        Flow::Continue
    }

    fn advance(&mut self) -> Flow {
        let Some(mut ray) = self.line_search.take() else {
            let has_converged = self.iteration == 0 && self.projected_gradient() <= self.options.gtol;
            return if has_converged { self.stop(SearchEnd::Converged) } else { self.start_iteration() };
        };
        let slope = dot(&self.current.gradient, &ray.direction);
        match ray.line.take(self.current.value, slope) {
            TrialResult::Continue => self.try_point(ray),
            TrialResult::Accept => self.end_iteration(&ray, slope),
        }
    }

    fn end_iteration(&mut self, ray: &Ray, slope: f64) -> Flow {
        self.iteration += 1;
        if self.iteration >= self.options.max_iterations {
            return self.stop(SearchEnd::IterationLimit);
        }
        if self.n_evaluations > self.options.max_evaluations {
            return self.stop(SearchEnd::EvaluationLimit);
        }
        let old = ray.start.value;
        let new = self.current.value;
        let is_flat = old - new <= self.options.ftol * old.abs().max(new.abs()).max(1.0);
        if self.projected_gradient() <= self.options.gtol || is_flat {
            return self.stop(SearchEnd::Converged);
        }
        self.update_memory(ray, slope);
        Flow::Continue
    }

    /// Adds the last step to the memory if its curvature is large enough.
    fn update_memory(&mut self, ray: &Ray, slope: f64) {
        let step = ray.line.step();
        let curvature = (slope - ray.slope) * step;
        if curvature <= f64::EPSILON * (-ray.slope * step) {
            self.memory.skip_pair();
            return;
        }
        let squared = step * step * dot(&ray.direction, &ray.direction);
        let new = self.current.gradient.iter();
        let old = &ray.start.gradient;
        let change = new.zip(old).map(|(new, old)| new - old).collect();
        let moved = ray.direction.iter().map(|d| step * d).collect();
        // If the factorization fails, the memory has cleared itself, and no further action is
        // needed.
        let _ = self.memory.push(moved, change, squared, curvature);
    }
}

impl RoundBased for Lbfgsb {
    fn name(&self) -> &'static str {
        NAME
    }

    fn round(&self) -> &[Vec<f64>] {
        &self.round
    }

    fn receive(&mut self, values: &[f64]) {
        self.n_evaluations += values.len();
        let mut round = mem::take(&mut self.round).into_iter().zip(values);
        let Some((x, &value)) = round.next() else { return };
        let differences = round.enumerate().map(|(i, (u, v))| (v - value) / (u[i] - x[i]));
        let gradient = differences.collect();
        self.take(EvaluatedPoint { x, value, gradient });
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.end
    }
}

fn check(start: &[f64], options: &LbfgsbOptions) -> Result<(), SearchError> {
    if start.is_empty() {
        return Err(SearchError::Dimension { found: 0 });
    }
    let inside = start.iter().all(|x| (0.0..=1.0).contains(x));
    let LbfgsbOptions { memory, ftol, gtol, difference, max_iterations, max_evaluations, max_line_search } =
        *options;
    let count = |option, found: usize| (option, found.to_string(), found >= 1, "at least 1");
    let tolerance = |option, found: f64| (option, found.to_string(), found >= 0.0, "at least 0");
    let is_step = difference > 0.0 && difference <= 0.5;
    let ranges = [
        ("start", format!("{start:?}"), inside, "a list of numbers in [0, 1]"),
        ("difference", difference.to_string(), is_step, "in (0, 0.5]"),
        count("memory", memory),
        tolerance("ftol", ftol),
        tolerance("gtol", gtol),
        count("max_iterations", max_iterations),
        count("max_evaluations", max_evaluations),
        count("max_line_search", max_line_search),
    ];
    match ranges.into_iter().find(|(_, _, is_valid, _)| !is_valid) {
        Some((option, found, _, expected)) => Err(SearchError::Option {
            search: NAME,
            option: option.to_owned(),
            found,
            expected: expected.to_owned(),
        }),
        None => Ok(()),
    }
}

/// Returns the point, and for each coordinate the point with it increased by `h`, or decreased at
/// the upper bound.
fn difference_points(point: Vec<f64>, h: f64) -> Vec<Vec<f64>> {
    let neighbor = |i: usize| {
        let mut moved = point.clone();
        moved[i] = if point[i] + h > 1.0 { point[i] - h } else { point[i] + h };
        moved
    };
    let neighbors: Vec<Vec<f64>> = (0..point.len()).map(neighbor).collect();
    std::iter::once(point).chain(neighbors).collect()
}

/// Clips a number to [0, 1]; 0 for NaN, like C's `fmin(fmax(x, 0), 1)`.
fn clipped(x: f64) -> f64 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

/// Returns the largest step from `x` along `direction` within `[0,1]^d`, at most 1e10.
fn longest_step(x: &[f64], direction: &[f64]) -> f64 {
    let mut longest = 1e10;
    for (x, d) in x.iter().zip(direction) {
        let room = if *d < 0.0 { -x } else { 1.0 - x };
        if *d != 0.0 && room * d <= 0.0 {
            longest = 0.0;
        } else if (d * longest).abs() > room.abs() {
            longest = room / d;
        }
    }
    longest
}
