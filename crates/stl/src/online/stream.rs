//! The exact values of a node, in the order of the samples: a node has the value at a sample as
//! soon as the samples pushed decide it.

use super::graph::{Kind, Node};
use super::preallocated;
use super::row::Row;
use super::window::{Composition, Extrema, Function, Pick};
use crate::clock::Window;
use crate::operator::Operator;
use crate::pointwise::{self, Undefined};
use std::collections::VecDeque;
use std::ops::Range;

/// The memory of an operator about its operands.
#[derive(Clone, Debug)]
enum Memory {
    Nothing,
    /// The window of a unary operator.
    Extrema(Extrema),
    /// The extremum since the first sample.
    Fold(f64),
    /// The samples that the right operand reads, and those of the left operand before or after.
    Composition(Composition, Extrema),
    /// The value of `since` without an end, at the begin of its window.
    Since(f64, Extrema),
}

/// Exact operands of the value at time 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Accumulated {
    /// The first sample accumulated.
    pub from: usize,
    /// One past the last sample that can be accumulated.
    pub to: usize,
    /// One past the last sample accumulated.
    pub next: usize,
    /// The composition of their functions; q is the extremum for a unary operator.
    pub all: Function,
    /// The extremum of the left operand before `from`, if only time 0 reads the node.
    pub held: f64,
}

/// The state of a node.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// The number of exact values.
    pub len: usize,
    pub latest: f64,
    /// The value of a state formula at the sample that is being pushed.
    pub pushed: f64,
    recent: VecDeque<f64>,
    head: Vec<f64>,
    memory: Memory,
    pub accumulated: Option<Accumulated>,
    /// The least and greatest values at the samples without an exact value, from `len` on. The last
    /// ones hold for all later samples.
    pub low: Vec<f64>,
    pub high: Vec<f64>,
}

/// Returns the outer extremum of a temporal operator that has a window.
pub(super) fn pick(operator: Operator) -> Pick {
    match operator {
        Operator::Always | Operator::Historically | Operator::Release => Pick::Least,
        _ => Pick::Greatest,
    }
}

impl Cell {
    pub fn new(node: &Node, samples: usize) -> Cell {
        let keep = if node.keep > 1 { node.keep.min(samples) } else { 0 };
        // The bounds of nodes that wait for samples ahead, and of those after unknown samples.
        let partial = if node.is_state {
            0
        } else {
            node.reach.ahead.saturating_add(node.slack).min(node.need).saturating_add(2)
        };
        let partial = preallocated(partial);
        let mut cell = Cell {
            len: 0,
            latest: 0.0,
            pushed: 0.0,
            recent: VecDeque::with_capacity(preallocated(keep)),
            head: Vec::with_capacity(preallocated(node.head.min(samples))),
            memory: Memory::of(node, samples),
            accumulated: None,
            low: Vec::with_capacity(partial),
            high: Vec::with_capacity(partial),
        };
        cell.reset(node);
        cell
    }

    /// Removes all samples and keeps the allocated memory.
    pub fn reset(&mut self, node: &Node) {
        self.len = 0;
        self.recent.clear();
        self.head.clear();
        self.memory.clear(node);
        self.accumulated = node.operator().filter(|_| node.accumulates()).map(|(operator, window)| {
            let from = node.need.saturating_add(window.begin);
            let to = if window.is_unbounded() { usize::MAX } else { window.end.saturating_add(1) };
            let all = Function::identity(pick(operator));
            let held = pick(operator).dual().neutral();
            Accumulated { from, to, next: from, all, held }
        });
    }

    /// Saves or restores the samples. Bounds are computed again.
    pub fn visit(&mut self, row: &mut impl Row) {
        row.count(&mut self.len);
        row.number(&mut self.latest);
        row.queue(&mut self.recent, 0.0, Row::number);
        row.list(&mut self.head, 0.0, Row::number);
        match &mut self.memory {
            Memory::Nothing => {}
            Memory::Extrema(extrema) => extrema.visit(row),
            Memory::Fold(value) => row.number(value),
            Memory::Composition(all, other) => {
                all.visit(row);
                other.visit(row);
            }
            Memory::Since(value, other) => {
                row.number(value);
                other.visit(row);
            }
        }
        if let Some(accumulated) = &mut self.accumulated {
            // Small, unlike the samples, so that a number has the same value.
            let mut count = accumulated.next - accumulated.from;
            row.count(&mut count);
            accumulated.next = accumulated.from + count;
            row.function(&mut accumulated.all);
            row.number(&mut accumulated.held);
        }
    }

