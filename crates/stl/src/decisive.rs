//! The operand and sample that determine the robustness of an operator at a sample.
//!
//! The value of an operator over time at one sample is found in one pass over its window. The
//! values of its operands are computed some at a time, so that a long window takes no memory.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::moment::{Choice, Found, Held, Least, Moments, Values, is_less, offer};
use crate::monitor::{Monitor, Windows};
use crate::operator::Operator;
use crate::pointwise::{Undefined, apply_once};
use crate::program::{columns, undecided};
use crate::span::chunks;
use crate::state::TILE;
use crate::subformula::Reach;
use crate::trace::Trace;
use std::ops::{Range, RangeInclusive};

/// The syntax tree of a formula, with the trace and clock that its nodes are evaluated with.
pub(crate) struct Tree<'a> {
    formula: &'a Formula,
    /// The first node of the sub-formula of each node.
    starts: Vec<usize>,
    trace: &'a Trace,
    clock: &'a Clock,
    windows: Windows,
    /// The column of each signal.
    columns: Vec<usize>,
    spans: Vec<Span>,
}

/// The samples that an operator reads.
#[derive(Clone, Copy)]
struct Span {
    window: Window,
    reach: Reach,
    /// The number of samples at the end of the trace at which its operands are not decided.
    undecided: usize,
}

