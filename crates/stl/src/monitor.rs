//! Monitors: a formula compiled for a set of signals and a clock, with its buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum::{self, Extremum, Maximum, Minimum};
use crate::formula::Formula;
use crate::operator::Operator;
use crate::pointwise::{self, Undefined, Values};
use crate::program::{Action, Instruction, Program, Source};
use crate::state;
use crate::trace::Trace;
use crate::until;
use std::ops::Range;
use std::sync::Arc;

/// Computes the robustness of traces with respect to a formula.
///
/// The robustness ρ(φ, w, t) is positive if the trace w satisfies φ at sample t and negative if w
/// violates φ. Its size is the distance to the border between the two, in the unit of the signals.
/// At the border it is a zero whose sign is the Boolean verdict: +0.0 if w satisfies φ, −0.0 if w
/// violates φ. [`is_satisfied`](crate::is_satisfied) and [`is_violated`](crate::is_violated) read
/// it. At equality `<=`, `>=` and `==` hold; `<`, `>` and `!==` do not.
///
/// ```text
/// ρ(x <= y, t)         = y - x                      ρ(x > y, t)  = -ρ(x <= y, t)
/// ρ(x >= y, t)         = x - y                      ρ(x < y, t)  = -ρ(x >= y, t)
/// ρ(x == y, t)         = 0 - |x - y|                ρ(x !== y, t) = -ρ(x == y, t)
/// ρ(not φ, t)          = -ρ(φ, t)
/// ρ(φ and ψ, t)        = min(ρ(φ, t), ρ(ψ, t))      ρ(φ or ψ, t) = max(ρ(φ, t), ρ(ψ, t))
/// ρ(φ implies ψ, t)    = max(-ρ(φ, t), ρ(ψ, t))
/// φ iff ψ              = (φ and ψ) or (not φ and not ψ)          φ xor ψ = not (φ iff ψ)
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
/// Without an interval, windows extend to the end (or start) of the trace. A number or a signal is
/// its own robustness: it holds if it is not negative.
///
/// # Windows beyond the end of the trace
/// [`Monitor::robustness`] and [`Monitor::robustness_signal`] follow RTAMT 0.4.10's discrete-time
/// offline monitor: they cut windows at the end of the trace. The minimum over an empty window
/// is +∞, the maximum −∞. A cut window can satisfy a formula that the whole window would violate,
/// and vice versa. [`Monitor::decided_robustness_signal`] never uses a cut window; verdicts about
/// episodes are based on it. The values of the former equal those of RTAMT for every formula that
/// both parse alike; see [`Formula`](Formula#differences-from-rtamt) for the exceptions.
///
/// # Differences from RTAMT
/// RTAMT's `iff` is `-|ρ(φ, t) - ρ(ψ, t)|`, which is negative where both operands hold. Truncated
/// windows can produce two infinities of the same sign. Their difference in `-` and comparisons is
/// 0; RTAMT computes NaN, and the result of its `min` and `max` then depends on the order of the
/// operands. Arithmetic on finite operands without a finite result
/// is an error that contains the step; RTAMT raises a Python exception or continues with an
/// infinity. A trace of one sample is allowed. A bounded operator on a bare signal does not modify
/// the trace; RTAMT appends to the caller's list.
///
/// # Cost
/// Time is linear in the length of the trace for all intervals. Allocation happens only when a
/// trace is longer than all traces before it. Memory per sample: one number (8 bytes) for the
/// result and one per operand that waits for another one, at most 64 (see
/// [`Formula`](Formula#limits)); half a number more for windows of more than 16 samples ahead and
/// for `until`, `release` and `since`, one for such windows of past operators, and one and a half
/// for `unless`. State formulas wait without memory, as do all operands in
/// `a <= 1 and (b <= 1 and (c <= 1 and …))`.
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
    pub(crate) program: Program,
    clock: Clock,
    /// The names of the last checked trace. They are shared, so comparing the address suffices.
    checked_names: Option<Arc<[String]>>,
    buffers: Vec<Vec<f64>>,
    tile: state::Buffers,
    pub(crate) scratch: Vec<f64>,
}

impl Monitor {
    /// Compiles `formula` for traces of the signals `names`.
    ///
    /// # Errors
    /// If `names` lacks a signal of the formula or contains a name that the formula defines, the
    /// sampling period is not positive and finite, or an interval bound is not a whole number of
    /// samples or too large.
    pub fn new(formula: &Formula, names: &[String], clock: Clock) -> Result<Monitor, MonitorError> {
        let program = Program::compile(formula, names, &clock)?;
        let buffers = vec![Vec::new(); program.buffers];
        let tile = state::Buffers::of(&program.states);
        Ok(Monitor { program, clock, checked_names: None, buffers, tile, scratch: Vec::new() })
    }

