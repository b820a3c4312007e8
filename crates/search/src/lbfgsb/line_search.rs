//! The line search of Moré and Thuente: a step that satisfies the strong Wolfe conditions.

/// Sufficient decrease of a step α: φ(α) ≤ φ(0) + `DECREASE` α φ'(0).
const DECREASE: f64 = 1e-3;
/// Curvature condition of a step α: |φ'(α)| ≤ `CURVATURE` |φ'(0)|.
const CURVATURE: f64 = 0.9;
/// The search ends if the width of the interval is at most this fraction of its upper end.
const WIDTH: f64 = 0.1;

/// A trial step with the value and the slope there.
#[derive(Debug, Clone, Copy)]
struct Trial {
    step: f64,
    value: f64,
    slope: f64,
}

impl Trial {
    /// Converts the trial from φ to ψ(α) = φ(α) - φ(0) - DECREASE α φ'(0), up to the constant φ(0).
    fn subtract_line(self, slope: f64) -> Self {
        Self { value: self.value - self.step * slope, slope: self.slope - slope, ..self }
    }

    /// Inverts [`subtract_line`](Self::subtract_line).
    fn add_line(self, slope: f64) -> Self {
        Self { value: self.value + self.step * slope, slope: self.slope + slope, ..self }
    }
}

/// The result of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum TrialResult {
    /// The trial step is accepted.
    Accept,
    /// The search continues with another trial step.
    Continue,
}

/// A line search along a ray, from step 0 with a negative slope.
///
/// It maintains an interval that contains an acceptable step, between the best trial and another
/// trial, and shrinks it by cubic and quadratic interpolation. In the first stage, until ψ ≤ 0 and
/// φ' ≥ 0 at a trial, it uses ψ instead of φ.
///
/// # Reference
/// Moré and Thuente, "Line search algorithms with guaranteed sufficient decrease", ACM TOMS
/// 20, 1994.
#[derive(Debug, Clone)]
pub(super) struct LineSearch {
    start: Trial,
    max_step: f64,
    step: f64,
    best: Trial,
    other: Trial,
    bracketed: bool,
    /// Whether the search is in the second stage and uses φ.
    second_stage: bool,
    low: f64,
    high: f64,
    width: f64,
    previous_width: f64,
}

impl LineSearch {
    /// Creates a line search from `value` with `slope` < 0. The first trial step is 1; no step
    /// exceeds `max_step`.
    pub(super) fn new(value: f64, slope: f64, max_step: f64) -> Self {
        let start = Trial { step: 0.0, value, slope };
        Self {
            start,
            max_step,
            step: 1.0,
            best: start,
            other: start,
            bracketed: false,
            second_stage: false,
            low: 0.0,
            high: 5.0,
            width: max_step,
            previous_width: 2.0 * max_step,
        }
    }

    /// Returns the current trial step.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Takes value and slope at the current trial step.
    pub(super) fn take(&mut self, value: f64, slope: f64) -> TrialResult {
        let trial = Trial { step: self.step, value, slope };
        let line = DECREASE * self.start.slope;
        let bound = self.start.value + self.step * line;
        if !self.second_stage && value <= bound && slope >= 0.0 {
            self.second_stage = true;
        }
        if self.is_over(trial, bound, line) {
            return TrialResult::Accept;
        }
        if !self.second_stage && value <= self.best.value && value > bound {
            let mut best = self.best.subtract_line(line);
            let mut other = self.other.subtract_line(line);
            self.interpolate(&mut best, &mut other, trial.subtract_line(line));
            (self.best, self.other) = (best.add_line(line), other.add_line(line));
        } else {
            let mut best = self.best;
            let mut other = self.other;
            self.interpolate(&mut best, &mut other, trial);
            (self.best, self.other) = (best, other);
        }
        self.set_interval();
        TrialResult::Continue
    }

    /// Returns whether the trial is acceptable or no better step is possible.
    fn is_over(&self, trial: Trial, bound: f64, line: f64) -> bool {
        let acceptable = trial.value <= bound && trial.slope.abs() <= CURVATURE * -self.start.slope;
        let at_max = trial.step == self.max_step && trial.value <= bound && trial.slope <= line;
        let at_min = trial.step == 0.0 && (trial.value > bound || trial.slope >= line);
        acceptable || self.is_exhausted() || at_max || at_min
    }

    /// Returns whether the interval is too small for another step.
    fn is_exhausted(&self) -> bool {
        let outside = self.step <= self.low || self.step >= self.high;
        self.bracketed && (outside || self.high - self.low <= WIDTH * self.high)
    }

