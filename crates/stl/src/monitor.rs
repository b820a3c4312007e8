//! A monitor: a formula compiled for a set of signals and a clock, with the buffers it works in.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum::{self, Extremum, Greatest, Least};
use crate::formula::Formula;
use crate::operator::Operator;
use crate::pointwise::{self, Values};
use crate::program::{Action, Instruction, Place, Program, Source, Subformula};
use crate::subformula::SubformulaMinimum;
use crate::trace::Trace;
use crate::until;
use std::sync::Arc;

/// Measures how far traces are from violating a formula.
///
/// Robustness ρ(φ, w, t) is positive where the trace w satisfies φ at sample t, negative where it violates it, and 0 at
/// the border; its size is the distance to the border in the unit of the signals. For samples t of n:
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
/// ρ(next φ, t)         = ρ(φ, t+1), past the end +∞, for s_next −∞ (prev and s_prev likewise at the begin)
/// ρ(rise(φ), t)        = min(-ρ(φ, t-1), ρ(φ, t)), φ before the begin being −∞; fall(φ) = rise(not φ)
/// ```
///
/// Windows are cut where the trace ends; the minimum over no sample is +∞ and the maximum −∞. Without an interval,
/// windows reach to the end (or begin) of the trace. A number or a signal alone is its own robustness. These are the
/// values of RTAMT 0.4.10's discrete-time offline monitor for a formula that it reads as we do; see
/// [`Formula`](Formula#where-the-reading-is-not-rtamts) for the few that it does not.
///
/// # Where the values are not RTAMT's
/// Two infinities of the same sign, which cut windows can give, differ by 0 in `-`, comparisons, `iff` and `xor`; RTAMT
/// computes NaN, and what its `min` and `max` then give depends on the order of their operands. Arithmetic without a
/// finite value on finite operands is an error that names the step; RTAMT ends with Python's exception, or goes on with
/// an infinity. A trace of one sample is measured as any other. A bounded operator on a bare signal leaves the trace as
/// it is (RTAMT appends to the caller's list).
///
/// # Cost
/// Time is linear in the length of the trace, whatever the intervals, and measuring allocates only to grow the buffers
/// to the longest trace so far.
///
/// # Example
/// A fingertip that has to stay within 0.12 m of its target from the second control step on:
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
    /// The names of the last trace that was found to hold our signals; shared, so that a look at the address is enough.
    checked: Option<Arc<[String]>>,
    buffers: Vec<Vec<f64>>,
    scratch: Vec<f64>,
    /// Empty until minima are asked for.
    minima: Vec<SubformulaMinimum>,
}

impl Monitor {
    /// Compiles `formula` for traces of the signals `names`.
    ///
    /// # Errors
    /// A signal of the formula that is not in `names`, a period that is not positive, an interval bound that falls
    /// between two samples.
    pub fn new(formula: &Formula, names: &[String], clock: Clock) -> Result<Monitor, MonitorError> {
        let program = Program::compile(formula, names, &clock)?;
        let buffers = vec![Vec::new(); program.buffers];
        Ok(Monitor { program, clock, checked: None, buffers, scratch: Vec::new(), minima: Vec::new() })
    }

    /// The robustness at every sample of the trace.
    ///
    /// # Errors
    /// An empty trace, one of other signals, a NaN or an infinity in a signal that the formula reads, arithmetic without
    /// a value.
    pub fn robustness_signal(&mut self, trace: &Trace) -> Result<&[f64], MonitorError> {
        self.measure(trace, trace.len())
    }

