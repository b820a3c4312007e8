//! Traces: named signals sampled at a fixed period.

use std::sync::Arc;

/// Named signals over time, one `f64` per signal and sample, stored signal by signal.
///
/// Samples are numbered from 0 and are one sampling period apart. The names are shared between the
/// traces of many simulations. If two signals have the same name, formulas read the first.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use mishandle_stl::Trace;
///
/// let names: Arc<[String]> = Arc::from(["distance".to_owned(), "speed".to_owned()]);
/// let mut trace = Trace::with_capacity(names, 2);
/// trace.push(&[0.3, 1.0]);
/// trace.push(&[0.1, 0.5]);
/// assert_eq!(trace.len(), 2);
/// assert_eq!(trace.signal("speed"), Some(&[1.0, 0.5][..]));
/// assert_eq!(trace.signal("height"), None);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    names: Arc<[String]>,
    columns: Vec<Vec<f64>>,
    len: usize,
}

impl Trace {
    /// Creates a trace of these signals without samples.
    pub fn new(names: Arc<[String]>) -> Trace {
        Trace::with_capacity(names, 0)
    }

    /// Creates a trace of these signals without samples, with capacity for `samples` samples.
    pub fn with_capacity(names: Arc<[String]>, samples: usize) -> Trace {
        let columns = names.iter().map(|_| Vec::with_capacity(samples)).collect();
        Trace { names, columns, len: 0 }
    }

    /// Creates a trace from the values of each signal, in the order of the names.
    ///
    /// # Panics
    /// If there is not one column per name, or their lengths differ.
    pub fn from_columns(names: Arc<[String]>, columns: Vec<Vec<f64>>) -> Trace {
        assert_eq!(names.len(), columns.len(), "a trace must have one column per name");
        let len = columns.first().map_or(0, Vec::len);
        assert!(columns.iter().all(|column| column.len() == len), "columns must have the same length");
        Trace { names, columns, len }
    }

    /// Appends a sample: one value per signal, in the order of the names. Does not allocate within
    /// the capacity.
    ///
    /// # Panics
    /// If the length of `sample` is not the number of signals.
    pub fn push(&mut self, sample: &[f64]) {
        assert_eq!(sample.len(), self.columns.len(), "a sample must have one value per signal");
        for (column, value) in self.columns.iter_mut().zip(sample) {
            column.push(*value);
        }
        self.len += 1;
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether the trace has no samples.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the names of the signals, in the order of the columns.
    pub fn names(&self) -> &Arc<[String]> {
        &self.names
    }

    /// Returns signal `i`, one value per sample.
    ///
    /// # Panics
    /// If `i` is not less than the number of signals.
    pub fn column(&self, i: usize) -> &[f64] {
        &self.columns[i]
    }

    /// Returns the signal with this name, one value per sample; `None` if there is no such signal.
    pub fn signal(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|known| known == name).map(|i| self.column(i))
    }

    /// Removes all samples and keeps the allocated memory.
    pub fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
        self.len = 0;
    }
}