    /// Returns the robustness at every sample of the trace. Windows are cut at the end of the
    /// trace.
    ///
    /// # Errors
    /// If the trace is empty or has other signals, a signal of the formula is NaN or infinite, or
    /// arithmetic has no finite value at a sample.
    pub fn robustness_signal(&mut self, trace: &Trace) -> Result<&[f64], MonitorError> {
        self.evaluate(&Samples::of(trace), Windows::Cut)
    }

    /// Returns the robustness at time 0: the first value of [`Monitor::robustness_signal`].
    ///
    /// It reads the samples up to the [`horizon`](Monitor::horizon), so that `always[0:100] p` costs
    /// 101 samples of a trace of any length. Later samples may have errors.
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`], for the samples that it reads.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, Trace};
    ///
    /// let names: Arc<[String]> = Arc::from(["x".to_owned()]);
    /// let formula = Formula::parse("always[0:1](x <= 2)").unwrap();
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    /// let mut trace = Trace::new(names);
    /// for x in [0.0, 1.0, f64::NAN] {
    ///     trace.push(&[x]);
    /// }
    /// assert_eq!(monitor.robustness(&trace).unwrap(), 1.0);
    /// assert!(monitor.robustness_signal(&trace).is_err());
    /// ```
    pub fn robustness(&mut self, trace: &Trace) -> Result<f64, MonitorError> {
        let needed = self.horizon().map_or(usize::MAX, |_| self.needed_samples());
        let found = if trace.len() >= needed {
            // Without windows that are cut, which could have other errors.
            self.evaluate(&Samples { trace, range: 0..needed }, Windows::Whole)
        } else {
            self.robustness_signal(trace)
        };
        // `evaluate` rejects an empty trace.
        found?.first().copied().ok_or(MonitorError::EmptyTrace)
    }

    /// Returns the robustness at time 0 if the trace decides the formula there: the first value of
    /// [`Monitor::decided_robustness_signal`]. It reads the samples that [`Monitor::robustness`]
    /// reads.
    ///
    /// # Errors
    /// As for [`Monitor::decided_robustness_signal`], for the samples that it reads.
    pub fn decided_robustness(&mut self, trace: &Trace) -> Result<Option<f64>, MonitorError> {
        let is_decided = self.decided_samples(trace.len()) > 0;
        let needed = self.horizon().map_or(usize::MAX, |_| self.needed_samples());
        let samples = Samples { trace, range: 0..trace.len().min(needed) };
        let first = self.evaluate(&samples, Windows::Whole)?.first().copied();
        Ok(first.filter(|_| is_decided))
    }

