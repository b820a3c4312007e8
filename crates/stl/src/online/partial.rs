//! Bounds of a node at the samples that the samples pushed do not decide.
//!
//! An unknown sample of a state formula has the bounds -∞ and +∞. Every operator except pointwise
//! ones, `rise` and `fall` is monotone, so that each side is computed alone.

use super::graph::Node;
use super::stream::{Accumulated, Cell, constant, pick};
use super::window::{Function, Pick};
use super::{Bounds, preallocated};
use crate::clock::Window;
use crate::extremum::{self, Maximum, Minimum};
use crate::monitor::temporal_binary;
use crate::operator::Operator;
use crate::pointwise;
use crate::until;

/// Largest number of unknown samples at which past operators are bounded one by one. Later ones
/// have no bounds.
const MAX_SLACK: usize = 1 << 20;

/// The least or the greatest value.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Low,
    High,
}

impl Side {
    fn unknown(self) -> f64 {
        match self {
            Side::Low => f64::NEG_INFINITY,
            Side::High => f64::INFINITY,
        }
    }
}

/// Buffers for the operands of one operator.
#[derive(Clone, Debug, Default)]
pub(super) struct Buffers {
    first: Vec<f64>,
    last: Vec<f64>,
    scratch: Vec<f64>,
}

impl Buffers {
    /// Allocates what the operators over time need.
    pub fn new(nodes: &[Node]) -> Buffers {
        let operators = nodes.iter().filter(|node| !node.is_state);
        let needed = operators.filter_map(|node| {
            let (_, Window { begin, end }) = node.operator()?;
            let window = if end == usize::MAX { begin } else { end };
            let unknown = node.reach.ahead.saturating_add(node.slack).min(node.need);
            Some(preallocated(unknown.saturating_add(window.saturating_mul(2)).saturating_add(4)))
        });
        let samples = needed.max().unwrap_or(0);
        let buffer = || Vec::with_capacity(samples);
        // Short windows need this number of scratch values beside those of the samples.
        let short = extremum::ahead_scratch_len(Window { begin: 0, end: 0 }, 0);
        let scratch = if samples == 0 { 0 } else { 3 * samples + short };
        Buffers { first: buffer(), last: buffer(), scratch: Vec::with_capacity(scratch) }
    }

    /// Returns the scratch values, at least this number of them.
    fn scratch(scratch: &mut Vec<f64>, len: usize) -> &mut [f64] {
        if scratch.len() < len {
            scratch.resize(len, 0.0);
        }
        scratch
    }
}

/// An operand.
#[derive(Clone, Copy)]
pub(super) struct Operand<'a> {
    pub node: &'a Node,
    pub cell: &'a Cell,
}