    /// Returns the largest number of numbers that [`visit`](Self::visit) visits in a trace of some
    /// samples.
    pub fn row_size(&self, node: &Node, samples: usize) -> usize {
        let keep = if node.keep > 1 { node.keep.min(samples) } else { 0 };
        let window = node.operator().map_or(0, |(_, window)| window.length().min(samples));
        let begin = node.operator().map_or(0, |(_, window)| window.begin.min(samples));
        // A deque has pairs of numbers and a length.
        let deque = |length: usize| 1 + 2 * (length + 1);
        let memory = match &self.memory {
            Memory::Nothing => 0,
            Memory::Extrema(_) => deque(window),
            Memory::Fold(_) => 1,
            Memory::Composition(..) => 4 + 2 * (window + 1) + deque(begin),
            Memory::Since(..) => 1 + deque(begin),
        };
        let accumulated = if self.accumulated.is_some() { 4 } else { 0 };
        4 + keep + node.head.min(samples) + memory + accumulated
    }

    /// Adds an exact value.
    #[inline]
    pub fn emit(&mut self, node: &Node, value: f64) {
        if self.head.len() < node.head && self.head.len() == self.len {
            self.head.push(value);
        }
        if node.keep > 1 {
            if self.recent.len() >= node.keep {
                self.recent.pop_front();
            }
            self.recent.push_back(value);
        }
        self.latest = value;
        self.len += 1;
    }

    /// Returns an exact value that is kept.
    #[inline]
    pub fn exact(&self, sample: usize) -> f64 {
        if sample + 1 == self.len {
            self.latest
        } else if let Some(value) = self.head.get(sample) {
            *value
        } else {
            self.recent[self.recent.len() + sample - self.len]
        }
    }

    /// Appends the exact values at some samples, which are kept.
    pub fn copy_exact(&self, samples: Range<usize>, values: &mut Vec<f64>) {
        let kept = (self.len - self.recent.len()).clamp(samples.start, samples.end);
        values.extend((samples.start..kept).map(|sample| self.exact(sample)));
        let first = self.len - self.recent.len();
        if kept < samples.end {
            values.extend(self.recent.range(kept - first..samples.end - first));
        }
    }

    /// Returns the extrema of the exact operands of an operator with one window.
    pub fn suffixes(&self) -> Option<&Extrema> {
        match &self.memory {
            Memory::Extrema(extrema) => Some(extrema),
            _ => None,
        }
    }

    /// Returns the value of `since` without an end after the last exact sample.
    pub fn since(&self) -> Option<f64> {
        match self.memory {
            Memory::Since(value, _) => Some(value),
            _ => None,
        }
    }

    /// Adds the exact value at `sample`, given the operands.
    ///
    /// # Errors
    /// If arithmetic has no finite value.
    pub fn advance(
        &mut self,
        node: &Node,
        operator: Operator,
        window: Window,
        [x, y]: [&Cell; 2],
        samples: usize,
    ) -> Result<(), Undefined> {
        let due = node.exact(samples);
        self.accumulate(operator, window, [x, y]);
        if node.reach.is_unbounded {
            return Ok(());
        }
        // `due` is at most one more than before. Windows ahead take their operands from the start.
        let is_due = due > self.len;
        let sample = self.len;
        let pick = pick(operator);
        let value = match (&mut self.memory, operator) {
            (Memory::Extrema(extrema), Operator::Always | Operator::Eventually) => {
                if let Some(newest) = x.len.checked_sub(1).filter(|newest| *newest >= window.begin) {
                    extrema.push(newest, x.latest);
                }
                if !is_due {
                    return Ok(());
                }
                extrema.drop_before(sample + window.begin);
                extrema.all()
            }
            (Memory::Composition(all, before), Operator::Until | Operator::Release | Operator::Unless) => {
                // The sample before the last one of the window of this or a later value.
                let last = window.end + samples - 1;
                if let Some(last) = last.checked_sub(node.reach.ahead + 1)
                    && last >= window.begin
                    && window.begin < window.end
                {
                    all.push(Function { p: x.exact(last), q: y.exact(last) });
                }
                let held = window.begin + samples - 1;
                if let Some(held) = held.checked_sub(node.reach.ahead + 1).filter(|_| window.begin > 0) {
                    before.push(held, x.exact(held));
                }
                if !is_due {
                    return Ok(());
                }
                if sample > 0 && window.begin < window.end {
                    all.pop();
                }
                before.drop_before(sample);
                let end = match operator {
                    Operator::Unless => pick.of(y.exact(sample + window.end), x.exact(sample + window.end)),
                    _ => y.exact(sample + window.end),
                };
                pick.dual().of(before.all(), all.apply(end))
            }
            _ if !is_due => return Ok(()),
            (Memory::Extrema(extrema), _) => {
                if let Some(newest) = sample.checked_sub(window.begin) {
                    extrema.push(newest, x.exact(newest));
                }
                extrema.drop_before(sample.saturating_sub(window.end));
                extrema.all()
            }
            (Memory::Fold(value), _) => {
                if let Some(newest) = sample.checked_sub(window.begin) {
                    *value = pick.of(*value, x.exact(newest));
                }
                *value
            }
            (Memory::Composition(all, after), _) => {
                if window.begin > 0 {
                    after.push(sample, x.exact(sample));
                    after.drop_before((sample + 1).saturating_sub(window.begin));
                }
                match sample.checked_sub(window.begin) {
                    Some(newest) => {
                        all.push(Function { p: x.exact(newest), q: y.exact(newest) });
                        if all.len() > window.length() {
                            all.pop();
                        }
                        pick.dual().of(after.all(), all.apply(pick.neutral()))
                    }
                    None => pick.neutral(),
                }
            }
            (Memory::Since(value, after), _) => {
                if window.begin > 0 {
                    after.push(sample, x.exact(sample));
                    after.drop_before((sample + 1).saturating_sub(window.begin));
                }
                match sample.checked_sub(window.begin) {
                    Some(newest) => {
                        *value = Function { p: x.exact(newest), q: y.exact(newest) }.apply(pick, *value);
                        pick.dual().of(after.all(), *value)
                    }
                    None => pick.neutral(),
                }
            }
            (Memory::Nothing, Operator::Until | Operator::Release | Operator::Since) => y.exact(sample),
            (Memory::Nothing, Operator::Next | Operator::StrongNext) => x.exact(sample + 1),
            (
                Memory::Nothing,
                Operator::Previous | Operator::StrongPrevious | Operator::Rise | Operator::Fall,
            ) => {
                let before = match sample.checked_sub(1) {
                    Some(before) => x.exact(before),
                    None if matches!(operator, Operator::Previous | Operator::Fall) => f64::INFINITY,
                    None => f64::NEG_INFINITY,
                };
                match operator {
                    Operator::Rise => Pick::Least.of(-before, x.exact(sample)),
                    Operator::Fall => Pick::Least.of(before, -x.exact(sample)),
                    _ => before,
                }
            }
            (Memory::Nothing, _) => {
                let x = x.exact(sample);
                let y = y.exact(sample);
                pointwise::apply_once(operator, x, y).map_err(|undefined| undefined.after(sample))?
            }
        };
        self.emit(node, value);
        Ok(())
    }