    /// Returns the robustness at the samples at which the trace decides the formula, without a cut
    /// window. These are the first [`decided_samples`](Monitor::decided_samples); the result is
    /// empty if there are none.
    ///
    /// The trace decides the formula at t if it contains every sample that the value at t depends
    /// on:
    ///
    /// - every bounded window ahead, `next` and `s_next` lies inside the trace, at every sample at
    ///   which it is evaluated;
    /// - a window without an end contains at least one sample. It ends at the last sample at which
    ///   its operands are decided, instead of at the end of the trace. So
    ///   `eventually(always[0:30] p)` requires 31 samples with p in a row inside the trace, and
    ///   `always(p implies eventually[0:30] q)` requires nothing of the last 30 samples.
    ///
    /// Without unbounded windows ahead, no continuation of the trace changes a decided value, and
    /// the value equals that of [`Monitor::robustness_signal`]. A formula with an unbounded window
    /// assumes that the trace is complete.
    ///
    /// Windows of past operators are cut at the start of the trace, because nothing precedes it.
    /// Where such a window is empty, a decided value can be infinite.
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
        Ok(&self.evaluate(&Samples::of(trace), Windows::Whole)?[..decided])
    }

    /// Returns the number of samples, from the first, at which a trace of `samples` samples decides
    /// the formula; see [`Monitor::decided_robustness_signal`].
    pub fn decided_samples(&self, samples: usize) -> usize {
        self.program.reach.decided(samples)
    }

    /// Returns the number of samples that a trace must have to decide the formula at time 0.
    pub fn needed_samples(&self) -> usize {
        self.program.reach.ahead.saturating_add(1)
    }

    /// Returns whether [`Monitor::robustness`] of a trace of `samples` samples contains a window
    /// that is cut at the end of the trace.
    pub fn cuts_windows(&self, samples: usize) -> bool {
        self.decided_samples(samples) == 0 || self.program.cuts_operands()
    }

    /// Returns the number of samples after t that the value at t depends on. If `t + horizon` is a
    /// sample of the trace, the trace decides the formula at t. `None` if the value depends on all
    /// samples up to the end of the trace.
    pub fn horizon(&self) -> Option<usize> {
        let reach = self.program.reach;
        (!reach.is_unbounded).then_some(reach.ahead)
    }

    /// Computes the robustness at every sample. With [`Windows::Whole`], only the values at decided
    /// samples have a meaning.
    pub(crate) fn evaluate(
        &mut self,
        samples: &Samples<'_>,
        windows: Windows,
    ) -> Result<&[f64], MonitorError> {
        self.run(samples, windows, |_, _, _| {})?;
        Ok(&self.buffers[self.program.result()][..samples.len()])
    }

    /// Executes the instructions, and calls `visit` for every sub-formula of a trace with its
    /// index, and its values at a range of samples that decide it; several times for a state
    /// formula of several tiles.
    pub(crate) fn run(
        &mut self,
        samples: &Samples<'_>,
        windows: Windows,
        mut visit: impl FnMut(usize, Values<'_>, Range<usize>),
    ) -> Result<(), MonitorError> {
        self.check(samples)?;
        let scratch = self.program.scratch_len(samples.len());
        if self.scratch.len() < scratch {
            self.scratch.resize(scratch, 0.0);
        }
        let mut visited = 0;
        for done in 0..=self.program.instructions.len() {
            let ready = self.program.subformulas[visited..].iter();
            for subformula in ready.take_while(|subformula| subformula.instructions == done) {
                let decided = 0..subformula.reach.decided(samples.len());
                visit(subformula.index, self.values(subformula.values, decided.clone()), decided);
                visited += 1;
            }
            if done < self.program.instructions.len() {
                self.execute(done, samples, windows, &mut visit)?;
            }
        }
        Ok(())
    }

    fn values(&self, source: Source, samples: Range<usize>) -> Values<'_> {
        match source {
            Source::Constant(value) => Values::Constant(value),
            Source::Buffer(buffer) => Values::Signal(&self.buffers[buffer][samples]),
        }
    }

    /// Executes one instruction.
    fn execute(
        &mut self,
        instruction: usize,
        samples: &Samples<'_>,
        windows: Windows,
        visit: &mut impl FnMut(usize, Values<'_>, Range<usize>),
    ) -> Result<(), MonitorError> {
        let Instruction { action, buffer, reach, undecided, held } = self.program.instructions[instruction];
        let all = samples.len();
        let (evaluated, decided, held) = match windows {
            Windows::Cut => (all, all, all),
            Windows::Whole => (all.saturating_sub(undecided), reach.decided(all), all.saturating_sub(held)),
        };
        // Moved out, so that the other buffers can be read while this one is written.
        let mut values = std::mem::take(&mut self.buffers[buffer]);
        let result = match action {
            Action::State(state) => self.evaluate_state(state, samples, &mut values, visit),
            _ if evaluated == 0 => Ok(()),
            Action::Pointwise(operator, operands) => self
                .evaluate_pointwise(operator, operands, buffer, &mut values[..evaluated])
                .map_err(|undefined| undefined.after(samples.range.start)),
            Action::TemporalUnary(operator, window) => {
                temporal_unary(operator, window, &mut values[..evaluated], &mut self.scratch);
                Ok(())
            }
            Action::TemporalBinary(operator, window, left) => {
                let held = if operator == Operator::Unless { held } else { evaluated };
                let left = &mut self.buffers[left][..evaluated.max(held)];
                let right = &mut values[..evaluated];
                temporal_binary(operator, window, left, held, right, &mut self.scratch);
                Ok(())
            }
        };
        // An operator may read undecided values without using them. They must not be NaN.
        values[decided..all].fill(0.0);
        self.buffers[buffer] = values;
        result.map_err(|undefined| self.undefined(undefined))
    }

    pub(crate) fn undefined(&self, Undefined { operation, step }: Undefined) -> MonitorError {
        MonitorError::Undefined { operation, step, time_secs: self.clock.time_secs(step) }
    }

    /// Evaluates a state formula at all samples.
    pub(crate) fn evaluate_state(
        &mut self,
        state: usize,
        samples: &Samples<'_>,
        values: &mut Vec<f64>,
        visit: &mut impl FnMut(usize, Values<'_>, Range<usize>),
    ) -> Result<(), Undefined> {
        if values.len() < samples.len() {
            values.resize(samples.len(), 0.0);
        }
        let first = samples.range.start;
        let state = &self.program.states[state];
        for tile in state::tiles(samples.len()) {
            let out = &mut values[tile.clone()];
            let of_trace = first + tile.start..first + tile.end;
            state.evaluate(samples.trace, of_trace, &mut self.tile, out, |index, values| {
                visit(index, values, tile.clone());
            })?;
        }
        Ok(())
    }

    /// Applies a pointwise operator; `values` is the content of `buffer`, an operand that becomes
    /// the result.
    fn evaluate_pointwise(
        &mut self,
        operator: Operator,
        operands: [Source; 2],
        buffer: usize,
        values: &mut [f64],
    ) -> Result<(), Undefined> {
        for tile in state::tiles(values.len()) {
            let out = &mut values[tile.clone()];
            let replaced = &mut self.scratch[..out.len()];
            replaced.copy_from_slice(out);
            let replaced = &*replaced;
            let [x, y] = operands.map(|source| match source {
                Source::Constant(value) => Values::Constant(value),
                Source::Buffer(other) if other == buffer => Values::Signal(replaced),
                Source::Buffer(other) => Values::Signal(&self.buffers[other][tile.clone()]),
            });
            pointwise::apply(operator, x, y, out).map_err(|undefined| undefined.after(tile.start))?;
        }
        Ok(())
    }

    /// Checks that there is at least one sample, and that the signals are the expected ones and
    /// finite.
    pub(crate) fn check(&mut self, samples: &Samples<'_>) -> Result<(), MonitorError> {
        if samples.len() == 0 {
            return Err(MonitorError::EmptyTrace);
        }
        let names = samples.trace.names();
        if !self.checked_names.as_ref().is_some_and(|checked| Arc::ptr_eq(checked, names)) {
            self.check_names(names)?;
            self.checked_names = Some(Arc::clone(names));
        }
        for (column, signal) in &self.program.columns {
            let values = &samples.trace.column(*column)[samples.range.clone()];
            if pointwise::all_finite(values) {
                continue;
            }
            if let Some(found) = values.iter().position(|value| !value.is_finite()) {
                let step = samples.range.start + found;
                let time_secs = self.clock.time_secs(step);
                let signal = signal.clone();
                return Err(MonitorError::NotFinite { signal, value: values[found], step, time_secs });
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
}

/// The treatment of windows that extend beyond the end of the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Windows {
    /// They are cut, as in RTAMT.
    Cut,
    /// Values that depend on them are not computed.
    Whole,
}

/// The samples of a trace to evaluate.
pub(crate) struct Samples<'a> {
    pub trace: &'a Trace,
    pub range: Range<usize>,
}

impl Samples<'_> {
    pub fn of(trace: &Trace) -> Samples<'_> {
        Samples { trace, range: 0..trace.len() }
    }

    fn len(&self) -> usize {
        self.range.len()
    }
}

