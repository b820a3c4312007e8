//! Recordings: traces that are reduced to what a formula reads while they are recorded.

use crate::error::MonitorError;
use crate::formula::Formula;
use crate::monitor::Samples;
use crate::pointwise::Undefined;
use crate::program::Program;
use crate::state::{Buffers, State, TILE};
use crate::trace::Trace;
use std::sync::Arc;

/// A trace for one formula, of which only the values are kept that the formula's operators over
/// time read.
///
/// Memory per sample: one number (8 bytes) for each state formula that is an operand of another
/// operator or the whole formula, or one for each signal if these are fewer.
/// `always(a <= 1 and b <= 1 and c <= 1)` takes one number instead of three.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use mishandle_stl::{Clock, Formula, Monitor, Recording};
///
/// let formula = Formula::parse("always(d <= 0.5 and v < 2)").unwrap();
/// let names: Arc<[String]> = Arc::from(["d".to_owned(), "v".to_owned()]);
/// let mut recording = Recording::new(&formula, Arc::clone(&names)).unwrap();
/// for sample in [[0.75, 1.0], [0.25, 0.0], [0.25, 1.5]] {
///     recording.push(&sample);
/// }
/// let mut monitor = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
/// assert_eq!(monitor.recorded_robustness_signal(recording).unwrap(), [-0.25, 0.25, 0.25]);
/// ```
#[derive(Clone, Debug)]
pub struct Recording {
    columns: Vec<(usize, String)>,
    states: Vec<State>,
    tile: Buffers,
    /// All samples if the signals are kept, otherwise those since the last complete tile.
    trace: Trace,
    /// `None` if the signals are kept.
    recorded: Option<Recorded>,
}

/// The values of the state formulas of a recording.
#[derive(Clone, Debug)]
pub(crate) struct Recorded {
    pub samples: usize,
    pub states: Vec<RecordedState>,
    /// For each signal that the formula reads, the first sample that is NaN or infinite, and its
    /// value.
    pub not_finite: Vec<Option<(usize, f64)>>,
}

/// The values of a state formula, and the first sample without a value.
#[derive(Clone, Debug, Default)]
pub(crate) struct RecordedState {
    pub values: Vec<f64>,
    pub undefined: Option<Undefined>,
}

impl Recording {
    /// Creates a recording without samples of the signals `names`.
    ///
    /// # Errors
    /// If `names` lacks a signal of the formula or contains a name that the formula defines.
    pub fn new(formula: &Formula, names: Arc<[String]>) -> Result<Recording, MonitorError> {
        let Program { columns, states, .. } = Program::without_clock(formula, &names)?;
        let recorded = (states.len() <= columns.len()).then(|| Recorded {
            samples: 0,
            states: vec![RecordedState::default(); states.len()],
            not_finite: vec![None; columns.len()],
        });
        let tile = Buffers::of(&states);
        Ok(Recording { columns, states, tile, trace: Trace::new(names), recorded })
    }

    /// Appends a sample: one value per signal, in the order of the names.
    ///
    /// # Panics
    /// If the length of `sample` is not the number of signals.
    pub fn push(&mut self, sample: &[f64]) {
        self.trace.push(sample);
        if self.trace.len() == TILE {
            self.finish();
        }
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.trace.len() + self.recorded.as_ref().map_or(0, |recorded| recorded.samples)
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns whether the recording was made for this formula and signals.
    pub(crate) fn is_of(&self, program: &Program) -> bool {
        self.columns == program.columns && self.states == program.states
    }

    /// Evaluates the state formulas at the samples of the last tile, if they are kept.
    pub(crate) fn finish(&mut self) {
        let Some(recorded) = &mut self.recorded else { return };
        let first = recorded.samples;
        let samples = self.trace.len();
        for ((column, _), found) in self.columns.iter().zip(&mut recorded.not_finite) {
            let values = self.trace.column(*column);
            let step = values.iter().position(|value| !value.is_finite()).filter(|_| found.is_none());
            *found = step.map(|step| (first + step, values[step])).or(*found);
        }
        for (state, kept) in self.states.iter().zip(&mut recorded.states) {
            kept.values.resize(first + samples, 0.0);
            let out = &mut kept.values[first..];
            let result = state.evaluate(&self.trace, 0..samples, &mut self.tile, out, |_, _| {});
            if let (Err(undefined), None) = (result, &kept.undefined) {
                kept.undefined = Some(undefined.after(first));
            }
        }
        recorded.samples += samples;
        self.trace.clear();
    }

    /// Returns the samples for a monitor.
    pub(crate) fn samples(&mut self) -> Samples<'_> {
        match &mut self.recorded {
            Some(recorded) => Samples::Recorded(recorded),
            None => Samples::Trace(&self.trace, 0..self.trace.len()),
        }
    }
}
