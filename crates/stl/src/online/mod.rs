//! Online monitors: samples are pushed one at a time.

mod cut;
mod graph;
mod partial;
mod row;
mod stream;
mod window;

use crate::clock::Clock;
use crate::error::MonitorError;
use crate::formula::Formula;
use crate::pointwise::{self, Undefined};
use crate::trace::Trace;
use crate::verdict::{is_satisfied, is_violated};
pub use cut::CutMonitor;
use graph::{Graph, Kind};
use partial::{Buffers, Length, Operand};
use std::ops::Range;
use stream::Cell;

/// Number of samples up to which vectors are allocated when a monitor is created: those that a
/// formula needs whose windows have 65,536 samples one after the other. Longer ones grow.
const PREALLOCATED: usize = 1 << 18;

/// Returns the capacity of a vector for this number of samples when a monitor is created.
fn preallocated(samples: usize) -> usize {
    if samples <= PREALLOCATED { samples } else { 0 }
}

/// The least and the greatest robustness at time 0 over all continuations of a trace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// No continuation has a lower robustness.
    pub low: f64,
    /// No continuation has a greater robustness.
    pub high: f64,
}

impl Bounds {
    /// The bounds of a formula about which nothing is known.
    pub const UNKNOWN: Bounds = Bounds { low: f64::NEG_INFINITY, high: f64::INFINITY };

    fn exact(value: f64) -> Bounds {
        Bounds { low: value, high: value }
    }

    /// Returns whether every continuation satisfies the formula (`true`) or violates it (`false`);
    /// `None` if this is not certain.
    pub fn verdict(self) -> Option<bool> {
        match self {
            Bounds { low, .. } if is_satisfied(low) => Some(true),
            Bounds { high, .. } if is_violated(high) => Some(false),
            _ => None,
        }
    }
}