    /// The robustness at time 0. Looks at no more samples than that takes.
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`], though arithmetic is not tried on samples that the value at time 0 does
    /// not depend on.
    pub fn robustness(&mut self, trace: &Trace) -> Result<f64, MonitorError> {
        let needed = self.horizon().map_or(usize::MAX, |horizon| horizon.saturating_add(1));
        let values = self.measure(trace, trace.len().min(needed))?;
        // Measured traces hold at least one sample.
        values.first().copied().ok_or(MonitorError::EmptyTrace)
    }

    /// Returns the least robustness of every sub-formula over the trace, with the first sample at which it is attained.
    ///
    /// The order is that of [`Formula::subformulas`]: root first, depth first, left operand before right. The values of
    /// a sub-formula are those of a monitor of its own.
    ///
    /// The minimum is over the samples at which the trace covers the sub-formula: all samples that its bounded windows,
    /// `next`, `prev`, `rise` and `fall` look at are in the trace, and so is the first sample of each window without an
    /// end. Elsewhere the value is that of a cut or empty window and says little about the system. `always[50:300] p` on
    /// samples 0 to 300 is covered at sample 0 only, `p` at all of them.
    ///
    /// The cost is that of [`Monitor::robustness_signal`] plus one pass over the samples per sub-formula. Both are paid
    /// only here.
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`].
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
        let samples = trace.len();
        let mut minima = std::mem::take(&mut self.minima);
        minima.clear();
        minima.resize(self.program.subformulas.len(), SubformulaMinimum::NONE);
        let result = self.run(trace, samples, |subformula, operands| {
            minima[subformula.index] = operands.minimum(subformula);
        });
        self.minima = minima;
        result?;
        Ok(&self.minima)
    }

    /// How many samples past t the value at t depends on: with it, a value is that of the trace and of no cut window
    /// if `t + horizon` is a sample. `None` if the value depends on all samples to the end of the trace, whatever its
    /// length.
    pub fn horizon(&self) -> Option<usize> {
        self.program.horizon
    }

    /// The robustness at the first `samples` samples, as if the trace ended there.
    fn measure(&mut self, trace: &Trace, samples: usize) -> Result<&[f64], MonitorError> {
        self.check(trace)?;
        self.make_room(samples);
        for instruction in 0..self.program.instructions.len() {
            self.execute(instruction, trace, samples)?;
        }
        Ok(&self.buffers[self.program.result()][..samples])
    }

    /// The same, and shows `see` every sub-formula while its values are there.
    fn run(
        &mut self,
        trace: &Trace,
        samples: usize,
        mut see: impl FnMut(&Subformula, &Operands<'_>),
    ) -> Result<(), MonitorError> {
        self.check(trace)?;
        self.make_room(samples);
        let mut seen = 0;
        for done in 0..=self.program.instructions.len() {
            let operands = Operands { trace, buffers: &self.buffers, samples };
            let ready = self.program.subformulas[seen..].iter();
            for subformula in ready.take_while(|subformula| subformula.instructions == done) {
                see(subformula, &operands);
                seen += 1;
            }
            if done < self.program.instructions.len() {
                self.execute(done, trace, samples)?;
            }
        }
        Ok(())
    }

    /// Executes one instruction.
    fn execute(&mut self, instruction: usize, trace: &Trace, samples: usize) -> Result<(), MonitorError> {
        let Instruction { action, out } = self.program.instructions[instruction];
        // Taken out, so that the other buffers can be read while it is written.
        let mut values = std::mem::take(&mut self.buffers[out]);
        let operands = Operands { trace, buffers: &self.buffers, samples };
        let result = operands.act(action, &mut values[..samples], &mut self.scratch, &self.clock);
        self.buffers[out] = values;
        result
    }

    /// Accepts a trace of at least one sample that holds our signals, all of them finite.
    fn check(&mut self, trace: &Trace) -> Result<(), MonitorError> {
        if trace.is_empty() {
            return Err(MonitorError::EmptyTrace);
        }
        if !self.checked.as_ref().is_some_and(|names| Arc::ptr_eq(names, trace.names())) {
            self.check_names(trace.names())?;
            self.checked = Some(Arc::clone(trace.names()));
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
            Some((index, wanted)) => Err(MonitorError::OtherSignals {
                wanted: wanted.clone(),
                index: *index,
                found: names.to_vec(),
            }),
        }
    }

    /// Grows the buffers to hold this many samples.
    fn make_room(&mut self, samples: usize) {
        for buffer in &mut self.buffers {
            if buffer.len() < samples {
                buffer.resize(samples, 0.0);
            }
        }
        let scratch = until::scratch_len(samples);
        if self.scratch.len() < scratch {
            self.scratch.resize(scratch, 0.0);
        }
    }
}

/// What an instruction may read.
struct Operands<'a> {
    trace: &'a Trace,
    buffers: &'a [Vec<f64>],
    samples: usize,
}

