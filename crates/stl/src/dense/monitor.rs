//! Monitors in dense time.

use super::arithmetic::{binary, unary};
use super::error::DenseError;
use super::pick::pick;
use super::piecewise::Piecewise;
use super::robustness::DenseRobustness;
use super::signal::{DenseSignal, Interpolation};
use super::time::{Ticks, UNBOUNDED, bound_ticks, seconds, ticks};
use super::until::until;
use super::window::window;
use crate::clock::{Bound, Interval, TimeUnit};
use crate::extremum::{Maximum, Minimum};
use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::program::columns;

/// Computes the robustness of a formula in dense time.
///
/// Signals have samples at any times, each signal at its own, and an [`Interpolation`] between
/// them. The robustness is a function of time, and it is exact: nothing is sampled.
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
        let log = Log::new(&self.formula, signals)?;
        let until = log.first.saturating_add(self.ahead);
        let result = self.evaluate(&log, Windows::Cut, until)?;
        result.first().ok_or(DenseError::NoSignals)
    }

    /// Returns the robustness at all times from the first one at which all signals of the formula
    /// have a value. Windows are cut at the end of the log.
    ///
    /// # Errors
    /// As for [`DenseMonitor::robustness`].
    pub fn robustness_signal(&self, signals: &[DenseSignal]) -> Result<DenseRobustness, DenseError> {
        self.evaluate(&Log::new(&self.formula, signals)?, Windows::Cut, Ticks::MAX)
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
        self.evaluate(&Log::new(&self.formula, signals)?, Windows::Whole, Ticks::MAX)
    }

    /// Computes the robustness from the values up to `until`.
    fn evaluate(&self, log: &Log<'_>, windows: Windows, until: Ticks) -> Result<DenseRobustness, DenseError> {
        let signals: Vec<Operand> =
            log.signals.iter().map(|signal| Operand::new(signal, log, until)).collect();
        let starts = self.formula.starts();
        let mut stack: Vec<Operand> = Vec::new();
        for (index, node) in self.formula.nodes.iter().enumerate() {
            let result = match *node {
                Node::Constant(value) => log.constant(value, until),
                Node::Signal(signal) => signals[signal as usize].clone(),
                Node::Apply(operator, _) => {
                    // The parser guarantees the operands of every operator.
                    let Some(last) = stack.pop() else { return Err(DenseError::NoSignals) };
                    let first = if operator.arity() == 2 { stack.pop() } else { None };
                    if !is_linear(operator, first.as_ref(), &last) {
                        let text = |f: &mut std::fmt::Formatter<'_>| {
                            self.formula.write_node(f, Operator::name, index, &starts)
                        };
                        return Err(DenseError::NotLinear { term: std::fmt::from_fn(text).to_string() });
                    }
                    apply(operator, self.windows[index], first, last, windows)?
                }
            };
            stack.push(result);
        }
        Ok(DenseRobustness::new(stack.pop().map(|result| result.function).unwrap_or_default()))
    }
}

/// The treatment of windows at the end of the log.
#[derive(Clone, Copy, PartialEq)]
enum Windows {
    /// They are cut.
    Cut,
    /// A value whose windows would be cut is not computed.
    Whole,
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

/// The signals that a formula reads.
struct Log<'a> {
    /// In the order of the formula's signals.
    signals: Vec<&'a DenseSignal>,
    /// The first and last time of all signals.
    start: Ticks,
    end: Ticks,
    /// The first time at which all signals have a value.
    first: Ticks,
}

