//! Monitors: a formula compiled for a set of signals and a clock, with its buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum::{self, Extremum, Maximum, Minimum};
use crate::formula::Formula;
use crate::operator::Operator;
use crate::pointwise::{self, Values};
use crate::program::{Action, Instruction, Location, Program, Source, Subformula};
use crate::subformula::SubformulaMinimum;
use crate::trace::Trace;
use crate::until;
use std::sync::Arc;

/// Computes the robustness of traces with respect to a formula.
///
/// The robustness ρ(φ, w, t) is positive if the trace w satisfies φ at sample t and negative if w violates φ. Its
/// size is the distance to the border between the two, in the unit of the signals. At the border it is 0 and decides
/// nothing.
///
/// ```text
/// ρ(x <= y, t)         = y - x                      ρ(x >= y, t) = x - y           (the same for < and >)
/// ρ(x == y, t)         = -|x - y|                   ρ(x !== y, t) = |x - y|
/// ρ(not φ, t)          = -ρ(φ, t)
/// ρ(φ and ψ, t)        = min(ρ(φ, t), ρ(ψ, t))      ρ(φ or ψ, t) = max(ρ(φ, t), ρ(ψ, t))
/// ρ(φ implies ψ, t)    = max(-ρ(φ, t), ρ(ψ, t))
/// ρ(φ iff ψ, t)        = -|ρ(φ, t) - ρ(ψ, t)|       ρ(φ xor ψ, t) = |ρ(φ, t) - ρ(ψ, t)|
/// ρ(always[a:b] φ, t)  = min ρ(φ, t′) over t′ in [t+a, t+b]      eventually: max
/// ρ(historically[a:b] φ, t) = min ρ(φ, t′) over t′ in [t-b, t-a] once: max
/// ρ(φ until[a:b] ψ, t) = max over t′ in [t+a, t+b] of min(ρ(ψ, t′), min ρ(φ, s) over s in [t, t′))
/// ρ(φ since[a:b] ψ, t) = max over t′ in [t-b, t-a] of min(ρ(ψ, t′), min ρ(φ, s) over s in (t′, t])
/// φ release[a:b] ψ     = not (not φ until[a:b] not ψ)
/// φ unless[a:b] ψ      = always[0:b] φ or φ until[a:b] ψ
/// ρ(next φ, t)         = ρ(φ, t+1); past the end +∞, for s_next −∞ (prev and s_prev likewise before the start)
/// ρ(rise(φ), t)        = min(-ρ(φ, t-1), ρ(φ, t)), with −∞ for φ before the start; fall(φ) = rise(not φ)
/// ```
///
/// Without an interval, windows extend to the end (or start) of the trace. A number or a signal is its own robustness.
///
/// # Windows beyond the end of the trace
/// [`Monitor::robustness`] and [`Monitor::robustness_signal`] follow RTAMT 0.4.10's discrete-time offline monitor: they cut
/// windows at the end of the trace. The minimum over an empty window is +∞, the maximum −∞. A cut window can satisfy a
/// formula that the whole window would violate, and vice versa. [`Monitor::decided_robustness_signal`] never uses a cut
/// window; verdicts about episodes are based on it. The values of the former equal those of RTAMT for every formula that
/// both parse alike; see [`Formula`](Formula#differences-from-rtamt) for the exceptions.
///
/// # Differences from RTAMT
/// Truncated windows can produce two infinities of the same sign. Their difference in `-`, comparisons, `iff` and
/// `xor` is 0; RTAMT computes NaN, and the result of its `min` and `max` then depends on the order of the operands.
/// Arithmetic on finite operands without a finite result is an error that contains the step; RTAMT raises a Python
/// exception or continues with an infinity. A trace of one sample is allowed. A bounded operator on a bare signal
/// does not modify the trace; RTAMT appends to the caller's list.
///
/// # Cost
/// Time is linear in the length of the trace for all intervals. Allocation happens only when a trace is longer than all
/// traces before it. Memory per sample: one number (8 bytes) per operand that waits for another one, at most 64 (see
/// [`Formula`](Formula#limits)), two more numbers for windows of more than 16 samples, and five more for `until`,
/// `release`, `unless` and `since`.
///
/// # Example
/// A fingertip that must stay within 0.12 m of its target from control step 1 on:
/// ```
/// use std::sync::Arc;
/// use mishandle_stl::{Clock, Formula, Monitor, Trace};
///
/// let formula = Formula::parse("always[1:2](distance <= 0.12)").unwrap();
/// let names: Arc<[String]> = Arc::from(["distance".to_owned()]);
/// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0 / 60.0)).unwrap();
///
/// let mut trace = Trace::new(names);
/// for distance in [0.5, 0.02, 0.10] {
///     trace.push(&[distance]);
/// }
/// // 0.12 - distance is [-0.38, 0.10, 0.02]; the window of the last sample is empty.
/// let expected = [0.12 - 0.10, 0.12 - 0.10, f64::INFINITY];
/// assert_eq!(monitor.robustness_signal(&trace).unwrap(), expected);
/// assert_eq!(monitor.robustness(&trace).unwrap(), 0.12 - 0.10);
/// ```
///
/// # Reference
/// Donzé and Maler, "Robust Satisfaction of Temporal Logic over Real-Valued Signals", FORMATS 2010.
#[derive(Clone, Debug)]
pub struct Monitor {
    program: Program,
    clock: Clock,
    /// The names of the last checked trace. They are shared, so comparing the address suffices.
    checked_names: Option<Arc<[String]>>,
    buffers: Vec<Vec<f64>>,
    scratch: Vec<f64>,
    /// Empty until minima are requested.
    minima: Vec<SubformulaMinimum>,
}