    /// Computes the next step from the ends of the interval and the trial, and updates the ends.
    fn interpolate(&mut self, best: &mut Trial, other: &mut Trial, trial: Trial) {
        let opposite = trial.slope * (best.slope / best.slope.abs()) < 0.0;
        let along = trial.step > best.step;
        let next = if trial.value > best.value {
            // A higher value brackets a minimum. Take the cubic step if it is closer to the best
            // step than the quadratic step, otherwise their mean.
            self.bracketed = true;
            let cubic = cubic_step(*best, trial, trial.step < best.step);
            let secant = (best.value - trial.value) / (trial.step - best.step) + best.slope;
            let quadratic = best.step + ((best.slope / secant) / 2.0) * (trial.step - best.step);
            if (cubic - best.step).abs() < (quadratic - best.step).abs() {
                cubic
            } else {
                cubic + (quadratic - cubic) / 2.0
            }
        } else if opposite {
            // A lower value and a slope of the opposite sign also bracket a minimum. Take the cubic
            // or the secant step, whichever is farther from the trial.
            self.bracketed = true;
            farther(cubic_step(trial, *best, along), secant_step(*best, trial), trial.step)
        } else if trial.slope.abs() < best.slope.abs() {
            let cubic = cubic_step_ahead(*best, trial, along, self.low, self.high);
            let secant = secant_step(*best, trial);
            if self.bracketed {
                let nearer =
                    if (cubic - trial.step).abs() < (secant - trial.step).abs() { cubic } else { secant };
                let limit = trial.step + 0.66 * (other.step - trial.step);
                if along { limit.min(nearer) } else { limit.max(nearer) }
            } else {
                farther(cubic, secant, trial.step).min(self.high).max(self.low)
            }
        } else if self.bracketed {
            cubic_step(trial, *other, trial.step > other.step)
        } else if along {
            self.high
        } else {
            self.low
        };
        if trial.value > best.value {
            *other = trial;
        } else {
            if opposite {
                *other = *best;
            }
            *best = trial;
        }
        self.step = next;
    }

    /// Bisects an interval that shrinks too slowly, and clamps the step to the limits.
    fn set_interval(&mut self) {
        let best = self.best.step;
        let other = self.other.step;
        if self.bracketed {
            if (other - best).abs() >= 0.66 * self.previous_width {
                self.step = best + 0.5 * (other - best);
            }
            self.previous_width = self.width;
            self.width = (other - best).abs();
            self.low = best.min(other);
            self.high = best.max(other);
        } else {
            self.low = self.step + 1.1 * (self.step - best);
            self.high = self.step + 4.0 * (self.step - best);
        }
        self.step = self.step.max(0.0).min(self.max_step);
        if self.is_exhausted() {
            self.step = best;
        }
    }
}

/// Returns the coefficients θ and |γ| of the cubic interpolant of two trials.
fn cubic_coefficients(a: Trial, b: Trial, floor_at_zero: bool) -> (f64, f64) {
    let theta = 3.0 * (a.value - b.value) / (b.step - a.step) + a.slope + b.slope;
    let scale = theta.abs().max(a.slope.abs().max(b.slope.abs()));
    let ratio = theta / scale;
    let radicand = ratio * ratio - (a.slope / scale) * (b.slope / scale);
    let radicand = if floor_at_zero { 0.0_f64.max(radicand) } else { radicand };
    (theta, scale * radicand.sqrt())
}

/// Returns the minimizer of the cubic interpolant of `from` and `to`, computed relative to `from`.
fn cubic_step(from: Trial, to: Trial, negate: bool) -> f64 {
    let (theta, gamma) = cubic_coefficients(from, to, false);
    let gamma = if negate { -gamma } else { gamma };
    let p = (gamma - from.slope) + theta;
    let q = ((gamma - from.slope) + gamma) + to.slope;
    from.step + p / q * (to.step - from.step)
}

/// Returns the minimizer of the cubic interpolant if it is beyond the trial, otherwise the end of
/// the interval there.
fn cubic_step_ahead(best: Trial, trial: Trial, along: bool, low: f64, high: f64) -> f64 {
    let (theta, gamma) = cubic_coefficients(best, trial, true);
    let gamma = if along { -gamma } else { gamma };
    let p = (gamma - trial.slope) + theta;
    let q = (gamma + (best.slope - trial.slope)) + gamma;
    let r = p / q;
    if r < 0.0 && gamma != 0.0 {
        trial.step + r * (best.step - trial.step)
    } else if along {
        high
    } else {
        low
    }
}

/// Returns the zero of the linear interpolant of the slopes.
fn secant_step(best: Trial, trial: Trial) -> f64 {
    trial.step + (trial.slope / (trial.slope - best.slope)) * (best.step - trial.step)
}

/// Returns the cubic or the secant step, whichever is farther from `step`.
fn farther(cubic: f64, secant: f64, step: f64) -> f64 {
    if (cubic - step).abs() > (secant - step).abs() { cubic } else { secant }
}
