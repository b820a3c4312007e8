//! Searches with the ask-and-tell interface.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use mishandle::search::{Coordinate, Observation, OptionValue, SEARCHES, Search, SearchOptions, by_name};
use pyo3::prelude::*;

use crate::plain;

/// A search on \[0, 1\]^d.
#[pyclass(frozen, module = "mishandle._native", name = "Search")]
pub struct PySearch {
    search: Mutex<Box<dyn Search>>,
}

#[pymethods]
impl PySearch {
    /// Makes a search. `levels` has an entry for each coordinate: the number of levels of an
    /// integer, `None` for a real number. `options` is an object of JSON.
    #[new]
    fn new(name: &str, levels: Vec<Option<usize>>, seed: u64, options: &str) -> PyResult<Self> {
        let options: BTreeMap<String, OptionValue> = serde_json::from_str(options).map_err(plain)?;
        let given: SearchOptions = options.into_iter().collect();
        let coordinate = |levels: Option<usize>| {
            levels.map_or(Coordinate::Continuous, |levels| Coordinate::Integer { levels })
        };
        let coordinates: Vec<Coordinate> = levels.into_iter().map(coordinate).collect();
        let search = by_name(name, &coordinates, seed, &given).map_err(plain)?;
        Ok(PySearch { search: Mutex::new(search) })
    }

    fn ask(&self, points: usize) -> Vec<Vec<f64>> {
        self.search().ask_batch(points)
    }

    fn tell(&self, point: Vec<f64>, value: f64) -> PyResult<()> {
        self.search().tell(&point, &Observation::from(value)).map_err(plain)
    }

    #[getter]
    fn finished(&self) -> bool {
        self.search().finished().is_some()
    }

    #[getter]
    fn best(&self) -> Option<(Vec<f64>, f64)> {
        self.search().best().map(|(point, value)| (point.to_vec(), value))
    }
}

impl PySearch {
    fn search(&self) -> MutexGuard<'_, Box<dyn Search>> {
        self.search.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the names of all searches.
#[pyfunction]
pub fn search_names() -> Vec<&'static str> {
    SEARCHES.iter().map(|entry| entry.name).collect()
}