/// Evaluates formulas on a trace whose samples arrive one at a time.
///
/// After each sample, [`bounds`](OnlineMonitor::bounds) is the interval of the robustness at time 0
/// over all continuations, [`verdict`](OnlineMonitor::verdict) the verdict as soon as no
/// continuation can change it, and [`decided`](OnlineMonitor::decided) the robustness at the sample
/// that the last one decided. The formulas share equal sub-formulas, which are evaluated once.
///
/// # Bounds
/// The robustness is that of
/// [`Monitor::decided_robustness_signal`](crate::Monitor::decided_robustness_signal): windows with
/// an end are inside the trace. A continuation has the stated number of samples, or any number that
/// decides the formula if none is stated. A trace may become longer than stated. The bounds are
/// correct but not always tight: an unknown sample that occurs twice counts as two, as in
/// `p or not p`, and without a stated number each window without an end has an end of its own.
/// Arithmetic has bounds only where its operands are known.
///
/// # Errors
/// A sample with NaN or an infinity, or for which arithmetic on signals has no finite value, is
/// rejected: [`push`](OnlineMonitor::push) returns an error, the monitor is unchanged, and another
/// sample can take its place. If arithmetic on the values of temporal operators has no finite
/// value, the monitor has failed: each push returns this error until
/// [`reset`](OnlineMonitor::reset), and the bounds are unknown.
///
/// # Cost
/// With A as the number of distinct operators, a push takes amortized time in proportion to A,
/// whatever the windows. The bounds are computed when they are requested. This takes, for each
/// operator:
///
/// - constant time if its operands are state formulas, or pointwise operators on these and on
///   `once`, `historically` and `since` without an interval, and neighbors;
/// - time in proportion to the logarithm of the window for `always` and `eventually` at time 0
///   over windows ahead with an end, or `once[0:b]` and `historically[0:b]`, of state formulas:
///   alone, or with pointwise operators between operands that wait for the same number of samples;
/// - time in proportion to the windows that it waits for otherwise: windows in three levels,
///   `until` and its relatives inside a window or with a window inside, other windows of the past
///   inside windows ahead, pointwise operators between operands that wait for different numbers of
///   samples, as in `always[0:9](p implies eventually[0:5] q)`;
/// - time in proportion to the number of samples of the trace if a window ahead without an end is
///   inside another window ahead.
///
/// Memory: per operator at most nine numbers per sample of the windows that it waits for, its own
/// included, and for all operators together fifteen numbers per sample of the longest sum of such
/// windows, whatever the length of the trace; constant for a window without an end. A window ahead
/// without an end inside a window ahead without an end keeps all its values.
///
/// [`new`](OnlineMonitor::new) allocates this memory if windows inside each other have up to 65,536
/// samples together, and `next`, `prev` and edges count as one each. No push, question or reset
/// allocates after it, until an error. Memory for longer windows is allocated as samples arrive,
/// and so is that of a window ahead without an end inside another window ahead, and of a trace that
/// becomes longer than stated.
///
/// # Example
/// ```
/// use mishandle_stl::{Bounds, Clock, Formula, OnlineMonitor};
///
/// let formulas = [
///     Formula::parse("always[0:9](x <= 2)").unwrap(),
///     Formula::parse("eventually[0:1](x <= 2)").unwrap(),
/// ];
/// let mut monitor = OnlineMonitor::new(&formulas, &["x".to_owned()], Clock::steps(1.0), None).unwrap();
/// monitor.push(&[0.0]).unwrap();
/// assert_eq!(monitor.bounds(0), Bounds { low: f64::NEG_INFINITY, high: 2.0 });
/// assert_eq!(monitor.verdict(0), None);
/// assert_eq!(monitor.verdict(1), Some(true)); // sample 0 is enough
/// monitor.push(&[3.0]).unwrap();
/// assert_eq!(monitor.verdict(0), Some(false)); // whatever follows
/// assert_eq!(monitor.decided(1), Some((0, 2.0)));
/// monitor.push(&[1.0]).unwrap();
/// assert_eq!(monitor.decided(1), Some((1, 1.0))); // the greater of -1 and 1
/// ```
#[derive(Clone, Debug)]
pub struct OnlineMonitor {
    graph: Graph,
    clock: Clock,
    /// The nodes that each formula at time 0 reads and that are not state formulas, operands first.
    parts: Vec<Vec<usize>>,
    cells: Vec<Cell>,
    /// The number of signals of a sample.
    signals: usize,
    /// A sample of a trace.
    sample: Vec<f64>,
    /// For each node, the number of samples that its bounds belong to.
    bounded: Vec<usize>,
    len: usize,
    stated: Option<usize>,
    buffers: Buffers,
    /// The error of an operator over time.
    error: Option<MonitorError>,
}

impl OnlineMonitor {
    /// Compiles `formulas` for samples of the signals `names`. `samples` is the number of samples
    /// of the whole trace; `None` if it is unknown.
    ///
    /// # Errors
    /// As for [`Monitor::new`](crate::Monitor::new), and if a formula reads no signal.
    pub fn new(
        formulas: &[Formula],
        names: &[String],
        clock: Clock,
        samples: Option<usize>,
    ) -> Result<OnlineMonitor, MonitorError> {
        formulas.iter().try_for_each(|formula| formula.check_names(names))?;
        let graph = Graph::new(formulas, names, &clock)?;
        let cells = graph.nodes.iter().map(|node| Cell::new(node, samples.unwrap_or(usize::MAX))).collect();
        let parts = graph.roots.iter().map(|root| graph.parts(*root)).collect();
        let bounded = vec![0; graph.nodes.len()];
        let buffers = Buffers::new(&graph.nodes);
        Ok(OnlineMonitor {
            graph,
            clock,
            parts,
            cells,
            signals: names.len(),
            sample: Vec::with_capacity(names.len()),
            bounded,
            len: 0,
            stated: samples,
            buffers,
            error: None,
        })
    }

