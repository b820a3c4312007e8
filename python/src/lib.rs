//! The Python module `mishandle`: tasks as vectorized environments with NumPy arrays.
//!
//! `mishandle.pyi` contains the types for Python's tools.

mod vector_env;

use std::error::Error;
use std::iter::successors;

use pyo3::prelude::*;

use vector_env::VectorEnv;

pyo3::create_exception!(
    mishandle,
    MishandleError,
    pyo3::exceptions::PyException,
    "An invalid name or value. The message has one line."
);

/// Tasks of Mishandle as vectorized environments with NumPy arrays.
#[pymodule(name = "mishandle")]
fn contents(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", mishandle::VERSION)?;
    module.add("MishandleError", module.py().get_type::<MishandleError>())?;
    module.add_class::<VectorEnv>()
}

/// Converts an error to a Python exception: its causes, the outermost first, and a hint if there is one.
fn raised(error: impl Into<mishandle::MishandleError>) -> PyErr {
    let error = error.into();
    let hint = error.hint().map_or(String::new(), |hint| format!("; {hint}"));
    let causes = successors(Some(&error as &dyn Error), |error| (*error).source());
    let causes: Vec<String> = causes.map(ToString::to_string).collect();
    MishandleError::new_err(causes.join(": ") + &hint)
}