impl Operand<'_> {
    fn at(self, sample: usize, side: Side) -> f64 {
        if sample > self.node.need {
            // Read without effect, and perhaps not kept.
            return side.unknown();
        }
        let Some(unknown) = sample.checked_sub(self.cell.len) else {
            return self.cell.exact(sample);
        };
        if self.node.is_direct {
            return self.direct(sample, side);
        }
        let values = match side {
            Side::Low => &self.cell.low,
            Side::High => &self.cell.high,
        };
        match (values.len(), self.node.folded) {
            // A state formula.
            (0, _) => side.unknown(),
            (_, Some(begin)) => values[usize::from(sample > begin.max(self.cell.len))],
            (len, None) => values[unknown.min(len - 1)],
        }
    }

    /// Returns a bound of a node with [`Node::is_direct`].
    fn direct(self, sample: usize, side: Side) -> f64 {
        match self.direct_begin(sample, side).zip(self.cell.suffixes()) {
            Some((begin, suffixes)) => suffixes.from(begin),
            None => side.unknown(),
        }
    }

    /// Returns the first sample of the window of a node with [`Node::is_direct`]; `None` if the
    /// bound is unknown.
    fn direct_begin(self, sample: usize, side: Side) -> Option<usize> {
        let (operator, window) = self.node.operator()?;
        let (begin, known) = match operator {
            Operator::Eventually => (sample.saturating_add(window.begin), Side::Low),
            Operator::Always => (sample.saturating_add(window.begin), Side::High),
            Operator::Once => (sample.saturating_sub(window.end), Side::Low),
            _ => (sample.saturating_sub(window.end), Side::High),
        };
        (side == known).then_some(begin)
    }

    /// Replaces `values` by the bounds at the samples `first` to `last`: what [`Operand::at`]
    /// returns for each of them.
    fn fill(self, values: &mut Vec<f64>, first: usize, last: usize, side: Side) {
        values.clear();
        let count = last + 1 - first;
        // Samples after those that are read have no bounds.
        let end = last.min(self.node.need).saturating_add(1).max(first);
        let exact = self.cell.len.clamp(first, end);
        self.cell.copy_exact(first..exact, values);
        let bounds = match side {
            Side::Low => &self.cell.low,
            Side::High => &self.cell.high,
        };
        match (self.node.is_direct, bounds.split_last(), self.node.folded) {
            (true, ..) => {
                let begins = (exact..end).map_while(|sample| self.direct_begin(sample, side));
                self.cell
                    .suffixes()
                    .into_iter()
                    .for_each(|suffixes| suffixes.extend_from(begins.clone(), values));
            }
            (false, Some((last, _)), None) => {
                let listed = (self.cell.len..exact).len()..(self.cell.len..end).len().min(bounds.len());
                values.extend_from_slice(bounds.get(listed).unwrap_or_default());
                values.resize(end - first, *last);
            }
            (false, Some(_), Some(_)) => values.extend((exact..end).map(|sample| self.at(sample, side))),
            (false, None, _) => {}
        }
        values.resize(count, side.unknown());
    }

    /// Replaces `values` by the bounds for a pointwise operator, which knows constants at all
    /// samples.
    fn fill_pointwise(self, values: &mut Vec<f64>, first: usize, last: usize, side: Side) {
        match constant(self.node) {
            Some(value) => {
                values.clear();
                values.resize(last + 1 - first, value);
            }
            None => self.fill(values, first, last, side),
        }
    }

    /// Returns the bounds for a pointwise operator, which knows constants at all samples.
    fn both(self, sample: usize) -> Bounds {
        match constant(self.node) {
            Some(value) => Bounds::exact(value),
            None => self.bounds(sample),
        }
    }

    /// Returns the least and the greatest value at a sample.
    pub fn bounds(self, sample: usize) -> Bounds {
        Bounds { low: self.at(sample, Side::Low), high: self.at(sample, Side::High) }
    }

    /// Returns a sample from which on the bounds do not change.
    fn top(self) -> usize {
        if self.node.is_direct {
            let end = self.node.operator().map_or(0, |(_, window)| window.end);
            return self.cell.len.saturating_add(end).saturating_add(1);
        }
        self.cell.len + self.cell.low.len().saturating_sub(1)
    }

    /// Returns the extremum of the bounds at these samples.
    fn fold(self, pick: Pick, samples: std::ops::Range<usize>, side: Side) -> f64 {
        if (self.node.is_direct || self.node.folded.is_some()) && samples.start >= self.cell.len {
            // The bounds are monotone.
            return if samples.is_empty() {
                pick.neutral()
            } else {
                pick.of(self.at(samples.start, side), self.at(samples.end - 1, side))
            };
        }
        let end = samples.end.min(self.top().max(samples.start).saturating_add(1)).max(samples.start);
        let exact = self.cell.len.clamp(samples.start, end);
        let best =
            (samples.start..exact).fold(pick.neutral(), |best, sample| pick.of(best, self.at(sample, side)));
        let bounds = match side {
            Side::Low => &self.cell.low,
            Side::High => &self.cell.high,
        };
        let is_listed = !self.node.is_direct && end <= self.node.need.saturating_add(1);
        let listed = (self.cell.len..end).len();
        match bounds.get((self.cell.len..exact).len()..listed).filter(|_| is_listed) {
            Some(bounds) => pick.of(best, pick.all(bounds)),
            None => (exact..end).fold(best, |best, sample| pick.of(best, self.at(sample, side))),
        }
    }
}