impl<'a> Tree<'a> {
    pub(crate) fn new(
        formula: &'a Formula,
        trace: &'a Trace,
        clock: &'a Clock,
        windows: Windows,
    ) -> Result<Tree<'a>, MonitorError> {
        clock.check()?;
        if trace.is_empty() {
            return Err(MonitorError::EmptyTrace);
        }
        let columns = columns(formula, trace.names())?.into_iter().map(|(column, _)| column).collect();
        let mut spans = Vec::with_capacity(formula.nodes.len());
        let mut reaches: Vec<Reach> = Vec::new();
        for node in &formula.nodes {
            let mut span =
                Span { window: Window { begin: 0, end: 0 }, reach: Reach::default(), undecided: 0 };
            if let Node::Apply(operator, interval) = *node {
                let last = reaches.pop().unwrap_or_default();
                let first = if operator.arity() == 2 { reaches.pop().unwrap_or_default() } else { last };
                if operator.takes_interval() {
                    span.window = clock.window(operator.name(), interval)?;
                }
                span.reach = Reach::of(operator, span.window, first, last);
                span.undecided = undecided(operator, span.window, first, last, span.reach);
            }
            reaches.push(span.reach);
            spans.push(span);
        }
        Ok(Tree { formula, starts: formula.starts(), trace, clock, windows, columns, spans })
    }

    pub(crate) fn starts(&self) -> &[usize] {
        &self.starts
    }

    pub(crate) fn text(&self, node: usize) -> String {
        std::fmt::from_fn(|f| self.formula.write_node(f, Operator::name, node, &self.starts)).to_string()
    }

    /// Returns the operands of a node, left before right.
    pub(crate) fn operands(&self, node: usize) -> Vec<usize> {
        self.formula.operands(node, &self.starts)
    }

    /// Returns the number of samples at which a node has a value.
    pub(crate) fn known(&self, node: usize) -> usize {
        match self.windows {
            Windows::Cut => self.trace.len(),
            Windows::Whole => self.spans[node].reach.decided(self.trace.len()),
        }
    }

    /// Returns the first and last sample of the interval of an operator at a sample, cut at the
    /// ends of the trace; `None` if there is no interval or no such sample.
    pub(crate) fn window(&self, node: usize, sample: usize) -> Option<RangeInclusive<usize>> {
        match self.formula.nodes[node] {
            Node::Apply(operator, _) if operator.takes_interval() => self.samples(operator, node, sample),
            _ => None,
        }
    }

    fn samples(&self, operator: Operator, node: usize, sample: usize) -> Option<RangeInclusive<usize>> {
        let Window { begin, end } = self.spans[node].window;
        let range = match operator {
            Operator::Historically | Operator::Once | Operator::Since => {
                sample.saturating_sub(end)..=sample.checked_sub(begin)?
            }
            _ => sample.checked_add(begin)?..=sample.saturating_add(end).min(self.last_read(node)?),
        };
        (!range.is_empty()).then_some(range)
    }

    /// Returns the last sample at which the operands of an operator are evaluated.
    fn last_read(&self, node: usize) -> Option<usize> {
        let undecided = match self.windows {
            Windows::Cut => 0,
            Windows::Whole => self.spans[node].undecided,
        };
        self.trace.len().checked_sub(undecided + 1)
    }

    /// Returns the values of a node and the nodes below it at a sample.
    pub(crate) fn values(&self, node: usize, sample: usize) -> Result<Values<usize>, MonitorError> {
        Values::new(self, self.formula, &self.starts, node, sample)
    }

    /// Returns a monitor for the operand of a node.
    fn monitor(&self, operand: usize) -> Result<Monitor, MonitorError> {
        let nodes = &self.formula.nodes[self.starts[operand]..=operand];
        Monitor::new(&self.formula.of_nodes(nodes.iter().copied()), self.trace.names(), *self.clock)
    }

    /// Returns the least value (`sign` 1) or the greatest (`sign` -1) of the operand in a range.
    fn extreme(
        &self,
        node: usize,
        range: Option<RangeInclusive<usize>>,
        sign: f64,
    ) -> Result<Found<usize>, MonitorError> {
        let Some(range) = range else { return Ok((sign * f64::INFINITY, None)) };
        let mut monitor = self.monitor(node - 1)?;
        let mut least = Least::default();
        for chunk in chunks(half_open(&range), monitor.chunk_len()) {
            let first = chunk.start;
            least.add_all(monitor.values_at(self.trace, chunk, self.windows)?, first, sign);
        }
        Ok(least.found.map_or((sign * f64::INFINITY, None), |(value, sample)| {
            (sign * value, Some(Choice::at(0, sample)))
        }))
    }

    /// Returns the value of the operand at a neighboring sample, or `outside` of the trace.
    fn neighbor(
        &self,
        node: usize,
        sample: Option<usize>,
        outside: f64,
    ) -> Result<Found<usize>, MonitorError> {
        let Some(sample) = sample.filter(|sample| *sample < self.known(node - 1)) else {
            return Ok((outside, None));
        };
        let value = self.monitor(node - 1)?.values_at(self.trace, sample..sample + 1, self.windows)?[0];
        Ok((value, Some(Choice::at(0, sample))))
    }

    /// Returns the value of `rise` (`sign` 1) or `fall` (`sign` -1).
    fn edge(&self, node: usize, t: usize, sign: f64) -> Result<Found<usize>, MonitorError> {
        let mut monitor = self.monitor(node - 1)?;
        let values = monitor.values_at(self.trace, t.saturating_sub(1)..t + 1, self.windows)?;
        let choice = |is_negated, sample| Choice { operand: 0, time: sample, is_negated };
        Ok(match *values {
            [before, now] if is_less(-sign * before, sign * now) => {
                (-sign * before, Some(choice(sign > 0.0, t - 1)))
            }
            [.., now] => (sign * now, Some(choice(sign < 0.0, t))),
            [] => (f64::NAN, None),
        })
    }

    /// Returns the value of `until` (`sign` 1) or `release` (`sign` -1) at `t`.
    fn until(
        &self,
        node: usize,
        range: Option<RangeInclusive<usize>>,
        t: usize,
        sign: f64,
    ) -> Result<Found<usize>, MonitorError> {
        let Some(range) = range else { return Ok((-sign * f64::INFINITY, None)) };
        let (_, best) = self.held(node, t..*range.end(), half_open(&range), false, sign)?;
        Ok(best.map_or((-sign * f64::INFINITY, None), |(value, choice)| (sign * value, Some(choice))))
    }

    fn unless(
        &self,
        node: usize,
        range: Option<&RangeInclusive<usize>>,
        t: usize,
    ) -> Result<Found<usize>, MonitorError> {
        let left = self.operands(node)[0];
        let end = t.saturating_add(self.spans[node].window.end).saturating_add(1).min(self.known(left));
        let right = range.map_or(t..t, half_open);
        let (held, best) = self.held(node, t..end, right, false, 1.0)?;
        Ok(match (held.found, best) {
            (Some((held, sample)), best) if best.is_none_or(|(value, _)| !is_less(held, value)) => {
                (held, Some(Choice::at(0, sample)))
            }
            (_, best) => best.map_or((f64::INFINITY, None), |(value, choice)| (value, Some(choice))),
        })
    }

    fn since(
        &self,
        node: usize,
        range: Option<RangeInclusive<usize>>,
        t: usize,
    ) -> Result<Found<usize>, MonitorError> {
        let Some(range) = range else { return Ok((f64::NEG_INFINITY, None)) };
        let (_, best) = self.held(node, *range.start() + 1..t + 1, half_open(&range), true, 1.0)?;
        Ok(best.map_or((f64::NEG_INFINITY, None), |(value, choice)| (value, Some(choice))))
    }

    /// Goes through the samples in the direction of an operator. Returns the least value of its
    /// left operand at the samples `left`, and the greatest minimum of the right one at one of the
    /// samples `right` and the left one at the samples before that. `sign` -1 negates both.
    fn held(
        &self,
        node: usize,
        left: Range<usize>,
        right: Range<usize>,
        is_backward: bool,
        sign: f64,
    ) -> Result<Held<usize>, MonitorError> {
        let mut p = self.monitor(self.starts[node - 1] - 1)?;
        let mut q = self.monitor(node - 1)?;
        let length = p.chunk_len().max(q.chunk_len());
        let mut held = Least::default();
        let mut best = None;
        let all = if left.is_empty() {
            right.clone()
        } else {
            left.start.min(right.start)..left.end.max(right.end)
        };
        let mut add = |chunk: Range<usize>| {
            let inside = |of: &Range<usize>| {
                let start = chunk.start.max(of.start);
                start..chunk.end.min(of.end).max(start)
            };
            let left = inside(&left);
            let right = inside(&right);
            let values = |monitor: &mut Monitor, of: &Range<usize>| {
                if of.is_empty() {
                    Ok(Vec::new())
                } else {
                    monitor.values_at(self.trace, of.clone(), self.windows).map(<[f64]>::to_vec)
                }
            };
            let p = values(&mut p, &left)?;
            let q = values(&mut q, &right)?;
            let mut add = |sample: usize| {
                if right.contains(&sample) {
                    offer(&mut best, held.found, sign * q[sample - right.start], sample);
                }
                if left.contains(&sample) {
                    held.add(sign * p[sample - left.start], sample);
                }
            };
            if is_backward {
                chunk.rev().for_each(&mut add);
            } else {
                chunk.for_each(&mut add);
            }
            Ok(())
        };
        let mut chunks = chunks(all, length);
        if is_backward {
            chunks.rev().try_for_each(&mut add)?;
        } else {
            chunks.try_for_each(&mut add)?;
        }
        Ok((held, best))
    }
}

