//! Evaluation at a span of samples, from the samples around it that the values depend on.

use crate::error::MonitorError;
use crate::monitor::{Monitor, Samples, Windows};
use crate::operator::Operator;
use crate::program::{Action, Program};
use crate::trace::Trace;
use std::ops::Range;

/// The number of samples that are evaluated at once, if the windows are shorter.
const CHUNK: usize = 1 << 16;

/// The number of windows that a chunk has at least, since a window is read before and after it.
const WINDOWS_PER_CHUNK: usize = 4;

impl Monitor {
    /// Calls `visit` with the values of [`Monitor::robustness_signal`], or of
    /// [`Monitor::decided_robustness_signal`] with whole windows, at these samples, some at a time,
    /// in the order of time; `visit` also receives the number of the first one.
    ///
    /// It reads the samples that these values depend on. If all windows have an end, the memory
    /// depends on the windows and not on the length of the trace.
    ///
    /// # Errors
    /// As for these, for the samples that it reads.
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, Trace, Windows};
    ///
    /// let names: Arc<[String]> = Arc::from(["x".to_owned()]);
    /// let formula = Formula::parse("always[0:1](x <= 2)").unwrap();
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    /// let mut trace = Trace::new(names);
    /// for x in [0.0, 1.0, 3.0, 0.0] {
    ///     trace.push(&[x]);
    /// }
    /// let mut found = Vec::new();
    /// let visit = |first, values: &[f64]| found.push((first, values.to_vec()));
    /// monitor.visit_robustness(&trace, 1..3, Windows::Cut, visit).unwrap();
    /// assert_eq!(found, [(1, vec![-1.0, -1.0])]);
    /// ```
    pub fn visit_robustness(
        &mut self,
        trace: &Trace,
        samples: Range<usize>,
        windows: Windows,
        mut visit: impl FnMut(usize, &[f64]),
    ) -> Result<(), MonitorError> {
        let known = self.known(trace, windows);
        let samples = samples.start.min(known)..samples.end.min(known);
        for chunk in chunks(samples, self.chunk_len()) {
            visit(chunk.start, self.values_at(trace, chunk, windows)?);
        }
        Ok(())
    }

    /// Returns the number of samples at which the formula has a value.
    pub(crate) fn known(&self, trace: &Trace, windows: Windows) -> usize {
        match windows {
            Windows::Cut => trace.len(),
            Windows::Whole => self.decided_samples(trace.len()),
        }
    }

    /// Returns the number of samples to evaluate at once, so that few are read twice.
    pub(crate) fn chunk_len(&self) -> usize {
        let reach = self.program.reach;
        if reach.is_unbounded || self.program.reads_all() || self.program.reads_all_before() {
            return usize::MAX;
        }
        CHUNK.max(WINDOWS_PER_CHUNK.saturating_mul(reach.behind.saturating_add(reach.ahead)))
    }

    /// Returns the values at these samples, at all of which the formula has a value.
    pub(crate) fn values_at(
        &mut self,
        trace: &Trace,
        samples: Range<usize>,
        windows: Windows,
    ) -> Result<&[f64], MonitorError> {
        let reach = self.program.reach;
        let reads_all = self.program.reads_all();
        let begin = if reads_all || self.program.reads_all_before() {
            0
        } else {
            samples.start.saturating_sub(reach.behind)
        };
        let end = if reads_all || reach.is_unbounded {
            trace.len()
        } else {
            samples.end.saturating_add(reach.ahead).min(trace.len())
        };
        let values = self.evaluate(&Samples { trace, range: begin..end }, windows)?;
        Ok(&values[samples.start - begin..samples.end - begin])
    }
}

impl Program {
    /// Returns whether arithmetic has the result of an operator over time as operand: with a window
    /// that is cut in front of the samples that count, it could have no finite value.
    fn reads_all(&self) -> bool {
        let is_arithmetic = |action: &Action| match action {
            Action::Pointwise(operator, _) => operator.is_arithmetic(),
            _ => false,
        };
        self.instructions.iter().any(|instruction| is_arithmetic(&instruction.action))
    }

    /// Returns whether a window extends to the start of the trace.
    fn reads_all_before(&self) -> bool {
        self.instructions.iter().any(|instruction| match instruction.action {
            Action::TemporalUnary(Operator::Historically | Operator::Once, window)
            | Action::TemporalBinary(Operator::Since, window, _) => window.is_unbounded(),
            _ => false,
        })
    }
}

/// Splits samples into chunks of at most this length.
pub(crate) fn chunks(samples: Range<usize>, len: usize) -> impl DoubleEndedIterator<Item = Range<usize>> {
    let Range { start, end } = samples;
    let count = samples.len().div_ceil(len);
    (0..count).map(move |index| start + index * len..end.min((start + index * len).saturating_add(len)))
}
