//! Monitors in dense time.

use super::decisive::DenseDiagnosis;
use super::error::DenseError;
use super::evaluation::Evaluation;
use super::log::Log;
use super::robustness::DenseRobustness;
use super::signal::DenseSignal;
use super::time::{MAX_SECONDS, Ticks, UNBOUNDED, bound_ticks, seconds, ticks};
use crate::clock::{Bound, Interval, TimeUnit};
use crate::formula::{Formula, Node};
use crate::monitor::Windows;
use crate::operator::Operator;
use crate::program::columns;

/// Computes the robustness of a formula in dense time.
///
/// Signals have samples at any times, each signal at its own, and an
/// [`Interpolation`](super::Interpolation) between them. The robustness is a function of time, and
/// it is exact: nothing is sampled.
///
/// # Semantics
/// It is that of RTAMT 0.4.10's dense-time offline monitor for values that hold until the next
/// sample:
///
/// ```text
/// ρ(always[a:b] φ, t)  = inf ρ(φ, t′) over t′ in [t+a, t+b]      eventually: sup; historically, once: [t-b, t-a]
/// ρ(φ until[a:b] ψ, t) = sup over t′ in [t+a, t+b] of min(ρ(ψ, t′), inf ρ(φ, s) over s in [t, t′])
/// ρ(φ since[a:b] ψ, t) = sup over t′ in [t-b, t-a] of min(ρ(ψ, t′), inf ρ(φ, s) over s in [t′, t])
/// ```
///
/// Unlike in discrete time, `until` and `since` need the left operand at t′ itself. The other
/// definitions, and the verdict of a zero, are those of [`Monitor`](crate::Monitor). An extremum
/// that is a limit and no value counts as one. Where a line crosses zero, the verdict of that
/// instant is not stated.
///
/// # Ends of the log
/// Windows are cut where an operand ends, and the extremum over an empty window is infinite, as in
/// discrete time. RTAMT holds the last values forever instead.
/// [`DenseMonitor::decided_robustness_signal`] uses no cut window.
///
/// Held values hold until the end of the log, which is the last sample of all signals that the
/// formula reads. A linear signal ends at its last sample. An operator has a value where all of its
/// operands have one.
///
/// With signals that hold and have samples at 0, T, 2T, …, and bounds that are multiples of T, the
/// values at the samples equal those of [`Monitor`](crate::Monitor), for all operators but `until`,
/// `since`, `release` and `unless`.
///
/// # Operators
/// A bound is a time. `next`, `prev`, `s_next`, `s_prev`, `rise` and `fall` read neighboring
/// samples and are errors. With linear signals, products and quotients of two such signals, `sqrt`,
/// `exp`, `ln` and `pow` are errors, since the result is not piecewise linear; a factor or divisor
/// that holds is allowed. With signals that hold, all arithmetic is.
///
/// # Times
/// Times and bounds are decimals inside, with 24 decimals in seconds: 0.8 - 0.1 is 0.7. Times of
/// crossings are rounded like a product of `f64`.
///
/// # Cost
/// Time and memory are linear in the number n of breakpoints of the operands, for each operator and
/// all bounds. An extremum of two lines adds at most one breakpoint between two others, a window at
/// most twice two. Constant pieces have no breakpoints inside.
///
/// # Example
/// ```
/// use mishandle_stl::{DenseMonitor, DenseSignal, Formula, Interpolation};
///
/// let force = DenseSignal::new("force", vec![0.0, 1.0, 4.0], vec![0.0, 2.0, 0.5], Interpolation::Linear).unwrap();
/// let formula = Formula::parse("eventually[0:2s](force >= 1)").unwrap();
/// let monitor = DenseMonitor::new(&formula, &["force".to_owned()], None).unwrap();
/// assert_eq!(monitor.robustness(&[force.clone()]).unwrap(), 1.0); // 2 N at 1 s
///
/// let robustness = monitor.robustness_signal(&[force.clone()]).unwrap();
/// assert_eq!(robustness.at(2.0), Some(0.5)); // it falls from 1.5 N
/// assert_eq!(robustness.at(3.5), Some(-0.25)); // the window [3.5, 5.5] is cut at 4 s
/// let decided = monitor.decided_robustness_signal(&[force]).unwrap();
/// assert_eq!(decided.domain(), Some((0.0, 2.0)));
/// ```
///
/// # Reference
/// Donzé, Ferrère and Maler, "Efficient robust monitoring for STL", CAV 2013.
#[derive(Clone, Debug)]
pub struct DenseMonitor {
    formula: Formula,
    /// The window of each node, `[0, UNBOUNDED]` for those without an interval.
    windows: Vec<[Ticks; 2]>,
    /// The time after t that the value at t depends on, at least [`UNBOUNDED`] if that is all.
    ahead: Ticks,
}