impl Monitor {
    /// Compiles `formula` for traces of the signals `names`.
    ///
    /// # Errors
    /// If `names` lacks a signal of the formula or contains a name that the formula defines, the sampling period is not
    /// positive and finite, or an interval bound is not a whole number of samples or too large.
    pub fn new(formula: &Formula, names: &[String], clock: Clock) -> Result<Monitor, MonitorError> {
        let program = Program::compile(formula, names, &clock)?;
        let buffers = vec![Vec::new(); program.buffers];
        Ok(Monitor { program, clock, checked_names: None, buffers, scratch: Vec::new(), minima: Vec::new() })
    }

    /// Returns the robustness at every sample of the trace. Windows are cut at the end of the trace.
    ///
    /// # Errors
    /// If the trace is empty or has other signals, a signal of the formula is NaN or infinite, or arithmetic has no
    /// finite value at a sample.
    pub fn robustness_signal(&mut self, trace: &Trace) -> Result<&[f64], MonitorError> {
        self.evaluate(trace, Windows::Cut)
    }

    /// Returns the robustness at time 0: the first value of [`Monitor::robustness_signal`].
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`].
    pub fn robustness(&mut self, trace: &Trace) -> Result<f64, MonitorError> {
        // `evaluate` rejects an empty trace.
        self.robustness_signal(trace)?.first().copied().ok_or(MonitorError::EmptyTrace)
    }

    /// Returns the robustness at the samples at which the trace decides the formula, without a cut window. These are the
    /// first [`decided_samples`](Monitor::decided_samples); the result is empty if there are none.
    ///
    /// The trace decides the formula at t if it contains every sample that the value at t depends on:
    ///
    /// - every bounded window ahead, `next` and `s_next` lies inside the trace, at every sample at which it is evaluated;
    /// - a window without an end contains at least one sample. It ends at the last sample at which its operands are
    ///   decided, instead of at the end of the trace. So `eventually(always[0:30] p)` requires 31 samples with p in a row
    ///   inside the trace, and `always(p implies eventually[0:30] q)` requires nothing of the last 30 samples.
    ///
    /// Without unbounded windows ahead, no continuation of the trace changes a decided value, and the value equals that of
    /// [`Monitor::robustness_signal`]. A formula with an unbounded window assumes that the trace is complete.
    ///
    /// Windows of past operators are cut at the start of the trace, because nothing precedes it. Where such a window is
    /// empty, a decided value can be infinite.
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`], but arithmetic is evaluated only where it is decided.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, Trace};
    ///
    /// let names: Arc<[String]> = Arc::from(["x".to_owned()]);
    /// let formula = Formula::parse("eventually(always[0:2](x >= 4))").unwrap();
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    /// let mut trace = Trace::new(names);
    /// for x in [0.0, 1.0, 0.0, 5.0] {
    ///     trace.push(&[x]);
    /// }
    /// assert_eq!(monitor.robustness(&trace).unwrap(), 1.0); // the window of the last sample is cut to that sample
    /// assert_eq!(monitor.decided_robustness_signal(&trace).unwrap(), [-4.0, -4.0]); // samples 0 to 2, and 1 to 3
    /// ```
    pub fn decided_robustness_signal(&mut self, trace: &Trace) -> Result<&[f64], MonitorError> {
        let decided = self.decided_samples(trace.len());
        Ok(&self.evaluate(trace, Windows::Whole)?[..decided])
    }

    /// Returns the number of samples, from the first, at which a trace of `samples` samples decides the formula; see
    /// [`Monitor::decided_robustness_signal`].
    pub fn decided_samples(&self, samples: usize) -> usize {
        self.program.reach.decided(samples)
    }

    /// Returns the number of samples that a trace must have to decide the formula at time 0.
    pub fn needed_samples(&self) -> usize {
        self.program.reach.ahead.saturating_add(1)
    }

    /// Returns whether [`Monitor::robustness`] of a trace of `samples` samples contains a window that is cut at the end of
    /// the trace.
    pub fn cuts_windows(&self, samples: usize) -> bool {
        self.decided_samples(samples) == 0 || self.program.cuts_operands()
    }

    /// Returns the least robustness of every sub-formula over the trace, with the first sample at which it is attained.
    ///
    /// The order is that of [`Formula::subformulas`]: root first, depth first, left operand before right. The values
    /// of a sub-formula equal those of a separate monitor for it.
    ///
    /// The values are those of [`Monitor::decided_robustness_signal`]. The minimum is over the samples at which the trace
    /// covers the sub-formula: the sub-formula is decided, and the trace contains all samples that its bounded past
    /// windows, `prev`, `rise` and `fall` read. At other samples a window is cut or empty, and the value says little about
    /// the system. On samples 0 to 300, `always[50:300] p` is covered at sample 0 only, and `p` at all samples.
    ///
    /// The cost is that of [`Monitor::robustness_signal`] plus one pass over the samples per sub-formula.
    ///
    /// # Errors
    /// As for [`Monitor::decided_robustness_signal`].
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, SubformulaMinimum, Trace};
    ///
    /// let formula = Formula::parse("always[1:2](d <= 0.5 and v < 2)").unwrap();
    /// let names: Arc<[String]> = Arc::from(["d".to_owned(), "v".to_owned()]);
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
    /// let mut trace = Trace::new(names);
    /// for sample in [[0.75, 1.0], [0.25, 0.0], [0.25, 1.5]] {
    ///     trace.push(&sample);
    /// }
    /// let expected = [
    ///     (0.25, 0),  // always[1:2](...): covered at sample 0 only
    ///     (-0.25, 0), // d <= 0.5 and v < 2
    ///     (-0.25, 0), // d <= 0.5
    ///     (0.5, 2),   // v < 2
    /// ];
    /// let expected = expected.map(|(minimum, step)| SubformulaMinimum { minimum, step });
    /// assert_eq!(monitor.subformula_minima(&trace).unwrap(), expected);
    /// ```
    pub fn subformula_minima(&mut self, trace: &Trace) -> Result<&[SubformulaMinimum], MonitorError> {
        let mut minima = std::mem::take(&mut self.minima);
        minima.clear();
        minima.resize(self.program.subformulas.len(), SubformulaMinimum::NONE);
        let result = self.run(trace, Windows::Whole, |subformula, operands| {
            minima[subformula.index] = operands.minimum(subformula);
        });
        self.minima = minima;
        result?;
        Ok(&self.minima)
    }

    /// Returns the number of samples after t that the value at t depends on. If `t + horizon` is a sample of the
    /// trace, the trace decides the formula at t. `None` if the value depends on all samples up to the end of the trace.
    pub fn horizon(&self) -> Option<usize> {
        let reach = self.program.reach;
        (!reach.is_unbounded).then_some(reach.ahead)
    }

    /// Computes the robustness at every sample. With [`Windows::Whole`], only the values at decided samples have a meaning.
    fn evaluate(&mut self, trace: &Trace, windows: Windows) -> Result<&[f64], MonitorError> {
        self.check(trace)?;
        self.reserve(trace.len());
        for instruction in 0..self.program.instructions.len() {
            self.execute(instruction, trace, windows)?;
        }
        Ok(&self.buffers[self.program.result()][..trace.len()])
    }

    /// Like `evaluate`, and calls `visit` for every sub-formula while its values are in the buffers.
    fn run(
        &mut self,
        trace: &Trace,
        windows: Windows,
        mut visit: impl FnMut(&Subformula, &Operands<'_>),
    ) -> Result<(), MonitorError> {
        self.check(trace)?;
        self.reserve(trace.len());
        let mut visited = 0;
        for done in 0..=self.program.instructions.len() {
            let operands = Operands { trace, buffers: &self.buffers, samples: trace.len() };
            let ready = self.program.subformulas[visited..].iter();
            for subformula in ready.take_while(|subformula| subformula.instructions == done) {
                visit(subformula, &operands);
                visited += 1;
            }
            if done < self.program.instructions.len() {
                self.execute(done, trace, windows)?;
            }
        }
        Ok(())
    }

    /// Executes one instruction.
    fn execute(&mut self, instruction: usize, trace: &Trace, windows: Windows) -> Result<(), MonitorError> {
        let Instruction { action, out, reach, undecided } = self.program.instructions[instruction];
        let all = trace.len();
        let (samples, decided) = match windows {
            Windows::Cut => (all, all),
            Windows::Whole => (all.saturating_sub(undecided), reach.decided(all)),
        };
        // Moved out, so that the other buffers can be read while this one is written.
        let mut values = std::mem::take(&mut self.buffers[out]);
        let operands = Operands { trace, buffers: &self.buffers, samples };
        let result = if samples == 0 {
            Ok(())
        } else {
            operands.apply(action, &mut values[..samples], &mut self.scratch, &self.clock)
        };
        // An operator may read undecided values without using them. They must not be NaN.
        values[decided..all].fill(0.0);
        self.buffers[out] = values;
        result
    }

    /// Checks that the trace has at least one sample and the expected signals, and that they are finite.
    fn check(&mut self, trace: &Trace) -> Result<(), MonitorError> {
        if trace.is_empty() {
            return Err(MonitorError::EmptyTrace);
        }
        if !self.checked_names.as_ref().is_some_and(|names| Arc::ptr_eq(names, trace.names())) {
            self.check_names(trace.names())?;
            self.checked_names = Some(Arc::clone(trace.names()));
        }
        for (column, name) in &self.program.columns {
            let values = trace.column(*column);
            if pointwise::all_finite(values) {
                continue;
            }
            if let Some(step) = values.iter().position(|value| !value.is_finite()) {
                let (signal, value, time_secs) = (name.clone(), values[step], self.clock.time_secs(step));
                return Err(MonitorError::NotFinite { signal, value, step, time_secs });
            }
        }
        Ok(())
    }

    fn check_names(&self, names: &[String]) -> Result<(), MonitorError> {
        match self.program.columns.iter().find(|(column, name)| names.get(*column) != Some(name)) {
            None => Ok(()),
            Some((index, expected)) => Err(MonitorError::SignalMismatch {
                expected: expected.clone(),
                index: *index,
                found: names.to_vec(),
            }),
        }
    }

    /// Grows the buffers to this many samples.
    fn reserve(&mut self, samples: usize) {
        for buffer in &mut self.buffers {
            if buffer.len() < samples {
                buffer.resize(samples, 0.0);
            }
        }
        let scratch = self.program.scratch_len(samples);
        if self.scratch.len() < scratch {
            self.scratch.resize(scratch, 0.0);
        }
    }
}