impl<'a> Log<'a> {
    fn new(formula: &Formula, all: &'a [DenseSignal]) -> Result<Log<'a>, DenseError> {
        let names: Vec<String> = all.iter().map(|signal| signal.name().to_owned()).collect();
        let read: Vec<&DenseSignal> =
            columns(formula, &names)?.iter().map(|(index, _)| &all[*index]).collect();
        // A formula without signals has its value at the times of all of them.
        let timed: Vec<&DenseSignal> = if read.is_empty() { all.iter().collect() } else { read.clone() };
        let by_start = |a: &&&DenseSignal, b: &&&DenseSignal| a.start().total_cmp(&b.start());
        let by_end = |a: &&&DenseSignal, b: &&&DenseSignal| a.end().total_cmp(&b.end());
        let (Some(earliest), Some(latest)) = (timed.iter().min_by(by_start), timed.iter().max_by(by_end))
        else {
            return Err(DenseError::NoSignals);
        };
        let late = read.iter().max_by(by_start);
        let early =
            read.iter().filter(|signal| signal.interpolation() == Interpolation::Linear).min_by(by_end);
        if let (Some(late), Some(early)) = (late, early)
            && late.start() > early.end()
        {
            return Err(DenseError::NoCommonTime {
                late: late.name().to_owned(),
                start: late.start(),
                early: early.name().to_owned(),
                end: early.end(),
            });
        }
        let first = late.map_or(earliest.start(), |late| late.start());
        let (start, end) = (ticks(earliest.start()), ticks(latest.end()));
        Ok(Log { signals: read, start, end, first: ticks(first) })
    }

    /// Returns a constant operand.
    fn constant(&self, value: f64, until: Ticks) -> Operand {
        let (start, end) = (self.start, self.end.min(until));
        Operand { function: Piecewise::constant(value, start, end), start, end, log_end: end, is_steps: true }
    }
}

/// The values of a sub-formula.
#[derive(Clone)]
struct Operand {
    function: Piecewise,
    /// The domain of the function, which is empty if the end is before the start.
    start: Ticks,
    end: Ticks,
    /// The end of the domain if windows are cut.
    log_end: Ticks,
    /// Whether it is constant between knots.
    is_steps: bool,
}

impl Operand {
    fn new(signal: &DenseSignal, log: &Log<'_>, until: Ticks) -> Operand {
        let function = signal.piecewise(log.end, until);
        let (start, end) = function.domain().unwrap_or((log.start, log.start - 1));
        let is_steps = signal.interpolation() == Interpolation::Hold;
        Operand { function, start, end, log_end: end, is_steps }
    }
}

/// Returns whether the result of an operator is piecewise linear.
fn is_linear(operator: Operator, first: Option<&Operand>, last: &Operand) -> bool {
    let is_first_steps = first.is_none_or(|first| first.is_steps);
    match operator {
        Operator::Multiply => is_first_steps || last.is_steps,
        Operator::Divide | Operator::Sqrt | Operator::Exp | Operator::Ln => last.is_steps,
        Operator::Pow => is_first_steps && last.is_steps,
        _ => true,
    }
}

/// Returns a time minus a bound, within the range in which times can be negated.
fn earlier(time: Ticks, bound: Ticks) -> Ticks {
    time.saturating_sub(bound).max(-UNBOUNDED)
}

/// Applies an operator.
fn apply(
    operator: Operator,
    [begin, end]: [Ticks; 2],
    first: Option<Operand>,
    last: Operand,
    windows: Windows,
) -> Result<Operand, DenseError> {
    // The time of the operands that must be known after t.
    let ahead = match windows {
        Windows::Cut => 0,
        Windows::Whole if end >= UNBOUNDED => begin,
        Windows::Whole => end,
    };
    let Some(first) = first else {
        let Operand { function: x, start, end: known, log_end, is_steps } = last;
        let domain = match operator {
            Operator::Always | Operator::Eventually => [start, earlier(known, ahead)],
            Operator::Historically | Operator::Once => [start, known.saturating_add(begin).min(log_end)],
            _ => [start, known],
        };
        let function = match operator {
            Operator::Always => window::<Minimum>(&x, [begin, end], domain),
            Operator::Eventually => window::<Maximum>(&x, [begin, end], domain),
            Operator::Historically => window::<Minimum>(&x, [-end, -begin], domain),
            Operator::Once => window::<Maximum>(&x, [-end, -begin], domain),
            _ => unary(operator, x)?,
        };
        return Ok(Operand { function, start, end: domain[1], log_end, is_steps });
    };
    let (start, log_end) = (first.start.max(last.start), first.log_end.min(last.log_end));
    let common = first.end.min(last.end);
    let is_steps = first.is_steps && last.is_steps;
    let stop = match operator {
        Operator::Until | Operator::Release | Operator::Unless => earlier(common, ahead),
        Operator::Since => first.end.min(last.end.saturating_add(begin)).min(log_end),
        _ => common,
    };
    let domain = [start, stop];
    let (p, q) = (first.function, last.function);
    let function = match operator {
        Operator::Until => until(&p, &q, [begin, end], domain),
        Operator::Release => {
            let (p, q) = (p.map(|p| -p), q.map(|q| -q));
            until(&p, &q, [begin, end], domain).map(|result| -result)
        }
        Operator::Since => until(&p.reversed(), &q.reversed(), [begin, end], [-stop, -start]).reversed(),
        Operator::Unless => {
            let held = window::<Minimum>(&p, [0, end], domain);
            pick::<Maximum>(&held, &until(&p, &q, [begin, end], domain))
        }
        _ => binary(operator, p, q)?,
    };
    Ok(Operand { function, start, end: stop, log_end, is_steps })
}