impl DenseMonitor {
    /// Compiles `formula` for signals with these names. Bounds without a unit are in `unit`.
    ///
    /// # Errors
    /// If `names` lacks a signal of the formula or contains a name that the formula defines, a
    /// bound other than 0 and `inf` has no unit, or an operator has no meaning in dense time.
    pub fn new(
        formula: &Formula,
        names: &[String],
        unit: Option<TimeUnit>,
    ) -> Result<DenseMonitor, DenseError> {
        columns(formula, names)?;
        let windows: Result<Vec<_>, _> = formula.nodes.iter().map(|node| node_window(node, unit)).collect();
        let windows = windows?;
        let ahead = ahead(formula, &windows);
        Ok(DenseMonitor { formula: formula.clone(), windows, ahead })
    }

    /// Returns the time after t that the value at t depends on, s; `None` if it depends on all
    /// later values.
    pub fn horizon(&self) -> Option<f64> {
        // A bounded past window around an unbounded one subtracts from it.
        (self.ahead < UNBOUNDED / 2).then(|| seconds(self.ahead))
    }

    /// Returns the robustness at the first time at which all signals of the formula have a value.
    /// Windows are cut at the end of the log. Later samples than the horizon's are not read.
    ///
    /// # Errors
    /// If a signal of the formula is missing, the signals have no time in common, arithmetic leaves
    /// the piecewise-linear functions or has no finite value.
    pub fn robustness(&self, signals: &[DenseSignal]) -> Result<f64, DenseError> {
        self.at_start(signals, Windows::Cut)?.robustness()
    }