    /// Adds a sample: one value per signal, in the order of the names.
    ///
    /// # Errors
    /// If a signal of a formula is NaN or infinite, or arithmetic has no finite value.
    ///
    /// # Panics
    /// If the length of `sample` is not the number of signals.
    pub fn push(&mut self, sample: &[f64]) -> Result<(), MonitorError> {
        assert_eq!(sample.len(), self.signals, "a sample must have one value per signal");
        if let Some(error) = &self.error {
            return Err(error.clone());
        }
        for (column, name) in &self.graph.columns {
            let value = sample[*column];
            if !value.is_finite() {
                let signal = name.clone();
                let step = self.len;
                let time_secs = self.clock.time_secs(self.len);
                return Err(MonitorError::NotFinite { signal, value, step, time_secs });
            }
        }
        for (id, node) in self.graph.nodes.iter().enumerate() {
            if !node.is_state {
                continue;
            }
            let value = match node.kind {
                Kind::Constant(value) => value,
                Kind::Signal(column) => sample[column],
                Kind::Apply(operator, _) => {
                    let [x, y] = node.operands.map(|operand| self.cells[operand].pushed);
                    pointwise::apply_once(operator, x, y)
                        .map_err(|undefined| self.undefined(undefined.after(self.len)))?
                }
            };
            self.cells[id].pushed = value;
        }
        self.len += 1;
        for (id, node) in self.graph.nodes.iter().enumerate() {
            let (operands, cells) = self.cells.split_at_mut(id);
            let cell = &mut cells[0];
            match node.kind {
                _ if node.is_state => {
                    if node.is_read {
                        cell.emit(node, cell.pushed);
                    }
                }
                Kind::Apply(operator, window) => {
                    let operands = node.operands.map(|operand| &operands[operand]);
                    if let Err(undefined) = cell.advance(node, operator, window, operands, self.len) {
                        let error = self.undefined(undefined);
                        self.error = Some(error.clone());
                        return Err(error);
                    }
                }
                Kind::Constant(_) | Kind::Signal(_) => {}
            }
        }
        Ok(())
    }

    /// Adds some samples of a trace of the same signals.
    ///
    /// # Errors
    /// As for [`push`](OnlineMonitor::push), for the first sample with an error. The samples before
    /// it are added.
    ///
    /// # Panics
    /// If the trace has another number of signals, or not all of these samples.
    pub fn push_trace(&mut self, trace: &Trace, samples: Range<usize>) -> Result<(), MonitorError> {
        let mut sample = std::mem::take(&mut self.sample);
        let result = samples.into_iter().try_for_each(|step| {
            sample.clear();
            sample.extend((0..trace.names().len()).map(|column| trace.column(column)[step]));
            self.push(&sample)
        });
        self.sample = sample;
        result
    }

    fn undefined(&self, Undefined { operation, step }: Undefined) -> MonitorError {
        MonitorError::Undefined { operation, step, time_secs: self.clock.time_secs(step) }
    }

