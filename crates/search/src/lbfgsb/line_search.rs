//! The line search of Moré and Thuente: a step with sufficient decrease and a small slope.

/// φ(α) ≤ φ(0) + `DECREASE` α φ'(0) is asked of a step α,
const DECREASE: f64 = 1e-3;
/// as is |φ'(α)| ≤ `CURVATURE` |φ'(0)|.
const CURVATURE: f64 = 0.9;
/// The search gives up on an interval narrower than this share of its upper end.
const WIDTH: f64 = 0.1;

/// A trial step with the value and the slope there.
#[derive(Debug, Clone, Copy)]
struct Trial {
    step: f64,
    value: f64,
    slope: f64,
}

impl Trial {
    /// The same trial of the function ψ(α) = φ(α) - φ(0) - DECREASE α φ'(0), up to the constant φ(0).
    fn lowered(self, slope: f64) -> Self {
        Self { value: self.value - self.step * slope, slope: self.slope - slope, ..self }
    }

    fn raised(self, slope: f64) -> Self {
        Self { value: self.value + self.step * slope, slope: self.slope + slope, ..self }
    }
}

/// What the search wants after a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// The step just tried is the result.
    Accept,
    /// The search has chosen another step to try.
    Try,
}

/// One search along a ray, from step 0 with a negative slope.
///
/// It holds an interval that contains an acceptable step, between the best trial and the other end, and shrinks it
/// by cubic and quadratic interpolation. Until a step gives ψ ≤ 0 and φ' ≥ 0 it works on ψ instead of φ.
///
/// # Reference
/// Moré and Thuente, "Line search algorithms with guaranteed sufficient decrease", ACM TOMS 20, 1994.
#[derive(Debug, Clone)]
pub(super) struct LineSearch {
    start: Trial,
    max_step: f64,
    step: f64,
    best: Trial,
    other: Trial,
    bracketed: bool,
    /// Whether the search works on φ itself.
    second_stage: bool,
    low: f64,
    high: f64,
    width: f64,
    previous_width: f64,
}

impl LineSearch {
    /// A search from `value` with `slope` < 0, whose first trial is step 1 and whose steps stay within `max_step`.
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

    /// The step under trial.
    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// Takes value and slope at the step under trial.
    pub(super) fn take(&mut self, value: f64, slope: f64) -> Verdict {
        let trial = Trial { step: self.step, value, slope };
        let line = DECREASE * self.start.slope;
        let bound = self.start.value + self.step * line;
        if !self.second_stage && value <= bound && slope >= 0.0 {
            self.second_stage = true;
        }
        if self.is_over(trial, bound, line) {
            return Verdict::Accept;
        }
        if !self.second_stage && value <= self.best.value && value > bound {
            let (mut best, mut other) = (self.best.lowered(line), self.other.lowered(line));
            self.interpolate(&mut best, &mut other, trial.lowered(line));
            (self.best, self.other) = (best.raised(line), other.raised(line));
        } else {
            let (mut best, mut other) = (self.best, self.other);
            self.interpolate(&mut best, &mut other, trial);
            (self.best, self.other) = (best, other);
        }
        self.set_interval();
        Verdict::Try
    }

    /// Whether the trial is acceptable, or no better one can be had.
    fn is_over(&self, trial: Trial, bound: f64, line: f64) -> bool {
        let acceptable = trial.value <= bound && trial.slope.abs() <= CURVATURE * -self.start.slope;
        let at_max = trial.step == self.max_step && trial.value <= bound && trial.slope <= line;
        let at_min = trial.step == 0.0 && (trial.value > bound || trial.slope >= line);
        acceptable || self.is_exhausted() || at_max || at_min
    }

    /// Whether the interval leaves no room for a further step.
    fn is_exhausted(&self) -> bool {
        let outside = self.step <= self.low || self.step >= self.high;
        self.bracketed && (outside || self.high - self.low <= WIDTH * self.high)
    }

    /// Chooses the next step from the interval's ends and the trial, and moves the ends.
    fn interpolate(&mut self, best: &mut Trial, other: &mut Trial, trial: Trial) {
        let opposite = trial.slope * (best.slope / best.slope.abs()) < 0.0;
        let along = trial.step > best.step;
        let next = if trial.value > best.value {
            // A higher value: a minimum is bracketed. The cubic step if it is nearer to the best step than the
            // quadratic one, else their mean.
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
            // A lower value and a slope of the other sign: bracketed too. The farther of cubic and secant step.
            self.bracketed = true;
            farther(cubic_step(trial, *best, along), secant_step(*best, trial), trial.step)
        } else if trial.slope.abs() < best.slope.abs() {
            let cubic = cubic_step_ahead(*best, trial, along, (self.low, self.high));
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

    /// Bisects an interval that shrinks too slowly, keeps the step inside the limits.
    fn set_interval(&mut self) {
        let (best, other) = (self.best.step, self.other.step);
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

/// The pieces of the cubic through two trials: θ, and γ ≥ 0 before its sign is chosen.
fn cubic_pieces(a: Trial, b: Trial, floor_at_zero: bool) -> (f64, f64) {
    let theta = 3.0 * (a.value - b.value) / (b.step - a.step) + a.slope + b.slope;
    let scale = theta.abs().max(a.slope.abs().max(b.slope.abs()));
    let ratio = theta / scale;
    let radicand = ratio * ratio - (a.slope / scale) * (b.slope / scale);
    let radicand = if floor_at_zero { 0.0_f64.max(radicand) } else { radicand };
    (theta, scale * radicand.sqrt())
}

/// The minimiser of the cubic through `from` and `to`, reckoned from `from`.
fn cubic_step(from: Trial, to: Trial, negate: bool) -> f64 {
    let (theta, gamma) = cubic_pieces(from, to, false);
    let gamma = if negate { -gamma } else { gamma };
    let p = (gamma - from.slope) + theta;
    let q = ((gamma - from.slope) + gamma) + to.slope;
    from.step + p / q * (to.step - from.step)
}

/// The minimiser of the cubic if it lies beyond the trial, else the end of the interval on that side.
fn cubic_step_ahead(best: Trial, trial: Trial, along: bool, (low, high): (f64, f64)) -> f64 {
    let (theta, gamma) = cubic_pieces(best, trial, true);
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

/// Where the line through both slopes is zero.
fn secant_step(best: Trial, trial: Trial) -> f64 {
    trial.step + (trial.slope / (trial.slope - best.slope)) * (best.step - trial.step)
}

/// The cubic step if it is farther from `step` than the secant step, else the latter.
fn farther(cubic: f64, secant: f64, step: f64) -> f64 {
    if (cubic - step).abs() > (secant - step).abs() { cubic } else { secant }
}