    /// Returns the robustness at all times from the first one at which all signals of the formula
    /// have a value. Windows are cut at the end of the log.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn robustness_signal(&self, signals: &[DenseSignal]) -> Result<DenseRobustness, DenseError> {
        self.whole(signals, Windows::Cut)?.signal()
    }

    /// Returns the robustness at the times at which the log decides the formula, without a cut
    /// window. It is empty if there is no such time.
    ///
    /// As in [`Monitor::decided_robustness_signal`](crate::Monitor::decided_robustness_signal),
    /// every bounded window ahead is inside the log, and a window without an end closes at the last
    /// time at which its operands are decided. Windows of past operators are cut at the start of
    /// the log.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn decided_robustness_signal(&self, signals: &[DenseSignal]) -> Result<DenseRobustness, DenseError> {
        self.whole(signals, Windows::Whole)?.signal()
    }

    /// Returns [`DenseMonitor::robustness_signal`], or
    /// [`DenseMonitor::decided_robustness_signal`] with whole windows, at the times from `start` to
    /// `end`, s. Later samples than those that these values depend on are not read.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn robustness_within(
        &self,
        signals: &[DenseSignal],
        start: f64,
        end: f64,
        windows: Windows,
    ) -> Result<DenseRobustness, DenseError> {
        let log = Log::new(&self.formula, signals)?;
        let [start, end] = [start, end].map(|time| ticks(time.clamp(-MAX_SECONDS, MAX_SECONDS)));
        let until = end.max(log.first).saturating_add(self.ahead);
        let evaluation = Evaluation::new(&self.formula, &self.windows, log, windows, until)?;
        Ok(evaluation.signal()?.within(start, end))
    }

    /// Returns which predicate determines [`DenseMonitor::robustness`], and when.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{DenseMonitor, DenseSignal, Formula, Interpolation};
    ///
    /// let force = DenseSignal::new("force", vec![0.0, 1.0, 4.0], vec![0.0, 2.0, 0.5], Interpolation::Linear).unwrap();
    /// let formula = Formula::parse("always(force <= 1 or force >= 0)").unwrap();
    /// let monitor = DenseMonitor::new(&formula, &["force".to_owned()], None).unwrap();
    /// let predicate = monitor.diagnose(&[force]).unwrap().predicate.unwrap();
    /// assert_eq!((predicate.text.as_str(), predicate.time), ("force <= 1", 0.25));
    /// assert_eq!((predicate.values, predicate.robustness), ([0.5, 1.0], 0.5));
    /// ```
    pub fn diagnose(&self, signals: &[DenseSignal]) -> Result<DenseDiagnosis, DenseError> {
        self.at_start(signals, Windows::Cut)?.diagnosis()
    }

    /// Returns the diagnosis of the first value of [`DenseMonitor::decided_robustness_signal`];
    /// `None` if the log does not decide the formula at its first time.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn diagnose_decided(&self, signals: &[DenseSignal]) -> Result<Option<DenseDiagnosis>, DenseError> {
        let evaluation = self.at_start(signals, Windows::Whole)?;
        evaluation.is_decided().then(|| evaluation.diagnosis()).transpose()
    }

    /// Returns whether [`DenseMonitor::robustness`] contains a window that is cut at the end of the
    /// log.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn cuts_windows(&self, signals: &[DenseSignal]) -> Result<bool, DenseError> {
        Ok(self.whole(signals, Windows::Whole)?.would_cut())
    }

    /// Returns the evaluation at all times.
    fn whole<'a>(
        &'a self,
        signals: &'a [DenseSignal],
        windows: Windows,
    ) -> Result<Evaluation<'a>, DenseError> {
        let log = Log::new(&self.formula, signals)?;
        Evaluation::new(&self.formula, &self.windows, log, windows, Ticks::MAX)
    }

    /// Returns the evaluation at the first time.
    fn at_start<'a>(
        &'a self,
        signals: &'a [DenseSignal],
        windows: Windows,
    ) -> Result<Evaluation<'a>, DenseError> {
        let log = Log::new(&self.formula, signals)?;
        let until = log.first.saturating_add(self.ahead);
        Evaluation::new(&self.formula, &self.windows, log, windows, until)
    }
}

/// Returns the window of a node in ticks.
fn node_window(node: &Node, unit: Option<TimeUnit>) -> Result<[Ticks; 2], DenseError> {
    let Node::Apply(operator, interval) = *node else { return Ok([0, UNBOUNDED]) };
    if operator.is_temporal() && !operator.takes_interval() {
        return Err(DenseError::NoNeighbor { operator: operator.name() });
    }
    let Some(Interval { begin, end }) = interval else { return Ok([0, UNBOUNDED]) };
    let to_ticks = |bound: Bound| match bound.unit.or(unit) {
        Some(unit) => Ok(bound_ticks(bound, unit)),
        None if bound.value == 0.0 => Ok(0),
        None if bound.value.is_infinite() => Ok(UNBOUNDED),
        None => Err(DenseError::NoUnit { operator: operator.name(), bound: bound.to_string() }),
    };
    Ok([to_ticks(begin)?, to_ticks(end)?])
}

/// Returns the time after t that the value at t depends on.
fn ahead(formula: &Formula, windows: &[[Ticks; 2]]) -> Ticks {
    let mut stack: Vec<Ticks> = Vec::new();
    for (node, [begin, end]) in formula.nodes.iter().zip(windows) {
        let result = match *node {
            Node::Apply(operator, _) => {
                let last = stack.pop().unwrap_or(0);
                let first = if operator.arity() == 2 { stack.pop().unwrap_or(0) } else { 0 };
                let both = first.max(last);
                match operator {
                    Operator::Always
                    | Operator::Eventually
                    | Operator::Until
                    | Operator::Release
                    | Operator::Unless => both.saturating_add(*end),
                    Operator::Historically | Operator::Once => (last - begin).max(0),
                    Operator::Since => first.max(last - begin),
                    _ => both,
                }
            }
            _ => 0,
        };
        stack.push(result);
    }
    stack.pop().unwrap_or(0)
}
