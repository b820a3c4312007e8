//! A trace: named signals, one value per sample each.

use std::sync::Arc;

/// Named signals over time, one `f64` per sample each, stored signal by signal.
///
/// Samples are numbered from 0 and lie one sampling period apart. The names are shared, so that the traces of many
/// simulations hold them once. Of two signals of the same name, the first is the one that a formula reads.
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
    /// A trace of these signals without samples.
    pub fn new(names: Arc<[String]>) -> Trace {
        Trace::with_capacity(names, 0)
    }

    /// A trace of these signals without samples, with room for `samples` of them.
    pub fn with_capacity(names: Arc<[String]>, samples: usize) -> Trace {
        let columns = names.iter().map(|_| Vec::with_capacity(samples)).collect();
        Trace { names, columns, len: 0 }
    }

    /// Appends a sample: one value per signal, in the order of the names. Allocates nothing within the capacity.
    ///
    /// # Panics
    /// If `sample` does not hold one value per signal.
    pub fn push(&mut self, sample: &[f64]) {
        assert_eq!(sample.len(), self.columns.len(), "a sample holds one value per signal");
        for (column, value) in self.columns.iter_mut().zip(sample) {
            column.push(*value);
        }
        self.len += 1;
    }

    /// The number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The names of the signals, in the order of the columns.
    pub fn names(&self) -> &Arc<[String]> {
        &self.names
    }

    /// Signal `i`, one value per sample.
    ///
    /// # Panics
    /// If there are not more than `i` signals.
    pub fn column(&self, i: usize) -> &[f64] {
        &self.columns[i]
    }

    /// The signal of this name, one value per sample.
    pub fn signal(&self, name: &str) -> Option<&[f64]> {
        self.names.iter().position(|known| known == name).map(|i| self.column(i))
    }

    /// Removes the samples and keeps the room they took.
    pub fn clear(&mut self) {
        self.columns.iter_mut().for_each(Vec::clear);
        self.len = 0;
    }
}