    /// Returns the least and the greatest robustness of formula `i` at time 0 over all
    /// continuations of the trace: both are the robustness once it is decided. They are unknown
    /// before the first sample, and if the stated number of samples does not decide the formula.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn bounds(&mut self, i: usize) -> Bounds {
        let root = self.graph.roots[i];
        if self.cells[root].len > 0 {
            return Bounds::exact(self.cells[root].exact(0));
        }
        let length = Length { pushed: self.len, stated: self.stated.map(|stated| stated.max(self.len)) };
        let is_short =
            length.stated.is_some_and(|samples| self.graph.nodes[root].reach.decided(samples) == 0);
        if self.len == 0 || self.error.is_some() || is_short {
            return Bounds::UNKNOWN;
        }
        for id in &self.parts[i] {
            if std::mem::replace(&mut self.bounded[*id], self.len) == self.len {
                continue;
            }
            let (operands, cells) = self.cells.split_at_mut(*id);
            let node = &self.graph.nodes[*id];
            let operands = node
                .operands
                .map(|operand| Operand { node: &self.graph.nodes[operand], cell: &operands[operand] });
            partial::bound(node, &mut cells[0], operands, length, &mut self.buffers);
        }
        Operand { node: &self.graph.nodes[root], cell: &self.cells[root] }.bounds(0)
    }

    /// Returns the verdict of formula `i` at time 0 if every continuation of the trace has it.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn verdict(&mut self, i: usize) -> Option<bool> {
        self.bounds(i).verdict()
    }

    /// Returns the sample at which the last push decided formula `i`, and the robustness there: the
    /// value of [`Monitor::decided_robustness_signal`](crate::Monitor::decided_robustness_signal).
    /// A formula with a window ahead without an end is decided at no sample before the trace ends.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn decided(&self, i: usize) -> Option<(usize, f64)> {
        let root = self.graph.roots[i];
        let cell = &self.cells[root];
        cell.len.checked_sub(1).filter(|_| self.error.is_none()).map(|sample| (sample, cell.latest))
    }

    /// States that the trace ends with the last sample. The bounds of every formula that this trace
    /// decides become its robustness. A later push continues the trace and ends it again.
    pub fn finish(&mut self) {
        self.state_samples(Some(self.len));
    }

    /// Changes the stated number of samples of the whole trace.
    pub fn state_samples(&mut self, samples: Option<usize>) {
        self.stated = samples;
        self.bounded.fill(0);
    }

    /// Returns the number of samples that a trace must have to decide formula `i` at time 0, and
    /// whether the value depends on all samples up to the end of the trace.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn needed_samples(&self, i: usize) -> (usize, bool) {
        let reach = self.graph.nodes[self.graph.roots[i]].reach;
        (reach.ahead.saturating_add(1), reach.is_unbounded)
    }

    /// Returns the number of distinct operators of the formulas.
    pub fn operators(&self) -> usize {
        self.graph.nodes.iter().filter(|node| node.operator().is_some()).count()
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the largest number of numbers that [`save`](OnlineMonitor::save) writes in a trace of
    /// at most `samples` samples.
    pub fn row_size(&self, samples: usize) -> usize {
        let cells = self.graph.nodes.iter().zip(&self.cells);
        1 + cells.map(|(node, cell)| cell.row_size(node, samples)).sum::<usize>()
    }

    /// Writes the samples to a row of numbers, so that one monitor can serve many traces: its first
    /// numbers, at most [`row_size`](OnlineMonitor::row_size). An error of the monitor is not saved.
    pub fn save(&mut self, row: &mut [f64]) {
        row::visit(&mut self.len, &mut self.cells, &mut row::Saving(row));
    }

    /// Replaces the samples by those that [`save`](OnlineMonitor::save) of an equal monitor wrote,
    /// and removes the error. It then continues with the same bits.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Clock, Formula, OnlineMonitor};
    ///
    /// let formula = Formula::parse("once[0:1](x >= 1)").unwrap();
    /// let mut monitor = OnlineMonitor::new(&[formula], &["x".to_owned()], Clock::steps(1.0), None).unwrap();
    /// let mut rows = [[0.0; 32]; 2];
    /// assert!(monitor.row_size(100) <= 32);
    /// rows.iter_mut().for_each(|row| monitor.save(row)); // two traces without samples
    /// for (row, x) in rows.iter_mut().zip([3.0, 5.0]) {
    ///     monitor.restore(row);
    ///     monitor.push(&[x]).unwrap();
    ///     monitor.save(row);
    /// }
    /// monitor.restore(&rows[0]);
    /// monitor.push(&[0.0]).unwrap();
    /// assert_eq!(monitor.decided(0), Some((1, 2.0))); // 3 is 2 more than 1
    /// ```
    pub fn restore(&mut self, row: &[f64]) {
        self.error = None;
        self.bounded.fill(0);
        row::visit(&mut self.len, &mut self.cells, &mut row::Restoring(row));
    }

    /// Removes all samples and the error, and keeps the allocated memory.
    pub fn reset(&mut self) {
        self.len = 0;
        self.error = None;
        self.bounded.fill(0);
        for (node, cell) in self.graph.nodes.iter().zip(&mut self.cells) {
            cell.reset(node);
        }
    }
}