/// Replaces `x` by the values of a unary temporal operator.
pub(crate) fn temporal_unary(operator: Operator, window: Window, x: &mut [f64], scratch: &mut [f64]) {
    match operator {
        Operator::Always => extremum::ahead::<Minimum>(x, window, scratch),
        Operator::Eventually => extremum::ahead::<Maximum>(x, window, scratch),
        Operator::Historically => extremum::behind::<Minimum>(x, window, scratch),
        Operator::Once => extremum::behind::<Maximum>(x, window, scratch),
        Operator::Next => next(x, f64::INFINITY),
        Operator::StrongNext => next(x, f64::NEG_INFINITY),
        Operator::Previous => previous(x, f64::INFINITY),
        Operator::StrongPrevious => previous(x, f64::NEG_INFINITY),
        Operator::Rise => edge(x, |before, now| Minimum::pick(-before, now), f64::NEG_INFINITY),
        Operator::Fall => edge(x, |before, now| Minimum::pick(before, -now), f64::INFINITY),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Replaces `y` by the values of a binary temporal operator. The values of `x` are lost; `unless`
/// reads the first `held` of them to find how long its left operand holds.
pub(crate) fn temporal_binary(
    operator: Operator,
    window: Window,
    x: &mut [f64],
    held: usize,
    y: &mut [f64],
    scratch: &mut [f64],
) {
    match operator {
        Operator::Until => until::until::<Maximum>(x, y, window, scratch),
        Operator::Release => until::until::<Minimum>(x, y, window, scratch),
        Operator::Since => until::since::<Maximum>(x, y, window, scratch),
        Operator::Unless => {
            let (held, scratch) = scratch.split_at_mut(held);
            held.copy_from_slice(&x[..held.len()]);
            extremum::ahead::<Minimum>(held, Window { begin: 0, end: window.end }, scratch);
            until::until::<Maximum>(&mut x[..y.len()], y, window, scratch);
            y.iter_mut().zip(held).for_each(|(y, held)| *y = Maximum::pick(*y, *held));
        }
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

fn next(x: &mut [f64], after_end: f64) {
    x.rotate_left(1);
    x[x.len() - 1] = after_end;
}

fn previous(x: &mut [f64], before_start: f64) {
    x.rotate_right(1);
    x[0] = before_start;
}

fn edge(x: &mut [f64], value: impl Fn(f64, f64) -> f64, before_start: f64) {
    let mut before = before_start;
    for x in x {
        (before, *x) = (*x, value(before, *x));
    }
}
