//! Searches with the ask-and-tell interface.

use std::sync::{Mutex, MutexGuard, PoisonError};

use mishandle::search::{Coordinate, Observation, OptionValue, SEARCHES, Search, SearchOptions, by_name};
use pyo3::prelude::*;

use crate::plain;

/// Value of an option of a search.
#[derive(FromPyObject)]
enum SearchOption {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
    Point(Vec<f64>),
    Points(Vec<Vec<f64>>),
}

impl From<SearchOption> for OptionValue {
    fn from(value: SearchOption) -> OptionValue {
        match value {
            SearchOption::Boolean(value) => OptionValue::Boolean(value),
            SearchOption::Integer(value) => OptionValue::Integer(value),
            SearchOption::Float(value) => OptionValue::Float(value),
            SearchOption::Text(value) => OptionValue::Text(value),
            SearchOption::Point(value) => OptionValue::Point(value),
            SearchOption::Points(value) => OptionValue::Points(value),
        }
    }
}

/// A search on \[0, 1\]^d.
#[pyclass(frozen, module = "mishandle._native", name = "Search")]
pub struct PySearch {
    search: Mutex<Box<dyn Search>>,
}

#[pymethods]
impl PySearch {
    /// Makes a search. `levels` has an entry for each coordinate: the number of levels of an
    /// integer, `None` for a real number.
    #[new]
    fn new(
        name: &str,
        levels: Vec<Option<usize>>,
        seed: u64,
        options: Vec<(String, SearchOption)>,
    ) -> PyResult<Self> {
        let mut given = SearchOptions::new();
        for (option, value) in options {
            given.set(&option, value);
        }
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
