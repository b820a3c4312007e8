//! A state and the threads that change it, used by Python without the interpreter lock.

use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::{InvalidTypeError, InvalidValueError, in_this_process, warn};

/// Largest number of threads, more than any machine has cores.
const MAX_THREADS: usize = 1024;

/// A state that the threads of a pool change.
pub(crate) struct Pool<T> {
    parts: Arc<Parts<T>>,
    /// The process that created the threads.
    process: u32,
}

/// State that a process made by fork must not touch: threads that it does not have, and a state in
/// the middle of a change.
struct Parts<T> {
    threads: ThreadPool,
    /// Only threads that have released the interpreter lock it, which prevents deadlocks.
    state: Mutex<T>,
}

impl<T> Drop for Pool<T> {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // The copy is never dropped, so dropping the pool does not wait for its threads.
            std::mem::forget(self.parts.clone());
        }
    }
}

impl<T: Send> Pool<T> {
    /// Creates `threads` threads, by default as many as cores, and the state.
    pub(crate) fn new(threads: Option<usize>, state: impl FnOnce() -> T + Send) -> PyResult<Pool<T>> {
        if let Some(threads) = threads {
            check_range("`threads`", threads, MAX_THREADS)?;
            let cores = std::thread::available_parallelism().map_or(usize::MAX, usize::from);
            if threads > cores {
                let message =
                    format!("threads={threads} is more than the {cores} cores, which makes nothing faster");
                warn(&message, 1)?;
            }
        }
        let pool = ThreadPoolBuilder::new().num_threads(threads.unwrap_or_default()).build();
        let threads = pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        let state = Mutex::new(threads.install(state));
        Ok(Pool { parts: Arc::new(Parts { threads, state }), process: std::process::id() })
    }

    /// Calls `work` on the threads, without the interpreter lock. Concurrent calls are executed one
    /// after the other.
    pub(crate) fn with<R: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut T) -> R + Send) -> PyResult<R> {
        in_this_process(self.process)?;
        let Parts { threads, state } = &*self.parts;
        Ok(py.detach(|| {
            let mut guard = state.lock().unwrap_or_else(PoisonError::into_inner);
            let state = &mut *guard;
            threads.install(|| work(state))
        }))
    }
}

pub(crate) fn check_range(name: &str, found: usize, limit: usize) -> PyResult<()> {
    if (1..=limit).contains(&found) {
        return Ok(());
    }
    Err(InvalidValueError::new_err(format!("{name} must be a whole number from 1 to {limit}, found {found}")))
}

/// Copies actions row by row, and checks their type, shape and values.
pub(crate) fn actions(given: &Bound<'_, PyAny>, [rows, columns]: [usize; 2]) -> PyResult<Vec<f32>> {
    let Ok(actions) = given.extract::<PyReadonlyArray2<'_, f32>>() else {
        let found = given.get_type().name()?;
        let found = match (given.getattr("dtype"), given.getattr("shape")) {
            (Ok(dtype), Ok(shape)) => format!("{found} of {dtype} and shape {shape}"),
            _ => found.to_string(),
        };
        return Err(InvalidTypeError::new_err(format!(
            "`actions` must be a NumPy array of float32 and shape ({rows}, {columns}), found {found}"
        )));
    };
    if actions.shape() != [rows, columns] {
        return Err(InvalidValueError::new_err(format!(
            "`actions` must have the shape [{rows}, {columns}], found {:?}",
            actions.shape()
        )));
    }
    // A view of numbers at odd addresses would be undefined behavior, and the library checks it in
    // debug builds only.
    if !actions.is_aligned() {
        return Err(InvalidValueError::new_err(
            "`actions` is not aligned in memory, as a field of a packed array; pass `actions.copy()`",
        ));
    }
    // Other strides are allowed: the array is copied.
    let actions: Vec<f32> = actions.as_array().iter().copied().collect();
    match actions.iter().position(|action| !action.is_finite()) {
        None => Ok(actions),
        Some(index) => Err(InvalidValueError::new_err(format!(
            "`actions` must be finite, found {} at [{}, {}]",
            actions[index],
            index / columns,
            index % columns
        ))),
    }
}