/// The treatment of windows that extend beyond the end of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Windows {
    /// They are cut, as in RTAMT.
    Cut,
    /// Values that depend on them are not computed.
    Whole,
}

/// The data that an instruction may read.
struct Operands<'a> {
    trace: &'a Trace,
    buffers: &'a [Vec<f64>],
    samples: usize,
}

impl<'a> Operands<'a> {
    fn signal(&self, location: Location) -> &'a [f64] {
        match location {
            Location::Column(column) => &self.trace.column(column)[..self.samples],
            Location::Buffer(buffer) => &self.buffers[buffer][..self.samples],
        }
    }

    fn values(&self, source: Source) -> Values<'a> {
        match source {
            Source::Constant(value) => Values::Constant(value),
            Source::Location(location) => Values::Signal(self.signal(location)),
        }
    }

    /// Returns the minimum of a sub-formula over the samples of the whole trace that cover it.
    fn minimum(&self, subformula: &Subformula) -> SubformulaMinimum {
        let covered = subformula.reach.covered(self.samples);
        let first = covered.start;
        match self.values(subformula.values) {
            Values::Signal(values) => SubformulaMinimum::of(values[covered].iter().copied(), first),
            Values::Constant(value) => SubformulaMinimum::of(covered.take(1).map(|_| value), first),
        }
    }

    fn apply(
        &self,
        action: Action,
        out: &mut [f64],
        scratch: &mut [f64],
        clock: &Clock,
    ) -> Result<(), MonitorError> {
        match action {
            Action::Load(Source::Constant(value)) => out.fill(value),
            Action::Load(Source::Location(location)) => out.copy_from_slice(self.signal(location)),
            Action::Map(operator, x) => {
                let x = self.values(x);
                pointwise::map(operator, x, out);
                check_arithmetic(operator, &[x], out, clock)?;
            }
            Action::Zip(operator, x, y) => {
                let (x, y) = (self.values(x), self.values(y));
                pointwise::zip(operator, x, y, out);
                check_arithmetic(operator, &[x, y], out, clock)?;
            }
            Action::TemporalUnary(operator, window, x) => {
                temporal_unary(operator, window, self.signal(x), out, scratch);
            }
            Action::TemporalBinary(operator, window, x, y) => {
                temporal_binary(operator, window, self.signal(x), self.signal(y), out, scratch);
            }
        }
        Ok(())
    }
}

