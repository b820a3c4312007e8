//! L-BFGS-B in `[0,1]^d` with finite differences: the local search inside dual annealing.

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
use line_search::{LineSearch, Verdict};
use memory::Memory;
use reduced::ReducedMatrix;
use subspace::subspace_minimum;

const NAME: &str = "l-bfgs-b";

/// The options of [`Lbfgsb`], with the defaults of SciPy's `minimize(method="L-BFGS-B")`.
#[derive(Debug, Clone, PartialEq)]
pub struct LbfgsbOptions {
    /// The number of pairs of steps and gradients kept (10).
    pub memory: usize,
    /// Ends when an iteration lowers the value by less than this share of max(|old|, |new|, 1) (2.2204460492503131e-9).
    pub ftol: f64,
    /// Ends when no component of the projected gradient exceeds this (1e-5).
    pub gtol: f64,
    /// The step of the finite differences, forward or, at the upper bound, backward (1e-8).
    pub difference: f64,
    /// Ends after this many iterations (15,000).
    pub max_iterations: usize,
    /// Ends after the iteration in which the evaluations exceed this (15,000).
    pub max_evaluations: usize,
    /// The evaluations of value and gradient that one line search may take (20).
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

/// The quasi-Newton search L-BFGS-B 3.0 in `[0,1]^d`, as SciPy runs it without a gradient.
///
/// Each round is one point u and its d neighbours u + h eᵢ (u - h eᵢ where that would leave the box), which give value
/// and gradient. An iteration finds the generalised Cauchy point of the limited-memory model, minimises the model
/// over the free coordinates from there, and searches the line to that point.
///
/// From the same start and values its points are SciPy's up to rounding in the linear algebra. It ends, as abnormal,
/// rather than propose a point that is not a number, which values of +∞ can lead to.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu, "A limited memory algorithm for bound constrained optimization", SIAM J. Sci. Comput. 16,
/// 1995. Morales and Nocedal, "Remark on Algorithm 778", ACM TOMS 38, 2011.
#[derive(Debug, Clone)]
pub struct Lbfgsb {
    options: LbfgsbOptions,
    memory: Memory,
    reduced: ReducedMatrix,
    /// Where the search stands.
    now: Valued,
    /// What was told last; a trial at the same point needs no new round.
    told: Valued,
    iteration: usize,
    n_evaluations: usize,
    search: Option<Ray>,
    round: Vec<Vec<f64>>,
    finish: Option<SearchEnd>,
}

/// A point with its value and gradient.
#[derive(Debug, Clone)]
struct Valued {
    x: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

/// A line search under way, with the point it set out from.
#[derive(Debug, Clone)]
struct Ray {
    start: Valued,
    /// Where step 1 leads.
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
        let (x, d) = (self.start.x.iter(), self.direction.iter());
        x.zip(d).map(|(x, d)| clipped(step * d + x)).collect()
    }
}

/// Whether the machine goes on at once or waits for values.
#[derive(PartialEq)]
enum Flow {
    GoOn,
    Wait,
}

impl Lbfgsb {
    /// A local search from `start`.
    ///
    /// # Errors
    /// [`SearchError::Dimension`] for an empty start; [`SearchError::Option`] for one outside `[0,1]^d`, for a memory, a
    /// line search or a limit of 0, a tolerance that is not at least 0 or a difference outside (0, 0.5].
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
    /// assert!((u[0] - 0.3).abs() < 1e-6 && u[1] == 0.0, "the second minimiser is beyond the bound");
    /// # Ok::<(), mishandle_search::SearchError>(())
    /// ```
    pub fn new(start: &[f64], options: &LbfgsbOptions) -> Result<Self, SearchError> {
        check(start, options)?;
        Ok(Self::from_inside(start, options.clone()))
    }

    /// A local search from a point known to be in the box.
    pub(crate) fn from_inside(start: &[f64], options: LbfgsbOptions) -> Self {
        let now = Valued { x: start.to_vec(), value: f64::NAN, gradient: vec![0.0; start.len()] };
        Self {
            memory: Memory::new(options.memory),
            reduced: ReducedMatrix::new(start.len(), options.memory),
            round: neighbourhood(start.to_vec(), options.difference),
            options,
            told: now.clone(),
            now,
            iteration: 0,
            n_evaluations: 0,
            search: None,
            finish: None,
        }
    }

    /// Point and value of the result.
    ///
    /// The value is the last one told at the first point of a round, as in SciPy: after a line search that failed it
    /// belongs to the last trial and not to the point, where the search set out.
    pub fn result(&self) -> (&[f64], f64) {
        (&self.now.x, self.told.value)
    }

    fn end(&mut self, finish: SearchEnd) -> Flow {
        self.finish = Some(finish);
        self.round.clear();
        Flow::Wait
    }

    /// The largest component of the gradient once projected on the box; NaN if the gradient has one.
    fn projected_gradient(&self) -> f64 {
        let component = |(x, g): (&f64, &f64)| if *g < 0.0 { (x - 1.0).max(*g) } else { x.min(*g) };
        if self.now.gradient.iter().any(|g| g.is_nan()) {
            return f64::NAN;
        }
        let components = self.now.x.iter().zip(&self.now.gradient).map(component);
        components.fold(0.0, |largest, c| c.abs().max(largest))
    }

