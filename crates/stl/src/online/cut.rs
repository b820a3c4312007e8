//! Online monitors whose windows are cut at the end of the trace, as those of
//! [`Monitor`](crate::Monitor) are.
//!
//! A trace that ends is one that continues with samples outside of it. A signal of its own shows
//! which samples are inside: it is [`INSIDE`] there, and `-INSIDE` outside. `always p` becomes
//! `always (not inside or p)` and `eventually p` becomes `eventually (inside and p)`, and so do the
//! other operators over samples ahead. No sample outside then has an effect, and the values are
//! those of windows that end with the trace, to the bit: minima and maxima with a number that is
//! larger than every other one.

use super::{Bounds, OnlineMonitor};
use crate::clock::Clock;
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::operator::Operator;

/// Stands for +∞, because a sample must be finite.
const INSIDE: f64 = f64::MAX;

/// The name of the signal. No column has it: readers trim names.
const SIGNAL: &str = " inside the trace ";

/// An [`OnlineMonitor`] whose windows are cut at the end of the trace: its bounds are those over
/// all continuations, a trace that ends now among them, and after [`finish`](CutMonitor::finish)
/// they are the robustness of [`Monitor::robustness`](crate::Monitor::robustness).
///
/// A comparison of the values of temporal operators, as in `(prev p) <= (next q)`, takes an empty
/// window as a large number: at the ends of the trace it can be another value than that of the
/// [`Monitor`](crate::Monitor), where both sides are infinite.
///
/// The costs are those of the [`OnlineMonitor`], with one operator more for each operator over
/// samples ahead.
///
/// # Example
/// ```
/// use mishandle_stl::{Bounds, Clock, CutMonitor, Formula};
///
/// let formulas = [Formula::parse("always(x >= 1 implies eventually[0:9](y >= 2))").unwrap()];
/// let names = ["x".to_owned(), "y".to_owned()];
/// let mut monitor = CutMonitor::new(&formulas, &names, Clock::steps(1.0)).unwrap();
/// monitor.push(&[4.0, 0.0]).unwrap();
/// monitor.push(&[0.0, 5.0]).unwrap();
/// assert_eq!(monitor.verdict(0), None);
/// monitor.finish().unwrap();
/// assert_eq!(monitor.bounds(0), Bounds { low: 3.0, high: 3.0 });
/// ```
#[derive(Clone, Debug)]
pub struct CutMonitor {
    monitor: OnlineMonitor,
    /// The last sample, and the signal that shows which samples are inside.
    sample: Vec<f64>,
    len: usize,
}

impl CutMonitor {
    /// Compiles `formulas` for samples of the signals `names`.
    ///
    /// # Errors
    /// As for [`OnlineMonitor::new`].
    pub fn new(formulas: &[Formula], names: &[String], clock: Clock) -> Result<CutMonitor, MonitorError> {
        // The rewritten formulas have no text, whose letters could be names.
        formulas.iter().try_for_each(|formula| formula.check_names(names))?;
        let formulas: Vec<Formula> = formulas.iter().map(cut).collect();
        let mut names = names.to_vec();
        names.push(SIGNAL.to_owned());
        let monitor = OnlineMonitor::new(&formulas, &names, clock, None)?;
        Ok(CutMonitor { monitor, sample: vec![0.0; names.len()], len: 0 })
    }

    /// Adds a sample: one value per signal, in the order of the names.
    ///
    /// # Errors
    /// As for [`OnlineMonitor::push`].
    ///
    /// # Panics
    /// If the length of `sample` is not the number of signals.
    pub fn push(&mut self, sample: &[f64]) -> Result<(), MonitorError> {
        let signals = self.sample.len() - 1;
        self.sample[..signals].copy_from_slice(sample);
        self.sample[signals] = INSIDE;
        self.monitor.push(&self.sample)?;
        self.len += 1;
        Ok(())
    }

    /// States that the trace ends with the last sample: the bounds become the robustness. No sample
    /// may follow. It takes time for as many samples as the formulas wait for.
    ///
    /// # Errors
    /// If arithmetic on the values of temporal operators has no finite value.
    pub fn finish(&mut self) -> Result<(), MonitorError> {
        if let Some(inside) = self.sample.last_mut() {
            *inside = -INSIDE;
        }
        let formulas = 0..self.monitor.graph.roots.len();
        let needed = formulas.map(|i| self.monitor.needed_samples(i).0).max().unwrap_or(1);
        for _ in 1..needed {
            self.monitor.push(&self.sample)?;
        }
        self.monitor.finish();
        Ok(())
    }

    /// Returns the least and the greatest robustness of formula `i` at time 0 over all
    /// continuations of the trace.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn bounds(&mut self, i: usize) -> Bounds {
        let Bounds { low, high } = self.monitor.bounds(i);
        Bounds { low: unlimited(low), high: unlimited(high) }
    }

    /// Returns the verdict of formula `i` at time 0 if every continuation of the trace has it.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn verdict(&mut self, i: usize) -> Option<bool> {
        self.monitor.verdict(i)
    }

    /// Returns the sample at which the last push decided formula `i`, and the robustness there, as
    /// [`OnlineMonitor::decided`] does.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn decided(&self, i: usize) -> Option<(usize, f64)> {
        self.monitor.decided(i).map(|(sample, value)| (sample, unlimited(value)))
    }

    /// Returns the number of samples that decide formula `i` at time 0, as
    /// [`OnlineMonitor::needed_samples`] does.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn needed_samples(&self, i: usize) -> (usize, bool) {
        self.monitor.needed_samples(i)
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

fn unlimited(value: f64) -> f64 {
    if value.abs() >= INSIDE { f64::INFINITY.copysign(value) } else { value }
}

/// Returns the formula in which no sample outside the trace has an effect.
fn cut(formula: &Formula) -> Formula {
    let mut signals = formula.signals.clone();
    let inside = Node::Signal(signals.len() as u32);
    signals.push(SIGNAL.to_owned());
    let mut cut =
        Formula { signals, nodes: Vec::new(), origins: Vec::new(), defined: formula.defined.clone() };
    // The first nodes of the operands so far.
    let mut starts: Vec<usize> = Vec::new();
    for node in &formula.nodes {
        let Node::Apply(operator, _) = node else {
            starts.push(cut.nodes.len());
            cut.nodes.push(*node);
            continue;
        };
        let first = starts.len() - operator.arity();
        let start = starts.get(first).copied().unwrap_or(cut.nodes.len());
        match operator {
            Operator::Always | Operator::Next | Operator::Release => cut.or_outside(inside),
            Operator::Eventually | Operator::StrongNext | Operator::Until => cut.and_inside(inside),
            Operator::Unless => {
                let last = cut.nodes.split_off(starts[first + 1]);
                cut.or_outside(inside);
                cut.nodes.extend(last);
                cut.and_inside(inside);
            }
            _ => {}
        }
        cut.nodes.push(*node);
        starts.truncate(first);
        starts.push(start);
    }
    cut
}

impl Formula {
    fn and_inside(&mut self, inside: Node) {
        self.nodes.extend([inside, Node::Apply(Operator::And, None)]);
    }

    fn or_outside(&mut self, inside: Node) {
        self.nodes.extend([inside, Node::Apply(Operator::Not, None), Node::Apply(Operator::Or, None)]);
    }
}