    /// Adds exact operands to the value at time 0.
    fn accumulate(&mut self, operator: Operator, window: Window, [x, y]: [&Cell; 2]) {
        let Some(accumulated) = &mut self.accumulated else { return };
        let pick = pick(operator);
        let is_unary = matches!(operator, Operator::Always | Operator::Eventually);
        // Each push gives at most one value of an operand.
        if !is_unary && x.len > 0 && x.len <= window.begin {
            accumulated.held = pick.dual().of(accumulated.held, x.latest);
        }
        let next = accumulated.next;
        if next < accumulated.to && next < x.len && next < y.len {
            let function = if is_unary {
                Function { p: pick.dual().neutral(), q: x.exact(next) }
            } else {
                Function { p: x.exact(next), q: y.exact(next) }
            };
            accumulated.all = accumulated.all.after(pick, function);
            accumulated.next += 1;
        }
    }
}

impl Memory {
    fn of(node: &Node, samples: usize) -> Memory {
        let Some((operator, window)) = node.operator().filter(|_| !node.reach.is_unbounded) else {
            return Memory::Nothing;
        };
        let pick = pick(operator);
        let length = window.length().min(samples);
        // One more, which is added before the first one is removed.
        let held = if window.begin > 0 { window.begin.min(samples).saturating_add(1) } else { 0 };
        let before = || Extrema::new(pick.dual(), held);
        match operator {
            Operator::Until | Operator::Release | Operator::Since if window.end == 0 => Memory::Nothing,
            Operator::Once | Operator::Historically if window.is_unbounded() => Memory::Fold(pick.neutral()),
            Operator::Always | Operator::Eventually | Operator::Once | Operator::Historically => {
                Memory::Extrema(Extrema::new(pick, length.saturating_add(1)))
            }
            Operator::Since if window.is_unbounded() => Memory::Since(pick.neutral(), before()),
            Operator::Since => {
                Memory::Composition(Composition::new(pick, true, length.saturating_add(1)), before())
            }
            Operator::Until | Operator::Release | Operator::Unless => {
                Memory::Composition(Composition::new(pick, false, length), before())
            }
            _ => Memory::Nothing,
        }
    }

    fn clear(&mut self, node: &Node) {
        match self {
            Memory::Nothing => {}
            Memory::Extrema(extrema) => extrema.clear(),
            Memory::Fold(value) => {
                *value = node.operator().map_or(0.0, |(operator, _)| pick(operator).neutral());
            }
            Memory::Composition(all, other) => {
                all.clear();
                other.clear();
            }
            Memory::Since(value, other) => {
                *value = node.operator().map_or(0.0, |(operator, _)| pick(operator).neutral());
                other.clear();
            }
        }
    }
}

/// Returns whether a node has one value for all samples.
pub(super) fn constant(node: &Node) -> Option<f64> {
    match node.kind {
        Kind::Constant(value) => Some(value),
        _ => None,
    }
}