    /// Chooses a direction and begins the line search along it.
    fn begin_iteration(&mut self) -> Flow {
        let target = self.target();
        let Valued { x, value, gradient } = &self.now;
        let direction: Vec<f64> = target.iter().zip(x).map(|(z, x)| z - x).collect();
        let slope = dot(gradient, &direction);
        let max_step = if self.iteration == 0 { 1.0 } else { longest_step(x, &direction) };
        let line = LineSearch::new(*value, slope, max_step);
        let ray = Ray { start: self.now.clone(), target, direction, slope, line, n_trials: 0 };
        if slope >= 0.0 { self.fail(ray) } else { self.try_point(ray) }
    }

    /// The minimum of the model in the box; a model without one is forgotten.
    fn target(&mut self) -> Vec<f64> {
        let Valued { x, gradient, .. } = &self.now;
        loop {
            let cauchy = cauchy_point(x, gradient, &self.memory);
            self.reduced.set_free(&cauchy.free, self.iteration == 0);
            if cauchy.free.is_empty() || self.memory.len() == 0 {
                return cauchy.x;
            }
            match self.reduced.factor(&self.memory) {
                Some(factor) => return subspace_minimum(x, gradient, &cauchy, &self.memory, &factor),
                None => self.memory.clear(),
            }
        }
    }

    /// Asks for value and gradient at the ray's step, unless they are those just told.
    fn try_point(&mut self, mut ray: Ray) -> Flow {
        ray.n_trials += 1;
        if ray.n_trials > self.options.max_line_search {
            return self.fail(ray);
        }
        let point = ray.point();
        if point.iter().any(|x| x.is_nan()) {
            self.now = ray.start;
            return self.end(SearchEnd::Abnormal);
        }
        self.search = Some(ray);
        if point == self.told.x {
            self.now.clone_from(&self.told);
            return Flow::GoOn;
        }
        self.round = neighbourhood(point, self.options.difference);
        Flow::Wait
    }

    /// Goes back to where the line search set out, and tries again without memory if there was any.
    fn fail(&mut self, ray: Ray) -> Flow {
        self.now = ray.start;
        if self.memory.len() == 0 {
            return self.end(SearchEnd::Abnormal);
        }
        self.memory.clear();
        Flow::GoOn
    }

    fn advance(&mut self) -> Flow {
        let Some(mut ray) = self.search.take() else {
            let converged = self.iteration == 0 && self.projected_gradient() <= self.options.gtol;
            return if converged { self.end(SearchEnd::Converged) } else { self.begin_iteration() };
        };
        let slope = dot(&self.now.gradient, &ray.direction);
        match ray.line.take(self.now.value, slope) {
            Verdict::Try => self.try_point(ray),
            Verdict::Accept => self.end_iteration(&ray, slope),
        }
    }

    fn end_iteration(&mut self, ray: &Ray, slope: f64) -> Flow {
        self.iteration += 1;
        if self.iteration >= self.options.max_iterations {
            return self.end(SearchEnd::IterationLimit);
        }
        if self.n_evaluations > self.options.max_evaluations {
            return self.end(SearchEnd::EvaluationLimit);
        }
        let (old, new) = (ray.start.value, self.now.value);
        let is_flat = old - new <= self.options.ftol * old.abs().max(new.abs()).max(1.0);
        if self.projected_gradient() <= self.options.gtol || is_flat {
            return self.end(SearchEnd::Converged);
        }
        self.remember(ray, slope);
        Flow::GoOn
    }

    /// Adds the step just made to the memory where it shows enough curvature.
    fn remember(&mut self, ray: &Ray, slope: f64) {
        let step = ray.line.step();
        let curvature = (slope - ray.slope) * step;
        if curvature <= f64::EPSILON * (-ray.slope * step) {
            self.memory.keep();
            return;
        }
        let squared = step * step * dot(&ray.direction, &ray.direction);
        let (new, old) = (self.now.gradient.iter(), &ray.start.gradient);
        let change = new.zip(old).map(|(new, old)| new - old).collect();
        let moved = ray.direction.iter().map(|d| step * d).collect();
        // A memory without a factor has emptied itself, which is all there is to do.
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
        self.told = Valued { x, value, gradient };
        self.now.clone_from(&self.told);
        while self.advance() == Flow::GoOn {}
    }

    fn finish(&self) -> Option<SearchEnd> {
        self.finish
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
        ("start", format!("{start:?}"), inside, "of numbers in [0, 1]"),
        ("difference", difference.to_string(), is_step, "in (0, 0.5]"),
        count("memory", memory),
        tolerance("ftol", ftol),
        tolerance("gtol", gtol),
        count("max_iterations", max_iterations),
        count("max_evaluations", max_evaluations),
        count("max_line_search", max_line_search),
    ];
    match ranges.into_iter().find(|(_, _, is_right, _)| !is_right) {
        Some((option, found, _, expected)) => Err(SearchError::Option {
            search: NAME,
            option: option.to_owned(),
            found,
            expected: expected.to_owned(),
        }),
        None => Ok(()),
    }
}

/// The point, then for each coordinate the point with it moved by `h`, downwards where upwards would leave the box.
fn neighbourhood(point: Vec<f64>, h: f64) -> Vec<Vec<f64>> {
    let neighbour = |i: usize| {
        let mut moved = point.clone();
        moved[i] = if point[i] + h > 1.0 { point[i] - h } else { point[i] + h };
        moved
    };
    let neighbours: Vec<Vec<f64>> = (0..point.len()).map(neighbour).collect();
    std::iter::once(point).chain(neighbours).collect()
}

/// The nearest number in [0, 1]; 0 for NaN, as C's `fmin(fmax(x, 0), 1)` has it.
fn clipped(x: f64) -> f64 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

/// How far `direction` may be followed from `x` within the box.
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