/// Applies a unary temporal operator.
fn temporal_unary(operator: Operator, window: Window, x: &[f64], out: &mut [f64], scratch: &mut [f64]) {
    match operator {
        Operator::Always => extremum::ahead::<Minimum>(x, window, out, scratch),
        Operator::Eventually => extremum::ahead::<Maximum>(x, window, out, scratch),
        Operator::Historically => extremum::behind::<Minimum>(x, window, out, scratch),
        Operator::Once => extremum::behind::<Maximum>(x, window, out, scratch),
        Operator::Next => next(x, f64::INFINITY, out),
        Operator::StrongNext => next(x, f64::NEG_INFINITY, out),
        Operator::Previous => previous(x, f64::INFINITY, out),
        Operator::StrongPrevious => previous(x, f64::NEG_INFINITY, out),
        Operator::Rise => edge(x, out, |before, now| Minimum::pick(-before, now), f64::NEG_INFINITY),
        Operator::Fall => edge(x, out, |before, now| Minimum::pick(before, -now), f64::INFINITY),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Applies a binary temporal operator.
fn temporal_binary(
    operator: Operator,
    window: Window,
    x: &[f64],
    y: &[f64],
    out: &mut [f64],
    scratch: &mut [f64],
) {
    match operator {
        Operator::Until => until::until::<Maximum>(x, y, window, out, scratch),
        Operator::Release => until::until::<Minimum>(x, y, window, out, scratch),
        Operator::Since => until::since::<Maximum>(x, y, window, out, scratch),
        Operator::Unless => {
            until::until::<Maximum>(x, y, window, out, scratch);
            let (held, scratch) = scratch.split_at_mut(x.len());
            extremum::ahead::<Minimum>(x, Window { begin: 0, end: window.end }, held, scratch);
            out.iter_mut().zip(held).for_each(|(out, held)| *out = Maximum::pick(*out, *held));
        }
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

fn next(x: &[f64], after_end: f64, out: &mut [f64]) {
    let last = x.len() - 1;
    out[..last].copy_from_slice(&x[1..]);
    out[last] = after_end;
}

fn previous(x: &[f64], before_start: f64, out: &mut [f64]) {
    out[0] = before_start;
    out[1..].copy_from_slice(&x[..x.len() - 1]);
}

fn edge(x: &[f64], out: &mut [f64], value: impl Fn(f64, f64) -> f64, before_start: f64) {
    out[0] = value(before_start, x[0]);
    for (out, pair) in out[1..].iter_mut().zip(x.windows(2)) {
        *out = value(pair[0], pair[1]);
    }
}

/// Checks that arithmetic has a value at every sample: not NaN, and finite if its operands are finite.
fn check_arithmetic(
    operator: Operator,
    operands: &[Values<'_>],
    out: &[f64],
    clock: &Clock,
) -> Result<(), MonitorError> {
    if !operator.is_arithmetic() || pointwise::all_finite(out) {
        return Ok(());
    }
    let is_undefined = |step: usize| {
        let is_finite = |values: &Values<'_>| values.at(step).is_finite();
        out[step].is_nan() || (out[step].is_infinite() && operands.iter().all(is_finite))
    };
    match (0..out.len()).find(|step| is_undefined(*step)) {
        None => Ok(()),
        Some(step) => {
            let operands: Vec<String> = operands.iter().map(|values| values.at(step).to_string()).collect();
            let operation = match operator.shape() {
                crate::operator::Shape::Infix => operands.join(&format!(" {} ", operator.name())),
                _ => format!("{}({})", operator.name(), operands.join(", ")),
            };
            Err(MonitorError::Undefined { operation, step, time_secs: clock.time_secs(step) })
        }
    }
}
