//! The evaluation of a formula on a log, from the leaves to the root.

use super::arithmetic::{binary, unary};
use super::error::DenseError;
use super::log::Log;
use super::pick::pick;
use super::piecewise::Piecewise;
use super::robustness::DenseRobustness;
use super::signal::Interpolation;
use super::time::{Ticks, UNBOUNDED, ticks};
use super::until::until;
use super::window::window;
use crate::extremum::{Maximum, Minimum};
use crate::formula::{Formula, Node};
use crate::monitor::Windows;
use crate::operator::Operator;

/// A formula on a log, up to a time.
pub(crate) struct Evaluation<'a> {
    pub formula: &'a Formula,
    /// The first node of the sub-formula of each node.
    pub starts: Vec<usize>,
    /// The window of each node.
    pub windows: &'a [[Ticks; 2]],
    pub log: Log<'a>,
    /// Later values are not read.
    until: Ticks,
    /// The times at which each node has a value.
    pub extents: Vec<Extent>,
    /// The [bare numbers](Formula::bare_numbers).
    is_bare: Vec<bool>,
}

/// The times at which a sub-formula has a value.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    /// It has none if the end is before the start.
    pub start: Ticks,
    pub end: Ticks,
    /// The end if windows are cut.
    pub log_end: Ticks,
    /// Whether it is constant between knots.
    is_steps: bool,
}

impl<'a> Evaluation<'a> {
    /// Checks that all arithmetic is piecewise linear.
    pub(crate) fn new(
        formula: &'a Formula,
        windows: &'a [[Ticks; 2]],
        log: Log<'a>,
        at_end: Windows,
        until: Ticks,
    ) -> Result<Evaluation<'a>, DenseError> {
        let starts = formula.starts();
        let mut extents: Vec<Extent> = Vec::with_capacity(formula.nodes.len());
        for (index, node) in formula.nodes.iter().enumerate() {
            extents.push(match *node {
                Node::Constant(_) => Extent::new(log.start, log.end.min(until), true),
                Node::Signal(signal) => {
                    let signal = log.signals[signal as usize];
                    let is_steps = signal.interpolation() == Interpolation::Hold;
                    let end = if is_steps { log.end } else { ticks(signal.end()) };
                    Extent::new(ticks(signal.start()), end.min(until), is_steps)
                }
                Node::Apply(operator, _) => {
                    let last = extents[index - 1];
                    let first = extents[formula.operands(index, &starts)[0]];
                    if !is_linear(operator, first, last) {
                        let text = |f: &mut std::fmt::Formatter<'_>| {
                            formula.write_node(f, Operator::name, index, &starts)
                        };
                        return Err(DenseError::NotLinear { term: std::fmt::from_fn(text).to_string() });
                    }
                    Extent::of(operator, windows[index], first, last, at_end)
                }
            });
        }
        let is_bare = formula.bare_numbers();
        Ok(Evaluation { formula, starts, windows, log, until, extents, is_bare })
    }

    /// Returns the robustness of the formula.
    pub(crate) fn signal(&self) -> Result<DenseRobustness, DenseError> {
        Ok(DenseRobustness::new(self.function(self.formula.nodes.len() - 1)?))
    }

    /// Returns the values of a node.
    pub(crate) fn function(&self, node: usize) -> Result<Piecewise, DenseError> {
        let mut stack: Vec<Piecewise> = Vec::new();
        for index in self.starts[node]..=node {
            let result = match self.formula.nodes[index] {
                Node::Constant(value) => {
                    Piecewise::constant(value, self.extents[index].start, self.extents[index].end)
                }
                Node::Signal(signal) => self.log.signals[signal as usize].piecewise(self.log.end, self.until),
                Node::Apply(operator, _) => {
                    // The parser guarantees the operands of every operator.
                    let Some(last) = stack.pop() else { return Err(DenseError::NoSignals) };
                    let first = if operator.arity() == 2 { stack.pop() } else { None };
                    let Extent { start, end, .. } = self.extents[index];
                    apply(operator, self.windows[index], first, last, [start, end])?
                }
            };
            // −0.0 + 0.0 is 0.0; other numbers stay.
            stack.push(if self.is_bare[index] { result.map(|value| value + 0.0) } else { result });
        }
        Ok(stack.pop().unwrap_or_default())
    }

    /// Returns whether the value at the first time contains a window that is cut at the end of the
    /// log. The evaluation must be one of whole windows.
    pub(crate) fn would_cut(&self) -> bool {
        let is_cut = |node: usize| {
            let Node::Apply(operator, _) = self.formula.nodes[node] else { return false };
            let is_ahead = matches!(
                operator,
                Operator::Always
                    | Operator::Eventually
                    | Operator::Until
                    | Operator::Release
                    | Operator::Unless
            );
            let is_short = |operand: usize| self.extents[operand].end < self.extents[operand].log_end;
            is_ahead
                && self.windows[node][1] >= UNBOUNDED
                && self.formula.operands(node, &self.starts).into_iter().any(is_short)
        };
        let root = self.formula.nodes.len() - 1;
        self.extents[root].end < self.log.first || (0..=root).any(is_cut)
    }
}