impl<'a> Operands<'a> {
    fn signal(&self, place: Place) -> &'a [f64] {
        match place {
            Place::Column(column) => &self.trace.column(column)[..self.samples],
            Place::Buffer(buffer) => &self.buffers[buffer][..self.samples],
        }
    }

    fn values(&self, source: Source) -> Values<'a> {
        match source {
            Source::Constant(value) => Values::Constant(value),
            Source::Place(place) => Values::Signal(self.signal(place)),
        }
    }

    fn minimum(&self, subformula: &Subformula) -> SubformulaMinimum {
        let covered = subformula.reach.covered(self.samples);
        let first = covered.start;
        match self.values(subformula.values) {
            Values::Signal(values) => SubformulaMinimum::of(values[covered].iter().copied(), first),
            Values::Constant(value) => SubformulaMinimum::of(covered.take(1).map(|_| value), first),
        }
    }

    fn act(
        &self,
        action: Action,
        out: &mut [f64],
        scratch: &mut [f64],
        clock: &Clock,
    ) -> Result<(), MonitorError> {
        match action {
            Action::Load(Source::Constant(value)) => out.fill(value),
            Action::Load(Source::Place(place)) => out.copy_from_slice(self.signal(place)),
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
            Action::Along(operator, window, x) => along(operator, window, self.signal(x), out, scratch),
            Action::Between(operator, window, x, y) => {
                between(operator, window, self.signal(x), self.signal(y), out, scratch);
            }
        }
        Ok(())
    }
}

/// Temporal operators of one operand.
fn along(operator: Operator, window: Window, x: &[f64], out: &mut [f64], scratch: &mut [f64]) {
    match operator {
        Operator::Always => extremum::ahead::<Least>(x, window, out, scratch),
        Operator::Eventually => extremum::ahead::<Greatest>(x, window, out, scratch),
        Operator::Historically => extremum::behind::<Least>(x, window, out, scratch),
        Operator::Once => extremum::behind::<Greatest>(x, window, out, scratch),
        Operator::Next => next(x, f64::INFINITY, out),
        Operator::StrongNext => next(x, f64::NEG_INFINITY, out),
        Operator::Previous => previous(x, f64::INFINITY, out),
        Operator::StrongPrevious => previous(x, f64::NEG_INFINITY, out),
        Operator::Rise => edge(x, out, |before, now| Least::pick(-before, now), f64::NEG_INFINITY),
        Operator::Fall => edge(x, out, |before, now| Least::pick(before, -now), f64::INFINITY),
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

/// Temporal operators of two operands.
fn between(operator: Operator, window: Window, x: &[f64], y: &[f64], out: &mut [f64], scratch: &mut [f64]) {
    match operator {
        Operator::Until => until::until::<Greatest>(x, y, window, out, scratch),
        Operator::Release => until::until::<Least>(x, y, window, out, scratch),
        Operator::Since => until::since::<Greatest>(x, y, window, out, scratch),
        Operator::Unless => {
            until::until::<Greatest>(x, y, window, out, scratch);
            let (held, scratch) = scratch.split_at_mut(x.len());
            extremum::ahead::<Least>(x, Window { begin: 0, end: window.end }, held, scratch);
            out.iter_mut().zip(held).for_each(|(out, held)| *out = Greatest::pick(*out, *held));
        }
        _ => unreachable!("{operator:?} is compiled to another kind of instruction"),
    }
}

fn next(x: &[f64], past_the_end: f64, out: &mut [f64]) {
    let last = x.len() - 1;
    out[..last].copy_from_slice(&x[1..]);
    out[last] = past_the_end;
}

fn previous(x: &[f64], before_the_begin: f64, out: &mut [f64]) {
    out[0] = before_the_begin;
    out[1..].copy_from_slice(&x[..x.len() - 1]);
}

fn edge(x: &[f64], out: &mut [f64], value: impl Fn(f64, f64) -> f64, before_the_begin: f64) {
    out[0] = value(before_the_begin, x[0]);
    for (out, pair) in out[1..].iter_mut().zip(x.windows(2)) {
        *out = value(pair[0], pair[1]);
    }
}

/// Finds the first sample where arithmetic has no finite value, if its operands are finite, or no value at all.
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