impl Moments for Tree<'_> {
    type Time = usize;
    type Error = MonitorError;

    fn signal(&self, signal: usize, sample: usize) -> Result<f64, MonitorError> {
        let value = self.trace.column(self.columns[signal])[sample];
        if !value.is_finite() {
            let signal = self.formula.signals[signal].clone();
            let time_secs = self.clock.time_secs(sample);
            return Err(MonitorError::NotFinite { signal, value, step: sample, time_secs });
        }
        Ok(value)
    }

    fn pointwise(&self, operator: Operator, x: f64, y: f64, step: usize) -> Result<f64, MonitorError> {
        let time_secs = self.clock.time_secs(step);
        apply_once(operator, x, y).map_err(|Undefined { operation, .. }| MonitorError::Undefined {
            operation,
            step,
            time_secs,
        })
    }

    fn temporal(&self, operator: Operator, node: usize, t: usize) -> Result<Found<usize>, MonitorError> {
        let range = self.samples(operator, node, t);
        match operator {
            Operator::Always | Operator::Historically => self.extreme(node, range, 1.0),
            Operator::Eventually | Operator::Once => self.extreme(node, range, -1.0),
            Operator::Next => self.neighbor(node, t.checked_add(1), f64::INFINITY),
            Operator::StrongNext => self.neighbor(node, t.checked_add(1), f64::NEG_INFINITY),
            Operator::Previous => self.neighbor(node, t.checked_sub(1), f64::INFINITY),
            Operator::StrongPrevious => self.neighbor(node, t.checked_sub(1), f64::NEG_INFINITY),
            Operator::Rise => self.edge(node, t, 1.0),
            Operator::Fall => self.edge(node, t, -1.0),
            Operator::Until => self.until(node, range, t, 1.0),
            Operator::Release => self.until(node, range, t, -1.0),
            Operator::Unless => self.unless(node, range.as_ref(), t),
            _ => self.since(node, range, t),
        }
    }
}

impl Least<usize> {
    /// Adds the values from the sample `first` on, times `sign`.
    fn add_all(&mut self, values: &[f64], first: usize, sign: f64) {
        for (index, tile) in values.chunks(TILE).enumerate() {
            let least = least(tile, sign);
            // Most tiles have no value that is as small.
            if self.found.is_none_or(|(known, _)| least < known || (least == 0.0 && known == 0.0)) {
                for (value, sample) in tile.iter().zip(first + index * TILE..) {
                    self.add(sign * value, sample);
                }
            }
        }
    }
}

/// Returns the least of the values times `sign`; the sign of a zero is not stated.
fn least(values: &[f64], sign: f64) -> f64 {
    let pick = |a: f64, b: f64| if a < b { a } else { b };
    let (lanes, rest) = values.as_chunks::<8>();
    let mut least = [f64::INFINITY; 8];
    for lane in lanes {
        for (least, value) in least.iter_mut().zip(lane) {
            *least = pick(sign * value, *least);
        }
    }
    let rest = rest.iter().fold(f64::INFINITY, |least, value| pick(sign * value, least));
    least.into_iter().fold(rest, pick)
}

fn half_open(range: &RangeInclusive<usize>) -> Range<usize> {
    *range.start()..range.end() + 1
}