/// The samples pushed, and the stated number of samples.
#[derive(Clone, Copy)]
pub(super) struct Length {
    pub pushed: usize,
    pub stated: Option<usize>,
}

/// Computes the bounds of a node at the samples from its number of exact values on, as far as other
/// nodes read them.
pub(super) fn bound(
    node: &Node,
    cell: &mut Cell,
    operands: [Operand<'_>; 2],
    length: Length,
    buffers: &mut Buffers,
) {
    let mut low = std::mem::take(&mut cell.low);
    let mut high = std::mem::take(&mut cell.high);
    low.clear();
    high.clear();
    let Some((operator, window)) =
        node.operator().filter(|_| !node.is_state && !node.is_direct && cell.len <= node.need)
    else {
        (cell.low, cell.high) = (low, high);
        return;
    };
    let first = cell.len;
    let last = node.need.min(length.pushed.saturating_add(node.slack.min(MAX_SLACK))).max(first);
    let [x, y] = operands;
    if let Some(begin) = node.folded {
        // Samples after the last one that is decided do not matter.
        let end =
            length.stated.map_or(last, |samples| last.min(node.reach.decided(samples).saturating_sub(1)));
        let begin = begin.max(first);
        for sample in [begin, end.max(begin)] {
            let bounds = pointwise_bounds(operator, x.both(sample), y.both(sample));
            low.push(bounds.low);
            high.push(bounds.high);
        }
        (cell.low, cell.high) = (low, high);
        return;
    }
    if matches!(operator, Operator::Rise | Operator::Fall) {
        for sample in first..=last {
            let bounds = edge_bounds(operator, x, sample);
            low.push(bounds.low);
            high.push(bounds.high);
        }
    } else if !operator.is_temporal() {
        x.fill_pointwise(&mut low, first, last, Side::Low);
        x.fill_pointwise(&mut high, first, last, Side::High);
        y.fill_pointwise(&mut buffers.first, first, last, Side::Low);
        y.fill_pointwise(&mut buffers.last, first, last, Side::High);
        let of_x = low.iter_mut().zip(&mut high);
        for ((low, high), (y_low, y_high)) in of_x.zip(buffers.first.iter().zip(&buffers.last)) {
            let x = Bounds { low: *low, high: *high };
            let bounds = pointwise_bounds(operator, x, Bounds { low: *y_low, high: *y_high });
            *low = bounds.low;
            *high = bounds.high;
        }
    } else {
        let evaluation = Evaluation { node, cell, operator, window, x, y, first, last, length };
        for (side, out) in [(Side::Low, &mut low), (Side::High, &mut high)] {
            out.resize(last - first + 1, side.unknown());
            evaluation.run(side, out, buffers);
        }
    }
    if node.slack > MAX_SLACK && last < node.need {
        let end = last - first;
        (low[end], high[end]) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    (cell.low, cell.high) = (low, high);
}

/// One temporal operator at the samples `first` to `last`.
struct Evaluation<'a> {
    node: &'a Node,
    cell: &'a Cell,
    operator: Operator,
    window: Window,
    x: Operand<'a>,
    y: Operand<'a>,
    first: usize,
    last: usize,
    length: Length,
}

impl Evaluation<'_> {
    fn run(&self, side: Side, out: &mut [f64], buffers: &mut Buffers) {
        let pick = pick(self.operator);
        match self.operator {
            Operator::Until | Operator::Release | Operator::Since if self.window.end == 0 => {
                self.each(out, |sample| self.y.at(sample, side));
            }
            Operator::Next | Operator::StrongNext => self.each(out, |sample| self.x.at(sample + 1, side)),
            Operator::Previous | Operator::StrongPrevious => {
                let start =
                    if self.operator == Operator::Previous { f64::INFINITY } else { f64::NEG_INFINITY };
                self.each(out, |sample| match sample.checked_sub(1) {
                    Some(before) => self.x.at(before, side),
                    None => start,
                });
            }
            Operator::Once | Operator::Historically if self.window.is_unbounded() => {
                let mut best = if self.first > 0 { self.cell.latest } else { pick.neutral() };
                self.each(out, |sample| {
                    if let Some(newest) = sample.checked_sub(self.window.begin) {
                        best = pick.of(best, self.x.at(newest, side));
                    }
                    best
                });
            }
            Operator::Once | Operator::Historically => {
                let begin = self.first.saturating_sub(self.window.end);
                let values = &mut buffers.first;
                self.x.fill(values, begin, self.last, side);
                let scratch = extremum::behind_scratch_len(self.window, values.len());
                let scratch = Buffers::scratch(&mut buffers.scratch, scratch);
                behind(pick, values, self.window, scratch);
                out.copy_from_slice(&values[self.first - begin..]);
            }
            Operator::Since => self.since(pick, side, out, buffers),
            _ => match &self.cell.accumulated {
                Some(accumulated) => self.accumulated(pick, accumulated, side, out),
                None if self.operator.arity() == 1 => self.ahead(pick, side, out, buffers),
                None => self.until(side, out, buffers),
            },
        }
    }

    fn each(&self, out: &mut [f64], value: impl FnMut(usize) -> f64) {
        out.iter_mut().zip((self.first..=self.last).map(value)).for_each(|(out, value)| *out = value);
    }

    fn since(&self, pick: Pick, side: Side, out: &mut [f64], buffers: &mut Buffers) {
        let Window { begin, end } = self.window;
        let Buffers { first: p, last: q, scratch } = buffers;
        if !self.window.is_unbounded() {
            let start = self.first.saturating_sub(end);
            self.x.fill(p, start, self.last, side);
            self.y.fill(q, start, self.last, side);
            let scratch = Buffers::scratch(scratch, until::scratch_len(self.window, p.len()));
            until::since::<Maximum>(p, q, self.window, scratch);
            return out.copy_from_slice(&q[self.first - start..]);
        }
        let start = (self.first + 1).saturating_sub(begin);
        if begin > 0 {
            self.x.fill(p, start, self.last, side);
            let after = Window { begin: 0, end: begin - 1 };
            let scratch = Buffers::scratch(scratch, extremum::behind_scratch_len(after, p.len()));
            behind(pick.dual(), p, after, scratch);
        }
        let mut value = self.cell.since().unwrap_or(pick.neutral());
        self.each(out, |sample| match sample.checked_sub(begin) {
            Some(newest) => {
                value = self.function(newest, side).apply(pick, value);
                if begin > 0 { pick.dual().of(p[sample - start], value) } else { value }
            }
            None => pick.neutral(),
        });
    }

    /// `always` and `eventually` with an end, at several samples.
    fn ahead(&self, pick: Pick, side: Side, out: &mut [f64], buffers: &mut Buffers) {
        let Window { begin, end } = self.window;
        let start = self.first + begin;
        let top = self.x.top().min(self.last + end);
        if start > top {
            return out.fill(self.x.at(start, side));
        }
        let values = &mut buffers.first;
        values.clear();
        let exact = self.x.cell.len.clamp(start, top + 1);
        values.resize(exact - start, pick.neutral());
        values.extend((exact..=top).map(|sample| self.x.at(sample, side)));
        let window = Window { begin: 0, end: end - begin };
        let scratch =
            Buffers::scratch(&mut buffers.scratch, extremum::ahead_scratch_len(window, values.len()));
        match pick {
            Pick::Least => extremum::ahead::<Minimum>(values, window, scratch),
            Pick::Greatest => extremum::ahead::<Maximum>(values, window, scratch),
        }
        self.each(out, |sample| match values.get(sample + begin - start) {
            Some(value) if sample + begin < exact && self.x.cell.len > start => pick.of(
                *value,
                self.cell.suffixes().map_or(pick.neutral(), |suffixes| suffixes.from(sample + begin)),
            ),
            Some(value) => *value,
            None => self.x.at(sample + begin, side),
        });
    }

    /// `until`, `release` and `unless` with an end, at several samples.
    fn until(&self, side: Side, out: &mut [f64], buffers: &mut Buffers) {
        let Window { begin, end } = self.window;
        let top = self.x.top().max(self.y.top()).min(self.last + end).max(self.last);
        // Later samples have the bounds of the last one, so that longer windows have the same
        // value.
        let near = begin.min(top - self.first + 1);
        let window = Window { begin: near, end: near + (end - begin) };
        let Buffers { first: p, last: q, scratch } = buffers;
        self.x.fill(p, self.first, top + near + 1, side);
        self.y.fill(q, self.first, top + near + 1, side);
        let samples = p.len();
        let held = Window { begin: 0, end: window.end };
        let len =
            samples + extremum::ahead_scratch_len(held, samples).max(until::scratch_len(window, samples));
        temporal_binary(self.operator, window, p, samples, q, Buffers::scratch(scratch, len));
        out.copy_from_slice(&q[..out.len()]);
    }

    /// Operators ahead of which the exact operands are accumulated.
    fn accumulated(&self, pick: Pick, accumulated: &Accumulated, side: Side, out: &mut [f64]) {
        let begin = self.window.begin;
        let Length { pushed, stated } = self.length;
        // A value does not decrease, or does not increase, with the number of samples of the trace.
        let grows = matches!(self.operator, Operator::Eventually | Operator::Until);
        let is_shortest = grows == (side == Side::Low);
        let ends_at = |samples: usize| samples.saturating_sub(self.node.undecided);
        let (end, decided) = match stated {
            _ if !self.window.is_unbounded() => (accumulated.to, usize::MAX),
            Some(samples) => (ends_at(samples), usize::MAX),
            None if is_shortest => (ends_at(pushed), self.node.reach.decided(pushed)),
            None => (usize::MAX, usize::MAX),
        };
        // The shortest trace that decides these samples is longer than the one pushed.
        for sample in self.first.max(decided)..=self.last {
            let end = ends_at(sample.saturating_add(self.node.reach.ahead).saturating_add(1));
            let value = self.from(pick, accumulated, sample + begin, end, side);
            out[sample - self.first] = pick.dual().of(self.held(pick, accumulated, sample, side), value);
        }
        let Some(last) = decided.min(self.last + 1).checked_sub(1).filter(|last| *last >= self.first) else {
            return;
        };
        let mut value = self.from(pick, accumulated, last + begin, end, side);
        for sample in (self.first..=last).rev() {
            out[sample - self.first] = pick.dual().of(self.held(pick, accumulated, sample, side), value);
            // No sample at or after `end` is in the window.
            if sample > self.first && sample + begin - 1 < end {
                value = self.function(sample + begin - 1, side).apply(pick, value);
            }
        }
    }

    /// Returns the composition from sample `begin` to before `end`.
    fn from(&self, pick: Pick, accumulated: &Accumulated, begin: usize, end: usize, side: Side) -> f64 {
        let mut value = match self.operator {
            Operator::Unless => pick.dual().neutral(),
            _ => pick.neutral(),
        };
        let has_exact = accumulated.next > accumulated.from;
        let partial = if has_exact { accumulated.next } else { begin };
        if self.operator.arity() == 1 && self.node.need == 0 {
            return pick.of(accumulated.all.q, self.x.fold(pick, partial..end, side));
        }
        let top = self.x.top().max(self.y.top()).max(begin);
        for sample in (partial..end.min(top.saturating_add(1))).rev() {
            value = self.function(sample, side).apply(pick, value);
        }
        if has_exact {
            value = accumulated.all.apply(pick, value);
            for sample in (begin..accumulated.from).rev() {
                value = self.function(sample, side).apply(pick, value);
            }
        }
        value
    }

    /// Returns the function of a sample.
    fn function(&self, sample: usize, side: Side) -> Function {
        let p = match self.operator.arity() {
            1 => pick(self.operator).dual().neutral(),
            _ => self.x.at(sample, side),
        };
        Function { p, q: self.y.at(sample, side) }
    }

    /// Returns the extremum of the left operand before the window of a sample.
    fn held(&self, pick: Pick, accumulated: &Accumulated, sample: usize, side: Side) -> f64 {
        if self.operator.arity() == 1 || self.window.begin == 0 {
            return pick.dual().neutral();
        }
        let end = sample + self.window.begin;
        if self.node.need > 0 {
            return self.x.fold(pick.dual(), sample..end, side);
        }
        let partial = self.x.cell.len.min(end);
        pick.dual().of(accumulated.held, self.x.fold(pick.dual(), partial..end, side))
    }
}

