//! Bounds of the robustness over all continuations of a trace.
//!
//! The instructions of a monitor run on two values per sample, the least and the greatest
//! robustness: a sample that the trace does not have yet has the values -∞ and +∞. The bounds are
//! correct, but not always tight, because two occurrences of the same unknown sample count as
//! independent: `p or not p` is unknown although it always holds.

use crate::error::MonitorError;
use crate::extremum::{Extremum, Maximum, Minimum};
use crate::monitor::{Monitor, Samples, temporal_binary, temporal_unary};
use crate::operator::Operator;
use crate::pointwise::{self, Undefined, Values};
use crate::program::{Action, Instruction, Source};
use crate::trace::Trace;

/// The least and the greatest value at each sample.
#[derive(Clone, Default)]
struct Bounds {
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Monitor {
    /// Returns the least and the greatest robustness at time 0 of all traces of `samples` samples
    /// that begin with `trace`; `None` if a trace of `samples` samples does not decide the formula.
    ///
    /// The robustness is that of [`Monitor::decided_robustness_signal`]. If the lower bound is
    /// positive, every such trace satisfies the formula; if the upper bound is negative, every such
    /// trace violates it. The bounds are not always tight: the unknown samples of two operands
    /// count as independent.
    ///
    /// # Errors
    /// As for [`Monitor::robustness_signal`]. Arithmetic is evaluated only where its operands are
    /// known.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, Trace};
    ///
    /// let names: Arc<[String]> = Arc::from(["x".to_owned()]);
    /// let formula = Formula::parse("always[0:9](x <= 2)").unwrap();
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    /// let mut trace = Trace::new(names);
    /// for x in [0.0, 3.0, 1.0] {
    ///     trace.push(&[x]);
    /// }
    /// // The 3 violates the formula, whatever follows.
    /// assert_eq!(monitor.robustness_bounds(&trace, 10).unwrap(), Some((f64::NEG_INFINITY, -1.0)));
    /// ```
    pub fn robustness_bounds(
        &mut self,
        trace: &Trace,
        samples: usize,
    ) -> Result<Option<(f64, f64)>, MonitorError> {
        self.check(&Samples::Trace(trace))?;
        let samples = samples.max(trace.len());
        if self.decided_samples(samples) == 0 {
            return Ok(None);
        }
        let scratch = self.program.scratch_len(samples);
        if self.scratch.len() < scratch {
            self.scratch.resize(scratch, 0.0);
        }
        let mut buffers = vec![Bounds::default(); self.program.buffers];
        for index in 0..self.program.instructions.len() {
            self.bound(index, trace, samples, &mut buffers).map_err(|undefined| self.undefined(undefined))?;
        }
        let result = &buffers[self.program.result()];
        Ok(result.low.first().copied().zip(result.high.first().copied()))
    }

    /// Executes one instruction on bounds.
    fn bound(
        &mut self,
        index: usize,
        trace: &Trace,
        samples: usize,
        buffers: &mut [Bounds],
    ) -> Result<(), Undefined> {
        let Instruction { action, buffer, reach, undecided } = self.program.instructions[index];
        let evaluated = samples.saturating_sub(undecided);
        let mut values = std::mem::take(&mut buffers[buffer]);
        match action {
            Action::State(state) => {
                let mut known = Vec::new();
                self.evaluate_state(state, &mut Samples::Trace(trace), &mut known, &mut |_, _, _| {})?;
                known.truncate(trace.len());
                values = Bounds { low: known.clone(), high: known };
                values.low.resize(samples, f64::NEG_INFINITY);
                values.high.resize(samples, f64::INFINITY);
            }
            _ if evaluated == 0 => {}
            Action::Pointwise(operator, operands) => {
                for sample in 0..evaluated {
                    let [x, y] = operands.map(|source| match source {
                        Source::Constant(value) => (value, value),
                        Source::Buffer(other) if other == buffer => (values.low[sample], values.high[sample]),
                        Source::Buffer(other) => (buffers[other].low[sample], buffers[other].high[sample]),
                    });
                    let (low, high) = pointwise_bounds(operator, x, y).map_err(|it| it.after(sample))?;
                    (values.low[sample], values.high[sample]) = (low, high);
                }
            }
            Action::TemporalUnary(operator @ (Operator::Rise | Operator::Fall), _) => {
                edge_bounds(operator, &mut values, evaluated);
            }
            // The other temporal operators do not decrease if an operand increases.
            Action::TemporalUnary(operator, window) => {
                for side in [&mut values.low, &mut values.high] {
                    temporal_unary(operator, window, &mut side[..evaluated], &mut self.scratch);
                }
            }
            Action::TemporalBinary(operator, window, left) => {
                let Bounds { low, high } = &mut buffers[left];
                for (left, side) in [(low, &mut values.low), (high, &mut values.high)] {
                    let (left, side) = (&mut left[..evaluated], &mut side[..evaluated]);
                    temporal_binary(operator, window, left, side, &mut self.scratch);
                }
            }
        }
        // As in `Monitor::execute`: read by some operators without effect.
        let decided = reach.decided(samples);
        values.low[decided..].fill(f64::NEG_INFINITY);
        values.high[decided..].fill(f64::INFINITY);
        buffers[buffer] = values;
        Ok(())
    }
}

/// Returns the bounds of a pointwise operator from those of its operands.
fn pointwise_bounds(operator: Operator, x: (f64, f64), y: (f64, f64)) -> Result<(f64, f64), Undefined> {
    Ok(match operator {
        Operator::Not | Operator::Negate => (-x.1, -x.0),
        Operator::And => (Minimum::pick(x.0, y.0), Minimum::pick(x.1, y.1)),
        Operator::Or => (Maximum::pick(x.0, y.0), Maximum::pick(x.1, y.1)),
        Operator::Implies => (Maximum::pick(-x.1, y.0), Maximum::pick(-x.0, y.1)),
        Operator::Iff => equivalence_bounds(x, y),
        Operator::Xor => {
            let (low, high) = equivalence_bounds(x, y);
            (-high, -low)
        }
        _ if is_known(x) && is_known(y) => {
            let mut out = [0.0];
            pointwise::apply(operator, Values::Constant(x.0), Values::Constant(y.0), &mut out)?;
            (out[0], out[0])
        }
        _ => (f64::NEG_INFINITY, f64::INFINITY),
    })
}

/// Returns whether both bounds are the same, also in the sign of a zero.
fn is_known((low, high): (f64, f64)) -> bool {
    low.to_bits() == high.to_bits()
}

/// Returns the bounds of `(x and y) or (not x and not y)`.
fn equivalence_bounds(x: (f64, f64), y: (f64, f64)) -> (f64, f64) {
    let both = (Minimum::pick(x.0, y.0), Minimum::pick(x.1, y.1));
    let neither = (Minimum::pick(-x.1, -y.1), Minimum::pick(-x.0, -y.0));
    (Maximum::pick(both.0, neither.0), Maximum::pick(both.1, neither.1))
}

/// Replaces the bounds of an operand of `rise` or `fall` by those of the operator: the minimum of
/// the negated value before and the value now, or of the value before and the negated value now.
fn edge_bounds(operator: Operator, values: &mut Bounds, samples: usize) {
    let is_rise = operator == Operator::Rise;
    let start = if is_rise { f64::NEG_INFINITY } else { f64::INFINITY };
    let mut before = (start, start);
    for (low, high) in values.low[..samples].iter_mut().zip(&mut values.high) {
        let now = (*low, *high);
        (*low, *high) = if is_rise {
            (Minimum::pick(-before.1, now.0), Minimum::pick(-before.0, now.1))
        } else {
            (Minimum::pick(before.0, -now.1), Minimum::pick(before.1, -now.0))
        };
        before = now;
    }
}