impl Extent {
    fn new(start: Ticks, end: Ticks, is_steps: bool) -> Extent {
        Extent { start, end, log_end: end, is_steps }
    }

    /// Returns the extent of an operator; `first` equals `last` for a unary one.
    fn of(
        operator: Operator,
        [begin, end]: [Ticks; 2],
        first: Extent,
        last: Extent,
        windows: Windows,
    ) -> Extent {
        // The time of the operands that must be known after t.
        let ahead = match windows {
            Windows::Cut => 0,
            Windows::Whole if end >= UNBOUNDED => begin,
            Windows::Whole => end,
        };
        let common = first.end.min(last.end);
        let log_end = first.log_end.min(last.log_end);
        let stop = match operator {
            Operator::Always
            | Operator::Eventually
            | Operator::Until
            | Operator::Release
            | Operator::Unless => earlier(common, ahead),
            Operator::Historically | Operator::Once => last.end.saturating_add(begin).min(log_end),
            Operator::Since => first.end.min(last.end.saturating_add(begin)).min(log_end),
            _ => common,
        };
        let is_steps = first.is_steps && last.is_steps;
        Extent { start: first.start.max(last.start), end: stop, log_end, is_steps }
    }
}

/// Returns whether the result of an operator is piecewise linear.
fn is_linear(operator: Operator, first: Extent, last: Extent) -> bool {
    match operator {
        Operator::Multiply => first.is_steps || last.is_steps,
        Operator::Divide | Operator::Sqrt | Operator::Exp | Operator::Ln => last.is_steps,
        Operator::Pow => first.is_steps && last.is_steps,
        _ => true,
    }
}

/// Returns a time minus a bound, within the range in which times can be negated.
fn earlier(time: Ticks, bound: Ticks) -> Ticks {
    time.saturating_sub(bound).max(-UNBOUNDED)
}

/// Applies an operator; the result of one over time has this domain.
fn apply(
    operator: Operator,
    [begin, end]: [Ticks; 2],
    first: Option<Piecewise>,
    x: Piecewise,
    domain: [Ticks; 2],
) -> Result<Piecewise, DenseError> {
    let Some(p) = first else {
        return Ok(match operator {
            Operator::Always => window::<Minimum>(&x, [begin, end], domain),
            Operator::Eventually => window::<Maximum>(&x, [begin, end], domain),
            Operator::Historically => window::<Minimum>(&x, [-end, -begin], domain),
            Operator::Once => window::<Maximum>(&x, [-end, -begin], domain),
            _ => unary(operator, x)?,
        });
    };
    let q = x;
    Ok(match operator {
        Operator::Until => until(&p, &q, [begin, end], domain),
        Operator::Release => {
            let p = p.map(|p| -p);
            let q = q.map(|q| -q);
            until(&p, &q, [begin, end], domain).map(|result| -result)
        }
        Operator::Since => {
            let reversed = [-domain[1], -domain[0]];
            until(&p.reversed(), &q.reversed(), [begin, end], reversed).reversed()
        }
        Operator::Unless => {
            let held = window::<Minimum>(&p, [0, end], domain);
            pick::<Maximum>(&held, &until(&p, &q, [begin, end], domain))
        }
        _ => binary(operator, p, q)?,
    })
}