fn behind(pick: Pick, values: &mut [f64], window: Window, scratch: &mut [f64]) {
    match pick {
        Pick::Least => extremum::behind::<Minimum>(values, window, scratch),
        Pick::Greatest => extremum::behind::<Maximum>(values, window, scratch),
    }
}

/// Returns the bounds of a pointwise operator from those of its operands. Arithmetic without a
/// value has none.
fn pointwise_bounds(operator: Operator, x: Bounds, y: Bounds) -> Bounds {
    match operator {
        Operator::Not | Operator::Negate => negated(x),
        Operator::And => picked(Pick::Least, x, y),
        Operator::Or => picked(Pick::Greatest, x, y),
        Operator::Implies => picked(Pick::Greatest, negated(x), y),
        Operator::Iff => equivalence_bounds(x, y),
        Operator::Xor => negated(equivalence_bounds(x, y)),
        _ if is_known(x) && is_known(y) => {
            pointwise::apply_once(operator, x.low, y.low).map_or(Bounds::UNKNOWN, Bounds::exact)
        }
        _ => Bounds::UNKNOWN,
    }
}

/// Returns whether both bounds are the same, also in the sign of a zero.
fn is_known(x: Bounds) -> bool {
    x.low.to_bits() == x.high.to_bits()
}

fn negated(x: Bounds) -> Bounds {
    Bounds { low: -x.high, high: -x.low }
}

fn picked(pick: Pick, x: Bounds, y: Bounds) -> Bounds {
    Bounds { low: pick.of(x.low, y.low), high: pick.of(x.high, y.high) }
}

/// Returns the bounds of `(x and y) or (not x and not y)`.
fn equivalence_bounds(x: Bounds, y: Bounds) -> Bounds {
    let both = picked(Pick::Least, x, y);
    let neither = picked(Pick::Least, negated(x), negated(y));
    picked(Pick::Greatest, both, neither)
}

/// Returns the bounds of `rise` or `fall`: the minimum of the negated value before and the value
/// now, or of the value before and the negated value now.
fn edge_bounds(operator: Operator, x: Operand<'_>, sample: usize) -> Bounds {
    let is_rise = operator == Operator::Rise;
    let start = if is_rise { f64::NEG_INFINITY } else { f64::INFINITY };
    let before = sample.checked_sub(1).map_or(Bounds::exact(start), |sample| x.bounds(sample));
    let now = x.bounds(sample);
    if is_rise {
        picked(Pick::Least, negated(before), now)
    } else {
        picked(Pick::Least, before, negated(now))
    }
}
