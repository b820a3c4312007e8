//! The Python module `mishandle`: tasks as a vectorised environment of NumPy arrays.
//!
//! Types and documentation for Python's tools stand in `mishandle.pyi`.

mod vector_env;

use std::error::Error;
use std::iter::successors;

use pyo3::prelude::*;

use vector_env::VectorEnv;

pyo3::create_exception!(
    mishandle,
    MishandleError,
    pyo3::exceptions::PyException,
    "What is wrong with what was asked for, in one line."
);

/// Tasks of Mishandle as a vectorised environment of NumPy arrays.
#[pymodule(name = "mishandle")]
fn contents(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", mishandle::VERSION)?;
    module.add("MishandleError", module.py().get_type::<MishandleError>())?;
    module.add_class::<VectorEnv>()
}

/// An error with its causes, outermost first, and what to try instead.
fn raised(error: impl Into<mishandle::MishandleError>) -> PyErr {
    let error = error.into();
    let hint = error.hint().map_or(String::new(), |hint| format!("; {hint}"));
    let causes = successors(Some(&error as &dyn Error), |error| (*error).source());
    let causes: Vec<String> = causes.map(ToString::to_string).collect();
    MishandleError::new_err(causes.join(": ") + &hint)
}
